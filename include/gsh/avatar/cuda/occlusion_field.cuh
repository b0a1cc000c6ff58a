// SPDX-License-Identifier: Apache-2.0
/// @file  Ambient occlusion on the GPU: the hidden layers as products of tiles in shared memory.
#pragma once

#include <gsh/avatar/cuda/pose_of_neurons.cuh>
#include <gsh/avatar/occlusion_field.hpp>
#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/backend/cuda/lane_sums.cuh>
#include <gsh/backend/cuda/reduce.cuh>
#include <gsh/core/lane.hpp>
#include <gsh/core/span.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>

namespace gsh {

template <std::floating_point T>
struct OcclusionFieldScratch<cuda::Device, T> {
    /// Of forward, for backward: a bit for each number of a hidden layer that is above zero, four in a byte.
    cuda::Device::Buffer<std::uint8_t> signs; // [hidden layers, N, W / 4]
    cuda::Device::Buffer<T> values[2];        // [N, W] a layer's numbers, or their gradients; not for two layers
    cuda::Device::Buffer<T> partials;         // [W, blocks] sums of dL_dpose
};

namespace cuda {

namespace detail {

/// Four numbers that travel between shared memory and registers in one instruction.
template <class T>
struct alignas(4 * sizeof(T)) Four {
    T v[4];
};

/// A block's product of 128 rows by a matrix, 64 columns at a time: a thread has 8 rows by 4 columns in registers, and
/// for each step of the sum loads three Fours for its 32 products.
template <class T>
struct OcclusionProduct {
    static constexpr unsigned rows = 128, columns = 64, depth = 16, block_size = rows / 8 * (columns / 4);
    // One more Four in each step's row, so that threads which store consecutive steps use different banks.
    static constexpr unsigned left_pitch = rows / 4 + 1, right_pitch = columns / 4 + 1;
    struct Shared {
        SharedArray<Four<T>, depth * left_pitch> left;
        SharedArray<Four<T>, depth * right_pitch> right;
    };
    using Sums = T[8][4];

    /// The thread's first row and column within the tile.
    [[nodiscard]] __device__ static unsigned row() { return threadIdx.x / 16 * 8; }
    [[nodiscard]] __device__ static unsigned column() { return threadIdx.x % 16 * 4; }

    /// sums[r][c] = Σ_k left(row + r, k) right(k, column + c), k in [0, count). The functions return zeros outside.
    template <class Left, class Right>
    __device__ static void sum(Shared& shared, std::size_t count, const Left& left, const Right& right, Sums& sums) {
        for (auto& row_sums : sums)
            for (T& value : row_sums) value = T(0);
        const unsigned k = threadIdx.x % depth, group = threadIdx.x / depth;
        for (std::size_t first = 0; first < count; first += depth) {
            __syncthreads();
            for (unsigned half = 0; half < 2; ++half) {
                Four<T> four;
                const unsigned at = group + half * (rows / 8);
                for (unsigned r = 0; r < 4; ++r) four.v[r] = left(4 * at + r, first + k);
                shared.left[k * left_pitch + at] = four;
            }
            Four<T> four;
            for (unsigned c = 0; c < 4; ++c) four.v[c] = right(first + k, 4 * group + c);
            shared.right[k * right_pitch + group] = four;
            __syncthreads();
            for (unsigned step = 0; step < depth; ++step) {
                const Four<T> upper = shared.left[step * left_pitch + row() / 4];
                const Four<T> lower = shared.left[step * left_pitch + row() / 4 + 1];
                const Four<T> across = shared.right[step * right_pitch + column() / 4];
                for (unsigned r = 0; r < 4; ++r)
                    for (unsigned c = 0; c < 4; ++c) {
                        sums[r][c] += upper.v[r] * across.v[c];
                        sums[r + 4][c] += lower.v[r] * across.v[c];
                    }
            }
        }
    }
};

/// One hidden layer, y = relu(matrix x), and the output logits = last · y.
template <class T>
struct OcclusionLayer {
    using Product = OcclusionProduct<T>;
    using Shared = typename Product::Shared;
    static constexpr unsigned block_size = Product::block_size, least_blocks = sizeof(T) == 4 ? 3 : 1;

    Span<const T> from;       // [N, W]
    Span<const T> pose;       // [W] x = relu(from + pose), or empty for x = from
    Span<const T> matrix;     // [W, W], or empty for y = x
    Span<const T> last;       // [W], or empty: there is another hidden layer
    Span<T> logits;           // [N] if there is `last`
    Span<T> values;           // [N, W] y if there is another hidden layer
    Span<std::uint8_t> signs; // [N, W / 4], or empty if y = x
    std::size_t rows, width;

