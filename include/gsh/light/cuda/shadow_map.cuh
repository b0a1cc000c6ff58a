// SPDX-License-Identifier: Apache-2.0
/// @file  Shadow maps on the GPU: a thread per triangle and light draws, a thread per vertex and light looks up.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/core/lane.hpp>
#include <gsh/core/span.hpp>
#include <gsh/light/shadow_frame.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/light/shadow_triangle.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>

namespace gsh {

/// Empty: a thread places the vertices of its triangle itself, which is cheaper than a kernel that stores them.
template <std::floating_point T>
struct ShadowMapScratch<cuda::Device, T> {};

namespace cuda {

namespace detail {

using gsh::detail::ShadowBox;
using gsh::detail::ShadowTriangle;
using gsh::detail::ShadowVertex;

/// The least or greatest of a number of each lane, on every lane. All 32 lanes take part.
template <class T>
[[nodiscard]] __device__ T warp_min(T value) {
    for (int distance = warp_size / 2; distance > 0; distance /= 2)
        value = min(value, __shfl_xor_sync(all_lanes, value, distance));
    return value;
}
template <class T>
[[nodiscard]] __device__ T warp_max(T value) {
    for (int distance = warp_size / 2; distance > 0; distance /= 2)
        value = max(value, __shfl_xor_sync(all_lanes, value, distance));
    return value;
}
template <class T>
[[nodiscard]] __device__ ShadowBox<T> warp_box(const ShadowBox<T>& box) {
    return {{warp_min(box.low.x), warp_min(box.low.y), warp_min(box.low.z)},
            {warp_max(box.high.x), warp_max(box.high.y), warp_max(box.high.z)}};
}

/// A warp for each box.
template <class T>
struct BoundCasters {
    static constexpr unsigned block_size = 128;
    gsh::detail::BoundShadowCasters<T> element;

    __device__ void operator()() const {
        const std::size_t i = (std::size_t(blockIdx.x) * block_size + threadIdx.x) / warp_size;
        if (i >= element.boxes.size()) return;
        const std::size_t begin = i * gsh::detail::shadow_box_vertices, last = element.vertices.size() - 1;
        const std::size_t lane = threadIdx.x % warp_size;
        const auto vertex = [&](std::size_t v) { return element.vertices[v < last ? v : last]; };
        const vec3<T> p = vertex(begin + lane), q = vertex(begin + warp_size + lane);
        ShadowBox<T> box{p, p};
        box.include({q, q});
        box = warp_box(box);
        if (lane == 0) element.boxes[i] = box;
    }
    static_assert(gsh::detail::shadow_box_vertices == 2 * warp_size);
};

/// A warp for each light. Least and greatest numbers do not depend on their order, so frames are those of one thread.
template <class T>
struct AimMaps {
    static constexpr unsigned block_size = warp_size;
    gsh::detail::AimShadowMaps<T> element;

    __device__ void operator()() const {
        const std::size_t l = blockIdx.x, count = element.boxes.size();
        vec3<T> center(T(0));
        if (count > 0) {
            ShadowBox<T> all = element.boxes[0];
            for (std::size_t b = threadIdx.x; b < count; b += warp_size) all.include(element.boxes[b]);
            center = element.middle(warp_box(all));
        }
        const auto view = element.look(l, center);
        typename gsh::detail::AimShadowMaps<T>::Bounds bounds(view);
        for (std::size_t b = threadIdx.x; b < count; b += warp_size) bounds.include(view, element.boxes[b]);
        for (int k = 0; k < 2; ++k) bounds.low[k] = warp_min(bounds.low[k]), bounds.high[k] = warp_max(bounds.high[k]);
        if (threadIdx.x == 0) element.frames[l] = element.cover(l, view, bounds);
    }
};

/// Keeps the greater of a texel and `nearness`, whatever others write there at the same time.
///
/// The bits of floating-point numbers without a sign are ordered as signed integers, those with a sign in reverse as
/// unsigned ones, and each kind lies on the right side of the other.
template <class T>
__device__ void keep_nearest(T& texel, T nearness) {
    using Bits = std::conditional_t<sizeof(T) == 4, int, long long>;
    using Unsigned = std::conditional_t<sizeof(T) == 4, unsigned, unsigned long long>;
    Bits* const at = reinterpret_cast<Bits*>(&texel);
    // Texels only grow, so an outdated value at worst leads to an operation without effect. NaN ends here.
    const Bits kept = *at;
    T value;
    std::memcpy(&value, &kept, sizeof value);
    if (!(nearness > value)) return;
    Bits bits;
    std::memcpy(&bits, &nearness, sizeof bits);
    if (bits >= 0)
        atomicMax(at, bits);
    else
        atomicMin(reinterpret_cast<Unsigned*>(at), static_cast<Unsigned>(bits));
}

template <class T>
struct DrawShadow {
    static constexpr unsigned block_size = 128;
    static constexpr int large = 48; ///< texels; the triangles of a person's mesh cover a few
    Span<const ShadowFrame<T>> frames;
    ShadowCaster<T> caster;
    bool closed;
    Span<T> maps;
    std::size_t blocks_per_light;

