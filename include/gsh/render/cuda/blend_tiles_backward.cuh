// SPDX-License-Identifier: Apache-2.0
/// @file  First stage of the rasterizer's backward pass on a GPU: each tile's share of the gradients of its splats.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/reduce.cuh>
#include <gsh/backend/cuda/scan.cuh>
#include <gsh/math/vec.hpp>
#include <gsh/render/cuda/float_pair.cuh>
#include <gsh/render/cuda/pixel_sums.cuh>
#include <gsh/render/cuda/raster_scratch.cuh>
#include <gsh/render/cuda/segments.cuh>
#include <gsh/render/cuda/tile.cuh>
#include <gsh/render/target.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>

namespace gsh::cuda::detail {

/// Entries of a slot: sums over pixels, with G = dL/d ln(alpha) at a pixel.
enum SlotEntry : unsigned {
    slot_g,     // sum G
    slot_u,     // sum G u
    slot_v,     // sum G v
    slot_uu,    // sum G u u
    slot_uv,    // sum G u v
    slot_vv,    // sum G v v
    slot_red,   // sum weight * dL/d color of the pixel
    slot_green, // likewise
    slot_blue,  // likewise
    slot_depth, // likewise for the depths, if there is such a gradient
    slot_entries
};

/// One thread block per segment of a tile's list. Per batch of it:
///
/// 1. Pixels are the threads. Each blends its block's splats again, front to back, and leaves two numbers per splat in
///    shared memory: G and the weight.
/// 2. Pairs of a splat and a block of pixels are the threads. Each sums over its 16 pixels.
/// 3. Splats are the threads. Each sums over its blocks and writes its slot.
///
/// Sums of ten numbers over lanes in step 1 would instead take as long as the blending. Each sum has a fixed order.
template <std::floating_point T, bool Depth>
struct BlendTilesBackward {
    static constexpr unsigned block_size = tile_pixels;
    static constexpr unsigned least_blocks = sizeof(T) == 4 ? 3 : 1;
    static constexpr unsigned batch = 128;
    /// Pairs of a batch, as many as fit into 48 KiB. The stride is odd: 16 lanes write to 16 banks.
    static constexpr unsigned pairs = sizeof(T) == 4 ? 208 : 64, stride = pairs + 1;
    using Lists = BlockLists<batch, std::uint32_t>; // splat of the batch, and from bit 16 on its pair
    static_assert(pairs >= blocks_of_tile);
    static constexpr unsigned depth_pixels = Depth ? tile_pixels : 1;
    struct Shared {
        SharedArray<TileSplat<T>, batch + 1> splats;    // the last one pads lists
        SharedArray<T, block_lanes * stride> g, weight; // [pixel of the block, pair]; negative weight: the median
        SharedArray<T, tile_pixels> red, green, blue;   // [pixel of the block, block] gradient
        SharedArray<T, depth_pixels> depth, median;
        SharedArray<std::uint16_t, batch> mask, begin; // blocks of a splat, and its first pair
        SharedArray<std::uint16_t, pairs> pair;        // splat and block
        Lists lists;                                   // splat and pair
        SharedArray<std::uint32_t, block_size / warp_size> scan;
        SharedArray<vec3<T>, block_size / warp_size> sums;
    };

    TileGrid grid;
    Span<const std::uint32_t> refused;
    Segments segments;
    Span<const std::uint32_t> segment_used, used;
    Span<const TileInstance> instances;
    Span<const ScreenSplat<T>> screen;
    Span<const T> pixels;
    bool has_depth; // sums over depths are in `pixels`
    BlendLimits<T> limits;
    Background<T> background;
    RenderGradient<T> dL_dtarget;
    ImageView<T> dL_dbackground;
    Span<vec3<T>> tile_background; // [tiles] or empty
    Span<Slot<T>> slots;

