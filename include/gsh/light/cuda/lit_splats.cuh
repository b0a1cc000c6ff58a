// SPDX-License-Identifier: Apache-2.0
/// @file  Vertices and Gaussians under a light on the GPU, one per thread, with sums of the light's gradient by warps.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/backend/cuda/lane_sums.cuh>
#include <gsh/backend/cuda/reduce.cuh>
#include <gsh/core/span.hpp>
#include <gsh/light/light.hpp>
#include <gsh/light/lit_element.hpp>
#include <gsh/light/lit_splats.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstddef>

namespace gsh {

template <std::floating_point T>
struct LitSplatsScratch<cuda::Device, T> {
    cuda::Device::Buffer<T> sums; // [3 P + (P + D) + 2 + 3, warps] points, intensities, gloss, centre
};

namespace cuda {

namespace detail {

using gsh::detail::LitVertexBackward;
using gsh::detail::LitVertexForward;

/// A body has about ten thousand vertices, so blocks are small: then most multiprocessors of a large GPU have one.
inline constexpr unsigned lit_block_size = 64;

template <class T>
struct ShadeVertices {
    static constexpr unsigned block_size = lit_block_size;
    LitVertexForward<T> element;

    __device__ void operator()() const {
        const std::size_t v = std::size_t(blockIdx.x) * block_size + threadIdx.x;
        if (v < element.shading.size()) element(v);
    }
};

/// The sums of one warp's vertices, a column of all sums. What a lane adds is summed over the lanes at once, so a
/// light may have any number of parts without memory in the block.
template <class T>
struct WarpLightSums {
    Span<T> sums; // [size, warps]
    std::size_t warps, warp;

    template <int N>
    __device__ void add(std::size_t first, const T (&values)[N]) const {
        sum_lanes(values, [&](unsigned k, T sum) { sums[(first + k) * warps + warp] = sum; });
    }

    /// Stands for one number of a sum. Each is added to once.
    struct Number {
        const WarpLightSums& sums;
        std::size_t at;
        __device__ void operator+=(T value) const {
            const T values[1] = {value};
            sums.add(at, values);
        }
    };
    struct Vector {
        const WarpLightSums& sums;
        std::size_t at;
        __device__ void operator+=(const vec3<T>& value) const {
            const T values[3] = {value.x, value.y, value.z};
            sums.add(at, values);
        }
    };
    template <class Part, unsigned Width>
    struct Parts {
        const WarpLightSums& sums;
        std::size_t first;
        __device__ Part operator[](std::size_t k) const { return {sums, first + Width * k}; }
    };
};

/// Where each part of a light's gradient begins among the sums.
struct LightSumPlaces {
    std::size_t log_intensities, gloss, center, size;
    GSH_HD LightSumPlaces(std::size_t points, std::size_t lights)
        : log_intensities(3 * points), gloss(log_intensities + lights), center(gloss + 2), size(center + 3) {}
};

template <class T>
struct BackwardVertices {
    static constexpr unsigned block_size = lit_block_size;
    LitVertexBackward<T> element;
    Span<T> sums; // [size, warps]
    std::size_t warps;

    __device__ void operator()() const {
        using Sums = WarpLightSums<T>;
        const std::size_t v = std::size_t(blockIdx.x) * block_size + threadIdx.x, count = element.shading.size();
        const std::size_t lane = threadIdx.x % warp_size;
        const Sums own{sums, warps, v / warp_size};
        const auto& light = element.surface.light;
        const LightSumPlaces places(light.points.size(), light.size());
        const bool seen = v < count && !element.unseen(v);
        const unsigned some = __ballot_sync(all_lanes, seen);
        if (some == 0) {
            for (std::size_t k = lane; k < places.size; k += warp_size) sums[k * warps + own.warp] = T(0);
            return;
        }
        // A lane without a gradient takes part in the sums with zeros, which it computes from a vertex that has one:
        // its own may hold numbers that are not finite.
        const std::size_t at = seen ? v : v - lane + static_cast<std::size_t>(__ffs(static_cast<int>(some)) - 1);
        const LitShading<T> dL_dshading = seen ? element.dL_dshading[at] : LitShading<T>(T(0));
        struct {
            typename Sums::template Parts<typename Sums::Vector, 3> points;
            typename Sums::template Parts<typename Sums::Number, 1> log_intensities, gloss;
        } const of_light{{own, 0}, {own, places.log_intensities}, {own, places.gloss}};
        const LitPoint::Gradient<T> gradient = element.adjoint(at, dL_dshading, of_light);
        typename Sums::Vector{own, places.center} += gradient.center;
        if (seen) element.add(v, gradient);
    }
};

/// One block for each number of the light's gradient: adds the sums of all warps of BackwardVertices.
template <class T>
struct JoinLight {
    static constexpr unsigned block_size = 256;
    struct Shared {
        SharedArray<T, block_size / warp_size> warps;
    };
    Span<const T> sums; // [size, warps]
    std::size_t warps, points, lights;
    LightView<T> dL_dlight; // each part may be empty
    Span<vec3<T>> dL_dcenter;

    __device__ void operator()(Shared& shared) const {
        T* const to = destination();
        if (to == nullptr) return;
        T sum(0);
        for (std::size_t w = threadIdx.x; w < warps; w += block_size) sum += sums[blockIdx.x * warps + w];
        sum = block_sum<block_size>(shared.warps, sum);
        if (threadIdx.x == 0) *to += sum;
    }

private:
    [[nodiscard]] __device__ T* destination() const {
        const LightSumPlaces places(points, lights);
        const auto number = [](Span<T> part, std::size_t k) { return part.empty() ? nullptr : &part[k]; };
        const std::size_t k = blockIdx.x;
        if (k < places.log_intensities) return number(view_as<T>(dL_dlight.points), k);
        if (k < places.gloss) return number(dL_dlight.log_intensities, k - places.log_intensities);
        if (k < places.center) return number(dL_dlight.gloss, k - places.gloss);
        return number(view_as<T>(dL_dcenter), k - places.center);
    }
};

} // namespace detail

template <class T>
void lit_vertices_shade(Device& device, const gsh::detail::LitVertexForward<T>& element) {
    using Kernel = detail::ShadeVertices<T>;
    device.launch(chunk_count(element.shading.size(), Kernel::block_size), Kernel{element});
}

/// Adds the adjoints of all vertices with a gradient. Each warp sums its vertices; a second kernel adds the warps, in
/// fixed order.
template <class T>
void lit_vertices_accumulate(Device& device, const gsh::detail::LitVertexBackward<T>& element,
                             const LightView<T>& dL_dlight, Span<vec3<T>> dL_dcenter,
                             LitSplatsScratch<Device, T>& scratch) {
    using Kernel = detail::BackwardVertices<T>;
    const auto& light = element.surface.light;
    const std::size_t blocks = chunk_count(element.shading.size(), Kernel::block_size);
    if (blocks == 0) return;
    const std::size_t warps = blocks * (Kernel::block_size / warp_size);
    const detail::LightSumPlaces places(light.points.size(), light.size());
    scratch.sums.resize(places.size * warps);
    device.launch(blocks, Kernel{element, scratch.sums, warps});
    if (dL_dlight.points.empty() && dL_dlight.log_intensities.empty() && dL_dlight.gloss.empty() && dL_dcenter.empty())
        return;
    device.launch(places.size,
                  detail::JoinLight<T>{scratch.sums, warps, light.points.size(), light.size(), dL_dlight, dL_dcenter});
}

} // namespace cuda

} // namespace gsh
