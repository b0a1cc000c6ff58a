// SPDX-License-Identifier: Apache-2.0
/// @file  A backend on the host that runs every sum as a plain loop over elements, in order. Unlike the kernels of the
///        CPU backends, which need vectors of the compiler, it can stand beside device code in one file.
#pragma once

#include <gsh/avatar/occlusion_field.hpp>
#include <gsh/avatar/skinned_splats.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/core/span.hpp>
#include <gsh/light/lit_splats.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/light/shadow_triangle.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <vector>

#if defined(GSH_CUDA_EMULATION)
#include <gsh/avatar/cpu/occlusion_field.hpp>
#include <gsh/avatar/cpu/skinned_splats.hpp>
#include <gsh/light/cpu/lit_splats.hpp>
#include <gsh/light/cpu/shadow_map.hpp>
#endif

namespace gsh::test {

/// Not a CpuBackend, so the overloads below and the components' fallbacks serve it.
class Plain : public cpu::detail::HostBackend {
public:
    [[nodiscard]] static constexpr std::string_view name() { return "plain"; }
    [[nodiscard]] static bool available() { return true; }
    template <class Body>
    void for_each(std::size_t n, const Body& body) {
        for (std::size_t i = 0; i < n; ++i) body(i);
    }
};
static_assert(Backend<Plain> && !CpuBackend<Plain>);

/// Calls use(backend) with the plain backend and, where it can be compiled, the reference backend.
template <class Use>
void with_references(const Use& use) {
    Plain plain;
    use(plain);
#if defined(GSH_CUDA_EMULATION)
    cpu::Serial serial;
    use(serial);
#endif
}

} // namespace gsh::test

namespace gsh {

template <std::floating_point T>
struct SkinnedSplatsScratch<test::Plain, T> {};
template <std::floating_point T>
struct LitSplatsScratch<test::Plain, T> {};
template <std::floating_point T>
struct OcclusionFieldScratch<test::Plain, T> {};
template <std::floating_point T>
struct ShadowMapScratch<test::Plain, T> {};

} // namespace gsh