    __device__ void operator()(Shared& shared) const {
        Segment segment;
        if (refused[0] != 0 || !segments.find(blockIdx.x, segment)) return;
        if (segment.length == 0 && tile_background.empty() && dL_dbackground.data.empty()) return;
        const TilePixel pixel(grid, segment.tile);
        if (threadIdx.x == 0) shared.splats[batch] = TileSplat<T>::none();
        State state;
        const vec3<T> dL_dbehind = start(shared, pixel, segment, state);
        if (segment.number == 0) add_to_background(shared, pixel, dL_dbehind);
        std::uint32_t entry = segment.from;
        const std::uint32_t end = entry + segment_used[segment.place];
        TileInstance instance = instance_at(segment, entry, end);
        while (entry < end) entry += add_batch(shared, pixel, segment, state, entry, end, instance);
        for (std::uint32_t i = end + threadIdx.x; i < segment.to; i += block_size) // behind the last pixel that stopped
            slots[instances[segment.list + i].slot] = Slot<T>{};
    }

private:
    /// State of the second sweep front to back at a pixel, and the pixel's gradients.
    ///
    /// With the pixel's value F = sum w s + T_end s_end, where s is a splat's colour (and depth) dotted with the
    /// pixel's gradient, dF/d alpha = T s - (share of F behind the splat) / (1 - alpha). `behind` starts at F and loses
    /// w s at each splat.
    struct State {
        T product, behind;
        T red = 0, green = 0, blue = 0, depth = 0, median = 0;
        bool has_median = false;
    };

    [[nodiscard]] __device__ static T read(const ImageView<const T>& image, const TilePixel& pixel, int channel = 0) {
        if (image.data.empty() || !pixel.inside) return T(0);
        return image.data[static_cast<std::size_t>(channel) * image.plane_size() + pixel.index];
    }

    /// What the forward pass left at a pixel; without depth sums, they are 0.
    [[nodiscard]] __device__ PixelSums<T, true> sums(std::size_t segment) const {
        if (has_depth) return PixelSums<T, true>::load(pixels, segment);
        const auto without = PixelSums<T, false>::load(pixels, segment);
        return {without.red, without.green, without.blue, without.transmittance, T(0), T(0)};
    }

    /// Reads the pixel; returns the gradient with respect to its background.
    __device__ vec3<T> start(Shared& shared, const TilePixel& pixel, const Segment& segment, State& state) const {
        const unsigned at = pixel.lane * blocks_of_tile + pixel.block;
        PixelSums<T, true> whole;
        if (segment.length != 0) whole = sums(segment.tile);
        state.red = read(dL_dtarget.color, pixel, 0), state.green = read(dL_dtarget.color, pixel, 1);
        state.blue = read(dL_dtarget.color, pixel, 2);
        const vec3<T> dL_dcolor(state.red, state.green, state.blue);
        const vec3<T> dL_dbehind = pixel.inside ? whole.transmittance * dL_dcolor : vec3<T>(T(0));
        if (segment.length == 0) return dL_dbehind;

        state.product = pixel.inside ? T(1) : T(0);
        if constexpr (Depth) {
            state.depth = read(dL_dtarget.expected_depth, pixel);
            state.median = read(dL_dtarget.median_depth, pixel);
            shared.depth[at] = state.depth;
            shared.median[at] = state.median;
        }
        if (segment.number != 0) {
            const PixelSums<T, true> in_front = sums(segment.place);
            state.product = in_front.transmittance;
            whole.red -= in_front.red, whole.green -= in_front.green, whole.blue -= in_front.blue;
            whole.depth -= in_front.depth;
            state.has_median = in_front.median != T(0);
        }
        T value = state.depth * whole.depth - whole.transmittance * read(dL_dtarget.alpha, pixel);
        const T from_splats[3] = {whole.red, whole.green, whole.blue};
        for (int c = 0; c < 3; ++c) {
            const T behind = background.image.data.empty() ? background.color[c] : read(background.image, pixel, c);
            value += dL_dcolor[c] * (from_splats[c] + whole.transmittance * behind);
        }
        state.behind = value;
        shared.red[at] = state.red;
        shared.green[at] = state.green;
        shared.blue[at] = state.blue;
        return dL_dbehind;
    }

