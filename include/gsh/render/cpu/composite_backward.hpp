// SPDX-License-Identifier: Apache-2.0
/// @file  The rasterizer's backward pass on the CPU.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/core/prefetch.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/math/wide.hpp>
#include <gsh/math/wide_shuffle.hpp>
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
/// gradient, dF/d alpha = T s - (share of F behind the splat) / (1 - alpha). `minus_behind` starts at -F and gains w s
/// at each splat.
template <class T>
struct alignas(64) GradientBlock {
    Lanes<T> product, minus_behind, dL_dred, dL_dgreen, dL_dblue, dL_ddepth, dL_dmedian;
};

/// A splat of a batch, and the blocks in which it may get a gradient.
struct BatchPair {
    std::uint32_t splat, blocks;
};

/// Writes the gradients of splats of a batch, summed over the pixels of their blocks, to their slots: those of the
/// first `count` pairs, of which each has a block. The pair after them is read, too.
///
/// A splat's shape in its next block is computed before its gradient in this one, so that the one does not wait for the
/// other: each alone is a long chain of dependent operations. Narrow registers are too few for that.
template <bool Depth, bool Absolute, class T>
void blend_backward([[maybe_unused]] const Batch<T>& batch, [[maybe_unused]] const BatchPair* pairs,
                    [[maybe_unused]] std::size_t count, [[maybe_unused]] const BlendLimits<T>& bounds,
                    [[maybe_unused]] GradientBlock<T>* blocks, [[maybe_unused]] T* slots) {
#if !defined(__CUDA_ARCH__) // in its pass for the device, nvcc parses host code, too, and refuses vectors of registers
    using W = Wide<T>;
    constexpr std::size_t size = slot_size<Depth, Absolute>;
    constexpr bool in_advance = W::width == block_lanes;
    const BlendLimits<T> limits = bounds; // a local copy: the stores below cannot alias it
    const W zero(T(0));
    const auto shape_in = [&](std::size_t splat, std::size_t b, std::size_t l) {
        const TileSplat<T> s = batch[splat];
        const W x = W::load(&pixel_coordinates<T, false>[b][l]), y = W::load(&pixel_coordinates<T, true>[b][l]);
        return BlendShape<W>(s, limits, x, y);
    };
    const auto first_of = [](std::uint32_t bits) { return static_cast<std::size_t>(std::countr_zero(bits)); };
    W sums[size];
    for (W& sum : sums) sum = zero;
    std::uint32_t bits = pairs->blocks;
    BlendShape<W> next_shape = shape_in(pairs->splat, first_of(bits), 0);
    for (const BatchPair* const end = pairs + count; pairs != end;) {
        const std::size_t splat = pairs->splat, b = first_of(bits);
        const TileSplat<T> s = batch[splat];
        GradientBlock<T>& block = blocks[b];
        BlendShape<W> shape = next_shape;
        bits &= bits - 1;
        const bool last = bits == 0;
        pairs += last ? 1 : 0;
        bits = last ? pairs->blocks : bits;
        if constexpr (in_advance) next_shape = shape_in(pairs->splat, first_of(bits), 0);
        for (std::size_t l = 0; l < block_lanes; l += W::width) {
            if constexpr (!in_advance) shape = shape_in(splat, b, l);
            const W before = W::load(&block.product[l]);
            const auto lit = before >= W(limits.gradient_transmittance_min);
            const BlendStep<W> step(shape, limits, before);
            step.after.store(&block.product[l]);
            const W weight = select(lit, step.weight, zero);

            const W red = W::load(&block.dL_dred[l]), green = W::load(&block.dL_dgreen[l]);
            const W blue = W::load(&block.dL_dblue[l]);
            W shade = multiply_add(W(s.red), red, multiply_add(W(s.green), green, W(s.blue) * blue));
            if constexpr (Depth) shade = multiply_add(W(s.depth), W::load(&block.dL_ddepth[l]), shade);
            const W share = step.weight * shade, minus_behind = W::load(&block.minus_behind[l]) + share;
            minus_behind.store(&block.minus_behind[l]);
            const W dF = multiply_add(step.alpha / step.keep, minus_behind, share); // by d ln(alpha)
            const W g = select(step.live & lit & (step.raw <= W(limits.alpha_max)), dF, zero);

            const W gu = g * step.u, gv = g * step.v;
            sums[slot_g] += g;
            sums[slot_u] += gu;
            sums[slot_v] += gv;
            sums[slot_uu] = multiply_add(gu, step.u, sums[slot_uu]);
            sums[slot_uv] = multiply_add(gu, step.v, sums[slot_uv]);
            sums[slot_vv] = multiply_add(gv, step.v, sums[slot_vv]);
            sums[slot_red] = multiply_add(weight, red, sums[slot_red]);
            sums[slot_green] = multiply_add(weight, green, sums[slot_green]);
            sums[slot_blue] = multiply_add(weight, blue, sums[slot_blue]);
            if constexpr (Depth) {
                const auto crosses = (before > W(T(0.5))) & (step.after <= W(T(0.5))) & step.live & lit;
                sums[slot_depth] += multiply_add(weight, W::load(&block.dL_ddepth[l]),
                                                 select(crosses, W::load(&block.dL_dmedian[l]), zero));
            }
            if constexpr (Absolute) {
                constexpr std::size_t first = slot_size<Depth>;
                sums[first] += abs(gu);
                sums[first + 1] += abs(multiply_add(gu, W(s.uy), gv * W(s.vy)));
            }
        }
        if (!last) continue;
        T* const slot = slots + splat * size;
        constexpr int whole = size / W::width * W::width, rest = size - whole;
        for (int i = 0; i < whole; i += W::width) sums_of_rows<W::width>(sums + i).store(slot + i);
        if constexpr (rest > 0) sums_of_rows<rest>(sums + whole).template store_first<rest>(slot + whole);
        for (W& sum : sums) sum = zero;
    }
#endif
}

