// SPDX-License-Identifier: Apache-2.0
/// @file  A backend that is not a CPU backend. Its overloads only record their calls.
#pragma once

#include <gsh/avatar/occlusion_field.hpp>
#include <gsh/avatar/skinned_splats.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/backend/sum.hpp>
#include <gsh/body/blend_shapes.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/hash_grid.hpp>
#include <gsh/field/mlp.hpp>
#include <gsh/light/lit_splats.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/loss/lpips.hpp>
#include <gsh/loss/photometric.hpp>
#include <gsh/optim/adam.hpp>
#include <gsh/render/rasterizer.hpp>

#include <algorithm>
#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace other {

/// Satisfies the concept Backend, but not HostExecutor.
struct Device {
    template <class T>
    using Buffer = std::vector<T>;
    static constexpr bool host_memory = true; // these tests are about overloads, not about memory

    std::vector<std::string> calls = {};

    [[nodiscard]] static constexpr std::string_view name() { return "other"; }
    [[nodiscard]] static bool available() { return true; }
    void for_each(std::size_t n, const auto& body) {
        for (std::size_t i = 0; i < n; ++i) body(i);
    }
    template <class T>
    void fill(gsh::Span<T> values, std::type_identity_t<T> value) {
        std::fill(values.begin(), values.end(), value);
    }
    template <class T>
    void copy(gsh::Span<const T> from, gsh::Span<std::type_identity_t<T>> to) {
        std::copy(from.begin(), from.end(), to.begin());
    }
    template <class T>
    void upload(gsh::Span<const T> from, gsh::Span<std::type_identity_t<T>> to) {
        copy(from, to);
    }
    template <class T>
    void download(gsh::Span<const T> from, gsh::Span<std::type_identity_t<T>> to) {
        copy(from, to);
    }
    void synchronize() {}
};
static_assert(gsh::Backend<Device> && !gsh::CpuBackend<Device>);

} // namespace other

// The backend's own scratch types.
namespace gsh {
template <std::floating_point T>
struct RasterScratch<other::Device, T> {
    int sorted = 0;
};
template <std::floating_point T>
struct HashScratch<other::Device, T> {};
template <std::floating_point T>
struct MlpScratch<other::Device, T> {
    std::vector<std::uint16_t> half_precision;
};
template <std::floating_point T>
struct PhotometricScratch<other::Device, T> {};
template <std::floating_point T>
struct SkinnedSplatsScratch<other::Device, T> {};
template <std::floating_point T>
struct OcclusionFieldScratch<other::Device, T> {};
template <std::floating_point T>
struct LitSplatsScratch<other::Device, T> {};
template <std::floating_point T>
struct BlendShapesScratch<other::Device, T> {};
template <std::floating_point T>
struct ShadowMapScratch<other::Device, T> {};
} // namespace gsh