    __device__ void operator()() const {
        const ShadowFrame<T> frame = frames[blockIdx.x / blocks_per_light];
        const std::size_t f = blockIdx.x % blocks_per_light * block_size + threadIdx.x;
        ShadowTriangle<T> triangle;
        const bool drawn = f < caster.triangles.size() && place(frame, f, triangle);
        const bool alone = drawn && texels(triangle) <= large;
        if (alone) draw(frame, triangle, 0, 1);
        // The lanes of a warp share each large triangle.
        const std::size_t first = f - threadIdx.x % warp_size;
        for (unsigned rest = __ballot_sync(all_lanes, drawn && !alone); rest != 0; rest &= rest - 1)
            if (place(frame, first + static_cast<std::size_t>(__ffs(static_cast<int>(rest)) - 1), triangle))
                draw(frame, triangle, static_cast<int>(threadIdx.x % warp_size), static_cast<int>(warp_size));
    }

private:
    [[nodiscard]] __device__ bool place(const ShadowFrame<T>& frame, std::size_t f, ShadowTriangle<T>& result) const {
        const vec3<std::uint32_t> t = caster.triangles[f];
        return result.place(gsh::detail::place_shadow_vertex(frame, caster.vertices[t.x]),
                            gsh::detail::place_shadow_vertex(frame, caster.vertices[t.y]),
                            gsh::detail::place_shadow_vertex(frame, caster.vertices[t.z]), closed, 0, frame.height);
    }
    [[nodiscard]] __device__ static int texels(const ShadowTriangle<T>& t) {
        return (t.right - t.left) * (t.bottom - t.top);
    }
    /// Every step-th texel of the triangle's rectangle.
    __device__ void draw(const ShadowFrame<T>& frame, const ShadowTriangle<T>& t, int begin, int step) const {
        const int width = t.right - t.left, count = texels(t);
        for (int n = begin; n < count; n += step) {
            const int row = n / width, column = n - row * width;
            const auto at = [&](const typename ShadowTriangle<T>::Edge& edge) {
                return edge.at + column * edge.column_step + row * edge.row_step;
            };
            const int ca = at(t.ca), ab = at(t.ab);
            if ((at(t.bc) | ca | ab) < 0) continue;
            const T nearness = t.at_a + static_cast<T>(ca) * t.to_b + static_cast<T>(ab) * t.to_c;
            keep_nearest(
                maps[frame.begin + static_cast<std::size_t>(t.top + row) * static_cast<std::size_t>(frame.stride) +
                     static_cast<std::size_t>(t.left + column)],
                nearness);
        }
    }
};

/// A thread for each vertex and light. The lanes of a warp look up neighbouring vertices in the map of one light, whose
/// texels lie close together.
template <class T>
struct ReceiveShadow {
    static constexpr unsigned block_size = 128;
    gsh::detail::ReceiveShadows<T> element;
    std::size_t blocks_per_light;

    __device__ void operator()() const {
        const std::size_t l = blockIdx.x / blocks_per_light;
        const std::size_t v = blockIdx.x % blocks_per_light * block_size + threadIdx.x;
        if (v >= element.vertices.size()) return;
        element.visibility[v * element.frames.size() + l] = gsh::detail::shadow_visibility(
            element.frames[l], element.maps.data(), element.vertices[v], element.normals[v], element.lift);
    }
};

} // namespace detail

template <class T>
void shadow_bound(Device& device, const gsh::detail::BoundShadowCasters<T>& element) {
    using Kernel = detail::BoundCasters<T>;
    device.launch(chunk_count(element.boxes.size() * warp_size, Kernel::block_size), Kernel{element});
}

template <class T>
void shadow_aim(Device& device, const gsh::detail::AimShadowMaps<T>& element) {
    device.launch(element.frames.size(), detail::AimMaps<T>{element});
}

template <class T>
void shadow_receive(Device& device, const gsh::detail::ReceiveShadows<T>& element) {
    using Kernel = detail::ReceiveShadow<T>;
    const std::size_t blocks = chunk_count(element.vertices.size(), Kernel::block_size);
    device.launch(blocks * element.frames.size(), Kernel{element, blocks});
}

/// Draws one caster into the maps of all lights; `clear` empties them first. A texel keeps the greatest of the values
/// that its triangles have there, so the order in which they are drawn does not matter.
///
/// Where the compiler fuses no products and sums, maps are bit-identical to the CPU's. nvcc does by default: a vertex
/// that is a rounding error away from the middle between two sixteenths of a texel may then go to the other one.
template <class T>
void shadow_draw(Device& device, Span<const ShadowFrame<T>> frames, const ShadowCaster<T>& caster, bool closed,
                 bool clear, Span<T> maps, ShadowMapScratch<Device, T>&) {
    using Kernel = detail::DrawShadow<T>;
    if (clear) device.fill(maps, gsh::detail::shadow_empty<T>);
    const std::size_t blocks = chunk_count(caster.triangles.size(), Kernel::block_size);
    device.launch(blocks * frames.size(), Kernel{frames, caster, closed, maps, blocks});
}

} // namespace cuda

} // namespace gsh
