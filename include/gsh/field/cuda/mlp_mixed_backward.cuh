// SPDX-License-Identifier: Apache-2.0
/// @file  The backward pass of a network in mixed precision, and the sum of its blocks' gradients.
///
/// Activations are computed again. Gradients of the weights stay in registers over all rows of a block: each warp has
/// 16 of the outputs, and receives rows of the other warps through shared memory.
#pragma once

#include <gsh/backend/cuda/half.cuh>
#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/backend/cuda/matrix.cuh>
#include <gsh/core/span.hpp>
#include <gsh/field/cuda/mlp_mixed_rows.cuh>
#include <gsh/field/cuda/mlp_mixed_shape.cuh>
#include <gsh/field/cuda/mlp_shape.cuh>
#include <gsh/field/cuda/mlp_sums.cuh>

#include <cstddef>
#include <cstdint>

namespace gsh::cuda::detail {

/// A block takes a fixed range of tiles of 128 rows, 16 for each warp.
template <class Inputs>
struct MixedBackward {
    using Rows = MixedRows<Inputs>;
    static constexpr unsigned block_size = 256, warps = block_size / warp_size, tile_rows = warps * Rows::rows;
    static constexpr unsigned least_blocks = Inputs::least_blocks;
    // Words of a row. Four more than its numbers take: eight rows then lie in different banks.
    static constexpr unsigned gradient_stride = MixedShape::most_width / 2 + 4,
                              input_stride = MixedShape::most_inputs / 2 + 4;
    struct Shared {
        alignas(16) SharedArray<std::uint32_t, tile_rows * gradient_stride> gradients; ///< [row][two columns in a word]
        alignas(16) SharedArray<std::uint32_t, tile_rows * input_stride> inputs;       ///< likewise
    };

    Rows network;
    Span<const float> dL_doutputs;
    typename Inputs::Gradient dL_dfeatures;
    Span<float> sums; ///< [blocks][MixedShape::sums_size()]

    __device__ void operator()(Shared& shared) const {
        MatrixC first[Rows::most_in_tiles] = {}, second[4] = {}, third[4] = {}, bias = {}; // this warp's shares
        for (unsigned tile = first_tile(blockIdx.x); tile < first_tile(blockIdx.x + 1); ++tile) {
            const unsigned row = tile * tile_rows + threadIdx.x / warp_size * Rows::rows;
            MatrixA h1[4], gradient[4];
            // Addresses are computed anew in each part, because registers are scarce.
            compute_hidden(shared, row, h1);
            load_gradient(computed_anew(row), gradient);
            add_weights(shared, gradient, 2, third);
            through(2, gradient, [&](unsigned k) { return get_inputs(shared, k); });

            put_inputs<4>(shared, [&](unsigned k) { return h1[k]; }, 1);
            add_weights(shared, gradient, 1, second);
            through(1, gradient, [&](unsigned k) { return h1[k]; });

            const unsigned again = computed_anew(row);
            put_inputs<Rows::most_in_tiles>(shared, [&](unsigned k) { return network.input_tile(again, k); }, 0);
            add_weights(shared, gradient, 0, first);
            if (!network.bias.empty()) add_bias(shared, bias);
            if (dL_dfeatures.wanted()) write_features(computed_anew(row), gradient);
        }
        store(0, first), store(1, second), store(2, third);
        if (!network.bias.empty()) store_bias(bias);
    }

private:
    /// Each warp sums the gradients of 16 outputs of a layer, for every second group of 8 inputs.
    [[nodiscard]] __device__ static unsigned share_outputs() { return threadIdx.x / warp_size % 4; }
    [[nodiscard]] __device__ static unsigned share_inputs() { return threadIdx.x / warp_size / 4; }

    [[nodiscard]] __device__ unsigned first_tile(unsigned block) const {
        return mlp_first_tile(network.inputs.rows(), tile_rows, block);
    }
    /// The first hidden layer. The second becomes the inputs of the last layer's products.
    __device__ void compute_hidden(Shared& shared, unsigned row, MatrixA (&h1)[4]) const {
        MatrixA x[Rows::most_in_tiles], h2[4];
        for (unsigned k = 0; k < Rows::most_in_tiles; ++k) x[k] = network.input_tile(row, k);
        network.hidden(0, x, h1);
        network.hidden(1, h1, h2);
        put_inputs<4>(shared, [&](unsigned k) { return h2[k]; }, 2);
    }
    [[nodiscard]] __device__ float output_gradient(unsigned row, unsigned column) const {
        const bool inside = row < network.inputs.rows() && column < network.shape.outputs;
        return inside ? dL_doutputs[row * network.shape.outputs + column] : 0.0f;
    }
    __device__ void load_gradient(unsigned first_row, MatrixA (&gradient)[4]) const {
        for (unsigned k = 0; k < 4; ++k) {
            gradient[k] = {};
            if (k >= network.shape.out_tiles(2)) continue;
            for (unsigned w = 0; w < 4; ++w) {
                const unsigned row = first_row + Rows::group() + w % 2 * 8, column = 16 * k + w / 2 * 8 + Rows::pair();
                gradient[k].words[w] = pack_bf16(output_gradient(row, column), output_gradient(row, column + 1));
            }
        }
    }