    __device__ void operator()(Shared& shared) const {
        const std::size_t first = std::size_t(blockIdx.x) * Product::rows, groups = (width + 3) / 4;
        const std::size_t row = first + Product::row();
        T dots[8] = {};
        for (std::size_t begin = 0; begin < width; begin += Product::columns) {
            const std::size_t column = begin + Product::column();
            typename Product::Sums y;
            if (matrix.empty()) {
                for (unsigned r = 0; r < 8; ++r)
                    for (unsigned c = 0; c < 4; ++c) y[r][c] = input(row + r, column + c);
            } else {
                Product::sum(
                    shared, width, [&](unsigned r, std::size_t k) { return input(first + r, k); },
                    [&](std::size_t k, unsigned c) {
                        return k < width && begin + c < width ? matrix[(begin + c) * width + k] : T(0);
                    },
                    y);
            }
            for (unsigned r = 0; r < 8; ++r) {
                unsigned positive = 0;
                for (unsigned c = 0; c < 4; ++c) {
                    positive |= unsigned(y[r][c] > T(0)) << c;
                    y[r][c] = max(y[r][c], T(0));
                    if (!last.empty() && column + c < width) dots[r] += last[column + c] * y[r][c];
                }
                if (row + r >= rows || column >= width) continue;
                if (!signs.empty()) signs[(row + r) * groups + column / 4] = static_cast<std::uint8_t>(positive);
                if (!values.empty())
                    for (unsigned c = 0; c < 4; ++c)
                        if (column + c < width) values[(row + r) * width + column + c] = y[r][c];
            }
        }
        if (last.empty()) return;
        sum_lanes<16>(dots, [&](unsigned r, T sum) {
            if (row + r < rows) logits[row + r] = sum;
        });
    }

private:
    [[nodiscard]] __device__ T input(std::size_t row, std::size_t k) const {
        if (row >= rows || k >= width) return T(0);
        const T value = from[row * width + k];
        return pose.empty() ? value : max(value + pose[k], T(0));
    }
};

/// The adjoint of one hidden layer: dL_dx = matrixᵀ (dL_dy where y > 0). At the first one, sums over the block's rows.
template <class T>
struct OcclusionLayerBackward {
    using Product = OcclusionProduct<T>;
    using Shared = typename Product::Shared;
    static constexpr unsigned block_size = Product::block_size, least_blocks = sizeof(T) == 4 ? 3 : 1;

    Span<const T> dL_dlogits, last; // [N], [W] dL_dy = dL_dlogits last, or empty
    Span<const T> dL_dy;            // [N, W] otherwise
    Span<const std::uint8_t> signs; // [N, W / 4] of y
    Span<const T> matrix;           // [W, W], or empty for y = x
    Span<const T> neurons, pose;    // [N, W], [W] x = relu(neurons + pose), or empty if there is a layer below
    Span<T> dL_dx;                  // [N, W] if there is
    Span<T> partials;               // [W, blocks] otherwise
    std::size_t rows, width;

    __device__ void operator()(Shared& shared) const {
        const std::size_t first = std::size_t(blockIdx.x) * Product::rows, row = first + Product::row();
        for (std::size_t begin = 0; begin < width; begin += Product::columns) {
            const std::size_t column = begin + Product::column();
            typename Product::Sums dx;
            if (matrix.empty()) {
                for (unsigned r = 0; r < 8; ++r)
                    for (unsigned c = 0; c < 4; ++c) dx[r][c] = gradient(row + r, column + c);
            } else {
                Product::sum(
                    shared, width,
                    [&](unsigned r, std::size_t k) {
                        return is_positive(first + r, k) ? gradient(first + r, k) : T(0);
                    },
                    [&](std::size_t k, unsigned c) {
                        return k < width && begin + c < width ? matrix[k * width + begin + c] : T(0);
                    },
                    dx);
            }
            if (neurons.empty())
                store(row, column, dx);
            else
                sum_rows(shared, row, column, dx);
        }
    }

private:
    [[nodiscard]] __device__ T gradient(std::size_t row, std::size_t k) const {
        if (row >= rows || k >= width) return T(0);
        return last.empty() ? dL_dy[row * width + k] : dL_dlogits[row] * last[k];
    }
    [[nodiscard]] __device__ bool is_positive(std::size_t row, std::size_t k) const {
        return row < rows && k < width && (signs[row * ((width + 3) / 4) + k / 4] >> k % 4 & 1u);
    }
    __device__ void store(std::size_t row, std::size_t column, const typename Product::Sums& dx) const {
        for (unsigned r = 0; r < 8; ++r)
            for (unsigned c = 0; c < 4; ++c)
                if (row + r < rows && column + c < width) dL_dx[(row + r) * width + column + c] = dx[r][c];
    }
    /// Of the thread's rows, then of all threads with the same columns, in their order.
    __device__ void sum_rows(Shared& shared, std::size_t row, std::size_t column,
                             const typename Product::Sums& dx) const {
        Four<T> sum{};
        for (unsigned r = 0; r < 8; ++r)
            for (unsigned c = 0; c < 4; ++c)
                if (row + r < rows && column + c < width &&
                    neurons[(row + r) * width + column + c] + pose[column + c] > T(0))
                    sum.v[c] += dx[r][c];
        static_assert(block_size <= Product::depth * Product::left_pitch);
        __syncthreads(); // the product has been read
        shared.left[threadIdx.x] = sum;
        __syncthreads();
        if (threadIdx.x < 16) {
            for (unsigned t = threadIdx.x + 16; t < block_size; t += 16) {
                const Four<T> other = shared.left[t];
                for (unsigned c = 0; c < 4; ++c) sum.v[c] += other.v[c];
            }
            for (unsigned c = 0; c < 4; ++c)
                if (column + c < width) partials[(column + c) * gridDim.x + blockIdx.x] = sum.v[c];
        }
    }
};

/// One block for each neuron: adds the sums of all blocks of OcclusionLayerBackward.
template <class T>
struct JoinPose {
    static constexpr unsigned block_size = 256;
    struct Shared {
        SharedArray<T, block_size / warp_size> warps;
    };
    Span<const T> partials; // [W, blocks]
    Span<T> dL_dpose;       // [W]
    std::size_t blocks;