/// One plane of an image in block order; zero where the plane is empty or the tile extends beyond the image.
template <class T>
void read_tile(const TilePlace& tile, const ImageView<const T>& image, int channel, T* pixels) {
    if (image.empty() || tile.width < TileGrid::tile_size || tile.height < TileGrid::tile_size)
        std::fill(pixels, pixels + tile_pixels, T(0));
    if (image.empty()) return;
    for (int y = 0; y < tile.height; ++y) {
        const T* const row = image.row(channel, tile.y + y) + tile.x;
        if (tile.is_whole())
            for (int x = 0; x < TileGrid::tile_size; x += 4) std::copy_n(row + x, 4, pixels + block_order(x, y));
        else
            for (int x = 0; x < tile.width; x += 4) // a line of a block
                std::copy_n(row + x, std::min(4, tile.width - x), pixels + block_order(x, y));
    }
}

/// The blocks of `bits` in which some pixel still passes a gradient.
template <class T>
[[nodiscard]] std::uint32_t lit_blocks(std::uint32_t bits, const GradientBlock<T>* blocks, T transmittance_min) {
    std::uint32_t lit = 0;
    if (transmittance_min <= T(0)) return bits;
    for (; bits != 0; bits &= bits - 1) {
        const int b = std::countr_zero(bits);
        lit |= (any_reaches(blocks[b].product, transmittance_min) ? 1u : 0u) << b;
    }
    return lit;
}

/// Second sweep over a tile's list: writes the sums of each splat to its slot. `used` and `touched` are blend_tile's.
template <bool Depth, bool Absolute, class T>
void blend_tile_backward(const TilePlace& tile, Span<const ScreenSplat<T>> splats, Span<const std::uint32_t> list,
                         const BlendLimits<T>& limits, const std::uint32_t* used, const std::uint16_t* touched,
                         GradientBlock<T>* blocks, T* slots) {
    constexpr std::size_t slot = slot_size<Depth, Absolute>;
    Batch<T> batch;
    std::uint32_t lit = (1u << blocks_of_tile) - 1; // blocks in which splats still get a gradient
    for (std::size_t begin = 0; begin < list.size(); begin += batch.size) {
        batch.load(splats, list, begin, tile);
        std::uint16_t bits[batch_size];
        std::copy_n(touched + begin, batch.size, bits);
        for (std::size_t b = 0; b < blocks_of_tile; ++b)
            for (std::size_t j = used[b] < begin ? 0 : used[b] - begin; j < batch.size; ++j)
                bits[j] = static_cast<std::uint16_t>(bits[j] & ~(1u << b));
        lit = lit_blocks(lit, blocks, limits.gradient_transmittance_min);
        BatchPair pairs[batch_size + 1];
        std::uint32_t count = 0;
        for (std::uint32_t j = 0; j < batch.size; ++j) {
            pairs[count] = {j, bits[j] & lit};
            if (pairs[count].blocks == 0) std::fill_n(slots + (begin + j) * slot, slot, T(0));
            else ++count;
        }
        pairs[count] = {0, 1};
        if (count != 0) blend_backward<Depth, Absolute>(batch, pairs, count, limits, blocks, slots + begin * slot);
    }
}

} // namespace detail

/// First stage: each tile writes its share of the gradients of its splats to their slots, and adds to the gradient of
/// the background. With Absolute, slots have the sums of absolute values, too.
template <bool Absolute = false, CpuBackend B, std::floating_point T>
void blend_tiles_backward(B& backend, const Background<T>& background, const RasterParams<T>& params,
                          const RenderGradient<T>& dL_dtarget, RasterCache<B, T>& cache,
                          const BackgroundGradient<T>& dL_dbackground) {
    using namespace detail;
    RasterScratch<B, T>& scratch = cache.scratch;
    const bool with_depth = dL_dtarget.has_depth();
    const BlendLimits<T> limits(params);
    const Span<const ScreenSplat<T>> splats = scratch.splats;
    const Span<const std::uint32_t> instances = scratch.instances;
    constexpr std::size_t record = pixel_channels * tile_pixels;
    const std::size_t slot = with_depth ? slot_size<true, Absolute> : slot_size<false, Absolute>;
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
                block.minus_behind[l] = -value;
                block.dL_dred[l] = dL[0][p], block.dL_dgreen[l] = dL[1][p], block.dL_dblue[l] = dL[2][p];
                block.dL_ddepth[l] = dL[4][p], block.dL_dmedian[l] = dL[5][p];
            }
        }
        const std::uint32_t begin = scratch.tile_begin[index], end = scratch.tile_begin[index + 1];
        const std::uint32_t used = scratch.tile_used[index];
        const Span<const std::uint32_t> list = instances.subspan(begin, used);
        const std::uint32_t* const block_used = scratch.block_used.data() + rank * blocks_of_tile;
        const std::uint16_t* const touched = scratch.touched.data() + begin;
        T* const slots = scratch.slots.data() + begin * slot;
        if (with_depth)
            blend_tile_backward<true, Absolute>(tile, splats, list, limits, block_used, touched, blocks, slots);
        else
            blend_tile_backward<false, Absolute>(tile, splats, list, limits, block_used, touched, blocks, slots);
        std::fill(slots + used * slot, slots + (end - begin) * slot, T(0));
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
