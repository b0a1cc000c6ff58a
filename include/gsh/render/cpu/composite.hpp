// SPDX-License-Identifier: Apache-2.0
/// @file  The rasterizer's forward pass on the CPU.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/render/cpu/bin.hpp>
#include <gsh/render/cpu/tile.hpp>
#include <gsh/render/target.hpp>

#include <algorithm>
#include <bit>

namespace gsh::cpu {

namespace detail {

/// The blend's state at the 16 pixels of a block.
template <class T>
struct alignas(64) BlendBlock {
    Lanes<T> transmittance, cut, red, green, blue, depth, median;
};

/// Blends one splat into one block:  C += T alpha c,  T *= 1 - alpha,  unless that would take T below the limit.
template <bool Depth, class T>
inline void blend(const BlockSplat<T>& s, const BlendLimits<T>& limits, BlendBlock<T>& block) {
    for (std::size_t l = 0; l < block_lanes; ++l) {
        T u, v;
        const T raw = splat_alpha(s, lane_x<T>[l], lane_y<T>[l], u, v);
        const T capped = raw < limits.alpha_max ? raw : limits.alpha_max;
        const T before = block.transmittance[l], cut = block.cut[l];
        const T alpha = raw >= cut ? capped : T(0);
        const T after = multiply_add(-alpha, before, before);
        const bool stop = after < limits.transmittance_min;
        const T weight = stop ? T(0) : alpha * before;
        block.cut[l] = stop ? std::numeric_limits<T>::infinity() : cut;
        block.transmittance[l] = stop ? before : after;
        block.red[l] = multiply_add(weight, s.red, block.red[l]);
        block.green[l] = multiply_add(weight, s.green, block.green[l]);
        block.blue[l] = multiply_add(weight, s.blue, block.blue[l]);
        if constexpr (Depth) {
            const bool crosses = (before > T(0.5)) & (after <= T(0.5)) & !stop;
            block.depth[l] = multiply_add(weight, s.depth, block.depth[l]);
            block.median[l] = crosses ? s.depth : block.median[l];
        }
    }
}

/// Writes `value(pixel in block order)` to the tile's place in a plane.
template <class T, class Value>
void write_tile(const TilePlace& tile, const ImageView<T>& image, int channel, const Value& value) {
    for (int y = 0; y < tile.height; ++y) {
        T* const row = image.row(channel, tile.y + y) + tile.x;
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

/// Blends a tile's list; returns how much of it any pixel looked at.
template <bool Depth, class T>
std::uint32_t blend_tile(const TilePlace& tile, Span<const ScreenSplat<T>> splats, Span<const TileInstance> list,
                         const BlendLimits<T>& limits, BlendBlock<T>* blocks) {
    std::uint32_t live = 0;
    for (int b = 0; b < blocks_of_tile; ++b) {
        BlendBlock<T>& block = blocks[b];
        block.transmittance.fill(T(1));
        block.cut = initial_cut(tile, b, limits.alpha_min);
        block.red.fill(T(0)), block.green.fill(T(0)), block.blue.fill(T(0));
        block.depth.fill(T(0)), block.median.fill(T(0));
    }
    const auto find_live = [&] {
        live = 0;
        for (int b = 0; b < blocks_of_tile; ++b) {
            T least = blocks[b].cut[0];
            for (const T cut : blocks[b].cut) least = cut < least ? cut : least;
            live |= (least <= limits.alpha_max ? 1u : 0u) << b;
        }
    };
    find_live();
    Batch<T> batch;
    std::size_t begin = 0;
    for (; begin < list.size() && live != 0; begin += batch.size) {
        batch.load(splats, list.subspan(begin, std::min(batch_size, list.size() - begin)), tile);
        for (std::size_t j = 0; j < batch.size; ++j)
            for (std::uint32_t touched = batch.mask[j] & live; touched != 0; touched &= touched - 1) {
                const int b = std::countr_zero(touched);
                blend<Depth>(BlockSplat<T>(batch, j, b), limits, blocks[b]);
            }
        find_live();
    }
    return static_cast<std::uint32_t>(begin);
}

} // namespace detail

/// Fourth stage: blends every tile and writes the target.
template <CpuBackend B, std::floating_point T>
void blend_tiles(B& backend, const Background<T>& background, const RasterParams<T>& params,
                 const RenderTarget<T>& target, RasterCache<B, T>& cache) {
    const bool with_depth = !target.expected_depth.empty() || !target.median_depth.empty();
    const detail::BlendLimits<T> limits(params);
    const Span<const ScreenSplat<T>> splats = cache.splats;
    const Span<const TileInstance> instances = cache.instances;
    constexpr std::size_t record = detail::pixel_channels * detail::tile_pixels;
    cache.pixels.resize(cache.active_tiles * record);

    detail::run_queue(backend, cache.active_tiles, [&](std::size_t rank) {
        const std::uint32_t index = cache.tile_order[rank], begin = cache.tile_begin[index];
        const detail::TilePlace tile(cache.grid, index);
        const Span<const TileInstance> list = instances.subspan(begin, cache.tile_begin[index + 1] - begin);
        detail::BlendBlock<T> blocks[detail::blocks_of_tile];
        cache.tile_used[index] = with_depth ? detail::blend_tile<true>(tile, splats, list, limits, blocks)
                                            : detail::blend_tile<false>(tile, splats, list, limits, blocks);
        T* const pixels = cache.pixels.data() + rank * record;
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
    backend.for_chunks(cache.grid.size() - cache.active_tiles, 64, [&](std::size_t, std::size_t first, std::size_t end) {
        for (std::size_t i = first; i < end; ++i)
            detail::write_target(
                detail::TilePlace(cache.grid, cache.tile_order[cache.active_tiles + i]), background, target,
                [](int c, int) { return c == 4 ? T(1) : T(0); }, [](int, int, int) { return T(0); });
    });
}

/// Rasterizes; see Rasterizer::forward. Writes nothing but cache.status if that reports something to refuse.
template <CpuBackend B, std::floating_point T>
void composite_forward(B& backend, const Camera<T>& camera, const SplatView<const T>& splats,
                       const Background<T>& background, const RasterParams<T>& params, const RenderTarget<T>& target,
                       RasterCache<B, T>& cache) {
    if (!project_splats(backend, camera, splats, params, cache)) return;
    bin_splats(backend, sort_by_depth(backend, cache), cache);
    blend_tiles(backend, background, params, target, cache);
}

} // namespace gsh::cpu
