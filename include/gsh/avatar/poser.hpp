// SPDX-License-Identifier: Apache-2.0
/// @file  From canonical Gaussians to the splats of a pose: rig, offsets, skinning, shading, light, and the adjoint.
#pragma once

#include <gsh/avatar/deformation.hpp>
#include <gsh/avatar/rig.hpp>
#include <gsh/avatar/skinned_gaussian.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/light/light.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/light/surface_light.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstddef>
#include <optional>
#include <string_view>

namespace gsh {

/// The light in which a poser shades its Gaussians, and who casts shadows on them beside their own body.
///
/// Shapes  light as in LightView, normal_offsets as in LitSurface, in the backend's memory; others: a list on the host.
template <std::floating_point T>
struct PoserLight {
    LightView<const T> light = {};
    Span<const vec3<T>> normal_offsets = {};
    Span<const ShadowCaster<T>> others = {};
};

/// Gradient with respect to a PoserLight. Casters have none.
template <std::floating_point T>
struct PoserLightGradient {
    LightView<T> light = {};
    Span<vec3<T>> normal_offsets = {};
    bool reaches_pose = false; ///< the gradient of the surface, too, for a bones_backward with a gradient of the pose
};

/// Poses the Gaussians of an avatar. One frame takes three calls, because the displacement of the canonical means and
/// the ambient occlusion may depend on the pose:
///
///     bones(pose, joints, cache)       joint rotations, bones, offsets of the body's surface
///     cache.means := x₀ + δx           by the caller, [N]
///     forward(gaussians, …)            adds the offsets to the means, skins, shades
///
/// `backward` and then `bones_backward` are the adjoints. With a light, the colours of skinning are those of the
/// surface itself; SurfaceLight shades them.
///
/// Shapes  N points and J joints of the rig; `gaussians` holds all attributes but means and weights.
/// Frame   see RigData (canonical) and Camera (world).
template <Backend B, std::floating_point T = float, class D = NamedDeformation>
class Poser {
public:
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    /// Intermediate values of both passes; one cache per frame in flight.
    struct Cache {
        typename Rig<B, T>::Cache rig;
        Buffer<vec3<T>> means;       // [N] x̂₀(t) after forward
        Buffer<vec3<T>> dL_dmeans;   // [N] after backward
        Buffer<Affine<T>> dL_dbones; // [J] after backward
        Buffer<vec3<T>> dL_djoints;  // [J], used if the caller passes none
        SkinnedSplatsCache<B, T> skin;
        // with a light:
        Buffer<vec3<T>> dL_doffsets; // [V] after backward, or empty
        typename SurfaceLight<B, T>::Cache light;
    };

    Poser(B& backend, const RigData& rig, const SkinnedSplatsParams& params = {})
        : backend_(&backend), rig_(backend, rig), params_(params) {}

    /// From now on, forward and backward accept a light. `rig` is that of the constructor.
    /// Errors  ValueError for a body without triangles.
    void prepare_light(const RigData& rig, SurfaceLightParams params = {}) {
        params.clamping = params_.clamping;
        surface_light_.emplace(*backend_, rig.body, rig.betas, rig.triangles, rig.barycentric, params);
    }

    /// From now on, the light casts shadows or does not. Without prepare_light, nothing changes.
    void set_shadows(bool shadows) {
        if (surface_light_) surface_light_->set_shadows(shadows);
    }

    /// Whether prepare_light was called.
    [[nodiscard]] bool has_light() const { return surface_light_.has_value(); }

    [[nodiscard]] const Rig<B, T>& rig() const { return rig_; }
    [[nodiscard]] std::size_t size() const { return rig_.point_count(); }

    /// joints [J]: the learned rest positions.
    void bones(const RigPose<B, T>& pose, Span<const vec3<T>> joints, Cache& cache) const {
        rig_.forward(pose, joints, cache.rig);
        cache.means.resize(size());
    }

    /// The body's mesh after bones(), for the light of others. It is valid until the next call with this cache.
    [[nodiscard]] ShadowCaster<T> caster(Cache& cache) const {
        return lit("Poser::caster").caster(surface(cache), cache.light);
    }

    /// Irradiance and gloss of each Gaussian in the last forward, [N], in the backend's memory.
    [[nodiscard]] Span<const LitShading<T>> shading(Cache& cache) const {
        return lit("Poser::shading").shading(cache.light);
    }

