// SPDX-License-Identifier: Apache-2.0
/// @file  Fourth stage of the rasterizer on a GPU: blends each tile's list and writes the images.
///
/// A list of up to blended_at_once entries is the work of one thread block. A longer one is blended in segments, all at
/// once, in three launches:
///
/// 1. SegmentProducts computes the product of (1 - alpha) over each segment, but for the last of a list.
/// 2. BlendTiles blends each segment. It begins with the product of the segments in front.
/// 3. JoinSegments sums over the segments.
///
/// The first launch is additional work, but no thread block has more than one segment of it.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/render/cuda/pixel_sums.cuh>
#include <gsh/render/cuda/raster_scratch.cuh>
#include <gsh/render/cuda/segments.cuh>
#include <gsh/render/cuda/tile.cuh>
#include <gsh/render/target.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>

namespace gsh::cuda::detail {

/// A thread block's way through a segment, front to back, with one thread per pixel. A batch of the list is staged in
/// shared memory; then each half warp visits those splats that may touch its block of pixels.
template <std::floating_point T>
struct ListSweep {
    static constexpr unsigned batch = 256;
    using Lists = BlockLists<batch, std::uint16_t>;
    struct Shared {
        SharedArray<TileSplat<T>, batch + 1> splats; // the last one pads lists
        SharedArray<std::uint16_t, batch> touched;
        Lists lists;
    };

    Span<const TileInstance> instances;
    Span<const ScreenSplat<T>> screen;
    BlendLimits<T> limits;

    /// Calls blend(splat) until `product`, which it lowers, is below the limit at all pixels. After each batch, calls
    /// visited(entry, word) on lane g of each half warp: bit i of `word` is set where the splat of entry + i came to
    /// the half's block before all of its pixels had stopped. Returns the number of entries that were read.
    template <class Blend, class Visited>
    __device__ std::uint32_t operator()(Shared& shared, const TilePixel& pixel, const Segment& segment,
                                        const T& product, const Blend& blend, const Visited& visited) const {
        if (threadIdx.x == 0) shared.splats[batch] = TileSplat<T>::none();
        std::uint32_t entry = segment.from;
        TileInstance instance = instance_at(segment, entry);
        while (entry < segment.to && __syncthreads_or(product >= limits.transmittance_min) != 0) {
            const std::uint32_t size = segment.to - entry < batch ? segment.to - entry : batch;
            std::uint32_t touched = 0;
            if (threadIdx.x < size) {
                const TileSplat<T> splat(screen[instance.splat], pixel);
                touched = splat.touched();
                shared.splats[threadIdx.x] = splat;
            }
            shared.touched[threadIdx.x] = static_cast<std::uint16_t>(touched);
            __syncthreads();
            instance = instance_at(segment, entry + size); // of the next batch, while this one is blended
            const std::uint32_t word = blend_batch(shared, pixel, product, blend);
            if (pixel.lane < (size + 31) / 32) visited(entry + 32 * pixel.lane, word);
            entry += size;
        }
        return entry - segment.from;
    }

private:
    [[nodiscard]] __device__ TileInstance instance_at(const Segment& segment, std::uint32_t entry) const {
        const std::uint32_t i = entry + threadIdx.x;
        return i < segment.to ? instances[segment.list + i] : TileInstance{0, 0};
    }

    /// Returns, on lane g of each half warp, the word of the splats 32 g, 32 g + 1, … of the batch.
    template <class Blend>
    __device__ std::uint32_t blend_batch(Shared& shared, const TilePixel& pixel, const T& product,
                                         const Blend& blend) const {
        const auto touched = [&](unsigned j) -> std::uint32_t { return shared.touched[j]; };
        typename Lists::List list = shared.lists.make(
            touched, [](unsigned j, unsigned) { return static_cast<std::uint16_t>(j); }, std::uint16_t(batch));
        const auto accepts = [&] { return __ballot_sync(all_lanes, product >= limits.transmittance_min); };
        unsigned votes = accepts(), end = pixel.in_half(votes) ? list.padded : 0;
        for (unsigned k = 0; k < list.padded && votes != 0; k += Lists::unroll) {
            for (unsigned q = 0; q < Lists::unroll; ++q) blend(shared.splats[shared.lists.at(pixel.block, k + q)]);
            votes = accepts();
            if (!pixel.in_half(votes) && end > k + Lists::unroll) end = k + Lists::unroll;
        }
        if (__any_sync(all_lanes, end < list.length) != 0) shared.lists.cut(touched, end, list);
        return list.word;
    }
};

/// The product of (1 - alpha) of further segments: at place k, for the k-th, of the segment in front of it.
template <std::floating_point T>
struct SegmentProducts {
    static constexpr unsigned block_size = tile_pixels;
    static constexpr unsigned least_blocks = sizeof(T) == 8 ? 1 : 4;
    using Shared = typename ListSweep<T>::Shared;

    TileGrid grid;
    Span<const std::uint32_t> refused;
    Segments segments;
    ListSweep<T> sweep;
    Span<T> products; // [further segments, 256]

    __device__ void operator()(Shared& shared) const {
        Segment segment;
        if (refused[0] != 0 || !segments.find(blockIdx.x, segment)) return;
        segment.to = segment.from, segment.from -= segments.size;
        const TilePixel pixel(grid, segment.tile);
        T product = pixel.inside ? T(1) : T(0);
        const auto blend = [&](const TileSplat<T>& s) {
            product = BlendStep<T>(s, sweep.limits, static_cast<T>(pixel.x), static_cast<T>(pixel.y), product).after;
        };
        (void)sweep(shared, pixel, segment, product, blend, [](std::uint32_t, std::uint32_t) {});
        products[std::size_t(blockIdx.x) * tile_pixels + threadIdx.x] = product;
    }

