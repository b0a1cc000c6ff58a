// SPDX-License-Identifier: Apache-2.0
/// @file  Gaussians under a light on the CPU, with one Gaussian in each lane of a vector register.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/surface_interpolation.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/span.hpp>
#include <gsh/light/light.hpp>
#include <gsh/light/lit_element.hpp>
#include <gsh/light/lit_splats.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/math/wide.hpp>

#include <concepts>
#include <cstddef>
#include <cstring>

namespace gsh {

template <CpuBackend B, std::floating_point T>
struct LitSplatsScratch<B, T> {
    typename B::template Buffer<Wide<T>> sums; // [chunks, 3 P + (P + D) + 2 + 3] points, intensities, gloss, centre
};

namespace cpu::inline GSH_ISA {

namespace detail {

using gsh::detail::Contribution;
using gsh::detail::LitSplatBackward;
using gsh::detail::LitSplatForward;
using gsh::detail::LitSplatInput;

/// Visibilities of a block of Gaussians, light by light. They are interpolated Gaussian by Gaussian, since a vertex's
/// row is contiguous, and transposed in memory, a tile of lights at a time.
template <class T>
class VisibilityTile {
public:
    using W = Wide<T>;

    VisibilityTile(const LitSplatInput<T>& input, const std::size_t* index)
        : corners_(input.corners.data()), visibility_(input.visibility.data()), lights_(input.light.size()),
          index_(index) {}

    /// V_k in each lane. Ascending k are fast.
    [[nodiscard]] GSH_INLINE W operator()(std::size_t k) {
        if (k >= end_ || k < begin_) load(k / columns * columns);
        return tile_[k - begin_];
    }

private:
    static constexpr std::size_t columns = 16, few = lanes_per_store<T>;
    typedef T Few __attribute__((vector_size(few * sizeof(T))));
    typedef T Row __attribute__((vector_size(columns * sizeof(T)))); // as many registers as it takes

    void load(std::size_t begin) {
        begin_ = begin, end_ = begin + columns;
        const std::size_t count = lights_ - begin < columns ? lights_ - begin : columns;
        for (std::size_t lane = 0; lane < W::width; lane += few) {
            alignas(Row) T rows[few][columns];
            for (std::size_t j = 0; j < few; ++j) {
                const Contribution<T>* corner = corners_ + 3 * index_[lane + j];
                const T* const row[3] = {visibility_ + corner[0].index * lights_ + begin,
                                         visibility_ + corner[1].index * lights_ + begin,
                                         visibility_ + corner[2].index * lights_ + begin};
                if (count == columns) {
                    Row a, b, c;
                    std::memcpy(&a, row[0], sizeof a);
                    std::memcpy(&b, row[1], sizeof b);
                    std::memcpy(&c, row[2], sizeof c);
                    a = a * corner[0].weight + b * corner[1].weight + c * corner[2].weight;
                    std::memcpy(rows[j], &a, sizeof a);
                } else {
                    for (std::size_t k = 0; k < count; ++k)
                        rows[j][k] = row[0][k] * corner[0].weight + row[1][k] * corner[1].weight +
                                     row[2][k] * corner[2].weight;
                }
            }
            for (std::size_t k = 0; k < count; k += few) { // numbers beyond count are not used
                Few mixed[few];
                for (std::size_t j = 0; j < few; ++j) std::memcpy(mixed + j, rows[j] + k, sizeof(Few));
                transpose(mixed);
                for (std::size_t j = 0; j < few; ++j)
                    std::memcpy(reinterpret_cast<char*>(tile_ + k + j) + lane * sizeof(T), mixed + j, sizeof(Few));
            }
        }
    }

    GSH_INLINE static void transpose(Few (&m)[few]) {
        if constexpr (few == 4) {
            const Few a = __builtin_shufflevector(m[0], m[1], 0, 4, 1, 5);
            const Few b = __builtin_shufflevector(m[0], m[1], 2, 6, 3, 7);
            const Few c = __builtin_shufflevector(m[2], m[3], 0, 4, 1, 5);
            const Few d = __builtin_shufflevector(m[2], m[3], 2, 6, 3, 7);
            m[0] = __builtin_shufflevector(a, c, 0, 1, 4, 5), m[1] = __builtin_shufflevector(a, c, 2, 3, 6, 7);
            m[2] = __builtin_shufflevector(b, d, 0, 1, 4, 5), m[3] = __builtin_shufflevector(b, d, 2, 3, 6, 7);
        } else {
            const Few a = __builtin_shufflevector(m[0], m[1], 0, 2);
            m[1] = __builtin_shufflevector(m[0], m[1], 1, 3), m[0] = a;
        }
    }

    const Contribution<T>* corners_;
    const T* visibility_;
    std::size_t lights_;
    const std::size_t* index_;
    std::size_t begin_ = 1, end_ = 0; // lights in the tile; none at first
    W tile_[columns];
};

/// Up to `width` Gaussians, one per lane. If there are fewer, the last one fills the other lanes.
template <class T>
struct LitBlock {
    using W = Wide<T>;
    static constexpr std::size_t width = W::width;

    std::size_t index[width];
    std::size_t count = 0;

    /// Adds Gaussian i; true if the block is then full.
    bool push(std::size_t i) {
        index[count++] = i;
        return count == width;
    }