    __device__ void add_to_background(Shared& shared, const TilePixel& pixel, const vec3<T>& dL_dbehind) const {
        if (!dL_dbackground.data.empty() && pixel.inside)
            for (int c = 0; c < 3; ++c)
                dL_dbackground.data[static_cast<std::size_t>(c) * dL_dbackground.plane_size() + pixel.index] +=
                    dL_dbehind[c];
        if (tile_background.empty()) return;
        const vec3<T> sum = block_sum<block_size>(shared.sums, dL_dbehind);
        if (threadIdx.x == 0) tile_background[pixel.tile] = sum;
    }

    /// This thread's entry of a batch from `entry` on, before `end`.
    [[nodiscard]] __device__ TileInstance instance_at(const Segment& segment, std::uint32_t entry,
                                                      std::uint32_t end) const {
        const std::uint32_t i = entry + threadIdx.x;
        return threadIdx.x < batch && i < end ? instances[segment.list + i] : TileInstance{0, 0};
    }

    /// Entries of the list from `entry` on, as many as fit; returns their number. `instance` is this thread's entry,
    /// and becomes that of the next batch.
    __device__ std::uint32_t add_batch(Shared& shared, const TilePixel& pixel, const Segment& segment, State& state,
                                       std::uint32_t entry, std::uint32_t end, TileInstance& instance) const {
        const unsigned i = threadIdx.x;
        const std::uint32_t left = end - entry < batch ? end - entry : batch, slot = instance.slot;
        std::uint32_t mask = 0;
        __syncthreads(); // the batch before has been read
        if (i < left) {
            mask = blocks_of(segment, entry + i);
            if (mask != 0) shared.splats[i] = TileSplat<T>(screen[instance.splat], pixel);
        }
        std::uint32_t all;
        const auto count = static_cast<std::uint32_t>(__popc(mask));
        const std::uint32_t first = block_scan<block_size>(shared.scan, count, all);
        const bool fits = i < left && first + count <= pairs;
        if (i < batch) {
            shared.mask[i] = static_cast<std::uint16_t>(fits ? mask : 0u);
            shared.begin[i] = static_cast<std::uint16_t>(first);
        }
        const auto taken = static_cast<std::uint32_t>(__syncthreads_count(fits)); // always the first ones
        if (taken < left) all = shared.begin[taken];
        instance = instance_at(segment, entry + taken, end); // while this batch is blended
        if (all != 0) {
            blend_batch(shared, pixel, state);
            __syncthreads();
            if (i < all) sum_pixels(shared, i);
            __syncthreads();
        }
        if (i < taken) slots[slot] = sum_blocks(shared, first, count);
        return taken;
    }

    /// The blocks to which entry i of the list came.
    [[nodiscard]] __device__ std::uint32_t blocks_of(const Segment& segment, std::uint32_t i) const {
        const std::size_t group = RasterScratch<Device, T>::group_begin(segment.tile, segment.list) + i / 32;
        std::uint32_t mask = 0;
        for (unsigned b = 0; b < blocks_of_tile; ++b) mask |= (used[group * blocks_of_tile + b] >> i % 32 & 1u) << b;
        return mask;
    }