    /// Where a word of this warp's 16 rows of 16 columns lies.
    [[nodiscard]] __device__ static unsigned place(unsigned stride, unsigned tile, unsigned w) {
        const unsigned row = threadIdx.x / warp_size * Rows::rows + Rows::group();
        return (row + w % 2 * 8) * stride + 8 * tile + w / 2 * 4 + threadIdx.x % 4;
    }
    template <std::size_t N>
    __device__ static void put(SharedArray<std::uint32_t, N>& to, unsigned stride, unsigned tile, const MatrixA& from) {
        for (unsigned w = 0; w < 4; ++w) to[place(stride, tile, w)] = from.words[w];
    }
    /// What this warp wrote with put_inputs().
    [[nodiscard]] __device__ static MatrixA get_inputs(const Shared& shared, unsigned tile) {
        MatrixA words;
        for (unsigned w = 0; w < 4; ++w) words.words[w] = shared.inputs[place(input_stride, tile, w)];
        return words;
    }
    /// The gradients of this warp's outputs for the k-th 16 rows, as a left operand.
    [[nodiscard]] __device__ static MatrixA share_gradients(const Shared& shared, unsigned k) {
        const unsigned lane = threadIdx.x % warp_size, row = 16 * k + lane / 16 * 8 + lane % 8;
        return load_transposed(shared.gradients, row * gradient_stride + 8 * share_outputs() + lane / 8 % 2 * 4);
    }
    /// The k-th 16 rows of this warp's n-th and m-th groups of 8 inputs.
    [[nodiscard]] __device__ static MatrixB2 share_inputs(const Shared& shared, unsigned k, unsigned n, unsigned m) {
        const unsigned lane = threadIdx.x % warp_size, row = 16 * k + lane / 8 % 2 * 8 + lane % 8;
        const MatrixA words =
            load_transposed(shared.inputs, row * input_stride + 4 * (2 * (lane / 16 ? m : n) + share_inputs()));
        return {{{{words.words[0], words.words[1]}}, {{words.words[2], words.words[3]}}}};
    }

    /// The inputs of a layer, for its products. x(k) are 16 columns.
    template <unsigned Tiles, class Input>
    __device__ void put_inputs(Shared& shared, const Input& x, unsigned layer) const {
        __syncthreads(); // the arrays are still read
        for (unsigned k = 0; k < Tiles; ++k)
            if (k < network.shape.in_tiles(layer)) put(shared.inputs, input_stride, k, x(k));
    }
    /// dL/dW += dL/dyᵀ x over the block's rows, for this warp's share of a layer, after put_inputs().
    template <std::size_t Tiles>
    __device__ void add_weights(Shared& shared, const MatrixA (&gradient)[4], unsigned layer,
                                MatrixC (&to)[Tiles]) const {
        const unsigned out_tiles = network.shape.out_tiles(layer), in_tiles = network.shape.in_tiles(layer);
        for (unsigned k = 0; k < 4; ++k)
            if (k < out_tiles) put(shared.gradients, gradient_stride, k, gradient[k]);
        __syncthreads();
        if (share_outputs() >= out_tiles) return; // no barrier follows before all warps are back
        GSH_NO_UNROLL
        for (unsigned k = 0; k < tile_rows / 16; ++k) {
            const MatrixA a = share_gradients(shared, k);
            for (unsigned n = 0; n < Tiles; n += 2) {
                if (n >= in_tiles) continue; // not break: the loop must have a constant length
                const bool both = n + 1 < Tiles;
                const MatrixB2 b = share_inputs(shared, k, n, n + 1 < in_tiles ? n + 1 : n);
                multiply_add(to[n], a, b.halves[0]);
                if (both) multiply_add(to[n + 1], a, b.halves[1]);
            }
        }
    }
    /// The first layer's bias is the weight of an input that is 1 in every row.
    __device__ void add_bias(const Shared& shared, MatrixC& bias) const {
        if (share_inputs() != 0 || share_outputs() >= network.shape.out_tiles(0)) return;
        const std::uint32_t ones = pack_bf16(1.0f, 1.0f);
        GSH_NO_UNROLL
        for (unsigned k = 0; k < tile_rows / 16; ++k) multiply_add(bias, share_gradients(shared, k), {{ones, ones}});
    }