    void forward(const LitSplatForward<T>& element) {
        if (count == 0) return;
        const auto in = gather(element.input);
        const auto shading =
            LitGaussian::shading(element.input.light, in, VisibilityTile<T>(element.input, index));
        const vec3<W> color = LitGaussian::color(in.base, shading, element.input.light.clamping);
        for (std::size_t lane = 0; lane < count; ++lane) {
            const std::size_t i = index[lane];
            element.irradiance[i] = shading.irradiance[lane];
            element.specular[i] = shading.specular[lane];
            get_lane<T>(color, lane, element.colors[i]);
        }
        count = 0;
    }

    void backward(const LitSplatBackward<T>& element, const LitLightSums<W>& sums, vec3<W>& dL_dcenter) {
        if (count == 0) return;
        const auto in = gather(element.input);
        LitGaussian::Shading<W> shading, dL_dshading{W(T(0)), W(T(0))};
        vec3<W> dL_dcolor;
        for (std::size_t lane = 0; lane < width; lane += lanes_per_store<T>) {
            const std::size_t* i = index + lane;
            put_lanes<T>(shading.irradiance, lane, [&](std::size_t j) -> auto& { return element.irradiance[i[j]]; });
            put_lanes<T>(shading.specular, lane, [&](std::size_t j) -> auto& { return element.specular[i[j]]; });
            put_lanes<T>(dL_dcolor, lane, [&](std::size_t j) -> auto& { return element.dL_dcolors[i[j]]; });
        }
        for (std::size_t lane = count; lane < width; ++lane) // the others add nothing to the sums
            dL_dcolor.x.set(lane, T(0)), dL_dcolor.y.set(lane, T(0)), dL_dcolor.z.set(lane, T(0));
        LitGaussian::Gradient<W> gradient;
        LitGaussian::color_backward(in.base, shading, dL_dcolor, element.input.light.clamping, gradient.base,
                                    dL_dshading);
        LitGaussian::shading_backward(element.input.light, in, VisibilityTile<T>(element.input, index), shading,
                                      dL_dshading, gradient, sums);
        dL_dcenter += gradient.center;
        for (std::size_t lane = 0; lane < count; ++lane) {
            const std::size_t i = index[lane];
            if (!element.dL_dmeans.empty()) add_lane<T>(gradient.mean, lane, element.dL_dmeans[i]);
            if (!element.dL_dbase.empty()) add_lane<T>(gradient.base, lane, element.dL_dbase[i]);
            if (!element.dL_dnormals.empty()) get_lane<T>(gradient.normal, lane, element.dL_dnormals[i]);
        }
        count = 0;
    }

private:
    LitGaussian::Input<W> gather(const LitSplatInput<T>& input) {
        for (std::size_t lane = count; lane < width; ++lane) index[lane] = index[count - 1];
        LitGaussian::Input<W> in;
        in.center = vec3<W>(W(input.center.x), W(input.center.y), W(input.center.z));
        for (std::size_t lane = 0; lane < width; lane += lanes_per_store<T>) {
            const std::size_t* i = index + lane;
            vec3<T> normals[lanes_per_store<T>];
            for (std::size_t j = 0; j < lanes_per_store<T>; ++j) normals[j] = input.normal(i[j]);
            put_lanes<T>(in.mean, lane, [&](std::size_t j) -> auto& { return input.means[i[j]]; });
            put_lanes<T>(in.base, lane, [&](std::size_t j) -> auto& { return input.base[i[j]]; });
            put_lanes<T>(in.normal, lane, [&](std::size_t j) -> auto& { return normals[j]; });
        }
        return in;
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

/// The result of a lane depends on its own Gaussian alone, so the grouping of Gaussians into blocks does not change any
/// result.
template <CpuBackend B, class T>
void lit_splats_shade(B& backend, const gsh::detail::LitSplatForward<T>& element) {
    constexpr std::size_t grain = 1024;
    backend.for_chunks(element.colors.size(), grain, [&](std::size_t, std::size_t begin, std::size_t end) {
        const auto mine = element;
        detail::LitBlock<T> block;
        for (std::size_t i = begin; i < end; ++i)
            if (block.push(i)) block.forward(mine);
        block.forward(mine);
    });
}

/// Adds the adjoints of all Gaussians with a gradient. Each fixed chunk sums its Gaussians, in order, into its own
/// lanes of the light's gradient and of the centre's. The sums of the chunks are added in order, so the result does not
/// depend on the assignment of chunks to threads.
template <CpuBackend B, class T>
void lit_splats_accumulate(B& backend, const gsh::detail::LitSplatBackward<T>& element, const LightView<T>& dL_dlight,
                           Span<vec3<T>> dL_dcenter, LitSplatsScratch<B, T>& scratch) {
    using W = Wide<T>;
    using Sums = detail::LitChunkSums<W>;
    constexpr std::size_t grain = 2048;
    const auto& light = element.input.light;
    const std::size_t count = element.dL_dcolors.size(), chunks = chunk_count(count, grain), size = Sums::size(light);
    scratch.sums.resize(chunks * size);
    W* const all = scratch.sums.data();
    backend.for_chunks(count, grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        const auto mine = element;
        W* const memory = all + chunk * size;
        for (std::size_t n = 0; n < size; ++n) memory[n] = W(T(0));
        const Sums sums(mine.input.light, memory);
        const LitLightSums<W> of_light{sums.points, sums.log_intensities, sums.gloss};
        detail::LitBlock<T> block;
        for (std::size_t i = begin; i < end; ++i)
            if (!mine.unseen(i)) {
                if (block.push(i)) block.backward(mine, of_light, *sums.center);
            } else if (!mine.dL_dnormals.empty()) {
                mine.dL_dnormals[i] = vec3<T>(T(0));
            }
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