    /// First step: this pixel's numbers for the splats of its block.
    __device__ void blend_batch(Shared& shared, const TilePixel& pixel, State& state) const {
        const typename Lists::List list =
            shared.lists.make([&](unsigned j) -> std::uint32_t { return shared.mask[j]; },
                              [&](unsigned j, unsigned block) {
                                  const std::uint32_t mask = shared.mask[j], first = shared.begin[j];
                                  const std::uint32_t pair =
                                      first + static_cast<unsigned>(__popc(mask & ((1u << block) - 1)));
                                  shared.pair[pair] = static_cast<std::uint16_t>(j | block << 8);
                                  return j | pair << 16;
                              },
                              batch);
        // The next splat is loaded before the numbers of this one are stored: the compiler does not know that they are
        // not the same memory.
        std::uint32_t entry = shared.lists.at(pixel.block, 0);
        TileSplat<T> next = shared.splats[entry & 0xFFFFu];
        for (unsigned begin = 0; begin < list.padded; begin += Lists::unroll)
            for (unsigned k = begin; k < begin + Lists::unroll; ++k) {
                const TileSplat<T> s = next;
                const unsigned pair = entry >> 16;
                entry = shared.lists.at(pixel.block, k + 1);
                next = shared.splats[entry & 0xFFFFu];
                T weight;
                const T g = blend(s, pixel, state, weight);
                if (k >= list.length) continue; // padding
                shared.g[pixel.lane * stride + pair] = g;
                shared.weight[pixel.lane * stride + pair] = weight;
            }
    }
    /// Returns G of one splat at this pixel.
    [[nodiscard]] __device__ T blend(const TileSplat<T>& s, const TilePixel& pixel, State& state, T& weight) const {
        const T before = state.product;
        const BlendStep<T> step(s, limits, static_cast<T>(pixel.x), static_cast<T>(pixel.y), before);
        const bool lit = before >= limits.gradient_transmittance_min;
        state.product = step.after;
        T shade = s.red * state.red + s.green * state.green + s.blue * state.blue;
        if constexpr (Depth) shade += s.depth * state.depth;
        state.behind -= step.weight * shade;
        weight = lit ? step.weight : T(0);
        if constexpr (Depth) {
            const bool median = is_median(step, state.has_median);
            state.has_median |= median;
            weight = median ? -weight : weight;
        }
        const T dL_dalpha = before * shade - state.behind * quick_reciprocal(step.keep);
        const T passes = step.raw <= limits.alpha_max ? step.alpha : T(0);
        return step.live && lit ? dL_dalpha * passes : T(0);
    }

    /// Second step: sums pair i over its pixels. Column i of `g` then holds the entries of the slot.
    __device__ void sum_pixels(Shared& shared, unsigned i) const {
        const unsigned entry = shared.pair[i], block = entry >> 8;
        const TileSplat<T> s = shared.splats[entry & 0xFFu];
        const T x = static_cast<T>(block % 4 * 4), y = static_cast<T>(block / 4 * 4);
        T sum[slot_entries] = {};
        for (unsigned row = 0; row < 4; ++row) {
            const T v = s.vy * (y + T(row)) + s.v, u0 = s.ux * x + (s.uy * (y + T(row)) + s.u);
            T of_g = 0, of_u = 0, of_uu = 0;
            for (unsigned column = 0; column < 4; ++column) {
                const unsigned p = row * 4 + column, at = p * blocks_of_tile + block;
                const T g = shared.g[p * stride + i], stored = shared.weight[p * stride + i];
                const T u = s.ux * T(column) + u0, weight = Depth ? abs(stored) : stored;
                const T red = shared.red[at], green = shared.green[at], blue = shared.blue[at];
                of_g += g;
                of_u += g * u;
                of_uu += g * u * u;
                sum[slot_red] += weight * red;
                sum[slot_green] += weight * green;
                sum[slot_blue] += weight * blue;
                if constexpr (Depth) {
                    const T depth = shared.depth[at], median = shared.median[at];
                    sum[slot_depth] += weight * depth + (stored < T(0) ? median : T(0));
                }
            }
            sum[slot_g] += of_g;
            sum[slot_u] += of_u;
            sum[slot_v] += v * of_g;
            sum[slot_uu] += of_uu;
            sum[slot_uv] += v * of_u;
            sum[slot_vv] += v * v * of_g;
        }
        for (unsigned k = 0; k < slot_entries; ++k) shared.g[k * stride + i] = sum[k];
    }

    /// Third step: sums the pairs of a splat.
    [[nodiscard]] __device__ static Slot<T> sum_blocks(Shared& shared, std::uint32_t first, std::uint32_t count) {
        Slot<T> slot{};
        for (std::uint32_t pair = first; pair < first + count; ++pair)
            for (unsigned k = 0; k < slot_entries; ++k) {
                const T value = shared.g[k * stride + pair];
                slot.entries[k] += value;
            }
        return slot;
    }
};

} // namespace gsh::cuda::detail