    /// Splats as seen from `center`, in a light if there is one.
    template <int Degree>
    void forward(SkinnedView<const T> gaussians, const Deferred<vec3<T>>& center, const SplatView<T>& splats,
                 Cache& cache, const PoserLight<T>& light = {}) const {
        rig_.add_offsets(cache.rig, cache.means);
        SplatView<T> skinned = splats;
        if (light.light.size()) {
            cache.light.base.resize(size());
            skinned.colors = cache.light.base;
        }
        skin<Degree>().forward(posed(gaussians, cache), cache.rig.bones, center, skinned, cache.skin);
        if (!light.light.size()) return;
        lit("Poser::forward")
            .forward(surface(cache, light), light.light, light.others, center, splats.colors, cache.light);
    }

    /// Adjoint of forward with respect to the Gaussians, the light and the camera: adds to the non-empty attributes of
    /// dL_dgaussians and parts of dL_dlight, and to dL_dcenter [1] unless it is empty. Overwrites cache.dL_dmeans with
    /// the gradient of the canonical means, and what bones_backward needs. The light is that of forward.
    template <int Degree>
    void backward(SkinnedView<const T> gaussians, const Deferred<vec3<T>>& center, SplatView<const T> dL_dsplats,
                  Cache& cache, SkinnedView<T> dL_dgaussians, Span<vec3<T>> dL_dcenter = {},
                  const PoserLight<T>& light = {}, const PoserLightGradient<T>& dL_dlight = {}) const {
        zeros(cache.dL_dmeans, size(), vec3<T>(T(0)));
        zeros(cache.dL_dbones, rig_.joint_count(), Affine<T>::zero());
        zeros(cache.dL_doffsets, light.light.size() && dL_dlight.reaches_pose ? cache.rig.vertex_offsets.size() : 0,
              vec3<T>(T(0)));
        if (light.light.size()) {
            lit("Poser::backward")
                .backward(surface(cache, light), light.light, center, dL_dsplats.colors, cache.light,
                          {.light = dL_dlight.light,
                           .bones = cache.dL_dbones,
                           .offsets = cache.dL_doffsets,
                           .normal_offsets = dL_dlight.normal_offsets,
                           .center = dL_dcenter});
            dL_dsplats.colors = cache.light.dL_dbase;
        }
        dL_dgaussians.means = cache.dL_dmeans;
        skin<Degree>().backward(posed(gaussians, cache), cache.rig.bones, center, dL_dsplats, cache.skin, dL_dgaussians,
                                cache.dL_dbones, dL_dcenter);
    }

    /// Adjoint of bones, and of the offsets that forward adds, after backward: adds to dL_djoints [J] unless it is
    /// empty, and to the non-empty parts of dL_dpose.
    void bones_backward(const RigPose<B, T>& pose, Cache& cache, Span<vec3<T>> dL_djoints,
                        const RigPoseGradient<T>& dL_dpose) {
        if (dL_djoints.empty()) {
            zeros(cache.dL_djoints, rig_.joint_count(), vec3<T>(T(0)));
            dL_djoints = cache.dL_djoints;
        }
        rig_.backward(pose, cache.rig, cache.dL_dbones, cache.dL_dmeans, dL_djoints, dL_dpose, cache.dL_doffsets);
    }

private:
    template <int Degree>
    [[nodiscard]] SkinnedSplats<B, Degree, T, D> skin() const {
        return SkinnedSplats<B, Degree, T, D>(*backend_, params_);
    }
    [[nodiscard]] SkinnedView<const T> posed(SkinnedView<const T> gaussians, const Cache& cache) const {
        gaussians.means = cache.means;
        gaussians.weights = rig_.skin();
        return gaussians;
    }
    [[nodiscard]] static LitSurface<T> surface(const Cache& cache, const PoserLight<T>& light = {}) {
        return {cache.rig.bones, cache.rig.vertex_offsets, light.normal_offsets};
    }
    [[nodiscard]] const SurfaceLight<B, T>& lit(std::string_view where) const {
        check_value(surface_light_.has_value(), where, "there is a light; call prepare_light first");
        return *surface_light_;
    }
    void zeros(auto& buffer, std::size_t count, const auto& zero) const {
        buffer.resize(count);
        backend_->fill(Span(buffer.data(), count), zero);
    }

    B* backend_;
    Rig<B, T> rig_;
    SkinnedSplatsParams params_;
    std::optional<SurfaceLight<B, T>> surface_light_;
};

} // namespace gsh
