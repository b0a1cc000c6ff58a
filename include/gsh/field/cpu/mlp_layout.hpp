// SPDX-License-Identifier: Apache-2.0
/// @file  What the passes of the MLP on the CPU share: scratch memory, chunks, the layout of weights, sums of chunks.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/cpu/gemm.hpp>
#include <gsh/field/features.hpp>
#include <gsh/field/mlp.hpp>

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <cstdint>

namespace gsh {

template <CpuBackend B, std::floating_point T>
struct MlpScratch<B, T> {
    typename B::template Buffer<T> hidden;   ///< activations after ReLU, layer after layer
    typename B::template Buffer<T> packed;   ///< weights in the layout of the products
    typename B::template Buffer<T> tiles;    ///< each chunk's tiles of inputs, activations, outputs or gradients
    typename B::template Buffer<T> partials; ///< each chunk's sum of dL_dweights
    typename B::template Buffer<std::uint32_t> hidden_words, packed_words, tile_words; ///< those in mixed precision
};

namespace cpu::inline GSH_ISA::detail {

inline constexpr std::size_t mlp_tile_rows = 64;

/// Rows per chunk: whole tiles, and at most 64 chunks, so that the partial sums stay few.
[[nodiscard]] constexpr std::size_t mlp_chunk_rows(std::size_t rows) {
    constexpr std::size_t most_chunks = 64, least_tiles = 4;
    const std::size_t tiles = chunk_count(rows, mlp_tile_rows);
    return std::max(least_tiles, chunk_count(tiles, most_chunks)) * mlp_tile_rows;
}

/// Sizes and offsets common to forward and backward.
///
/// Inputs that all rows share take no part in the products. Their contribution to the first layer is the same for every
/// row. It becomes the column of one additional input, which is 1.
template <class T, class Network>
struct MlpLayout {
    using G = Gemm<T>;
    const Network& network;
    Span<const T> shared = {}; ///< the last of the network's inputs

    [[nodiscard]] std::size_t layers() const { return network.layer_count(); }
    [[nodiscard]] std::size_t hidden_layers() const { return layers() - 1; }
    /// Number of inputs that differ from row to row.
    [[nodiscard]] std::size_t row_inputs() const { return network.inputs() - shared.size(); }
    /// Columns of a layer's matrix in the products.
    [[nodiscard]] std::size_t in(std::size_t layer) const {
        return layer ? network.layer_inputs(layer) : row_inputs() + (shared.empty() ? 0 : 1);
    }
    [[nodiscard]] std::size_t out(std::size_t layer) const { return network.layer_outputs(layer); }
    [[nodiscard]] std::size_t padded_in(std::size_t layer) const { return G::padded(in(layer)); }
    [[nodiscard]] std::size_t padded_out(std::size_t layer) const { return G::padded(out(layer)); }
    [[nodiscard]] std::size_t widest() const {
        return std::max({padded_in(0), padded_out(layers() - 1), padded_out(0)});
    }

    /// [in][padded out]: right operand of forward.
    [[nodiscard]] std::size_t transposed_offset(std::size_t layer) const {
        std::size_t offset = 0;
        for (std::size_t l = 0; l < layer; ++l) offset += in(l) * padded_out(l);
        return offset;
    }
    /// [out][padded in]: right operand of backward, and the layout of its sums.
    [[nodiscard]] std::size_t padded_offset(std::size_t layer) const {
        std::size_t offset = 0;
        for (std::size_t l = 0; l < layer; ++l) offset += out(l) * padded_in(l);
        return offset;
    }
    /// Numbers of a hidden layer's activations (all hidden layers are as wide as the first).
    [[nodiscard]] std::size_t pitch(std::size_t rows) const { return rows * padded_out(0); }
    /// Address of a row's activations of the first hidden layer; null without hidden layers.
    [[nodiscard]] T* first_activation(Span<T> hidden, std::size_t row) const {
        return hidden_layers() ? hidden.data() + pitch(row) : nullptr;
    }
    /// A hidden layer's activations of all rows.
    [[nodiscard]] FeatureView<T> activations(Span<T> hidden, std::size_t layer, std::size_t rows) const {
        return row_major(hidden.subspan(layer * pitch(rows), pitch(rows)), padded_out(0));
    }

    /// Number (output o, input i) of a layer's matrix in the form that the products use.
    [[nodiscard]] T entry(Span<const T> weights, std::size_t layer, std::size_t o, std::size_t i) const {
        const T* row = weights.data() + network.layer_offset(layer) + o * network.layer_inputs(layer);
        if (layer || i < row_inputs()) return row[i];
        T sum = 0;
        for (std::size_t c = 0; c < shared.size(); ++c) sum += row[row_inputs() + c] * shared[c];
        return sum;
    }
    void pack_transposed(Span<const T> weights, T* packed) const {
        for (std::size_t l = 0; l < layers(); ++l) {
            T* to = packed + transposed_offset(l);
            for (std::size_t i = 0; i < in(l); ++i)
                for (std::size_t o = 0; o < padded_out(l); ++o)
                    to[i * padded_out(l) + o] = o < out(l) ? entry(weights, l, o, i) : T(0);
        }
    }
    void pack_padded(Span<const T> weights, T* packed) const {
        for (std::size_t l = 0; l < layers(); ++l) {
            T* to = packed + padded_offset(l);
            for (std::size_t o = 0; o < out(l); ++o)
                for (std::size_t i = 0; i < padded_in(l); ++i)
                    to[o * padded_in(l) + i] = i < in(l) ? entry(weights, l, o, i) : T(0);
        }
    }
};

/// Adds the partial sums, in order, to dL_dweights, and to dL_dshared unless that is empty.
template <CpuBackend B, class T, class Layout>
void mlp_join(B& backend, const Layout& layout, Span<const T> weights, const T* partials,
              std::size_t partial_count, Span<T> dL_dweights, Span<T> dL_dshared) {
    const std::size_t sums_size = layout.padded_offset(layout.layers()), own = layout.row_inputs();
    for (std::size_t l = 0; l < layout.layers(); ++l) {
        const std::size_t in = layout.network.layer_inputs(l), columns = l ? in : own, stride = layout.padded_in(l);
        const T* sums = partials + layout.padded_offset(l);
        T* to = dL_dweights.data() + layout.network.layer_offset(l);
        backend.for_chunks(layout.out(l), 8, [&](std::size_t, std::size_t begin, std::size_t end) {
            for (std::size_t o = begin; o < end; ++o)
                for (std::size_t p = 0; p < partial_count; ++p) {
                    const T* row = sums + p * sums_size + o * stride;
                    for (std::size_t i = 0; i < columns; ++i) to[o * in + i] += row[i];
                    if (l == 0)
                        for (std::size_t c = 0; c < layout.shared.size(); ++c)
                            to[o * in + own + c] += row[own] * layout.shared[c];
                }
        });
    }
    if (dL_dshared.empty()) return;
    for (std::size_t o = 0; o < layout.out(0); ++o)
        for (std::size_t p = 0; p < partial_count; ++p)
            for (std::size_t c = 0; c < dL_dshared.size(); ++c)
                dL_dshared[c] += weights[o * layout.network.inputs() + own + c] *
                                 partials[p * sums_size + layout.padded_offset(0) + o * layout.padded_in(0) + own];
}

} // namespace cpu::detail

} // namespace gsh
