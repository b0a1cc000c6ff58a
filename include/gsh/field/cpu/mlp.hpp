// SPDX-License-Identifier: Apache-2.0
/// @file  The MLP on the CPU: a tile of rows runs through all layers while it sits in the first-level cache.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/prefetch.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/cpu/gemm.hpp>
#include <gsh/field/features.hpp>

#include <algorithm>
#include <cstddef>
#include <type_traits>

namespace gsh::cpu {

namespace detail {

inline constexpr std::size_t mlp_tile_rows = 64;

/// Rows per chunk: whole tiles, and at most 64 chunks, so that the partial sums stay few.
[[nodiscard]] constexpr std::size_t mlp_chunk_rows(std::size_t rows) {
    constexpr std::size_t most_chunks = 64, least_tiles = 4;
    const std::size_t tiles = chunk_count(rows, mlp_tile_rows);
    return std::max(least_tiles, chunk_count(tiles, most_chunks)) * mlp_tile_rows;
}

/// Sizes and places that forward and backward share.
template <class T, class Network>
struct MlpLayout {
    using G = Gemm<T>;
    const Network& network;

    [[nodiscard]] std::size_t layers() const { return network.layer_count(); }
    [[nodiscard]] std::size_t in(std::size_t layer) const { return network.layer_inputs(layer); }
    [[nodiscard]] std::size_t out(std::size_t layer) const { return network.layer_outputs(layer); }
    [[nodiscard]] std::size_t padded_in(std::size_t layer) const { return G::padded(in(layer)); }
    [[nodiscard]] std::size_t padded_out(std::size_t layer) const { return G::padded(out(layer)); }
    [[nodiscard]] std::size_t widest() const {
        return std::max({padded_in(0), padded_out(layers() - 1), padded_out(0)});
    }

    /// [in][padded out]: forward's right operand.
    [[nodiscard]] std::size_t transposed_offset(std::size_t layer) const {
        std::size_t offset = 0;
        for (std::size_t l = 0; l < layer; ++l) offset += in(l) * padded_out(l);
        return offset;
    }
    /// [out][padded in]: backward's right operand, and the layout of its sums.
    [[nodiscard]] std::size_t padded_offset(std::size_t layer) const {
        std::size_t offset = 0;
        for (std::size_t l = 0; l < layer; ++l) offset += out(l) * padded_in(l);
        return offset;
    }
    [[nodiscard]] std::size_t hidden_offset(std::size_t layer, std::size_t rows) const {
        return layer * rows * padded_out(0); // all hidden layers are as wide as the first
    }

    void pack_transposed(Span<const T> weights, T* packed) const {
        for (std::size_t l = 0; l < layers(); ++l) {
            const T* from = weights.data() + network.layer_offset(l);
            T* to = packed + transposed_offset(l);
            for (std::size_t i = 0; i < in(l); ++i)
                for (std::size_t o = 0; o < padded_out(l); ++o)
                    to[i * padded_out(l) + o] = o < out(l) ? from[o * in(l) + i] : T(0);
        }
    }
    void pack_padded(Span<const T> weights, T* packed) const {
        for (std::size_t l = 0; l < layers(); ++l) {
            const T* from = weights.data() + network.layer_offset(l);
            T* to = packed + padded_offset(l);
            for (std::size_t o = 0; o < out(l); ++o)
                for (std::size_t i = 0; i < padded_in(l); ++i)
                    to[o * padded_in(l) + i] = i < in(l) ? from[o * in(l) + i] : T(0);
        }
    }
};

/// Calls f with the block size, as a compile-time constant where it is a common one.
template <class F>
void with_block(std::size_t block, const F& f) {
    switch (block) {
    case 2: return f(std::integral_constant<std::size_t, 2>());
    case 4: return f(std::integral_constant<std::size_t, 4>());
    case 8: return f(std::integral_constant<std::size_t, 8>());
    default: return f(block);
    }
}

/// Asks for rows of the next tile while this one is being worked on, a few lines at a time: the hardware alone loses
/// track at every tile's end.
template <class T>
struct Ahead {
    FeatureView<const T> view;
    std::size_t first, count; ///< the next tile