namespace other {

using namespace gsh;

template <class T>
void composite_forward(Device& device, const Deferred<Camera<T>>&, const SplatView<const T>&, const Background<T>&,
                       const RasterParams<T>&, const RenderTarget<T>&, RasterCache<Device, T>& cache) {
    device.calls.push_back("composite_forward");
    cache.status.assign(1, RasterStatus{});
    ++cache.scratch.sorted;
}
template <class T>
void composite_backward(Device& device, const Deferred<Camera<T>>&, const SplatView<const T>&, const Background<T>&,
                        const RasterParams<T>&, const RenderGradient<T>&, RasterCache<Device, T>&, const SplatView<T>&,
                        Span<CameraGradient<T>>, const BackgroundGradient<T>&) {
    device.calls.push_back("composite_backward");
}

template <class Grid, class T, class Query>
void hash_prepare(Device& device, const Grid&, Span<const vec3<T>>, const LevelWeights<T>&, Query&) {
    device.calls.push_back("hash_prepare");
}
template <class Grid, class T, class Query>
void hash_forward(Device& device, const Grid&, Span<const T>, const Query&, FeatureView<T>, Write) {
    device.calls.push_back("hash_forward");
}
template <class Grid, class T, class Query>
void hash_backward(Device& device, const Grid&, FeatureView<const T>, const Query&, Span<T>) {
    device.calls.push_back("hash_backward");
}

template <class T>
void mlp_forward(Device& device, const Mlp&, Span<const T>, const MlpInputs<T>&, Span<T>,
                 MlpScratch<Device, T>& scratch) {
    device.calls.push_back("mlp_forward");
    scratch.half_precision.resize(1);
}
template <class T>
void mlp_backward(Device& device, const Mlp&, Span<const T>, const MlpInputs<T>&, Span<const T>,
                  MlpScratch<Device, T>&, Span<T>, FeatureView<T>, Write, Span<T>) {
    device.calls.push_back("mlp_backward");
}

template <class T>
void photometric_forward(Device& device, const ImageView<const T>&, const ImageView<const T>&,
                         const PhotometricParams<T>&, PhotometricCache<Device, T>& cache) {
    device.calls.push_back("photometric_forward");
    cache.values = {1, 2, 3, 4};
}
template <class T>
void photometric_backward(Device& device, const ImageView<const T>&, const ImageView<const T>&, T,
                          const PhotometricParams<T>&, const PhotometricCache<Device, T>&, const ImageView<T>&) {
    device.calls.push_back("photometric_backward");
}

template <class T>
void lpips_forward(Device& device, const LpipsWeights<Device, T>& network, const ImageView<const T>&, LpipsScaling,
                   LpipsFeatures<Device, T>& features) {
    device.calls.push_back("lpips_forward");
    for (std::size_t k = 0; k < features.maps.size(); ++k)
        features.maps[k].channels = static_cast<int>(network.lins[k].size());
}
template <class T>
double lpips_distance(Device& device, const LpipsWeights<Device, T>&, const LpipsFeatures<Device, T>&,
                      const LpipsFeatures<Device, T>&) {
    device.calls.push_back("lpips_distance");
    return 0.5;
}

template <class Step>
void adam_step(Device& device, const Step&, std::size_t) {
    device.calls.push_back("adam_step");
}
template <class Step>
void adam_step_rows(Device& device, const Step&, Span<const std::uint32_t>, std::size_t) {
    device.calls.push_back("adam_step_rows");
}
template <class Step>
void adam_step_columns(Device& device, const Step&, const Step&, std::size_t, std::size_t, std::size_t) {
    device.calls.push_back("adam_step_columns");
}

template <int Degree, class T, class D>
void skinned_splats_accumulate(Device& device, const gsh::detail::SkinnedSplatBackward<Degree, T, D>&,
                               Span<typename D::template Bone<T>>, Span<vec3<T>>, SkinnedSplatsScratch<Device, T>&) {
    device.calls.push_back("skinned_splats_accumulate");
}

template <class T>
void lit_vertices_accumulate(Device& device, const gsh::detail::LitVertexBackward<T>&, const LightView<T>&,
                             Span<vec3<T>>, LitSplatsScratch<Device, T>&) {
    device.calls.push_back("lit_vertices_accumulate");
}

template <class T>
void occlusion_forward(Device& device, const Mlp&, Span<const T>, Span<const T>, Span<const T>, Span<T>,
                       OcclusionFieldScratch<Device, T>&) {
    device.calls.push_back("occlusion_forward");
}
template <class T>
void occlusion_backward(Device& device, const Mlp&, Span<const T>, Span<const T>, Span<const T>, Span<const T>,
                        OcclusionFieldScratch<Device, T>&, Span<T>) {
    device.calls.push_back("occlusion_backward");
}

template <class T>
void blend_shapes_forward(Device& device, Span<const vec3<T>>, Span<const T>, Span<vec3<T>>) {
    device.calls.push_back("blend_shapes_forward");
}
template <class T>
void blend_shapes_backward(Device& device, Span<const vec3<T>>, Span<const vec3<T>>, Span<T>,
                           BlendShapesScratch<Device, T>&) {
    device.calls.push_back("blend_shapes_backward");
}

template <class T>
void shadow_draw(Device& device, Span<const ShadowFrame<T>>, const ShadowCaster<T>&, bool, bool, Span<T> maps,
                 ShadowMapScratch<Device, T>&) {
    device.calls.push_back("shadow_draw");
    device.fill(maps, T(0));
}

template <class T>
void add_sum(Device& device, Span<const T>, Span<T>, std::vector<T>&) {
    device.calls.push_back("add_sum");
}

} // namespace other
