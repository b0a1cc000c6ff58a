// SPDX-License-Identifier: Apache-2.0
/// @file  One frame of an avatar, forwards and backwards: rig, displacement, occlusion, skinning, light.
#pragma once

#include <gsh/avatar/deformation.hpp>
#include <gsh/avatar/rig.hpp>
#include <gsh/avatar/skinned_gaussian.hpp>
#include <gsh/avatar/skinned_splats.hpp>
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

/// The light in which a frame is shaded, and who casts shadows on the avatar beside its own body.
///
/// Shapes  light as in LightView, normal_offsets as in LitSurface, in the backend's memory; others: a list on the host.
template <std::floating_point T>
struct FrameLight {
    LightView<const T> light = {};
    Span<const vec3<T>> normal_offsets = {};
    Span<const ShadowCaster<T>> others = {};
};

/// Where AvatarPass::backward adds. Spans that are empty are not computed.
///
/// Shapes  gaussians: all attributes but means and weights; joints [J]; center [1]; light and normal_offsets as in
///         FrameLight.
template <std::floating_point T>
struct AvatarGradient {
    SkinnedView<T> gaussians = {};
    Span<vec3<T>> joints = {};
    RigPoseGradient<T> pose = {};
    Span<vec3<T>> center = {};
    LightView<T> light = {};
    Span<vec3<T>> normal_offsets = {};
};

/// From canonical Gaussians to the splats of a pose. A frame takes five calls, in this order; backward takes their
/// adjoints in reverse:
///
///     rig         joint rotations, bones, offsets of the body's surface    move()
///     displace    means = x₀ + δx, by the caller; then the offsets         forward(), as the rest
///     occlude     ambient occlusion of the pose, by the caller
///     skinning    splats; with a light, their colours are those of the surface itself
///     light       lit colours, if there is a light
///
/// Displacement and occlusion are the caller's, because they may learn (AvatarModel) or be stored (Avatar).
///
/// Shapes  N points and J joints of the rig; `gaussians` holds all attributes but means and weights.
/// Frame   see RigData (canonical) and Camera (world).
template <Backend B, std::floating_point T = float, class D = NamedDeformation>
class AvatarPass {
public:
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    /// Intermediate values of both passes; one cache per frame in flight.
    struct Cache {
        typename Rig<B, T>::Cache rig;
        Buffer<vec3<T>> means;       // [N] x̂₀(t) after forward
        Buffer<T> ao, dL_dao;        // [N] of this pose, or empty; the caller's
        Buffer<vec3<T>> dL_dmeans;   // [N] after backward
        Buffer<Affine<T>> dL_dbones; // [J] after backward
        Buffer<vec3<T>> dL_djoints;  // [J], used if the caller wants none
        SkinnedSplatsCache<B, T> skin;
        // with a light:
        Buffer<vec3<T>> dL_doffsets; // [V] after backward, or empty
        typename SurfaceLight<B, T>::Cache light;
    };

    /// With light settings, frames may have a light.
    /// Errors  ValueError for a light on a body without triangles.
    AvatarPass(B& backend, const RigData& rig, const SkinnedSplatsParams& params = {},
               const std::optional<SurfaceLightParams>& light = {})
        : backend_(&backend), rig_(backend, rig), params_(params) {
        if (!light) return;
        SurfaceLightParams of_surface = *light;
        of_surface.clamping = params.clamping;
        surface_light_.emplace(backend, rig.body, rig.betas, rig.triangles, rig.barycentric, of_surface);
    }

    /// From now on, the light casts shadows or does not. Nothing changes without a light.
    void set_shadows(bool shadows) {
        if (surface_light_) surface_light_->set_shadows(shadows);
    }

    /// Whether frames may have a light.
    [[nodiscard]] bool has_light() const { return surface_light_.has_value(); }
    [[nodiscard]] const Rig<B, T>& rig() const { return rig_; }
    [[nodiscard]] std::size_t size() const { return rig_.point_count(); }

    /// Brings the cache to a pose. joints [J]: the learned rest positions.
    void move(const RigPose<B, T>& pose, Span<const vec3<T>> joints, Cache& cache) const {
        rig_.forward(pose, joints, cache.rig);
    }

    /// The body's mesh in the cache's pose, for the light of others. It is valid until the next call with this cache.
    /// Errors  ValueError without a light, as for shading.
    [[nodiscard]] ShadowCaster<T> caster(Cache& cache) const {
        return lit("AvatarPass::caster").caster(surface(cache), cache.light);
    }
    /// Irradiance and gloss of each Gaussian in the last forward, [N], in the backend's memory.
    [[nodiscard]] Span<const LitShading<T>> shading(Cache& cache) const {
        return lit("AvatarPass::shading").shading(cache.light);
    }

