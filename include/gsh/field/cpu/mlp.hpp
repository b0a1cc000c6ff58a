// SPDX-License-Identifier: Apache-2.0
/// @file  The MLP on the CPU: a tile of rows passes through all layers within the first-level cache.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/cpu/feature_rows.hpp>
#include <gsh/field/cpu/gemm.hpp>
#include <gsh/field/cpu/mlp_layout.hpp>
#include <gsh/field/cpu/mlp_mixed_passes.hpp>
#include <gsh/field/features.hpp>
#include <gsh/field/mlp.hpp>

#include <algorithm>
#include <concepts>
#include <cstddef>

namespace gsh::cpu::inline GSH_ISA {

namespace detail {

/// Data that the backward pass reads next: the inputs of the next tile during the work on layer 0, its activations
/// during the work on the other layers.
template <class T, class Network>
struct AheadOfLayers {
    const MlpLayout<T, Network>& layout;
    FeatureView<const T> inputs;
    Span<T> hidden;
    const GradientRows<T>& tile;

    [[nodiscard]] Ahead<T, RowsOf> operator[](std::size_t layer) const {
        return tile.ahead(layer ? FeatureView<const T>(layout.activations(hidden, layer - 1, inputs.rows)) : inputs);
    }
};

/// Rows in the layout of the products. This is the memory of the features where it has that layout and the rows follow
/// each other; else a copy of the features, the further inputs of each point, and a 1 for the shared inputs, padded
/// with zeros.
template <class T, class Network, class Rows>
typename Gemm<T>::Right input_tile(const MlpLayout<T, Network>& layout, const MlpInputs<T>& inputs, const Rows& rows,
                                   std::size_t count, T* copy) {
    const FeatureView<const T>& features = inputs.features;
    const std::size_t stride = layout.padded_in(0), own = layout.row_inputs() - features.columns;
    if (std::same_as<Rows, RowsFrom> && features.block == stride && features.columns == stride)
        return {features.values.data() + rows(0) * stride, stride};
    features_to_rows(features, rows, count, copy, stride);
    if (stride != features.columns)
        for (std::size_t r = 0; r < count; ++r) {
            T* row = copy + r * stride;
            T* rest = std::copy_n(inputs.points.data() + rows(r) * own, own, row + features.columns);
            std::fill(rest, row + stride, T(0));
            if (!inputs.shared.empty()) *rest = T(1);
        }
    return {copy, stride};
}

/// All layers of one tile. x: its inputs; hidden: destination of its activations, `pitch` numbers from layer to layer;
/// packed: result of pack_transposed; output: padded rows of the result.
template <class T, class Network, class Ahead>
void mlp_tile_forward(const MlpLayout<T, Network>& layout, const T* packed, typename Gemm<T>::Right x,
                      std::size_t count, T* hidden, std::size_t pitch, T* output, const Ahead& ahead) {
    using G = Gemm<T>;
    const std::size_t last = layout.layers() - 1;
    for (std::size_t l = 0; l <= last; ++l) {
        const std::size_t stride = layout.padded_out(l);
        const typename G::Right matrix{packed + layout.transposed_offset(l), stride};
        const auto multiply = [&](T* to, const auto& epilogue, const auto& ahead_of_layer) {
            G::product(count, layout.out(l), layout.in(l), {x.data, x.stride, 1}, matrix, {to, stride}, epilogue,
                       ahead_of_layer);
        };
        if (l == last) {
            multiply(output, typename G::Assign{}, typename G::Nothing{});
        } else {
            l == 0 ? multiply(hidden, typename G::Relu{}, ahead)
                   : multiply(hidden, typename G::Relu{}, typename G::Nothing{});
            x = {hidden, stride};
            hidden += pitch;
        }
    }
}

/// The adjoint for one tile: adds to `sums` (in the layout of pack_padded). Returns dL_dx of the first `wanted` inputs
/// in rows of padded_in(0), which lie in one of the two scratch tiles, or null if none is wanted. hidden, pitch: as in
/// mlp_tile_forward.
template <class T, class Network, class Ahead>
const T* mlp_tile_backward(const MlpLayout<T, Network>& layout, const T* packed, typename Gemm<T>::Right x,
                           typename Gemm<T>::Right dL_dy, std::size_t count, const T* hidden, std::size_t pitch,
                           T* const (&scratch)[2], T* sums, std::size_t wanted, const Ahead& ahead) {
    using G = Gemm<T>;
    for (std::size_t l = layout.layers(); l-- > 0;) {
        const std::size_t stride = layout.padded_in(l);
        const T* activations = l ? hidden + (l - 1) * pitch : nullptr;
        // dL_dW[o, i] += sum over rows of dL_dy[row, o] x[row, i]
        G::product(layout.out(l), layout.in(l), count, {dL_dy.data, 1, dL_dy.stride},
                   l ? typename G::Right{activations, stride} : x, {sums + layout.padded_offset(l), stride},
                   typename G::Add{});
        if (l == 0 && wanted == 0) return nullptr;
        // dL_dx = dL_dy W, through the ReLU that made x
        const auto multiply = [&](const auto& epilogue) {
            G::product(count, l ? layout.in(l) : wanted, layout.out(l), {dL_dy.data, dL_dy.stride, 1},
                       {packed + layout.padded_offset(l), stride}, {scratch[l % 2], stride}, epilogue, ahead[l]);
        };
        l ? multiply(typename G::WhereActive{activations}) : multiply(typename G::Assign{});
        dL_dy = {scratch[l % 2], stride};
    }
    return dL_dy.data;
}

} // namespace detail

template <CpuBackend B, class Network, class T>
void mlp_forward(B& backend, const Network& network, Span<const T> weights, const MlpInputs<T>& inputs,
                 Span<T> outputs, MlpScratch<B, T>& scratch) {
    if constexpr (std::same_as<T, float>)
        if (precision_of(backend) == Precision::mixed)
            return detail::mixed_forward(backend, network, weights, inputs, outputs, scratch);
    const detail::MlpLayout<T, Network> layout{network, inputs.shared};
    const std::size_t rows = inputs.features.rows, outputs_count = network.outputs(),
                      stride = layout.padded_out(layout.layers() - 1);
    const std::size_t grain = detail::mlp_chunk_rows(rows), tile_size = detail::mlp_tile_rows * layout.widest();

    scratch.hidden.resize(layout.hidden_layers() * layout.pitch(rows));
    scratch.packed.resize(layout.transposed_offset(layout.layers()));
    scratch.tiles.resize(chunk_count(rows, grain) * 2 * tile_size);
    layout.pack_transposed(weights, scratch.packed.data());

    backend.for_chunks(rows, grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        T* input_copy = scratch.tiles.data() + chunk * 2 * tile_size;
        T* output_copy = input_copy + tile_size;
        for (std::size_t first = begin; first < end; first += detail::mlp_tile_rows) {
            const std::size_t count = std::min(detail::mlp_tile_rows, end - first);
            const std::size_t next = first + count, next_count = std::min(detail::mlp_tile_rows, end - next);
            detail::mlp_tile_forward(layout, scratch.packed.data(),
                                     detail::input_tile(layout, inputs, detail::RowsFrom{first}, count, input_copy),
                                     count, layout.first_activation(scratch.hidden, first), layout.pitch(rows),
                                     output_copy,
                                     detail::Ahead<T, detail::RowsFrom>{inputs.features, {next}, next_count});
            for (std::size_t r = 0; r < count; ++r)
                std::copy_n(output_copy + r * stride, outputs_count, outputs.data() + (first + r) * outputs_count);
        }
    });
}

