// SPDX-License-Identifier: Apache-2.0
/// @file  The rasterizer's backward pass on a GPU.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/render/cuda/blend_tiles_backward.cuh>
#include <gsh/render/cuda/project_backward.cuh>
#include <gsh/render/cuda/raster_scratch.cuh>
#include <gsh/render/target.hpp>

#include <concepts>
#include <cstddef>
#include <type_traits>

namespace gsh::cuda {

namespace detail {

/// First stage: each segment of a tile's list writes its share of the gradients of its splats to their slots.
template <bool Depth, std::floating_point T>
void blend_tiles_backward(Device& device, const Background<T>& background, const RasterParams<T>& params,
                          const RenderGradient<T>& dL_dtarget, RasterCache<Device, T>& cache,
                          const BackgroundGradient<T>& dL_dbackground) {
    RasterScratch<Device, T>& scratch = cache.scratch;
    const Segments segments = scratch.segments_to_blend();
    scratch.slots.resize(scratch.capacity());
    scratch.tile_background.resize(dL_dbackground.color.empty() ? 0 : scratch.grid.size());
    device.launch(segments.blocks(), BlendTilesBackward<T, Depth>{
                                         scratch.grid, scratch.refused, segments, scratch.segment_used, scratch.used,
                                         scratch.instances, scratch.splats, scratch.pixels, cache.has_depth,
                                         BlendLimits<T>(params), background, dL_dtarget, dL_dbackground.image,
                                         scratch.tile_background, scratch.slots});
}

/// Second stage: sums the slots of each splat, and carries the gradient through the projection.
template <bool WithCamera, std::floating_point T>
void project_splats_backward(Device& device, const Deferred<Camera<T>>& camera, const SplatView<const T>& splats,
                             const RasterParams<T>& params, RasterCache<Device, T>& cache,
                             const SplatView<T>& dL_dsplats) {
    RasterScratch<Device, T>& scratch = cache.scratch;
    const std::size_t n = splats.size(), blocks = (n + splats_of_block - 1) / splats_of_block;
    cache.screen_gradient_norms.resize(n);
    cache.screen_radii.resize(n);
    scratch.block_camera.resize(WithCamera ? blocks : 0);
    const auto project_backward = [&](auto factored) {
        device.launch(blocks, ProjectSplatsBackward<T, WithCamera, decltype(factored)::value>{
                                  scratch.refused, splats, params, scratch.splats, cache.visible, scratch.slot_begin,
                                  scratch.slots, dL_dsplats, cache.screen_gradient_norms, cache.screen_radii,
                                  scratch.block_camera, camera});
    };
    if (splats.is_factored())
        project_backward(std::true_type());
    else
        project_backward(std::false_type());
}

} // namespace detail

/// Adjoint of composite_forward; see Rasterizer::backward. Adds nothing if the forward pass was refused.
template <std::floating_point T>
void composite_backward(Device& device, const Deferred<Camera<T>>& camera, const SplatView<const T>& splats,
                        const Background<T>& background, const RasterParams<T>& params,
                        const RenderGradient<T>& dL_dtarget, RasterCache<Device, T>& cache,
                        const SplatView<T>& dL_dsplats, Span<CameraGradient<T>> dL_dcamera,
                        const BackgroundGradient<T>& dL_dbackground) {
    RasterScratch<Device, T>& scratch = cache.scratch;
    if (!dL_dtarget.has_depth())
        detail::blend_tiles_backward<false>(device, background, params, dL_dtarget, cache, dL_dbackground);
    else
        detail::blend_tiles_backward<true>(device, background, params, dL_dtarget, cache, dL_dbackground);
    if (dL_dcamera.empty())
        detail::project_splats_backward<false>(device, camera, splats, params, cache, dL_dsplats);
    else
        detail::project_splats_backward<true>(device, camera, splats, params, cache, dL_dsplats);
    if (!dL_dcamera.empty() || !dL_dbackground.color.empty())
        device.launch(1, detail::AddSharedGradients<T>{scratch.refused, scratch.tile_background, scratch.block_camera,
                                                       dL_dbackground.color, dL_dcamera});
}

} // namespace gsh::cuda