namespace gsh::test {

template <int Degree, class T, class D>
void skinned_splats_accumulate(Plain&, const gsh::detail::SkinnedSplatBackward<Degree, T, D>& element,
                               Span<typename D::template Bone<T>> dL_dbones, Span<vec3<T>> dL_dcenter,
                               SkinnedSplatsScratch<Plain, T>&) {
    vec3<T> center(T(0));
    for (std::size_t i = 0; i < element.input.gaussians.size(); ++i) element(i, dL_dbones, center);
    if (!dL_dcenter.empty()) dL_dcenter[0] += center;
}

template <class T>
void lit_vertices_accumulate(Plain&, const gsh::detail::LitVertexBackward<T>& element, const LightView<T>& dL_dlight,
                             Span<vec3<T>> dL_dcenter, LitSplatsScratch<Plain, T>&) {
    const auto& light = element.surface.light;
    std::vector<vec3<T>> points(light.points.size(), vec3<T>(T(0)));
    std::vector<T> log_intensities(light.size(), T(0)), gloss(2, T(0));
    vec3<T> center(T(0));
    for (std::size_t v = 0; v < element.shading.size(); ++v)
        element(v, LitLightSums<T>{points.data(), log_intensities.data(), gloss.data()}, center);
    for (std::size_t k = 0; k < dL_dlight.points.size(); ++k) dL_dlight.points[k] += points[k];
    for (std::size_t k = 0; k < dL_dlight.log_intensities.size(); ++k)
        dL_dlight.log_intensities[k] += log_intensities[k];
    for (std::size_t k = 0; k < dL_dlight.gloss.size(); ++k) dL_dlight.gloss[k] += gloss[k];
    if (!dL_dcenter.empty()) dL_dcenter[0] += center;
}

/// The values of all layers of one row, the first of which is relu(neurons + pose).
template <class Network, class T>
std::vector<std::vector<T>> occlusion_layers(const Network& network, Span<const T> weights, Span<const T> neurons,
                                             Span<const T> pose) {
    std::vector<std::vector<T>> layers(1);
    for (std::size_t o = 0; o < pose.size(); ++o) layers[0].push_back(max(neurons[o] + pose[o], T(0)));
    for (std::size_t l = 0; l < network.layer_count(); ++l) {
        std::vector<T> next;
        for (std::size_t o = 0; o < network.layer_outputs(l); ++o) {
            T sum(0);
            for (std::size_t k = 0; k < layers[l].size(); ++k)
                sum += weights[network.layer_offset(l) + o * layers[l].size() + k] * layers[l][k];
            next.push_back(l + 1 < network.layer_count() ? max(sum, T(0)) : sum);
        }
        layers.push_back(next);
    }
    return layers;
}

template <class Network, class T>
void occlusion_forward(Plain&, const Network& network, Span<const T> weights, Span<const T> neurons, Span<const T> pose,
                       Span<T> logits, OcclusionFieldScratch<Plain, T>&) {
    for (std::size_t i = 0; i < logits.size(); ++i)
        logits[i] =
            occlusion_layers(network, weights, neurons.subspan(i * pose.size(), pose.size()), pose).back().at(0);
}

template <class Network, class T>
void occlusion_backward(Plain&, const Network& network, Span<const T> weights, Span<const T> neurons,
                        Span<const T> pose, Span<const T> dL_dlogits, OcclusionFieldScratch<Plain, T>&,
                        Span<T> dL_dpose) {
    for (std::size_t i = 0; i < dL_dlogits.size(); ++i) {
        const auto layers = occlusion_layers(network, weights, neurons.subspan(i * pose.size(), pose.size()), pose);
        std::vector<T> dL_dy{dL_dlogits[i]};
        for (std::size_t l = network.layer_count(); l-- > 0;) {
            std::vector<T> dL_dx(layers[l].size(), T(0));
            for (std::size_t k = 0; k < dL_dx.size(); ++k) {
                for (std::size_t o = 0; o < dL_dy.size(); ++o)
                    dL_dx[k] += weights[network.layer_offset(l) + o * dL_dx.size() + k] * dL_dy[o];
                if (!(layers[l][k] > T(0))) dL_dx[k] = T(0);
            }
            dL_dy = dL_dx;
        }
        for (std::size_t o = 0; o < dL_dpose.size(); ++o) dL_dpose[o] += dL_dy[o];
    }
}

template <class T>
void shadow_draw(Plain&, Span<const ShadowFrame<T>> frames, const ShadowCaster<T>& caster, bool closed, bool clear,
                 Span<T> maps, ShadowMapScratch<Plain, T>&) {
    if (clear)
        for (T& texel : maps) texel = gsh::detail::shadow_empty<T>;
    for (const ShadowFrame<T>& frame : frames)
        for (const vec3<std::uint32_t>& corners : caster.triangles) {
            const auto vertex = [&](std::uint32_t v) {
                return gsh::detail::place_shadow_vertex(frame, caster.vertices[v]);
            };
            gsh::detail::ShadowTriangle<T> t;
            if (!t.place(vertex(corners.x), vertex(corners.y), vertex(corners.z), closed, 0, frame.height)) continue;
            for (int row = t.top; row < t.bottom; ++row)
                for (int column = t.left; column < t.right; ++column) {
                    const auto at = [&](const auto& edge) {
                        return edge.at + (column - t.left) * edge.column_step + (row - t.top) * edge.row_step;
                    };
                    if (at(t.bc) < 0 || at(t.ca) < 0 || at(t.ab) < 0) continue;
                    T& texel = maps[frame.begin + static_cast<std::size_t>(row * frame.stride + column)];
                    texel = max(texel, t.at_a + static_cast<T>(at(t.ca)) * t.to_b + static_cast<T>(at(t.ab)) * t.to_c);
                }
        }
}

} // namespace gsh::test
