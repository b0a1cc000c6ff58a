// SPDX-License-Identifier: Apache-2.0
/// @file  The contribution of a pose to the neurons of the field of ambient occlusion on the GPU, by warps.
#pragma once

#include <gsh/avatar/occlusion_field.hpp>
#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/backend/cuda/reduce.cuh>

#include <cstddef>

namespace gsh::cuda {

namespace detail {

/// A warp for each neuron.
template <class T>
struct PoseOfNeuronsByWarps {
    static constexpr unsigned block_size = 128;
    gsh::detail::PoseOfNeurons<T> element;

    __device__ void operator()() const {
        const std::size_t o = (std::size_t(blockIdx.x) * block_size + threadIdx.x) / warp_size;
        const std::size_t count = element.feature.size();
        if (o >= element.sums.size()) return;
        T sum(0);
        for (std::size_t c = threadIdx.x % warp_size; c < count; c += warp_size)
            sum += element.weights[o * count + c] * element.feature[c];
        sum = warp_sum(sum);
        if (threadIdx.x % warp_size == 0) element.sums[o] = sum;
    }
};

/// A block for 32 numbers of the pose. Its warps share the neurons.
template <class T>
struct PoseOfNeuronsBackwardByWarps {
    static constexpr unsigned block_size = 256, warps = block_size / warp_size;
    struct Shared {
        SharedArray<T, block_size> sums;
    };
    gsh::detail::PoseOfNeuronsBackward<T> element;

    __device__ void operator()(Shared& shared) const {
        const std::size_t count = element.dL_dfeature.size();
        const std::size_t c = std::size_t(blockIdx.x) * warp_size + threadIdx.x % warp_size;
        T sum(0);
        for (std::size_t o = threadIdx.x / warp_size; c < count && o < element.dL_dsums.size(); o += warps)
            sum += element.weights[o * count + c] * element.dL_dsums[o];
        shared.sums[threadIdx.x] = sum;
        __syncthreads();
        if (threadIdx.x >= warp_size || c >= count) return;
        for (unsigned warp = 1; warp < warps; ++warp) {
            const T other = shared.sums[warp * warp_size + threadIdx.x];
            sum += other;
        }
        element.dL_dfeature[c] += sum;
    }
};

} // namespace detail

template <class T>
void pose_of_neurons(Device& device, const gsh::detail::PoseOfNeurons<T>& element) {
    using Kernel = detail::PoseOfNeuronsByWarps<T>;
    device.launch(chunk_count(element.sums.size() * warp_size, Kernel::block_size), Kernel{element});
}

template <class T>
void pose_of_neurons_backward(Device& device, const gsh::detail::PoseOfNeuronsBackward<T>& element) {
    device.launch(chunk_count(element.dL_dfeature.size(), warp_size), detail::PoseOfNeuronsBackwardByWarps<T>{element});
}

} // namespace gsh::cuda
