// SPDX-License-Identifier: Apache-2.0
/// @file  The MLP on the CPU: a tile of rows passes through all layers within the first-level cache.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/cpu/feature_rows.hpp>
#include <gsh/field/cpu/gemm.hpp>
#include <gsh/field/cpu/mlp_mixed.hpp>
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

namespace cpu::inline GSH_ISA {

namespace detail {

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

/// Activations of all points in mixed precision, with room for whole tiles. The words are null where backward computes
/// the activations again.
template <CpuBackend B, class Network>
MixedHidden mixed_hidden(const MixedLayout<Network>& layout, std::size_t rows, MlpScratch<B, float>& scratch) {
    const std::size_t stride = layout.hidden_words(), pitch = chunk_count(rows, mixed_tile) * mixed_tile * stride;
    if (ProductBf16::on_tiles()) return {nullptr, stride, pitch};
    scratch.hidden_words.resize(layout.hidden_layers() * pitch);
    return {scratch.hidden_words.data(), stride, pitch};
}

/// Data that backward reads next, as AheadOfLayers.
struct AheadOfMixedLayers {
    FeatureView<const float> inputs;
    MixedHidden hidden;
    const GradientRows<float>& tile;

    void operator()(std::size_t layer, std::size_t first, std::size_t count) const {
        if (layer == 0) return tile.ahead(inputs)(first, count);
        if (hidden.words)
            tile.ahead(row_major(Span<const std::uint32_t>(hidden.layer(layer - 1), hidden.pitch), hidden.stride))(
                first, count);
    }
};

template <CpuBackend B, class Network>
void mixed_forward(B& backend, const Network& network, Span<const float> weights, const MlpInputs<float>& inputs,
                   Span<float> outputs, MlpScratch<B, float>& scratch) {
    const MixedLayout<Network> layout{network, inputs.shared};
    using Tile = MixedTile<Network>;
    const std::size_t rows = inputs.features.rows, grain = mlp_chunk_rows(rows), chunks = chunk_count(rows, grain);
    const MixedHidden hidden = mixed_hidden(layout, rows, scratch);
    scratch.packed_words.resize(layout.packed_size());
    scratch.packed.resize(mixed_padded(layout.out(0)));
    scratch.tile_words.resize(chunks * Tile::word_count(layout));
    scratch.tiles.resize(chunks * Tile::number_count(layout));
    layout.pack(weights, scratch.packed_words.data(), scratch.packed.data());
    backend.for_chunks(rows, grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        Tile tile(layout, scratch.packed_words.data(), scratch.packed.data(),
                  scratch.tile_words.data() + chunk * Tile::word_count(layout),
                  scratch.tiles.data() + chunk * Tile::number_count(layout));
        for (std::size_t first = begin; first < end; first += mixed_tile) {
            const std::size_t count = std::min(mixed_tile, end - first), next = first + count;
            tile.load(inputs, first, count);
            if (hidden.words) tile.use_hidden(hidden.from(first));
            tile.compute_hidden(
                Ahead<float, RowsFrom>{inputs.features, {next}, std::min(mixed_tile, end - next)});
            tile.outputs(count, outputs.data() + first * network.outputs());
        }
    });
}

template <CpuBackend B, class Network>
void mixed_backward(B& backend, const Network& network, Span<const float> weights, const MlpInputs<float>& inputs,
                    Span<const float> dL_doutputs, MlpScratch<B, float>& scratch, Span<float> dL_dweights,
                    FeatureView<float> dL_dfeatures, Write features_mode, Span<float> dL_dshared) {
    const MixedLayout<Network> layout{network, inputs.shared};
    using Tile = MixedTile<Network>;
    const std::size_t rows = inputs.features.rows, grain = mlp_chunk_rows(rows), chunks = chunk_count(rows, grain);
    const std::size_t sums_size = layout.padded_offset(layout.layers());
    const MixedHidden hidden = mixed_hidden(layout, rows, scratch);
    // Tiles of a chunk: the tile's own, and copies of features and further inputs.
    const std::size_t columns = inputs.features.columns, own = layout.row_inputs() - columns;
    const std::size_t tile_numbers = Tile::number_count(layout),
                      chunk_tiles = tile_numbers + mixed_tile * (columns + own);
    scratch.partials.resize(chunks * sums_size);
    scratch.tiles.resize(chunks * chunk_tiles);
    backend.for_chunks(rows, grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        float* const numbers = scratch.tiles.data() + chunk * chunk_tiles;
        Tile tile(layout, scratch.packed_words.data(), scratch.packed.data(),
                  scratch.tile_words.data() + chunk * Tile::word_count(layout), numbers);
        const FeatureView<float> features({numbers + tile_numbers, mixed_tile * columns}, mixed_tile, columns,
                                          inputs.features.block);
        const Span<float> points(features.values.end(), mixed_tile * own);
        float* const sums = scratch.partials.data() + chunk * sums_size;
        std::fill_n(sums, sums_size, 0.0f);
        GradientRows<float> rows_of_tile(dL_doutputs, network.outputs(), dL_dfeatures, features_mode, begin, end);
        const AheadOfMixedLayers ahead{inputs.features, hidden, rows_of_tile};
        while (rows_of_tile.next()) {
            const RowsOf tile_rows = rows_of_tile.rows();
            const std::size_t count = rows_of_tile.count(), first = tile_rows(0);
            const bool consecutive = rows_of_tile.consecutive();
            if (consecutive) {
                tile.load(inputs, first, count);
            } else {
                gather_features<float>(inputs.features, tile_rows, count, features);
                copy_rows(inputs.points.data(), own, tile_rows, count, points.data());
                tile.load({features, points, inputs.shared}, 0, count);
            }
            if (!hidden.words)
                tile.compute_hidden(Gemm<float>::Nothing());
            else if (consecutive && count == mixed_tile)
                tile.use_hidden(hidden.from(first));
            else
                tile.copy_hidden(hidden, tile_rows, count);
            tile.load_gradient(dL_doutputs.data(), tile_rows, count);
            const FloatMatrix dL_dx = tile.backward(sums, dL_dfeatures.columns, ahead);
            if (dL_dfeatures.empty()) continue;
            const auto store = [&](const auto& of_tile) {
                rows_to_features<float>(dL_dx.numbers, dL_dx.stride, of_tile, count, dL_dfeatures, features_mode);
            };
            consecutive ? store(RowsFrom{first}) : store(tile_rows);
        }
    });
    mlp_join(backend, layout, weights, scratch.partials.data(), chunks, dL_dweights, dL_dshared);
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

} // namespace cpu

} // namespace gsh
