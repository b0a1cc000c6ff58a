// SPDX-License-Identifier: Apache-2.0
/// @file  Light on a surface and its Gaussians on the CPU, with one of them in each lane of a vector register.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/cpu/gaussian_lanes.hpp>
#include <gsh/light/light.hpp>
#include <gsh/light/lit_element.hpp>
#include <gsh/light/lit_splats.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/math/wide.hpp>
#include <gsh/math/wide_block.hpp>

#include <concepts>
#include <cstddef>

namespace gsh {

template <CpuBackend B, std::floating_point T>
struct LitSplatsScratch<B, T> {
    typename B::template Buffer<Wide<T>> sums; // [chunks, 3 P + (P + D) + 2 + 3] points, intensities, gloss, centre
};

namespace cpu::inline GSH_ISA {

namespace detail {

using gsh::detail::LitColorBackward;
using gsh::detail::LitColors;
using gsh::detail::LitVertexBackward;
using gsh::detail::LitVertexForward;
using gsh::detail::LitVertices;

template <class T>
struct LitBlock : WideBlock<T> {
    using typename WideBlock<T>::W;
    using WideBlock<T>::count, WideBlock<T>::index, WideBlock<T>::width;
    using WideBlock<T>::fill, WideBlock<T>::gather;

    // Vertices ------------------------------------------------------------------------------------------------------

    void forward(const LitVertexForward<T>& element) {
        if (!fill()) return;
        const LitShading<W> shading =
            LitPoint::forward(element.surface.light, input(element.surface), visibility(element.surface));
        for (std::size_t lane = 0; lane < count; ++lane) get_lane<T>(shading, lane, element.shading[index[lane]]);
        count = 0;
    }
    void backward(const LitVertexBackward<T>& element, const LitLightSums<W>& sums, vec3<W>& dL_dcenter) {
        if (!fill()) return;
        LitShading<W> shading, dL_dshading;
        gather(shading, [&](std::size_t v) -> auto& { return element.shading[v]; });
        gather(dL_dshading, [&](std::size_t v) -> auto& { return element.dL_dshading[v]; });
        for (std::size_t lane = count; lane < width; ++lane) // the others add nothing to the sums
            dL_dshading.x.set(lane, T(0)), dL_dshading.y.set(lane, T(0));
        LitPoint::Gradient<W> gradient;
        LitPoint::backward(element.surface.light, input(element.surface), visibility(element.surface), shading,
                           dL_dshading, gradient, sums);
        dL_dcenter += gradient.center;
        for (std::size_t lane = 0; lane < count; ++lane) {
            const std::size_t v = index[lane];
            if (!element.dL_dvertices.empty()) add_lane<T>(gradient.position, lane, element.dL_dvertices[v]);
            if (!element.dL_dnormals.empty()) add_lane<T>(gradient.normal, lane, element.dL_dnormals[v]);
        }
        count = 0;
    }

    // Gaussians -----------------------------------------------------------------------------------------------------

    void backward(const LitColorBackward<T>& element) {
        if (!fill()) return;
        vec3<W> base, dL_dcolor, dL_dbase(W(T(0)));
        gather(base, [&](std::size_t i) -> auto& { return element.splats.base[i]; });
        gather(dL_dcolor, [&](std::size_t i) -> auto& { return element.dL_dcolors[i]; });
        LitShading<W> dL_dshading(W(T(0)));
        LitColor::backward(base, shading_of(element.splats), dL_dcolor, element.splats.clamping, dL_dbase,
                           dL_dshading);
        for (std::size_t lane = 0; lane < count; ++lane) {
            const std::size_t i = index[lane];
            get_lane<T>(dL_dshading, lane, element.dL_dshading[i]);
            if (!element.dL_dbase.empty()) add_lane<T>(dL_dbase, lane, element.dL_dbase[i]);
        }
        count = 0;
    }

private:
    LitPoint::Input<W> input(const LitVertices<T>& surface) const {
        LitPoint::Input<W> in;
        const vec3<T> center = surface.center();
        in.center = vec3<W>(W(center.x), W(center.y), W(center.z));
        gather(in.position, [&](std::size_t v) -> auto& { return surface.vertices[v]; });
        gather(in.normal, [&](std::size_t v) -> auto& { return surface.normals[v]; });
        return in;
    }
    auto visibility(const LitVertices<T>& surface) const {
        return [this, rows = surface.visibility.data(), lights = surface.light.size()](std::size_t k) {
            W value;
            for (std::size_t lane = 0; lane < width; ++lane) value.set(lane, rows[index[lane] * lights + k]);
            return value;
        };
    }
    LitShading<W> shading_of(const LitColors<T>& splats) const {
        LitShading<T> interpolated[width];
        for (std::size_t lane = 0; lane < width; ++lane) interpolated[lane] = splats.shading_of(index[lane]);
        LitShading<W> shading;
        for (std::size_t lane = 0; lane < width; lane += lanes_per_store<T>)
            put_lanes<T>(shading, lane, [&](std::size_t j) -> auto& { return interpolated[lane + j]; });
        return shading;
    }
};

/// Sums of a chunk, in memory for `size(light)` numbers.
template <class T>
struct LitChunkSums {
    vec3<T>* points;
    T* log_intensities;
    T* gloss;
    vec3<T>* center;

