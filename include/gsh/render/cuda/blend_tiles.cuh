// SPDX-License-Identifier: Apache-2.0
/// @file  Fourth stage of the rasterizer on a GPU: blends each tile's list and writes the images.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/image/image.hpp>
#include <gsh/render/cuda/raster_scratch.cuh>
#include <gsh/render/cuda/tile.cuh>
#include <gsh/render/target.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>

namespace gsh::cuda::detail {

/// One thread block per tile, long lists first. A batch of the list is staged in shared memory; then each half warp
/// blends those splats that may touch its block of pixels.
///
/// `used` tells the backward pass which splats came to which block, so that it neither finds the blocks again nor
/// visits what is behind opaque ones.
template <std::floating_point T, bool Depth>
struct BlendTiles {
    static constexpr unsigned block_size = tile_pixels;
    static constexpr unsigned least_blocks = sizeof(T) == 8 ? 1 : Depth ? 3 : 4;
    static constexpr unsigned batch = 256;
    using Lists = BlockLists<batch, std::uint16_t>;
    struct Shared {
        SharedArray<TileSplat<T>, batch + 1> splats; // the last one pads lists
        SharedArray<std::uint16_t, batch> touched;
        Lists lists;
    };

    TileGrid grid;
    Span<const std::uint32_t> refused, tile_order, tile_begin;
    Span<const TileInstance> instances;
    Span<const ScreenSplat<T>> screen;
    BlendLimits<T> limits;
    Background<T> background;
    RenderTarget<T> target;
    Span<std::uint32_t> tile_used, used;
    Span<T> pixels; // [tiles, channels, 256]

    __device__ void operator()(Shared& shared) const {
        if (refused[0] != 0) return;
        const TilePixel pixel(grid, tile_order[blockIdx.x]);
        const std::uint32_t begin = tile_begin[pixel.tile], length = tile_begin[pixel.tile + 1] - begin;
        State state;
        state.product = state.transmittance = pixel.inside ? T(1) : T(0);
        if (threadIdx.x == 0) shared.splats[batch] = TileSplat<T>::none();
        std::uint32_t done = 0;
        TileInstance instance = instance_at(begin, length, done);
        while (done < length && __syncthreads_or(state.product >= limits.transmittance_min) != 0) {
            const std::uint32_t size = length - done < batch ? length - done : batch;
            std::uint32_t touched = 0;
            if (threadIdx.x < size) {
                const TileSplat<T> splat(screen[instance.splat], pixel);
                touched = splat.touched();
                shared.splats[threadIdx.x] = splat;
            }
            shared.touched[threadIdx.x] = static_cast<std::uint16_t>(touched);
            __syncthreads();
            instance = instance_at(begin, length, done + size); // of the next batch, while this one is blended
            const std::uint32_t word = blend_batch(shared, pixel, state);
            const std::size_t group = RasterScratch<Device, T>::group_begin(pixel.tile, begin) + done / 32 + pixel.lane;
            if (pixel.lane < (size + 31) / 32) used[group * blocks_of_tile + pixel.block] = word;
            done += size;
        }
        if (threadIdx.x == 0) tile_used[pixel.tile] = done;
        write(pixel, state, length != 0);
    }

private:
    struct State {
        T product;       // of (1 - alpha) of all splats so far
        T transmittance; // of those that were blended
        T red = 0, green = 0, blue = 0, depth = 0, median = 0;
    };

    [[nodiscard]] __device__ TileInstance instance_at(std::uint32_t begin, std::uint32_t length,
                                                      std::uint32_t done) const {
        const std::uint32_t i = done + threadIdx.x;
        return i < length ? instances[begin + i] : TileInstance{0, 0};
    }

    /// Returns, on lane g of each half warp, which of the splats 32 g, 32 g + 1, … came to the half's block before all
    /// of its pixels had stopped.
    __device__ std::uint32_t blend_batch(Shared& shared, const TilePixel& pixel, State& state) const {
        const auto touched = [&](unsigned j) -> std::uint32_t { return shared.touched[j]; };
        typename Lists::List list = shared.lists.make(
            touched, [](unsigned j, unsigned) { return static_cast<std::uint16_t>(j); }, std::uint16_t(batch));
        const auto accepts = [&] { return __ballot_sync(all_lanes, state.product >= limits.transmittance_min); };
        unsigned votes = accepts(), end = pixel.in_half(votes) ? list.padded : 0;
        for (unsigned k = 0; k < list.padded && votes != 0; k += Lists::unroll) {
            for (unsigned q = 0; q < Lists::unroll; ++q) {
                const unsigned j = shared.lists.at(pixel.block, k + q);
                blend(shared.splats[j], pixel, state);
            }
            votes = accepts();
            if (!pixel.in_half(votes) && end > k + Lists::unroll) end = k + Lists::unroll;
        }
        if (__any_sync(all_lanes, end < list.length) != 0) shared.lists.cut(touched, end, list);
        return list.word;
    }

    /// C += T alpha c,  T *= 1 - alpha,  unless that would take T below the limit.
    __device__ void blend(const TileSplat<T>& s, const TilePixel& pixel, State& state) const {
        const T before = state.product;
        const BlendStep<T> step(s, limits, static_cast<T>(pixel.x), static_cast<T>(pixel.y), before);
        state.product = step.after;
        state.transmittance = step.live ? step.after : state.transmittance;
        state.red = multiply_add(step.weight, s.red, state.red);
        state.green = multiply_add(step.weight, s.green, state.green);
        state.blue = multiply_add(step.weight, s.blue, state.blue);
        if constexpr (Depth) {
            const bool crosses = before > T(0.5) && step.after <= T(0.5) && step.live;
            state.depth = multiply_add(step.weight, s.depth, state.depth);
            state.median = crosses ? s.depth : state.median;
        }
    }

    __device__ void write(const TilePixel& pixel, const State& state, bool active) const {
        if (active) { // for the backward pass
            constexpr std::size_t channels = Depth ? 5 : 4;
            const Span<T> to = pixels.subspan(pixel.tile * channels * tile_pixels, channels * tile_pixels);
            const unsigned i = threadIdx.x;
            to[i] = state.red, to[tile_pixels + i] = state.green, to[2 * tile_pixels + i] = state.blue;
            to[3 * tile_pixels + i] = state.transmittance;
            if constexpr (Depth) to[4 * tile_pixels + i] = state.depth;
        }
        if (!pixel.inside) return;
        const std::size_t plane = target.color.plane_size(), p = pixel.index;
        const T color[3] = {state.red, state.green, state.blue};
        for (int c = 0; c < 3; ++c) {
            const std::size_t at = static_cast<std::size_t>(c) * plane + p;
            const T behind = background.image.data.empty() ? background.color[c] : background.image.data[at];
            target.color.data[at] = multiply_add(state.transmittance, behind, color[c]);
        }
        if (!target.alpha.data.empty()) target.alpha.data[p] = T(1) - state.transmittance;
        if constexpr (Depth) {
            if (!target.expected_depth.data.empty()) target.expected_depth.data[p] = state.depth;
            if (!target.median_depth.data.empty()) target.median_depth.data[p] = state.median;
        }
    }
};

} // namespace gsh::cuda::detail
