// SPDX-License-Identifier: Apache-2.0
/// @file  Sizes of a network in mixed precision, and its weights in the order of the lanes.
#pragma once

#include <gsh/backend/cuda/half.cuh>
#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/backend/cuda/matrix.cuh>
#include <gsh/core/config.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/cuda/mlp_shape.cuh>
#include <gsh/field/cuda/mlp_sums.cuh>

namespace gsh::cuda::detail {

/// A network of two hidden layers in tiles of 16 x 16 weights, of which each lane has a MatrixB2. Tiles lie where those
/// of the largest network would, inner ones first: then addresses are constants, and what a smaller one lacks is zero.
struct MixedShape {
    static constexpr unsigned most_width = 64, most_inputs = 80, most_outputs = 64, layers = 3;
    unsigned inputs = 0, outputs = 0, width = 0;

    [[nodiscard]] static bool fits(const MlpShape& shape) {
        return shape.layers == layers && shape.width <= most_width && shape.inputs <= most_inputs &&
               shape.outputs <= most_outputs;
    }
    explicit MixedShape(const MlpShape& shape) : inputs(shape.inputs), outputs(shape.outputs), width(shape.width) {}

    [[nodiscard]] GSH_HD unsigned in(unsigned layer) const { return layer ? width : inputs; }
    [[nodiscard]] GSH_HD unsigned out(unsigned layer) const { return layer + 1 < layers ? width : outputs; }
    [[nodiscard]] GSH_HD unsigned in_tiles(unsigned layer) const { return (in(layer) + 15) / 16; }
    [[nodiscard]] GSH_HD unsigned out_tiles(unsigned layer) const { return (out(layer) + 15) / 16; }
    [[nodiscard]] GSH_HD static constexpr unsigned most_in_tiles(unsigned layer) {
        return (layer ? most_width : most_inputs) / 16;
    }
    [[nodiscard]] GSH_HD static constexpr unsigned most_out_tiles(unsigned layer) {
        return (layer + 1 < layers ? most_width : most_outputs) / 16;
    }
    [[nodiscard]] GSH_HD static constexpr unsigned first_tile(unsigned layer) {
        unsigned tile = 0;
        for (unsigned l = 0; l < layer; ++l) tile += most_in_tiles(l) * most_out_tiles(l);
        return tile;
    }
    /// y = x Wᵀ: inner tiles over the inputs.
    [[nodiscard]] GSH_HD static constexpr unsigned forward_tile(unsigned layer, unsigned in, unsigned out) {
        return first_tile(layer) + in * most_out_tiles(layer) + out;
    }
    /// dL/dx = dL/dy W: inner tiles over the outputs.
    [[nodiscard]] GSH_HD static constexpr unsigned backward_tile(unsigned layer, unsigned out, unsigned in) {
        return first_tile(layers) + first_tile(layer) + out * most_in_tiles(layer) + in;
    }

    /// Sums of a block: of each layer [out_tiles][2 in_tiles][4][32 lanes], then the bias [width].
    [[nodiscard]] GSH_HD unsigned sums_offset(unsigned layer) const {
        unsigned offset = 0;
        for (unsigned l = 0; l < layer; ++l) offset += in_tiles(l) * out_tiles(l) * 256;
        return offset;
    }
    [[nodiscard]] GSH_HD unsigned sums_size() const { return sums_offset(layers) + width; }
};

/// Packs the weights for both passes, a thread per MatrixB2; and the first layer's bias, a warp per number.
struct MixedPack {
    static constexpr unsigned block_size = 256, numbers_per_block = block_size / warp_size;
    static constexpr unsigned size = 2 * MixedShape::first_tile(MixedShape::layers) * warp_size; ///< of `packed`
    MlpShape network;
    MixedShape shape;
    unsigned bias_blocks;
    Span<const float> weights, shared;
    Span<MatrixB2> packed; ///< [tiles of both passes][32 lanes]
    Span<float> bias;

    __device__ void operator()() const {
        if (blockIdx.x < bias_blocks)
            sum_shared();
        else
            pack((blockIdx.x - bias_blocks) * block_size + threadIdx.x);
    }

private:
    __device__ void sum_shared() const {
        const unsigned o = blockIdx.x * numbers_per_block + threadIdx.x / warp_size, lane = threadIdx.x % warp_size;
        const float sum = mlp_bias(network, weights, shared, o);
        if (lane == 0 && o < bias.size()) bias[o] = sum;
    }
    __device__ void pack(unsigned at) const {
        if (at >= packed.size()) return;
        constexpr unsigned tiles = MixedShape::first_tile(MixedShape::layers);
        const unsigned lane = at % warp_size, tile = at / warp_size % tiles;
        const bool backward = at / warp_size >= tiles;
        unsigned layer = 0;
        while (layer + 1 < MixedShape::layers && tile >= MixedShape::first_tile(layer + 1)) ++layer;
        const unsigned in_layer = tile - MixedShape::first_tile(layer),
                       columns = backward ? MixedShape::most_in_tiles(layer) : MixedShape::most_out_tiles(layer);
        const auto weight = [&](unsigned k, unsigned column) {
            const unsigned o = backward ? k : column, i = backward ? column : k;
            const bool inside = o < shape.out(layer) && i < shape.in(layer);
            return inside ? weights[network.weights_offset(layer) + o * network.weights_stride(layer) + i] : 0.0f;
        };
        MatrixB2 words;
        for (unsigned n = 0; n < 2; ++n)
            for (unsigned w = 0; w < 2; ++w) {
                const unsigned inner = in_layer / columns * 16 + 8 * w + 2 * (lane % 4),
                               column = in_layer % columns * 16 + 8 * n + lane / 4;
                words.halves[n].words[w] = pack_bf16(weight(inner, column), weight(inner + 1, column));
            }
        packed[at] = words;
    }
};

} // namespace gsh::cuda::detail