    static std::size_t size(const auto& light) { return 3 * light.points.size() + light.size() + 5; }
    LitChunkSums(const auto& light, T* memory)
        : points(reinterpret_cast<vec3<T>*>(memory)), log_intensities(memory + 3 * light.points.size()),
          gloss(log_intensities + light.size()), center(reinterpret_cast<vec3<T>*>(gloss + 2)) {}
};

/// The sum of all lanes.
template <class T>
[[nodiscard]] T sum_of_lanes(Wide<T> wide) {
    T sum = wide[0];
    for (std::size_t lane = 1; lane < Wide<T>::width; ++lane) sum += wide[lane];
    return sum;
}

} // namespace detail

template <CpuBackend B, class T>
void lit_vertices_shade(B& backend, const gsh::detail::LitVertexForward<T>& element) {
    detail::for_blocks<detail::LitBlock<T>>(backend, element.shading.size(), element);
}

/// The numbers of a chunk are transposed in the first-level cache. To load a register right after its lanes are stored
/// would wait for the stores.
template <CpuBackend B, class T>
void lit_splats_color(B& backend, const gsh::detail::LitColorForward<T>& element) {
    using W = Wide<T>;
    constexpr std::size_t grain = 256;
    static_assert(grain % W::width == 0);
    backend.for_chunks(element.colors.size(), grain, [&](std::size_t, std::size_t begin, std::size_t end) {
        const auto mine = element;
        const std::size_t count = end - begin;
        alignas(64) T color[3][grain]{}, irradiance[grain]{}, specular[grain]{};
        for (std::size_t i = 0; i < count; ++i) {
            const vec3<T>& base = mine.splats.base[begin + i];
            const LitShading<T> shading = mine.splats.shading_of(begin + i);
            for (int k = 0; k < 3; ++k) color[k][i] = base[k];
            irradiance[i] = shading.x, specular[i] = shading.y;
        }
        for (std::size_t i = 0; i < count; i += W::width) {
            const vec3<W> base(W::load(color[0] + i), W::load(color[1] + i), W::load(color[2] + i));
            const LitShading<W> shading(W::load(irradiance + i), W::load(specular + i));
            const vec3<W> lit = LitColor::forward(base, shading, mine.splats.clamping);
            for (int k = 0; k < 3; ++k) lit[k].store(color[k] + i);
        }
        for (std::size_t i = 0; i < count; ++i)
            mine.colors[begin + i] = vec3<T>(color[0][i], color[1][i], color[2][i]);
    });
}

/// A Gaussian whose colour has no gradient is left out of the blocks.
template <CpuBackend B, class T>
void lit_splats_color_backward(B& backend, const gsh::detail::LitColorBackward<T>& element) {
    detail::for_blocks<detail::LitBlock<T>>(backend, element.dL_dcolors.size(), element, [&](std::size_t i) {
        if (!element.unseen(i)) return false;
        element.dL_dshading[i] = LitShading<T>(T(0));
        return true;
    });
}

/// Adds the adjoints of all vertices with a gradient. Each fixed chunk sums its vertices, in order, into its own
/// lanes of the light's gradient and of the centre's. The sums of the chunks are added in order, so the result does not
/// depend on the assignment of chunks to threads.
template <CpuBackend B, class T>
void lit_vertices_accumulate(B& backend, const gsh::detail::LitVertexBackward<T>& element,
                             const LightView<T>& dL_dlight, Span<vec3<T>> dL_dcenter, LitSplatsScratch<B, T>& scratch) {
    using W = Wide<T>;
    using Sums = detail::LitChunkSums<W>;
    constexpr std::size_t grain = 1024;
    const auto& light = element.surface.light;
    const std::size_t count = element.shading.size(), chunks = chunk_count(count, grain), size = Sums::size(light);
    scratch.sums.resize(chunks * size);
    W* const all = scratch.sums.data();
    backend.for_chunks(count, grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        const auto mine = element;
        W* const memory = all + chunk * size;
        for (std::size_t n = 0; n < size; ++n) memory[n] = W(T(0));
        const Sums sums(mine.surface.light, memory);
        const LitLightSums<W> of_light{sums.points, sums.log_intensities, sums.gloss};
        detail::LitBlock<T> block;
        for (std::size_t v = begin; v < end; ++v)
            if (!mine.unseen(v) && block.push(v)) block.backward(mine, of_light, *sums.center);
        block.backward(mine, of_light, *sums.center);
    });
    if (chunks == 0) return;
    for (std::size_t chunk = 1; chunk < chunks; ++chunk)
        for (std::size_t n = 0; n < size; ++n) all[n] += all[chunk * size + n];
    const auto total = [](const vec3<W>& v) {
        return vec3<T>(detail::sum_of_lanes(v.x), detail::sum_of_lanes(v.y), detail::sum_of_lanes(v.z));
    };
    const Sums sums(light, all);
    for (std::size_t k = 0; k < dL_dlight.points.size(); ++k) dL_dlight.points[k] += total(sums.points[k]);
    for (std::size_t k = 0; k < dL_dlight.log_intensities.size(); ++k)
        dL_dlight.log_intensities[k] += detail::sum_of_lanes(sums.log_intensities[k]);
    for (std::size_t k = 0; k < dL_dlight.gloss.size(); ++k)
        dL_dlight.gloss[k] += detail::sum_of_lanes(sums.gloss[k]);
    if (!dL_dcenter.empty()) dL_dcenter[0] += total(*sums.center);
}

} // namespace cpu

} // namespace gsh
