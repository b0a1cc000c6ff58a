// SPDX-License-Identifier: Apache-2.0
/// @file  The rasterizer's backward pass on the CPU.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/render/cpu/project_backward.hpp>
#include <gsh/render/cpu/tile.hpp>
#include <gsh/render/target.hpp>

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>

namespace gsh::cpu::inline GSH_ISA {

namespace detail {

/// State of the second sweep front to back at the 16 pixels of a block, and the gradients of the pixels.
///
/// With the pixel's value F = sum w s + T_end s_end, where s is a splat's colour (and depth) dotted with the pixel's
/// gradient, dF/d alpha = T s - (share of F behind the splat) / (1 - alpha). `behind` starts at F and loses w s at each
/// splat.
template <class T>
struct alignas(64) GradientBlock {
    Lanes<T> product, behind, dL_dred, dL_dgreen, dL_dblue, dL_ddepth, dL_dmedian;
};

/// Entries of a slot before they are summed over the pixels of a block.
template <bool Depth, class T>
struct alignas(64) SlotSums {
    Lanes<T> lanes[slot_size<Depth>];
};

/// Adds one splat's share of the gradient in one block. The first block of a splat sets the sums, later blocks add to
/// them.
template <bool Depth, bool First, class T>
inline void blend_backward(const TileSplat<T>& splat, const BlendLimits<T>& bounds, const Lanes<T>& x,
                           const Lanes<T>& y, GradientBlock<T>& __restrict block,
                           SlotSums<Depth, T>& __restrict sums) {
    const TileSplat<T> s = splat; // local copies: the stores below cannot alias them
    const BlendLimits<T> limits = bounds;
    for (std::size_t l = 0; l < block_lanes; ++l) {
        const T before = block.product[l];
        const BlendStep<T> step(s, limits, x[l], y[l], before);
        block.product[l] = step.after;

        const T red = block.dL_dred[l], green = block.dL_dgreen[l], blue = block.dL_dblue[l];
        T shade = multiply_add(s.red, red, multiply_add(s.green, green, s.blue * blue));
        if constexpr (Depth) shade = multiply_add(s.depth, block.dL_ddepth[l], shade);
        const T behind = block.behind[l] - step.weight * shade;
        block.behind[l] = behind;
        const T dL_dalpha = before * shade - behind / step.keep;
        const T passes = step.raw <= limits.alpha_max ? step.alpha : T(0);
        const T g = step.live ? dL_dalpha * passes : T(0);

        const auto add = [&](SlotEntry entry, T value) {
            sums.lanes[entry][l] = First ? value : sums.lanes[entry][l] + value;
        };
        const auto add_product = [&](SlotEntry entry, T a, T b) {
            sums.lanes[entry][l] = First ? a * b : multiply_add(a, b, sums.lanes[entry][l]);
        };
        const T gu = g * step.u, gv = g * step.v;
        add(slot_g, g);
        add(slot_u, gu);
        add(slot_v, gv);
        add_product(slot_uu, gu, step.u);
        add_product(slot_uv, gu, step.v);
        add_product(slot_vv, gv, step.v);
        add_product(slot_red, step.weight, red);
        add_product(slot_green, step.weight, green);
        add_product(slot_blue, step.weight, blue);
        if constexpr (Depth) {
            const bool crosses = (before > T(0.5)) & (step.after <= T(0.5)) & step.live;
            add(slot_depth, multiply_add(step.weight, block.dL_ddepth[l], crosses ? block.dL_dmedian[l] : T(0)));
        }
    }
}

inline constexpr std::size_t sums_at_once = 16; // number of splats whose pixels are summed together

/// Sums the 16 pixels of each entry in a fixed order, half by half.
template <bool Depth, class T>
void reduce(const SlotSums<Depth, T>* sums, std::size_t count, T* entries) {
    alignas(64) T by8[sums_at_once * slot_size<Depth> * 8], by4[sums_at_once * slot_size<Depth> * 4];
    const std::size_t n = count * slot_size<Depth>;
    const T* const by16 = sums[0].lanes[0].data();
    for (std::size_t i = 0; i < n; ++i)
        for (std::size_t l = 0; l < 8; ++l) by8[8 * i + l] = by16[16 * i + l] + by16[16 * i + 8 + l];
    for (std::size_t i = 0; i < n; ++i)
        for (std::size_t l = 0; l < 4; ++l) by4[4 * i + l] = by8[8 * i + l] + by8[8 * i + 4 + l];
    for (std::size_t i = 0; i < n; ++i)
        entries[i] = (by4[4 * i] + by4[4 * i + 2]) + (by4[4 * i + 1] + by4[4 * i + 3]);
}

/// One plane of an image in block order; zero where the plane is empty or the tile extends beyond the image.
template <class T>
void read_tile(const TilePlace& tile, const ImageView<const T>& image, int channel, T* pixels) {
    if (image.empty() || tile.width < TileGrid::tile_size || tile.height < TileGrid::tile_size)
        std::fill(pixels, pixels + tile_pixels, T(0));
    if (image.empty()) return;
    for (int y = 0; y < tile.height; ++y) {
        const T* const row = image.row(channel, tile.y + y) + tile.x;
        for (int x = 0; x < tile.width; x += 4) // a line of a block
            std::copy_n(row + x, std::min(4, tile.width - x), pixels + block_order(x, y));
    }
}

/// Second sweep over a tile's list: writes the sums of each splat to its slot.
template <bool Depth, class T>
void blend_tile_backward(const TilePlace& tile, Span<const ScreenSplat<T>> splats, Span<const TileInstance> list,
                         const BlendLimits<T>& limits, GradientBlock<T>* blocks, T* slots) {
    constexpr std::size_t slot = slot_size<Depth>;
    Batch<T> batch;
    for (std::size_t begin = 0; begin < list.size(); begin += batch.size) {
        batch.load(splats, list, begin, tile);
        for (std::size_t first = 0; first < batch.size; first += sums_at_once) {
            const std::size_t count = std::min(sums_at_once, batch.size - first);
            SlotSums<Depth, T> sums[sums_at_once];
            alignas(64) T entries[sums_at_once * slot];
            for (std::size_t j = 0; j < count; ++j) {
                const TileSplat<T>& splat = batch.splats[first + j];
                std::uint32_t bits = batch.blocks[first + j];
                if (bits == 0) {
                    sums[j] = {};
                    continue;
                }
                auto b = static_cast<std::size_t>(std::countr_zero(bits));
                blend_backward<Depth, true>(splat, limits, pixel_coordinates<T, false>[b],
                                            pixel_coordinates<T, true>[b], blocks[b], sums[j]);
                while ((bits &= bits - 1) != 0) {
                    b = static_cast<std::size_t>(std::countr_zero(bits));
                    blend_backward<Depth, false>(splat, limits, pixel_coordinates<T, false>[b],
                                                 pixel_coordinates<T, true>[b], blocks[b], sums[j]);
                }
            }
            reduce(sums, count, entries);
            for (std::size_t j = 0; j < count; ++j)
                std::copy_n(entries + j * slot, slot, slots + list[begin + first + j].slot * slot);
        }
    }
}

} // namespace detail

/// First stage: each tile writes its share of the gradients of its splats to their slots, and adds to the gradient of
/// the background.
template <CpuBackend B, std::floating_point T>
void blend_tiles_backward(B& backend, const Background<T>& background, const RasterParams<T>& params,
                          const RenderGradient<T>& dL_dtarget, RasterCache<B, T>& cache,
                          const BackgroundGradient<T>& dL_dbackground) {
    using namespace detail;
    RasterScratch<B, T>& scratch = cache.scratch;
    const bool with_depth = !dL_dtarget.expected_depth.empty() || !dL_dtarget.median_depth.empty();
    const BlendLimits<T> limits(params);
    const Span<const ScreenSplat<T>> splats = scratch.splats;
    const Span<const TileInstance> instances = scratch.instances;
    constexpr std::size_t record = pixel_channels * tile_pixels;
    const std::size_t slot = with_depth ? slot_size<true> : slot_size<false>;
    scratch.slot_size = slot;
    scratch.slots.resize(instances.size() * slot);
    scratch.tile_background.resize(scratch.grid.size());

    run_queue(backend, scratch.grid.size(), [&](std::size_t rank) {
        const std::uint32_t index = scratch.tile_order[rank];
        const TilePlace tile(scratch.grid, index);
        const bool active = rank < scratch.active_tiles;
        const T* const pixels = active ? scratch.pixels.data() + rank * record : nullptr;
        const auto transmittance = [&](int p) { return active ? pixels[4 * tile_pixels + p] : T(1); };

        if (!active && dL_dbackground.color.empty() && dL_dbackground.image.empty()) return;
        alignas(64) T dL[6][tile_pixels]; // colour, alpha, expected and median depth
        for (int c = 0; c < 3; ++c) read_tile(tile, dL_dtarget.color, c, dL[c]);
        if (!dL_dbackground.color.empty()) {
            vec3<double> sum(0);
            for (int c = 0; c < 3; ++c)
                for (int p = 0; p < tile_pixels; ++p) sum[c] += static_cast<double>(transmittance(p) * dL[c][p]);
            scratch.tile_background[index] = sum;
        }
        if (!dL_dbackground.image.empty())
            for (int c = 0; c < 3; ++c)
                for (int y = 0; y < tile.height; ++y)
                    for (int x = 0; x < tile.width; ++x) {
                        const int p = block_order(x, y);
                        dL_dbackground.image.at(c, tile.y + y, tile.x + x) += transmittance(p) * dL[c][p];
                    }
        if (!active) return;

        read_tile(tile, dL_dtarget.alpha, 0, dL[3]);
        read_tile(tile, dL_dtarget.expected_depth, 0, dL[4]);
        read_tile(tile, dL_dtarget.median_depth, 0, dL[5]);
        alignas(64) T behind_splats[3][tile_pixels];
        for (int c = 0; c < 3; ++c) {
            if (background.image.empty())
                std::fill(behind_splats[c], behind_splats[c] + tile_pixels, background.color[c]);
            else
                read_tile(tile, background.image, c, behind_splats[c]);
        }
        GradientBlock<T> blocks[blocks_of_tile];
        for (std::size_t b = 0; b < blocks_of_tile; ++b) {
            GradientBlock<T>& block = blocks[b];
            block.product = initial_transmittance<T>(tile, b);
            for (std::size_t l = 0; l < block_lanes; ++l) {
                const std::size_t p = b * block_lanes + l;
                const T end = pixels[4 * tile_pixels + p];
                T value = dL[4][p] * pixels[3 * tile_pixels + p] - end * dL[3][p];
                for (int c = 0; c < 3; ++c)
                    value += dL[c][p] * (pixels[c * tile_pixels + p] + end * behind_splats[c][p]);
                block.behind[l] = value;
                block.dL_dred[l] = dL[0][p], block.dL_dgreen[l] = dL[1][p], block.dL_dblue[l] = dL[2][p];
                block.dL_ddepth[l] = dL[4][p], block.dL_dmedian[l] = dL[5][p];
            }
        }
        const std::uint32_t begin = scratch.tile_begin[index], end = scratch.tile_begin[index + 1];
        const std::uint32_t used = scratch.tile_used[index];
        const Span<const TileInstance> list = instances.subspan(begin, used);
        if (with_depth)
            blend_tile_backward<true>(tile, splats, list, limits, blocks, scratch.slots.data());
        else
            blend_tile_backward<false>(tile, splats, list, limits, blocks, scratch.slots.data());
        for (std::uint32_t i = begin + used; i < end; ++i)
            std::fill_n(scratch.slots.data() + instances[i].slot * slot, slot, T(0));
    });
    if (!dL_dbackground.color.empty()) {
        vec3<double> sum(0);
        for (const vec3<double>& share : scratch.tile_background) sum += share;
        dL_dbackground.color[0] += vec3<T>(sum);
    }
}

/// Adjoint of composite_forward; see Rasterizer::backward.
template <CpuBackend B, std::floating_point T>
void composite_backward(B& backend, const Deferred<Camera<T>>& camera, const SplatView<const T>& splats,
                        const Background<T>& background, const RasterParams<T>& params,
                        const RenderGradient<T>& dL_dtarget, RasterCache<B, T>& cache,
                        const SplatView<T>& dL_dsplats, Span<CameraGradient<T>> dL_dcamera,
                        const BackgroundGradient<T>& dL_dbackground) {
    blend_tiles_backward(backend, background, params, dL_dtarget, cache, dL_dbackground);
    project_splats_backward(backend, camera(), splats, params, cache, dL_dsplats, dL_dcamera);
}

} // namespace gsh::cpu
