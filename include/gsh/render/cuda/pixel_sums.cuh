// SPDX-License-Identifier: Apache-2.0
/// @file  What a pixel has gathered from its splats, kept for the backward pass, and how it becomes the images.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/image/image.hpp>
#include <gsh/render/arithmetic.hpp>
#include <gsh/render/blend.hpp>
#include <gsh/render/cuda/raster_scratch.cuh>
#include <gsh/render/cuda/tile.cuh>
#include <gsh/render/target.hpp>

#include <concepts>
#include <cstddef>

namespace gsh::cuda::detail {

/// Whether a splat's depth is the median of its pixel, which has one or not yet.
///
/// The product in front of a segment is rounded in another way than the one at the end of the segment before. If 1/2
/// lies between the two, no splat takes the product from above to below it, and the first one behind is the median.
template <std::floating_point T>
[[nodiscard]] __device__ bool is_median(const BlendStep<T>& step, bool has_median) {
    return !has_median && step.after <= T(0.5) && step.alpha > T(0) && step.live;
}

/// Sums over the splats that a pixel blends. With C = sum w c, D = sum w z, transmittance T; the median is the depth at
/// which T falls to 1/2, or 0.
///
/// In memory, [segment, channel, 256]: what one thread block has blended. Of a list with several segments, the first
/// one has the sums of the whole list once all are blended (JoinSegments). Each further one then has the sums of what
/// lies in front of it, where the backward pass begins.
template <std::floating_point T, bool Depth>
struct PixelSums {
    static constexpr std::size_t channels = Depth ? 6 : 4;

    T red = 0, green = 0, blue = 0, transmittance = 1, depth = 0, median = 0;

    [[nodiscard]] __device__ static PixelSums load(Span<const T> pixels, std::size_t segment) {
        const auto at = [&](std::size_t channel) { return pixels[place(segment, channel)]; };
        PixelSums sums{at(0), at(1), at(2), at(3), T(0), T(0)};
        if constexpr (Depth) sums.depth = at(4), sums.median = at(5);
        return sums;
    }
    __device__ void store(Span<T> pixels, std::size_t segment) const {
        const auto to = [&](std::size_t channel) -> T& { return pixels[place(segment, channel)]; };
        to(0) = red, to(1) = green, to(2) = blue, to(3) = transmittance;
        if constexpr (Depth) to(4) = depth, to(5) = median;
    }
    /// Writes the pixel of the images.
    __device__ void show(const TilePixel& pixel, const Background<T>& background, const RenderTarget<T>& target) const {
        if (!pixel.inside) return;
        const std::size_t plane = target.color.plane_size(), p = pixel.index;
        const T color[3] = {red, green, blue};
        for (int c = 0; c < 3; ++c) {
            const std::size_t at = static_cast<std::size_t>(c) * plane + p;
            const T behind = background.image.data.empty() ? background.color[c] : background.image.data[at];
            target.color.data[at] = multiply_add(transmittance, behind, color[c]);
        }
        if (!target.alpha.data.empty()) target.alpha.data[p] = T(1) - transmittance;
        if constexpr (Depth) {
            if (!target.expected_depth.data.empty()) target.expected_depth.data[p] = depth;
            if (!target.median_depth.data.empty()) target.median_depth.data[p] = median;
        }
    }

private:
    [[nodiscard]] __device__ static std::size_t place(std::size_t segment, std::size_t channel) {
        return (segment * channels + channel) * tile_pixels + threadIdx.x;
    }
};

} // namespace gsh::cuda::detail
