// SPDX-License-Identifier: Apache-2.0
/// @file  The MLP on a GPU, in float or double; networks like the paper's also in mixed precision.
///
/// Products of floats are sums of three products of TF32 on tensor cores, right to about 2^-21 of each product.
///
/// A pass is two launches: weights in the layout of the products, then all layers of a tile of rows in one kernel
/// (mlp_forward.cuh); or all layers in reverse (mlp_backward.cuh), then the sum of the blocks' gradients. Shared inputs
/// need one launch more. Forward stores the activations, 512 bytes a row for two layers of 64: computing them again
/// would take as long as a forward pass, and reading them half as long.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/cuda/mlp_backward.cuh>
#include <gsh/field/cuda/mlp_forward.cuh>
#include <gsh/field/cuda/mlp_mixed_backward.cuh>
#include <gsh/field/cuda/mlp_mixed_forward.cuh>
#include <gsh/field/cuda/mlp_mixed_rows.cuh>
#include <gsh/field/cuda/mlp_mixed_shape.cuh>
#include <gsh/field/cuda/mlp_shape.cuh>
#include <gsh/field/cuda/mlp_sums.cuh>
#include <gsh/field/cuda/mlp_tile.cuh>
#include <gsh/field/cuda/row.cuh>
#include <gsh/field/features.hpp>
#include <gsh/field/mlp.hpp>

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace gsh {

template <std::floating_point T>
struct MlpScratch<cuda::Device, T> {
    cuda::Device::Buffer<T> hidden; ///< activations after ReLU, tile after tile, layer after layer, column after column
    cuda::Device::Buffer<T> forward_weights, backward_weights; ///< in the layouts of the products
    cuda::Device::Buffer<T> bias;                              ///< what the shared inputs add to the first layer
    cuda::Device::Buffer<T> sums, dL_dbias;                    ///< of each block; of all
    cuda::Device::Buffer<T> wide;               ///< gradients of layers with more than 64 columns, of each block
    cuda::Device::Buffer<cuda::MatrixB2> packed; ///< mixed precision: the weights in bf16, for both passes
    cuda::Device::Buffer<std::uint32_t> features, dL_dfeatures; ///< mixed precision: of a hash grid, in bf16
};

namespace cuda {

namespace detail {

/// Enough blocks for the largest GPU. The number of partial sums, and with it the rounding, is the same on all.
inline constexpr unsigned mlp_most_blocks = 512;

/// Both layouts of the weights, padded with zeros to whole groups of columns; and the bias, a warp per output.
template <class T>
struct MlpPack {
    static constexpr unsigned block_size = 256, outputs_per_block = block_size / warp_size;
    MlpShape shape;
    unsigned bias_blocks;
    Span<const T> weights, shared;
    Span<T> forward, backward, bias;

    __device__ void operator()() const {
        if (blockIdx.x < bias_blocks)
            sum_shared();
        else
            copy((blockIdx.x - bias_blocks) * block_size + threadIdx.x);
    }

private:
    __device__ void sum_shared() const {
        const unsigned o = blockIdx.x * outputs_per_block + threadIdx.x / warp_size, lane = threadIdx.x % warp_size;
        const T sum = mlp_bias(shape, weights, shared, o);
        if (lane == 0) bias[o] = sum;
    }
    __device__ void copy(unsigned e) const {
        const unsigned forward_size = static_cast<unsigned>(forward.size());
        if (e < forward_size) {
            const unsigned layer = shape.layer_of(e, shape.forward_size(0), shape.middle_size());
            const auto [inner, column] =
                MlpTile<T>::packed(e - shape.forward_offset(layer), mlp_groups(shape.out(layer)));
            forward[e] = weight(layer, column, inner);
        } else if (e - forward_size < backward.size()) {
            e -= forward_size;
            const unsigned layer = shape.layer_of(e, shape.backward_size(0), shape.middle_size());
            const auto [inner, column] =
                MlpTile<T>::packed(e - shape.backward_offset(layer), mlp_groups(shape.in(layer)));
            backward[e] = weight(layer, inner, column);
        }
    }
    [[nodiscard]] __device__ T weight(unsigned layer, unsigned o, unsigned i) const {
        if (o >= shape.out(layer) || i >= shape.in(layer)) return T(0);
        return weights[shape.weights_offset(layer) + o * shape.weights_stride(layer) + i];
    }
};

/// Adds the blocks' sums to the gradient of the weights.
template <class T>
struct MlpJoin {
    using Tile = MlpTile<T>;
    using Sum = MlpSumOfBlocks<T>;
    using Shared = typename Sum::Shared;
    static constexpr unsigned numbers = Sum::numbers, block_size = Sum::block_size;
    MlpShape shape;
    unsigned blocks;
    Span<const T> sums;
    Span<T> dL_dweights, dL_dbias;

    __device__ void operator()(Shared& shared) const {
        const unsigned at = Sum::number();
        const bool is_bias = at >= bias_begin();
        T* to = nullptr; // for padding
        if (is_bias) {
            const unsigned o = at - bias_begin();
            if (o < dL_dbias.size()) to = &dL_dbias[o];
        } else {
            const unsigned piece = at / (mlp_columns * mlp_columns), layer = layer_of(piece),
                           in_layer = piece - shape.first_piece(layer), groups = mlp_groups(shape.in(layer));
            const unsigned first_out = in_layer / groups * mlp_columns, first_in = in_layer % groups * mlp_columns;
            const auto [out, in] = Tile::weight(at / Tile::threads % Tile::thread_weights, at % Tile::threads,
                                                mlp_share(mlp_count(shape.in(layer), in_layer % groups)));
            const unsigned o = first_out + out, i = first_in + in;
            if (out < mlp_columns && o < shape.out(layer) && i < shape.in(layer))
                to = &dL_dweights[shape.weights_offset(layer) + o * shape.weights_stride(layer) + i];
        }
        const T sum = Sum::sum(shared, sums, shape.sums_size(), blocks, to != nullptr);
        if (to != nullptr && Sum::receives()) *to = is_bias ? sum : *to + sum;
    }

private:
    [[nodiscard]] __device__ unsigned bias_begin() const { return shape.piece_count() * mlp_columns * mlp_columns; }
    [[nodiscard]] __device__ unsigned layer_of(unsigned piece) const {
        return shape.layer_of(piece, shape.pieces(0), mlp_groups(shape.width) * mlp_groups(shape.width));
    }
};

/// dL/dS += g sᵀ and dL/ds += Sᵀ g for the weights S of the shared inputs s, with the gradient g of the bias: 32 inputs
/// a block, each by 8 threads.
template <class T>
struct MlpShareGradient {
    static constexpr unsigned numbers = 32, parts = 8, block_size = numbers * parts;
    struct Shared {
        SharedArray<T, block_size> sums;
    };
    MlpShape shape;
    Span<const T> weights, shared_inputs, dL_dbias;
    Span<T> dL_dweights, dL_dshared;

    __device__ void operator()(Shared& shared) const {
        const unsigned c = blockIdx.x * numbers + threadIdx.x % numbers, part = threadIdx.x / numbers;
        constexpr unsigned batch = 8;
        T sum = 0;
        for (unsigned first = part; c < shape.shared && first < shape.out(0); first += batch * parts) {
            T gradients[batch], before[batch], weight[batch]; // all are read before the first is written
            const auto for_each = [&](const auto& body) {
                for (unsigned n = 0; n < batch; ++n)
                    if (const unsigned o = first + n * parts; o < shape.out(0))
                        body(n, o, o * shape.weights_stride(0) + shape.inputs + c);
            };
            for_each([&](unsigned n, unsigned o, unsigned w) {
                gradients[n] = dL_dbias[o], before[n] = dL_dweights[w], weight[n] = weights[w];
            });
            for_each([&](unsigned n, unsigned, unsigned w) {
                dL_dweights[w] = before[n] + gradients[n] * shared_inputs[c];
                sum += gradients[n] * weight[n];
            });
        }
        shared.sums[threadIdx.x] = sum;
        __syncthreads();
        if (part != 0 || c >= dL_dshared.size()) return;
        for (unsigned p = 1; p < parts; ++p) sum += shared.sums[p * numbers + threadIdx.x];
        dL_dshared[c] += sum;
    }
};

/// Sizes of a network, for a batch of `rows` rows of which `shared` inputs are the same.
/// Errors  ValueError unless the kernels' indexes of 32 bits suffice: for two layers of 64, up to 130 million rows.
template <class T, class Network>
[[nodiscard]] MlpShape mlp_shape(std::string_view where, const Network& network, std::size_t rows, std::size_t shared) {
    const std::size_t padded = rows + MlpTile<T>::rows, hidden = network.layer_count() - 1;
    const std::size_t width = hidden ? network.layer_outputs(0) : 0, groups = width / mlp_columns + 1,
                      columns = std::max(network.inputs(), network.outputs());
    const std::size_t pieces = (hidden * groups + 1) * (groups + columns / mlp_columns) * mlp_columns * mlp_columns;
    check_value(std::max({padded * columns, padded * width * hidden / 4, mlp_most_blocks * pieces}) < (1ull << 32),
                where, "the batch or the network is too large for the CUDA backend, which counts numbers in 32 bits");
    const auto number = [](std::size_t n) { return static_cast<unsigned>(n); };
    return {.inputs = number(network.inputs() - shared),
            .outputs = number(network.outputs()),
            .width = number(width),
            .layers = number(network.layer_count()),
            .shared = number(shared)};
}

template <class T>
[[nodiscard]] MlpRowInputs<T> mlp_row_inputs(const MlpShape& shape, const MlpInputs<T>& inputs) {
    return {inputs.features, inputs.points, shape.inputs - inputs.features.columns};
}

/// Whether a network is computed in mixed precision.
template <class T>
[[nodiscard]] bool is_mixed(const Device& device, const MlpShape& shape) {
    return std::same_as<T, float> && device.precision() == Precision::mixed && MixedShape::fits(shape);
}

template <class Inputs>
void mixed_forward(Device& device, const MlpShape& network, Span<const float> weights, const Inputs& inputs,
                   std::size_t rows, Span<const float> shared, Span<float> outputs,
                   MlpScratch<Device, float>& scratch) {
    using Kernel = MixedForward<Inputs>;
    const MixedShape shape(network);
    scratch.packed.resize(MixedPack::size);
    scratch.bias.resize(network.shared ? shape.width : 0);
    const unsigned bias_blocks =
        static_cast<unsigned>(chunk_count(scratch.bias.size(), MixedPack::numbers_per_block));
    device.launch(bias_blocks + chunk_count(MixedPack::size, MixedPack::block_size),
                  MixedPack{network, shape, bias_blocks, weights, shared, scratch.packed, scratch.bias});
    device.launch(chunk_count(rows, Kernel::block_rows),
                  Kernel{{shape, inputs, scratch.packed, scratch.bias}, outputs});
}

template <class Inputs>
void mixed_backward(Device& device, const MlpShape& network, Span<const float> weights, const Inputs& inputs,
                    std::size_t rows, Span<const float> shared, Span<const float> dL_doutputs,
                    MlpScratch<Device, float>& scratch, Span<float> dL_dweights,
                    const typename Inputs::Gradient& dL_dfeatures, Span<float> dL_dshared, unsigned most_blocks) {
    using Kernel = MixedBackward<Inputs>;
    const MixedShape shape(network);
    const unsigned blocks = std::min(static_cast<unsigned>(chunk_count(rows, Kernel::tile_rows)), most_blocks);
    scratch.sums.resize(std::size_t(blocks) * shape.sums_size());
    scratch.dL_dbias.resize(network.shared ? shape.width : 0);
    device.launch(blocks,
                  Kernel{{shape, inputs, scratch.packed, scratch.bias}, dL_doutputs, dL_dfeatures, scratch.sums});
    if (blocks != 0)
        device.launch(chunk_count(shape.sums_size(), MixedJoin::numbers),
                      MixedJoin{network, shape, blocks, scratch.sums, dL_dweights, scratch.dL_dbias});
    else
        device.fill(Span<float>(scratch.dL_dbias), 0.0f);
    device.launch(chunk_count(network.shared, MlpShareGradient<float>::numbers),
                  MlpShareGradient<float>{network, weights, shared, scratch.dL_dbias, dL_dweights, dL_dshared});
}

/// As mlp_backward, with a given number of blocks that sum gradients.
template <class Network, class T>
void mlp_backward_in_blocks(Device& device, const Network& network, Span<const T> weights, const MlpInputs<T>& inputs,
                            Span<const T> dL_doutputs, MlpScratch<Device, T>& scratch, Span<T> dL_dweights,
                            FeatureView<T> dL_dfeatures, Write features_mode, Span<T> dL_dshared,
                            unsigned most_blocks) {
    using Kernel = MlpBackward<T>;
    constexpr std::size_t tile_rows = MlpTile<T>::rows;
    const MlpShape shape = mlp_shape<T>("Mlp::backward", network, inputs.features.rows, inputs.shared.size());
    if constexpr (std::same_as<T, float>)
        if (is_mixed<T>(device, shape))
            return mixed_backward(device, shape, weights, MixedFloatInputs{mlp_row_inputs(shape, inputs)},
                                  inputs.features.rows, inputs.shared, dL_doutputs, scratch, dL_dweights,
                                  {dL_dfeatures, features_mode}, dL_dshared, most_blocks);
    const unsigned tiles = static_cast<unsigned>(chunk_count(inputs.features.rows, tile_rows));
    const unsigned blocks = std::min(tiles, most_blocks);
    const bool wide = Kernel::uses_wide(shape, dL_dfeatures.columns);
    scratch.sums.resize(std::size_t(blocks) * shape.sums_size());
    scratch.wide.resize(wide ? tile_rows * 2 * blocks * shape.width : 0);
    scratch.dL_dbias.resize(shape.shared ? shape.out(0) : 0);

    const auto fours = [](auto values) { return as_rows<4>("Mlp::backward", values); };
    device.launch(blocks, Kernel{shape, features_mode, mlp_row_inputs(shape, inputs),
                                 fours(Span<const T>(scratch.backward_weights)), fours(Span<const T>(scratch.hidden)),
                                 dL_doutputs, scratch.sums, fours(Span<T>(scratch.wide)), dL_dfeatures});
    device.launch(chunk_count(shape.sums_size(), MlpJoin<T>::numbers),
                  MlpJoin<T>{shape, blocks, scratch.sums, dL_dweights, scratch.dL_dbias});
    device.launch(chunk_count(shape.shared, MlpShareGradient<T>::numbers),
                  MlpShareGradient<T>{shape, weights, inputs.shared, scratch.dL_dbias, dL_dweights, dL_dshared});
}

} // namespace detail

template <class Network, class T>
void mlp_forward(Device& device, const Network& network, Span<const T> weights, const MlpInputs<T>& inputs,
                 Span<T> outputs, MlpScratch<Device, T>& scratch) {
    using detail::MlpPack;
    const detail::MlpShape shape =
        detail::mlp_shape<T>("Mlp::forward", network, inputs.features.rows, inputs.shared.size());
    if constexpr (std::same_as<T, float>)
        if (detail::is_mixed<T>(device, shape))
            return detail::mixed_forward(device, shape, weights,
                                         detail::MixedFloatInputs{detail::mlp_row_inputs(shape, inputs)},
                                         inputs.features.rows, inputs.shared, outputs, scratch);
    constexpr std::size_t tile_rows = detail::MlpTile<T>::rows;
    const std::size_t tiles = chunk_count(inputs.features.rows, tile_rows);
    const unsigned last = shape.layers - 1;
    scratch.forward_weights.resize(shape.forward_offset(last) + shape.forward_size(last));
    scratch.backward_weights.resize(shape.backward_offset(last) + shape.backward_size(last));
    scratch.bias.resize(shape.shared ? detail::mlp_groups(shape.out(0)) * detail::mlp_columns : 0);
    scratch.hidden.resize(tiles * last * shape.width * tile_rows);

    const unsigned bias_blocks = static_cast<unsigned>(scratch.bias.size()) / MlpPack<T>::outputs_per_block;
    const std::size_t packed = scratch.forward_weights.size() + scratch.backward_weights.size();
    device.launch(bias_blocks + chunk_count(packed, MlpPack<T>::block_size),
                  MlpPack<T>{shape, bias_blocks, weights, inputs.shared, scratch.forward_weights,
                             scratch.backward_weights, scratch.bias});
    device.launch(tiles, detail::MlpForward<T>{
                             shape, detail::mlp_row_inputs(shape, inputs),
                             detail::as_rows<4>("Mlp::forward", Span<const T>(scratch.forward_weights)), scratch.bias,
                             detail::as_rows<4>("Mlp::forward", Span<T>(scratch.hidden)), outputs});
}

template <class Network, class T>
void mlp_backward(Device& device, const Network& network, Span<const T> weights, const MlpInputs<T>& inputs,
                  Span<const T> dL_doutputs, MlpScratch<Device, T>& scratch, Span<T> dL_dweights,
                  FeatureView<T> dL_dfeatures, Write features_mode, Span<T> dL_dshared) {
    detail::mlp_backward_in_blocks(device, network, weights, inputs, dL_doutputs, scratch, dL_dweights, dL_dfeatures,
                                   features_mode, dL_dshared, detail::mlp_most_blocks);
}

} // namespace cuda

} // namespace gsh
