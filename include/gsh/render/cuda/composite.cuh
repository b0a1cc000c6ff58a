// SPDX-License-Identifier: Apache-2.0
/// @file  The rasterizer's forward pass on a GPU.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/render/cuda/bin.cuh>
#include <gsh/render/cuda/blend_tiles.cuh>
#include <gsh/render/cuda/project.cuh>
#include <gsh/render/cuda/raster_scratch.cuh>
#include <gsh/render/cuda/tile_sort.cuh>
#include <gsh/render/target.hpp>

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <type_traits>

namespace gsh::cuda {

namespace detail {

/// First stage: projects, counts, and finds where lists and slots begin.
template <std::floating_point T>
void project_splats(Device& device, const Deferred<Camera<T>>& camera, const SplatView<const T>& splats,
                    const RasterParams<T>& params, RasterCache<Device, T>& cache) {
    RasterScratch<Device, T>& scratch = cache.scratch;
    scratch.grid = {camera.known.width, camera.known.height};
    const std::size_t n = splats.size(), tiles = scratch.grid.size();
    const std::size_t blocks = (n + splats_of_block - 1) / splats_of_block;
    cache.status.resize(1);
    cache.visible.resize(n);
    scratch.refused.resize(1);
    scratch.splats.resize(n);
    scratch.covers.resize(n);
    scratch.slot_begin.resize(n + 1);
    scratch.block_counts.resize(blocks);
    scratch.block_begin.resize(blocks);
    scratch.counters.resize(tiles + tile_classes);
    scratch.tile_begin.resize(tiles + 1);
    scratch.sort_begin.resize(tiles + 1);
    scratch.blend_begin.resize(tiles + 1);
    scratch.tile_end.resize(tiles);
    scratch.tile_order.resize(tiles);

    const Span<std::uint32_t> counters(scratch.counters);
    device.fill(counters, 0u);
    const auto project = [&](auto factored) {
        device.launch(blocks,
                      ProjectSplats<T, decltype(factored)::value>{
                          splats, params, params.alpha_min, scratch.grid, scratch.splats, scratch.covers,
                          scratch.slot_begin, cache.visible, counters.subspan(0, tiles), scratch.block_counts, camera});
    };
    if (splats.is_factored())
        project(std::true_type());
    else
        project(std::false_type());
    const bool deferring = device.deferring();
    device.launch(2, ScanCounts{scratch.block_counts, scratch.block_begin, cache.status, scratch.refused,
                                deferring ? device.halted() : Span<std::uint32_t>{}, params.max_pairs,
                                deferring ? scratch.capacity() : std::numeric_limits<std::uint64_t>::max(),
                                counters.subspan(0, tiles), counters.subspan(tiles, tile_classes), scratch.tile_begin,
                                scratch.tile_end, scratch.tile_order, scratch.sort_begin, scratch.blend_begin});
}

/// Second and third stage: the tile lists.
template <std::floating_point T>
void list_splats(Device& device, RasterCache<Device, T>& cache) {
    RasterScratch<Device, T>& scratch = cache.scratch;
    const Segments segments = scratch.segments_to_sort();
    device.launch(scratch.block_counts.size(),
                  DistributeSplats<T>{scratch.refused, scratch.splats, scratch.covers, scratch.grid,
                                      scratch.block_begin, cache.status, scratch.slot_begin, scratch.tile_end,
                                      scratch.keys, scratch.owners});
    device.launch(segments.blocks(),
                  SortTiles<T>{scratch.refused, segments, scratch.keys, scratch.owners, scratch.instances});
    device.launch(segments.further * MergeTiles<T>::blocks_of_segment,
                  MergeTiles<T>{scratch.refused, segments, scratch.keys, scratch.owners, scratch.instances});
}

/// Fourth stage: the images.
template <bool Depth, std::floating_point T>
void blend_tiles(Device& device, const Background<T>& background, const RasterParams<T>& params,
                 const RenderTarget<T>& target, RasterCache<Device, T>& cache) {
    RasterScratch<Device, T>& scratch = cache.scratch;
    const std::size_t tiles = scratch.grid.size();
    const Segments segments = scratch.segments_to_blend();
    const ListSweep<T> sweep{scratch.instances, scratch.splats, BlendLimits<T>(params)};
    scratch.pixels.resize(segments.blocks() * PixelSums<T, Depth>::channels * tile_pixels);
    scratch.products.resize(segments.further * std::size_t(tile_pixels));
    scratch.segment_used.resize(segments.blocks());
    scratch.used.resize((scratch.capacity() / 32 + tiles + 1) * blocks_of_tile);
    device.launch(segments.further,
                  SegmentProducts<T>{scratch.grid, scratch.refused, segments, sweep, scratch.products});
    device.launch(segments.blocks(),
                  BlendTiles<T, Depth>{scratch.grid, scratch.refused, segments, sweep, scratch.products, background,
                                       target, scratch.segment_used, scratch.used, scratch.pixels});
    device.launch(tiles, JoinSegments<T, Depth>{scratch.grid, scratch.refused, segments, scratch.products, background,
                                                target, scratch.pixels});
}

} // namespace detail

/// Rasterizes; see Rasterizer::forward. If cache.status reports an error, the target is left unchanged.
///
/// Outside of a recorded step the host waits for the number of pairs and enlarges the buffers. Within one they stay as
/// they are, and too many pairs halt the device, as a Gaussian that is not finite does.
template <std::floating_point T>
void composite_forward(Device& device, const Deferred<Camera<T>>& camera, const SplatView<const T>& splats,
                       const Background<T>& background, const RasterParams<T>& params, const RenderTarget<T>& target,
                       RasterCache<Device, T>& cache) {
    detail::project_splats(device, camera, splats, params, cache);
    if (!device.deferring()) {
        RasterStatus status;
        device.download(Span<const RasterStatus>(cache.status), Span<RasterStatus>(&status, 1));
        if (status.nonfinite != 0 || status.pairs > params.max_pairs) return;
        cache.scratch.reserve(status.pairs);
    }
    detail::list_splats(device, cache);
    if (cache.has_depth)
        detail::blend_tiles<true>(device, background, params, target, cache);
    else
        detail::blend_tiles<false>(device, background, params, target, cache);
}

} // namespace gsh::cuda