    /// The gradient of a layer's inputs x, where the ReLU that made them passed, in the place of that of its outputs.
    /// x(k) are 16 columns.
    template <class Input>
    __device__ void through(unsigned layer, MatrixA (&gradient)[4], const Input& x) const {
        MatrixA result[4] = {};
        for (unsigned tile = 0; tile < 4; ++tile) {
            if (tile >= network.shape.in_tiles(layer)) continue;
            MatrixC products[2] = {};
            network.add_products(products, gradient, network.shape.out_tiles(layer),
                                 [&](unsigned k) { return MixedShape::backward_tile(layer, k, tile); });
            const MatrixA made = x(tile);
            for (unsigned n = 0; n < 2; ++n)
                for (unsigned i = 0; i < 2; ++i)
                    result[tile].words[2 * n + i] =
                        pack_bf16(products[n].values[2 * i], products[n].values[2 * i + 1]) &
                        mask_of_positive_bf16(made.words[2 * n + i]);
        }
        for (unsigned tile = 0; tile < 4; ++tile) gradient[tile] = result[tile];
    }

    __device__ void write_features(unsigned first_row, const MatrixA (&gradient)[4]) const {
        for (unsigned tile = 0; tile < network.shape.in_tiles(0); ++tile) {
            MatrixC products[2] = {};
            network.add_products(products, gradient, network.shape.out_tiles(0),
                                 [&](unsigned k) { return MixedShape::backward_tile(0, k, tile); });
            for (unsigned n = 0; n < 2; ++n)
                for (unsigned i = 0; i < 2; ++i) {
                    const unsigned row = first_row + Rows::group() + i * 8, column = 16 * tile + 8 * n + Rows::pair();
                    if (row < network.inputs.rows())
                        dL_dfeatures.write(row, column, products[n].values[2 * i], products[n].values[2 * i + 1]);
                }
        }
    }

    template <std::size_t N>
    __device__ void store(unsigned layer, const MatrixC (&from)[N]) const {
        const unsigned in_tiles = network.shape.in_tiles(layer);
        if (share_outputs() >= network.shape.out_tiles(layer)) return;
        const unsigned begin = blockIdx.x * network.shape.sums_size() + network.shape.sums_offset(layer);
        for (unsigned n = 0; n < N; ++n) {
            if (n >= in_tiles) continue;
            const unsigned tile = share_outputs() * 2 * in_tiles + 2 * n + share_inputs();
            for (unsigned i = 0; i < 4; ++i) // neighbouring lanes write neighbouring numbers
                sums[begin + (tile * 4 + i) * warp_size + threadIdx.x % warp_size] = from[n].values[i];
        }
    }
    /// All columns of the result are the same; a lane writes what it has of the first.
    __device__ void store_bias(const MatrixC& bias) const {
        if (share_inputs() != 0 || Rows::pair() != 0) return;
        const unsigned begin = blockIdx.x * network.shape.sums_size() + network.shape.sums_offset(MixedShape::layers);
        for (unsigned i = 0; i < 2; ++i) {
            const unsigned column = 16 * share_outputs() + Rows::group() + i * 8;
            if (column < network.shape.width) sums[begin + column] = bias.values[2 * i];
        }
    }
};

/// Adds the blocks' sums to the gradient of the weights.
struct MixedJoin {
    using Sum = MlpSumOfBlocks<float>;
    using Shared = Sum::Shared;
    static constexpr unsigned numbers = Sum::numbers, block_size = Sum::block_size;

    MlpShape network;
    MixedShape shape;
    unsigned blocks;
    Span<const float> sums;
    Span<float> dL_dweights, dL_dbias;

    __device__ void operator()(Shared& shared) const {
        const unsigned at = Sum::number();
        const bool wanted = at < shape.sums_size();
        const float sum = Sum::sum(shared, sums, shape.sums_size(), blocks, wanted);
        if (!wanted || !Sum::receives()) return;
        if (at >= shape.sums_offset(MixedShape::layers)) {
            if (!dL_dbias.empty()) dL_dbias[at - shape.sums_offset(MixedShape::layers)] = sum;
            return;
        }
        unsigned layer = 0;
        while (layer + 1 < MixedShape::layers && at >= shape.sums_offset(layer + 1)) ++layer;
        const unsigned in_layer = at - shape.sums_offset(layer), columns = 2 * shape.in_tiles(layer);
        const unsigned lane = in_layer % warp_size, i = in_layer / warp_size % 4,
                       n = in_layer / (4 * warp_size) % columns, tile = in_layer / (4 * warp_size) / columns;
        const unsigned o = 16 * tile + lane / 4 + i / 2 * 8, input = 8 * n + 2 * (lane % 4) + i % 2;
        if (o < shape.out(layer) && input < shape.in(layer))
            dL_dweights[network.weights_offset(layer) + o * network.weights_stride(layer) + input] += sum;
    }
};

} // namespace gsh::cuda::detail