    void operator()(std::size_t row, std::size_t rows) const {
        if (row >= count) return;
        constexpr std::size_t line = 64 / sizeof(T);
        for (std::size_t c = 0; c < view.columns; c += view.block) {
            const T* from = view.column(c) + (first + row) * view.block;
            for (std::size_t i = 0; i < rows * view.block; i += line) prefetch(from + i);
        }
    }
};

/// Rows [first, first + rows) of the view as a row-major tile: the view's own memory where its rows suit, else a copy
/// padded with zeros.
template <class T>
typename Gemm<T>::Right input_tile(const FeatureView<const T>& view, std::size_t first, std::size_t rows, T* copy) {
    const std::size_t stride = Gemm<T>::padded(view.columns);
    if (view.block == view.columns && stride == view.columns) return {view.values.data() + first * stride, stride};
    if (stride != view.columns) std::fill_n(copy, rows * stride, T(0));
    with_block(view.block, [&](auto block) {
        for (std::size_t c = 0; c < view.columns; c += block) {
            const T* from = view.column(c) + first * block;
            for (std::size_t r = 0; r < rows; ++r)
                for (std::size_t j = 0; j < block; ++j) copy[r * stride + c + j] = from[r * block + j];
        }
    });
    return {copy, stride};
}

/// Writes a row-major tile back to rows [first, first + rows) of the view.
template <class T>
void output_tile(const T* tile, std::size_t first, std::size_t rows, const FeatureView<T>& view, Write mode) {
    const std::size_t stride = Gemm<T>::padded(view.columns);
    with_block(view.block, [&](auto block) {
        for (std::size_t c = 0; c < view.columns; c += block) {
            T* to = view.column(c) + first * block;
            if (mode == Write::assign) {
                for (std::size_t r = 0; r < rows; ++r)
                    for (std::size_t j = 0; j < block; ++j) to[r * block + j] = tile[r * stride + c + j];
            } else {
                for (std::size_t r = 0; r < rows; ++r)
                    for (std::size_t j = 0; j < block; ++j) to[r * block + j] += tile[r * stride + c + j];
            }
        }
    });
}

} // namespace detail

template <CpuBackend B, class Network, class T, class Cache>
void mlp_forward(B& backend, const Network& network, Span<const T> weights, FeatureView<const T> inputs,
                 Span<T> outputs, Cache& cache) {
    using G = detail::Gemm<T>;
    const detail::MlpLayout<T, Network> layout{network};
    const std::size_t rows = inputs.rows, last = layout.layers() - 1, outputs_count = layout.out(last);
    const std::size_t grain = detail::mlp_chunk_rows(rows), tile_size = detail::mlp_tile_rows * layout.widest();

    cache.hidden.resize(layout.hidden_offset(last, rows));
    cache.packed.resize(layout.transposed_offset(layout.layers()));
    cache.scratch.resize(chunk_count(rows, grain) * 2 * tile_size);
    layout.pack_transposed(weights, cache.packed.data());

    backend.for_chunks(rows, grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        T* input_copy = cache.scratch.data() + chunk * 2 * tile_size;
        T* output_copy = input_copy + tile_size;
        for (std::size_t first = begin; first < end; first += detail::mlp_tile_rows) {
            const std::size_t count = std::min(detail::mlp_tile_rows, end - first);
            const std::size_t next = first + count, next_count = std::min(detail::mlp_tile_rows, end - next);
            typename G::Right x = detail::input_tile(inputs, first, count, input_copy);
            for (std::size_t l = 0; l < last; ++l) {
                const std::size_t stride = layout.padded_out(l);
                T* hidden = cache.hidden.data() + layout.hidden_offset(l, rows) + first * stride;
                G::product(count, layout.out(l), layout.in(l), {x.data, x.stride, 1},
                           {cache.packed.data() + layout.transposed_offset(l), stride}, {hidden, stride},
                           typename G::Relu{}, detail::Ahead<T>{l ? FeatureView<const T>() : inputs, next, next_count});
                x = {hidden, stride};
            }
            const std::size_t stride = layout.padded_out(last);
            G::product(count, outputs_count, layout.in(last), {x.data, x.stride, 1},
                       {cache.packed.data() + layout.transposed_offset(last), stride}, {output_copy, stride},
                       typename G::Assign{});
            for (std::size_t r = 0; r < count; ++r)
                std::copy_n(output_copy + r * stride, outputs_count, outputs.data() + (first + r) * outputs_count);
        }
    });
}

