// SPDX-License-Identifier: Apache-2.0
/// @file  The rasterizer's forward pass on the CPU.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/math/wide.hpp>
#include <gsh/render/cpu/bin.hpp>
#include <gsh/render/cpu/tile.hpp>
#include <gsh/render/target.hpp>

#include <algorithm>
#include <bit>

namespace gsh::cpu::inline GSH_ISA {

namespace detail {

/// Accumulated values of the blend at the 16 pixels of a block.
template <class T>
struct alignas(64) BlendBlock {
    Lanes<T> product;       ///< of (1 - alpha) of all splats so far
    Lanes<T> transmittance; ///< of those that were blended
    Lanes<T> red, green, blue, depth, median;
};

/// Blends splats of a batch, those of the set bits, into a block:  C += T alpha c,  T *= 1 - alpha,  unless that would
/// take T below the limit. Returns the number of the splat at which no pixel accepts more, or batch_size.
template <bool Depth, class T>
[[nodiscard]] std::size_t blend_block([[maybe_unused]] const Batch<T>& batch, [[maybe_unused]] std::uint64_t splats,
                                      [[maybe_unused]] const BlendLimits<T>& bounds, [[maybe_unused]] std::size_t b,
                                      [[maybe_unused]] BlendBlock<T>& block) {
    std::size_t end = 0;
#if !defined(__CUDA_ARCH__) // in its pass for the device, nvcc parses host code, too, and refuses vectors of registers
    using W = Wide<T>;
    const BlendLimits<T> limits = bounds;
    for (std::size_t l = 0; l < block_lanes; l += W::width) {
        const W x = W::load(&pixel_coordinates<T, false>[b][l]), y = W::load(&pixel_coordinates<T, true>[b][l]);
        W product = W::load(&block.product[l]), transmittance = W::load(&block.transmittance[l]);
        W red = W::load(&block.red[l]), green = W::load(&block.green[l]), blue = W::load(&block.blue[l]);
        W depth = W::load(&block.depth[l]), median = W::load(&block.median[l]);
        std::size_t stop = batch_size;
        for (std::uint64_t bits = splats; bits != 0; bits &= bits - 1) {
            const auto j = static_cast<std::size_t>(std::countr_zero(bits));
            const TileSplat<T> s = batch[j];
            const W before = product;
            const BlendStep<W> step(s, limits, x, y, before);
            product = step.after;
            if (!any(step.live)) {
                stop = j;
                break;
            }
            if constexpr (Depth) {
                const auto crosses = (before > W(T(0.5))) & (step.after <= W(T(0.5))) & step.live;
                depth = multiply_add(step.weight, W(s.depth), depth);
                median = select(crosses, W(s.depth), median);
            }
            transmittance = select(step.live, step.after, transmittance);
            red = multiply_add(step.weight, W(s.red), red);
            green = multiply_add(step.weight, W(s.green), green);
            blue = multiply_add(step.weight, W(s.blue), blue);
        }
        product.store(&block.product[l]), transmittance.store(&block.transmittance[l]);
        red.store(&block.red[l]), green.store(&block.green[l]), blue.store(&block.blue[l]);
        if constexpr (Depth) depth.store(&block.depth[l]), median.store(&block.median[l]);
        end = std::max(end, stop);
    }
#endif
    return end;
}

/// Writes `value(pixel in block order, column, row)` to the pixels of the tile in one channel of an image.
template <class T, class Value>
void write_tile(const TilePlace& tile, const ImageView<T>& image, int channel, const Value& value) {
    for (int y = 0; y < tile.height; ++y) {
        T* const row = image.row(channel, tile.y + y) + tile.x;
        if (tile.is_whole()) // the same with numbers of rounds that the compiler knows
            for (int x = 0; x < TileGrid::tile_size; x += 4) {
                const int first = block_order(x, y);
                for (int i = 0; i < 4; ++i) row[x + i] = value(first + i, x + i, y);
            }
        else
            for (int x = 0; x < tile.width; ++x) row[x] = value(block_order(x, y), x, y);
    }
}

/// Writes color + transmittance * background and the optional planes of a tile.
template <class T, class Channel, class Median>
void write_target(const TilePlace& tile, const Background<T>& background, const RenderTarget<T>& target,
                  const Channel& channel, const Median& median) {
    for (int c = 0; c < 3; ++c) {
        if (background.image.empty()) {
            const T behind = background.color[c];
            write_tile(tile, target.color, c,
                       [&](int p, int, int) { return multiply_add(channel(4, p), behind, channel(c, p)); });
        } else {
            write_tile(tile, target.color, c, [&](int p, int x, int y) {
                return multiply_add(channel(4, p), background.image.at(c, tile.y + y, tile.x + x), channel(c, p));
            });
        }
    }
    if (!target.alpha.empty()) write_tile(tile, target.alpha, 0, [&](int p, int, int) { return 1 - channel(4, p); });
    if (!target.expected_depth.empty())
        write_tile(tile, target.expected_depth, 0, [&](int p, int, int) { return channel(3, p); });
    if (!target.median_depth.empty()) write_tile(tile, target.median_depth, 0, median);
}

/// Blends a tile's list block by block, so that the state of a block stays in registers over the splats of a batch.
/// `used` is, for each block, the length of the part of the list that had an effect; returns the largest. `touched` are
/// the blocks that each splat of that part may touch.
template <bool Depth, class T>
std::uint32_t blend_tile(const TilePlace& tile, Span<const ScreenSplat<T>> splats, Span<const std::uint32_t> list,
                         const BlendLimits<T>& limits, BlendBlock<T>* blocks, std::uint32_t* used,
                         std::uint16_t* touched) {
    std::uint32_t live = 0;
    for (std::size_t b = 0; b < blocks_of_tile; ++b) {
        BlendBlock<T>& block = blocks[b];
        block = {};
        block.product = block.transmittance = initial_transmittance<T>(tile, b);
        live |= (any_reaches(block.product, limits.transmittance_min) ? 1u : 0u) << b;
        used[b] = (live >> b & 1u) != 0 ? static_cast<std::uint32_t>(list.size()) : 0;
    }
    Batch<T> batch;
    for (std::size_t begin = 0; begin < list.size() && live != 0; begin += batch.size) {
        batch.load(splats, list, begin, tile);
        std::uint64_t splats_of[blocks_of_tile];
        batch.find_blocks(touched + begin, splats_of);
        for (std::size_t b = 0; b < blocks_of_tile; ++b) {
            if ((live >> b & 1u) == 0 || splats_of[b] == 0) continue;
            const std::size_t stop = blend_block<Depth>(batch, splats_of[b], limits, b, blocks[b]);
            if (stop == batch_size) continue;
            live &= ~(1u << b);
            used[b] = static_cast<std::uint32_t>(begin + stop);
        }
    }
    return *std::max_element(used, used + blocks_of_tile);
}

} // namespace detail

/// Fourth stage: blends every tile and writes the target.
template <CpuBackend B, std::floating_point T>
void blend_tiles(B& backend, const Background<T>& background, const RasterParams<T>& params,
                 const RenderTarget<T>& target, RasterCache<B, T>& cache) {
    RasterScratch<B, T>& scratch = cache.scratch;
    const bool with_depth = target.has_depth();
    const detail::BlendLimits<T> limits(params);
    const Span<const ScreenSplat<T>> splats = scratch.splats;
    const Span<const std::uint32_t> instances = scratch.instances;
    constexpr std::size_t record = detail::pixel_channels * detail::tile_pixels;
    scratch.pixels.resize(scratch.active_tiles * record);
    scratch.touched.resize(instances.size());
    scratch.block_used.resize(scratch.active_tiles * std::size_t(detail::blocks_of_tile));

    detail::run_queue(backend, scratch.active_tiles, [&](std::size_t rank) {
        const std::uint32_t index = scratch.tile_order[rank], begin = scratch.tile_begin[index];
        const detail::TilePlace tile(scratch.grid, index);
        const Span<const std::uint32_t> list = instances.subspan(begin, scratch.tile_begin[index + 1] - begin);
        detail::BlendBlock<T> blocks[detail::blocks_of_tile];
        std::uint32_t* const used = scratch.block_used.data() + rank * detail::blocks_of_tile;
        std::uint16_t* const touched = scratch.touched.data() + begin;
        scratch.tile_used[index] =
            with_depth ? detail::blend_tile<true>(tile, splats, list, limits, blocks, used, touched)
                       : detail::blend_tile<false>(tile, splats, list, limits, blocks, used, touched);
        T* const pixels = scratch.pixels.data() + rank * record;
        for (int b = 0; b < detail::blocks_of_tile; ++b) {
            const detail::BlendBlock<T>& block = blocks[b];
            const detail::Lanes<T>* const from[] = {&block.red, &block.green, &block.blue, &block.depth,
                                                    &block.transmittance};
            for (int c = 0; c < detail::pixel_channels; ++c)
                std::copy(from[c]->begin(), from[c]->end(), pixels + c * detail::tile_pixels + b * detail::block_lanes);
        }
        detail::write_target(
            tile, background, target, [&](int c, int p) { return pixels[c * detail::tile_pixels + p]; },
            [&](int p, int, int) {
                return blocks[p / detail::block_lanes].median[static_cast<std::size_t>(p % detail::block_lanes)];
            });
    });
    const std::size_t idle = scratch.grid.size() - scratch.active_tiles;
    backend.for_chunks(idle, 64, [&](std::size_t, std::size_t first, std::size_t end) {
        for (std::size_t i = first; i < end; ++i)
            detail::write_target(
                detail::TilePlace(scratch.grid, scratch.tile_order[scratch.active_tiles + i]), background, target,
                [](int c, int) { return c == 4 ? T(1) : T(0); }, [](int, int, int) { return T(0); });
    });
}

/// Rasterizes; see Rasterizer::forward. If cache.status reports an error, the target is left unchanged.
template <CpuBackend B, std::floating_point T>
void composite_forward(B& backend, const Deferred<Camera<T>>& camera, const SplatView<const T>& splats,
                       const Background<T>& background, const RasterParams<T>& params, const RenderTarget<T>& target,
                       RasterCache<B, T>& cache) {
    if (!project_splats(backend, camera(), splats, params, cache)) return;
    bin_splats(backend, sort_by_depth(backend, cache), cache);
    blend_tiles(backend, background, params, target, cache);
}

} // namespace gsh::cpu
