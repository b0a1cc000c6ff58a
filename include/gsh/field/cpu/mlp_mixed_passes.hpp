// SPDX-License-Identifier: Apache-2.0
/// @file  Both passes of the MLP on the CPU in mixed precision, over all rows of a batch.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/cpu/feature_rows.hpp>
#include <gsh/field/cpu/gemm.hpp>
#include <gsh/field/cpu/matrix_bf16.hpp>
#include <gsh/field/cpu/mlp_layout.hpp>
#include <gsh/field/cpu/mlp_mixed.hpp>
#include <gsh/field/features.hpp>
#include <gsh/field/mlp.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>

namespace gsh::cpu::inline GSH_ISA::detail {

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

} // namespace gsh::cpu::detail