    __device__ void operator()(Shared& shared) const {
        T sum(0);
        for (std::size_t b = threadIdx.x; b < blocks; b += block_size) sum += partials[blockIdx.x * blocks + b];
        sum = block_sum<block_size>(shared.warps, sum);
        if (threadIdx.x == 0) dL_dpose[blockIdx.x] += sum;
    }
};

} // namespace detail

/// logits[i] = network(relu(neurons[i] + pose)). One kernel for each hidden layer after the first, so one in all for
/// the usual two; the last of them computes the output, too.
template <class Network, class T>
void occlusion_forward(Device& device, const Network& network, Span<const T> weights, Span<const T> neurons,
                       Span<const T> pose, Span<T> logits, OcclusionFieldScratch<Device, T>& scratch) {
    using Kernel = detail::OcclusionLayer<T>;
    const std::size_t rows = logits.size(), W = pose.size(), layers = network.layer_count() - 1;
    const std::size_t blocks = chunk_count(rows, Kernel::Product::rows), signs = rows * chunk_count(W, 4);
    scratch.signs.resize(layers * signs);
    for (auto& values : scratch.values) values.resize(layers > 1 ? rows * W : 0);
    const Span<const T> last = weights.subspan(network.layer_offset(layers), W);
    if (layers == 0) device.launch(blocks, Kernel{neurons, pose, {}, last, logits, {}, {}, rows, W});
    for (std::size_t l = 0; l < layers; ++l) {
        const bool ends = l + 1 == layers;
        Kernel kernel{neurons, pose, weights.subspan(network.layer_offset(l), W * W), {}, {}, {}, {}, rows, W};
        if (l > 0) kernel.from = scratch.values[(l - 1) % 2], kernel.pose = {};
        if (ends)
            kernel.last = last, kernel.logits = logits;
        else
            kernel.values = scratch.values[l % 2];
        kernel.signs = Span<std::uint8_t>(scratch.signs).subspan(l * signs, signs);
        device.launch(blocks, kernel);
    }
}

/// Adjoint with respect to the contribution of the pose: adds to dL_dpose [W]. scratch is that of forward.
template <class Network, class T>
void occlusion_backward(Device& device, const Network& network, Span<const T> weights, Span<const T> neurons,
                        Span<const T> pose, Span<const T> dL_dlogits, OcclusionFieldScratch<Device, T>& scratch,
                        Span<T> dL_dpose) {
    using Kernel = detail::OcclusionLayerBackward<T>;
    const std::size_t rows = dL_dlogits.size(), W = pose.size(), layers = network.layer_count() - 1;
    const std::size_t blocks = chunk_count(rows, Kernel::Product::rows), signs = rows * chunk_count(W, 4);
    if (blocks == 0) return;
    scratch.partials.resize(W * blocks);
    const Span<const T> last = weights.subspan(network.layer_offset(layers), W);
    if (layers == 0)
        device.launch(blocks, Kernel{dL_dlogits, last, {}, {}, {}, neurons, pose, {}, scratch.partials, rows, W});
    for (std::size_t l = layers; l-- > 0;) {
        Kernel kernel{{}, {}, {}, {}, weights.subspan(network.layer_offset(l), W * W), {}, {}, {}, {}, rows, W};
        if (l + 1 == layers)
            kernel.dL_dlogits = dL_dlogits, kernel.last = last;
        else
            kernel.dL_dy = scratch.values[(l + 1) % 2];
        if (l > 0)
            kernel.dL_dx = scratch.values[l % 2];
        else
            kernel.neurons = neurons, kernel.pose = pose, kernel.partials = scratch.partials;
        kernel.signs = Span<const std::uint8_t>(Span<std::uint8_t>(scratch.signs)).subspan(l * signs, signs);
        device.launch(blocks, kernel);
    }
    device.launch(W, detail::JoinPose<T>{scratch.partials, dL_dpose, blocks});
}

} // namespace cuda

} // namespace gsh
