// SPDX-License-Identifier: Apache-2.0
/// @file  Blend shapes on the GPU: both passes stream the directions once, at the speed of memory.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/reduce.cuh>
#include <gsh/backend/cuda/unroll.cuh>
#include <gsh/body/blend_shapes.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstddef>

namespace gsh {

template <std::floating_point T>
struct BlendShapesScratch<cuda::Device, T> {
    cuda::Device::Buffer<T> partials; ///< [C, chunks] each chunk's sums
};

namespace cuda {

namespace detail {

/// offsets[n] += Σ_k coefficients[k] directions[k, n], all of them numbers.
///
/// A mesh has too few numbers for a thread each to keep memory busy. Each warp of a block therefore takes every eighth
/// direction, for the same 64 numbers, and the block joins their sums. A thread has 16 loads on their way at a time.
/// They are of four bytes: a direction has 3 V numbers and seldom begins at a multiple of 16 bytes.
template <class T>
struct BlendShapesForward {
    static constexpr unsigned block_size = 256, warps = block_size / warp_size;
    static constexpr int batch = 8, columns = 2; // directions that are loaded together, and numbers of a thread
    static constexpr unsigned numbers = columns * warp_size;
    struct Shared {
        SharedArray<T, warps * numbers> sums;
    };
    Span<const T> directions, coefficients;
    Span<T> offsets;

    __device__ void operator()(Shared& shared) const {
        const unsigned warp = threadIdx.x / warp_size, lane = threadIdx.x % warp_size;
        const std::size_t first = std::size_t(blockIdx.x) * numbers, N = offsets.size();
        T sums[columns] = {};
        for (std::size_t k = warp; k < coefficients.size(); k += batch * warps) {
            T c[batch], d[batch][columns];
            unrolled<batch>([&]<int b>() {
                const std::size_t direction = k + b * warps;
                c[b] = direction < coefficients.size() ? coefficients[direction] : T(0);
            });
            unrolled<batch>([&]<int b>() {
                unrolled<columns>([&]<int i>() {
                    const std::size_t n = first + i * warp_size + lane;
                    const bool needed =
                        n < N && c[b] != T(0); // a zero coefficient, as of a face at rest, costs nothing
                    d[b][i] = needed ? directions[(k + b * warps) * N + n] : T(0);
                });
            });
            unrolled<batch>([&]<int b>() { unrolled<columns>([&]<int i>() { sums[i] += c[b] * d[b][i]; }); });
        }
        for (unsigned i = 0; i < columns; ++i) shared.sums[warp * numbers + i * warp_size + lane] = sums[i];
        __syncthreads();
        const std::size_t n = first + threadIdx.x;
        if (threadIdx.x >= numbers || n >= N) return;
        T sum(0);
        for (unsigned w = 0; w < warps; ++w) {
            const T of_warp = shared.sums[w * numbers + threadIdx.x];
            sum += of_warp;
        }
        offsets[n] += sum;
    }
};

/// partials[k, chunk] = Σ_n directions[k, n] gradient[n] over a chunk of numbers. A block has one chunk, which each of
/// its warps keeps in registers, and some directions.
template <class T>
struct BlendShapesBackward {
    static constexpr unsigned block_size = 256, warps = block_size / warp_size;
    static constexpr unsigned least_blocks = 3;
    static constexpr int of_lane = 96 / sizeof(T);            // numbers: 48 registers for them and their gradients
    static constexpr std::size_t chunk = of_lane * warp_size; // numbers of a block
    static constexpr std::size_t group = 4 * warps;           // directions of a block
    Span<const T> directions, gradient;
    Span<T> partials;
    std::size_t coefficients, chunks;

    __device__ void operator()() const {
        const std::size_t N = gradient.size(), first = blockIdx.x % chunks * chunk + threadIdx.x % warp_size;
        const std::size_t group_begin = blockIdx.x / chunks * group + threadIdx.x / warp_size;
        T g[of_lane];
        unrolled<of_lane>([&]<int i>() {
            const std::size_t n = first + i * warp_size;
            g[i] = n < N ? gradient[n] : T(0);
        });
        for (std::size_t k = group_begin; k < coefficients && k < group_begin + group; k += warps) { // for a whole warp
            T d[of_lane], sum(0);
            unrolled<of_lane>([&]<int i>() {
                const std::size_t n = first + i * warp_size;
                d[i] = n < N ? directions[k * N + n] : T(0);
            });
            unrolled<of_lane>([&]<int i>() { sum += d[i] * g[i]; });
            sum = warp_sum(sum);
            if (threadIdx.x % warp_size == 0) partials[k * chunks + blockIdx.x % chunks] = sum;
        }
    }
};

/// dL_dcoefficients[k] += Σ of the partials of k, by one warp each.
template <class T>
struct BlendShapesJoin {
    static constexpr unsigned block_size = 256, warps = block_size / warp_size;
    Span<const T> partials;
    Span<T> dL_dcoefficients;
    std::size_t chunks;

    __device__ void operator()() const {
        const std::size_t k = std::size_t(blockIdx.x) * warps + threadIdx.x / warp_size;
        if (k >= dL_dcoefficients.size()) return; // a whole warp
        T sum(0);
        for (std::size_t chunk = threadIdx.x % warp_size; chunk < chunks; chunk += warp_size)
            sum += partials[k * chunks + chunk];
        sum = warp_sum(sum);
        if (threadIdx.x % warp_size == 0) dL_dcoefficients[k] += sum;
    }
};

} // namespace detail

/// offsets[v] += Σ_k coefficients[k] directions[k, v].
template <std::floating_point T>
void blend_shapes_forward(Device& device, Span<const vec3<T>> directions, Span<const T> coefficients,
                          Span<vec3<T>> offsets) {
    using Kernel = detail::BlendShapesForward<T>;
    const Kernel kernel{view_as<const T>(directions), coefficients, view_as<T>(offsets)};
    device.launch(chunk_count(kernel.offsets.size(), Kernel::numbers), kernel);
}

/// dL_dcoefficients[k] += Σ_v <directions[k, v], dL_doffsets[v]>.
template <std::floating_point T>
void blend_shapes_backward(Device& device, Span<const vec3<T>> directions, Span<const vec3<T>> dL_doffsets,
                           Span<T> dL_dcoefficients, BlendShapesScratch<Device, T>& scratch) {
    using Kernel = detail::BlendShapesBackward<T>;
    using Join = detail::BlendShapesJoin<T>;
    const std::size_t C = dL_dcoefficients.size(), chunks = chunk_count(3 * dL_doffsets.size(), Kernel::chunk);
    scratch.partials.resize(C * chunks);
    device.launch(chunks * chunk_count(C, Kernel::group),
                  Kernel{view_as<const T>(directions), view_as<const T>(dL_doffsets), scratch.partials, C, chunks});
    device.launch(chunk_count(C, Join::warps), Join{scratch.partials, dL_dcoefficients, chunks});
}

} // namespace cuda

} // namespace gsh