    /// Splats of the cache's pose as seen from `center`. displace(means) writes x₀ + δx [N]; occlude() writes cache.ao
    /// [N], or leaves it empty, and returns what is used of it.
    template <int Degree, class Displace, class Occlude>
    void forward(SkinnedView<const T> gaussians, const Displace& displace, const Occlude& occlude,
                 const Deferred<vec3<T>>& center, const SplatView<T>& splats, Cache& cache,
                 const FrameLight<T>& light = {}) const {
        cache.means.resize(size());
        displace(Span<vec3<T>>(cache.means));
        rig_.add_offsets(cache.rig, cache.means);
        gaussians.ao = occlude();
        SplatView<T> skinned = splats;
        if (light.light.size()) {
            cache.light.base.resize(size());
            skinned.colors = cache.light.base;
        }
        skinning<Degree>().forward(posed(gaussians, cache), cache.rig.bones, center, skinned, cache.skin);
        if (light.light.size())
            lit("AvatarPass::forward")
                .forward(surface(cache, light), light.light, light.others, center, splats.colors, cache.light);
    }

    /// Adjoint of move and forward, whose arguments it takes again: adds to dL_din. displaced(dL_dmeans) and occluded()
    /// continue it, at the same time where the backend can; occluded reads dL_din.gaussians.ao.
    template <int Degree, class Displaced, class Occluded>
    void backward(const RigPose<B, T>& pose, SkinnedView<const T> gaussians, const Displaced& displaced,
                  const Occluded& occluded, const Deferred<vec3<T>>& center, SplatView<const T> dL_dsplats,
                  Cache& cache, AvatarGradient<T> dL_din, const FrameLight<T>& light = {}) {
        const bool reaches_pose = !dL_din.pose.empty();
        zeros(cache.dL_dmeans, size(), vec3<T>(T(0)));
        zeros(cache.dL_dbones, rig_.joint_count(), Affine<T>::zero());
        zeros(cache.dL_doffsets, light.light.size() && reaches_pose ? cache.rig.vertex_offsets.size() : 0,
              vec3<T>(T(0)));
        if (light.light.size()) {
            lit("AvatarPass::backward")
                .backward(surface(cache, light), light.light, center, dL_dsplats.colors, cache.light,
                          {.light = dL_din.light,
                           .bones = cache.dL_dbones,
                           .offsets = cache.dL_doffsets,
                           .normal_offsets = dL_din.normal_offsets,
                           .center = dL_din.center});
            dL_dsplats.colors = cache.light.dL_dbase;
        }
        dL_din.gaussians.means = cache.dL_dmeans;
        skinning<Degree>().backward(posed(gaussians, cache), cache.rig.bones, center, dL_dsplats, cache.skin,
                                    dL_din.gaussians, cache.dL_dbones, dL_din.center);
        for_each_branch(*backend_, 2, [&](std::size_t branch) {
            if (branch == 1) return displaced(Span<vec3<T>>(cache.dL_dmeans));
            // One branch, since both add to the gradient of the pose.
            if (dL_din.joints.empty()) {
                zeros(cache.dL_djoints, rig_.joint_count(), vec3<T>(T(0)));
                dL_din.joints = cache.dL_djoints;
            }
            rig_.backward(pose, cache.rig, cache.dL_dbones, cache.dL_dmeans, dL_din.joints, dL_din.pose,
                          cache.dL_doffsets);
            occluded();
        });
    }

private:
    template <int Degree>
    [[nodiscard]] SkinnedSplats<B, Degree, T, D> skinning() const {
        return SkinnedSplats<B, Degree, T, D>(*backend_, params_);
    }
    [[nodiscard]] SkinnedView<const T> posed(SkinnedView<const T> gaussians, const Cache& cache) const {
        gaussians.means = cache.means;
        gaussians.weights = rig_.skin();
        return gaussians;
    }
    [[nodiscard]] static LitSurface<T> surface(const Cache& cache, const FrameLight<T>& light = {}) {
        return {cache.rig.bones, cache.rig.vertex_offsets, light.normal_offsets};
    }
    [[nodiscard]] const SurfaceLight<B, T>& lit(std::string_view where) const {
        check_value(surface_light_.has_value(), where, "the avatar was made without a light");
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