template <CpuBackend B, class Network, class T>
void mlp_backward(B& backend, const Network& network, Span<const T> weights, const MlpInputs<T>& inputs,
                  Span<const T> dL_doutputs, MlpScratch<B, T>& scratch, Span<T> dL_dweights,
                  FeatureView<T> dL_dfeatures, Write features_mode, Span<T> dL_dshared) {
    if constexpr (std::same_as<T, float>)
        if (precision_of(backend) == Precision::mixed)
            return detail::mixed_backward(backend, network, weights, inputs, dL_doutputs, scratch, dL_dweights,
                                          dL_dfeatures, features_mode, dL_dshared);
    const detail::MlpLayout<T, Network> layout{network, inputs.shared};
    const std::size_t rows = inputs.features.rows, outputs = network.outputs();
    const std::size_t grain = detail::mlp_chunk_rows(rows), tile_size = detail::mlp_tile_rows * layout.widest();
    const std::size_t chunks = chunk_count(rows, grain), sums_size = layout.padded_offset(layout.layers());

    // Tiles of a chunk: padded inputs, gradients of two layers, and copies of activations and dL_doutputs.
    const std::size_t tile_hidden = layout.hidden_layers() * layout.pitch(detail::mlp_tile_rows),
                      chunk_tiles = 3 * tile_size + tile_hidden + detail::mlp_tile_rows * outputs;
    scratch.packed.resize(sums_size);
    scratch.tiles.resize(chunks * chunk_tiles);
    scratch.partials.resize(chunks * sums_size);
    layout.pack_padded(weights, scratch.packed.data());

    backend.for_chunks(rows, grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        T* const input_copy = scratch.tiles.data() + chunk * chunk_tiles;
        T* const gradients[2] = {input_copy + tile_size, input_copy + 2 * tile_size};
        T* const hidden_copy = input_copy + 3 * tile_size;
        T* const dL_dy_copy = hidden_copy + tile_hidden;
        T* sums = scratch.partials.data() + chunk * sums_size;
        std::fill_n(sums, sums_size, T(0));
        detail::GradientRows<T> tile(dL_doutputs, outputs, dL_dfeatures, features_mode, begin, end);
        const detail::AheadOfLayers<T, Network> ahead{layout, inputs.features, scratch.hidden, tile};
        const auto backward = [&](const auto& of_tile, const T* hidden, std::size_t pitch, const T* dL_dy) {
            const T* dL_dx = detail::mlp_tile_backward(
                layout, scratch.packed.data(), detail::input_tile(layout, inputs, of_tile, tile.count(), input_copy),
                {dL_dy, outputs}, tile.count(), hidden, pitch, gradients, sums, dL_dfeatures.columns, ahead);
            if (dL_dx)
                detail::rows_to_features(dL_dx, layout.padded_in(0), of_tile, tile.count(), dL_dfeatures,
                                         features_mode);
        };
        while (tile.next()) {
            if (tile.consecutive()) {
                const std::size_t first = tile.rows()(0);
                backward(detail::RowsFrom{first}, layout.first_activation(scratch.hidden, first), layout.pitch(rows),
                         dL_doutputs.data() + first * outputs);
            } else {
                const std::size_t pitch = layout.pitch(tile.count());
                for (std::size_t l = 0; l < layout.hidden_layers(); ++l)
                    detail::copy_rows<T>(scratch.hidden.data() + l * layout.pitch(rows), layout.padded_out(0),
                                         tile.rows(), tile.count(), hidden_copy + l * pitch);
                detail::copy_rows(dL_doutputs.data(), outputs, tile.rows(), tile.count(), dL_dy_copy);
                backward(tile.rows(), hidden_copy, pitch, dL_dy_copy);
            }
        }
    });
    detail::mlp_join(backend, layout, weights, scratch.partials.data(), chunks, dL_dweights, dL_dshared);
}

} // namespace gsh::cpu