    /// The product of the segments in front of further segment k + 1, given that in front of further segment k.
    [[nodiscard]] __device__ static T next(T product, Span<const T> products, std::uint32_t k) {
        return gsh::detail::next_product(product, products[std::size_t(k) * tile_pixels + threadIdx.x]);
    }
};

/// One thread block per segment.
///
/// `used` tells the backward pass which splats came to which block, so that it neither finds the blocks again nor
/// visits what is behind opaque ones.
template <std::floating_point T, bool Depth>
struct BlendTiles {
    static constexpr unsigned block_size = tile_pixels;
    static constexpr unsigned least_blocks = sizeof(T) == 8 ? 1 : Depth ? 3 : 4;
    using Shared = typename ListSweep<T>::Shared;
    using Sums = PixelSums<T, Depth>;

    TileGrid grid;
    Span<const std::uint32_t> refused;
    Segments segments;
    ListSweep<T> sweep;
    Span<const T> products;
    Background<T> background;
    RenderTarget<T> target;
    Span<std::uint32_t> segment_used, used;
    Span<T> pixels;

    __device__ void operator()(Shared& shared) const {
        Segment segment;
        if (refused[0] != 0 || !segments.find(blockIdx.x, segment)) return;
        const TilePixel pixel(grid, segment.tile);
        T product = pixel.inside ? T(1) : T(0);
        const std::uint32_t first = segments.further_begin[segment.tile];
        for (std::uint32_t k = 0; k < segment.number; ++k)
            product = SegmentProducts<T>::next(product, products, first + k);
        Sums sums;
        if (product >= sweep.limits.transmittance_min) sums.transmittance = product;
        const auto visited = [&](std::uint32_t entry, std::uint32_t word) {
            const std::size_t group = RasterScratch<Device, T>::group_begin(segment.tile, segment.list) + entry / 32;
            used[group * blocks_of_tile + pixel.block] = word;
        };
        const std::uint32_t read = sweep(
            shared, pixel, segment, product, [&](const TileSplat<T>& s) { blend(s, pixel, product, sums); }, visited);
        if (threadIdx.x == 0) segment_used[segment.place] = read;
        if (segment.length != 0) sums.store(pixels, segment.place);
        if (segment.length <= segments.size) sums.show(pixel, background, target);
    }

private:
    /// C += T alpha c,  T *= 1 - alpha,  unless that would take T below the limit. `product` is of (1 - alpha) of all
    /// splats so far, `sums` are of those that were blended.
    __device__ void blend(const TileSplat<T>& s, const TilePixel& pixel, T& product, Sums& sums) const {
        const T before = product;
        const BlendStep<T> step(s, sweep.limits, static_cast<T>(pixel.x), static_cast<T>(pixel.y), before);
        product = step.after;
        sums.transmittance = step.live ? step.after : sums.transmittance;
        sums.red = multiply_add(step.weight, s.red, sums.red);
        sums.green = multiply_add(step.weight, s.green, sums.green);
        sums.blue = multiply_add(step.weight, s.blue, sums.blue);
        if constexpr (Depth) {
            sums.depth = multiply_add(step.weight, s.depth, sums.depth);
            sums.median = is_median(step, sums.median != T(0)) ? s.depth : sums.median;
        }
    }
};

/// One thread block per tile: sums over the segments of a long list, and leaves at each further one the sums of what
/// lies in front of it, with the product that it began with.
///
/// A pixel that stopped in front of a segment has there a transmittance of 1, so the least one is that of the list.
template <std::floating_point T, bool Depth>
struct JoinSegments {
    static constexpr unsigned block_size = tile_pixels;
    using Sums = PixelSums<T, Depth>;

    TileGrid grid;
    Span<const std::uint32_t> refused;
    Segments segments;
    Span<const T> products;
    Background<T> background;
    RenderTarget<T> target;
    Span<T> pixels;

    __device__ void operator()() const {
        if (refused[0] != 0) return;
        const std::uint32_t tile = segments.tile_order[blockIdx.x];
        const std::uint32_t first = segments.further_begin[tile], end = segments.further_begin[tile + 1];
        if (first == end) return;
        const TilePixel pixel(grid, tile);
        const std::size_t tiles = segments.tile_order.size();
        Sums sums = Sums::load(pixels, tile);
        T product = pixel.inside ? T(1) : T(0);
        for (std::uint32_t k = first; k < end; ++k) {
            const Sums of_segment = Sums::load(pixels, tiles + k);
            product = SegmentProducts<T>::next(product, products, k);
            Sums in_front = sums;
            in_front.transmittance = product;
            in_front.store(pixels, tiles + k);
            sums.red += of_segment.red, sums.green += of_segment.green, sums.blue += of_segment.blue;
            sums.depth += of_segment.depth;
            if (of_segment.transmittance < sums.transmittance) sums.transmittance = of_segment.transmittance;
            if (sums.median == T(0)) sums.median = of_segment.median;
        }
        sums.store(pixels, tile);
        sums.show(pixel, background, target);
    }
};

} // namespace gsh::cuda::detail