template <CpuBackend B, class Network, class T, class Cache>
void mlp_backward(B& backend, const Network& network, Span<const T> weights, FeatureView<const T> inputs,
                  Span<const T> dL_doutputs, Cache& cache, Span<T> dL_dweights, FeatureView<T> dL_dinputs,
                  Write inputs_mode) {
    using G = detail::Gemm<T>;
    const detail::MlpLayout<T, Network> layout{network};
    const std::size_t rows = inputs.rows, last = layout.layers() - 1;
    const std::size_t grain = detail::mlp_chunk_rows(rows), tile_size = detail::mlp_tile_rows * layout.widest();
    const std::size_t chunks = chunk_count(rows, grain), sums_size = layout.padded_offset(layout.layers());

    cache.packed.resize(sums_size);
    cache.scratch.resize(chunks * 3 * tile_size);
    cache.partials.resize(chunks * sums_size);
    layout.pack_padded(weights, cache.packed.data());

    backend.for_chunks(rows, grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        T* input_copy = cache.scratch.data() + chunk * 3 * tile_size;
        T* gradients[2] = {input_copy + tile_size, input_copy + 2 * tile_size};
        T* sums = cache.partials.data() + chunk * sums_size;
        std::fill_n(sums, sums_size, T(0));
        for (std::size_t first = begin; first < end; first += detail::mlp_tile_rows) {
            const std::size_t count = std::min(detail::mlp_tile_rows, end - first);
            const std::size_t next = first + count, next_count = std::min(detail::mlp_tile_rows, end - next);
            typename G::Right dL_dy{dL_doutputs.data() + first * layout.out(last), layout.out(last)};
            for (std::size_t l = last + 1; l-- > 0;) {
                const std::size_t stride = layout.padded_in(l);
                const T* hidden = l ? cache.hidden.data() + layout.hidden_offset(l - 1, rows) + first * stride : nullptr;
                const typename G::Right x =
                    l ? typename G::Right{hidden, stride} : detail::input_tile(inputs, first, count, input_copy);
                // dL_dW[o, i] += sum over rows of dL_dy[row, o] x[row, i]
                G::product(layout.out(l), layout.in(l), count, {dL_dy.data, 1, dL_dy.stride}, x,
                           {sums + layout.padded_offset(l), stride}, typename G::Add{});
                if (l == 0 && dL_dinputs.empty()) break;
                // dL_dx = dL_dy W, through the ReLU that made x
                const typename G::Left left{dL_dy.data, dL_dy.stride, 1};
                const typename G::Right matrix{cache.packed.data() + layout.padded_offset(l), stride};
                T* dL_dx = gradients[l % 2];
                if (l) {
                    const Span<const T> layer{cache.hidden.data() + layout.hidden_offset(l - 1, rows), rows * stride};
                    G::product(count, layout.in(l), layout.out(l), left, matrix, {dL_dx, stride},
                               typename G::WhereActive{hidden},
                               detail::Ahead<T>{{layer, rows, stride, stride}, next, next_count});
                } else {
                    G::product(count, layout.in(l), layout.out(l), left, matrix, {dL_dx, stride},
                               typename G::Assign{}, detail::Ahead<T>{inputs, next, next_count});
                }
                dL_dy = {dL_dx, stride};
            }
            if (!dL_dinputs.empty()) detail::output_tile(dL_dy.data, first, count, dL_dinputs, inputs_mode);
        }
    });

    for (std::size_t l = 0; l <= last; ++l) {
        const std::size_t in = layout.in(l), stride = layout.padded_in(l);
        const T* sums = cache.partials.data() + layout.padded_offset(l);
        T* to = dL_dweights.data() + network.layer_offset(l);
        backend.for_chunks(layout.out(l), 8, [&](std::size_t, std::size_t begin, std::size_t end) {
            for (std::size_t o = begin; o < end; ++o)
                for (std::size_t chunk = 0; chunk < chunks; ++chunk)
                    for (std::size_t i = 0; i < in; ++i) to[o * in + i] += sums[chunk * sums_size + o * stride + i];
        });
    }
}

} // namespace gsh::cpu
