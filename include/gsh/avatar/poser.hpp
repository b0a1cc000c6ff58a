// SPDX-License-Identifier: Apache-2.0
/// @file  From canonical Gaussians to the splats of a pose: rig, offsets, skinning and shading, with the adjoint.
#pragma once

#include <gsh/avatar/deformation.hpp>
#include <gsh/avatar/rig.hpp>
#include <gsh/avatar/skinned_gaussian.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstddef>

namespace gsh {

/// Poses the Gaussians of an avatar. One frame takes three calls, because the displacement of the canonical means and
/// the ambient occlusion may depend on the pose:
///
///     bones(pose, joints, cache)       joint rotations, bones, offsets of the body's surface
///     cache.means := x₀ + δx           by the caller, [N]
///     forward(gaussians, …)            adds the offsets to the means, skins, shades
///
/// Shapes  N points and J joints of the rig; `gaussians` holds all attributes but means and weights.
/// Frame   see RigData (canonical) and Camera (world).
template <Backend B, std::floating_point T = float>
class Poser {
public:
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    /// Intermediate values of both passes; one cache per frame in flight.
    struct Cache {
        typename Rig<B, T>::Cache rig;
        Buffer<vec3<T>> means;       // [N] x̂₀(t) after forward
        Buffer<vec3<T>> dL_dmeans;   // [N] after backward
        Buffer<vec3<T>> dL_djoints;  // [J], used if the caller passes none
        Buffer<Affine<T>> dL_dbones; // [J]
        SkinnedSplatsCache<B, T> skin;
    };

    Poser(B& backend, const RigData& rig, const SkinnedSplatsParams& params = {})
        : backend_(&backend), rig_(backend, rig), params_(params) {}

    [[nodiscard]] const Rig<B, T>& rig() const { return rig_; }
    [[nodiscard]] std::size_t size() const { return rig_.point_count(); }

    /// joints [J]: the learned rest positions.
    void bones(const RigPose<B, T>& pose, Span<const vec3<T>> joints, Cache& cache) const {
        rig_.forward(pose, joints, cache.rig);
        cache.means.resize(size());
    }

    /// Splats as seen from `center`.
    template <int Degree>
    void forward(SkinnedView<const T> gaussians, const vec3<T>& center, const SplatView<T>& splats,
                 Cache& cache) const {
        rig_.add_offsets(cache.rig, cache.means);
        skin<Degree>().forward(posed(gaussians, cache), cache.rig.bones, center, splats, cache.skin);
    }

    /// Adjoint of forward and bones: adds to the non-empty attributes of dL_dgaussians, to dL_djoints [J] unless it is
    /// empty, and to the non-empty parts of dL_dpose and dL_dcenter. Overwrites cache.dL_dmeans with the gradient of
    /// the canonical means.
    template <int Degree>
    void backward(const RigPose<B, T>& pose, SkinnedView<const T> gaussians, const vec3<T>& center,
                  const SplatView<const T>& dL_dsplats, Cache& cache, SkinnedView<T> dL_dgaussians,
                  Span<vec3<T>> dL_djoints, const RigPoseGradient<T>& dL_dpose, Span<vec3<T>> dL_dcenter) {
        zeros(cache.dL_dmeans, size(), vec3<T>(T(0)));
        zeros(cache.dL_dbones, rig_.joint_count(), Affine<T>::zero());
        if (dL_djoints.empty()) {
            zeros(cache.dL_djoints, rig_.joint_count(), vec3<T>(T(0)));
            dL_djoints = cache.dL_djoints;
        }
        dL_dgaussians.means = cache.dL_dmeans;
        skin<Degree>().backward(posed(gaussians, cache), cache.rig.bones, center, dL_dsplats, cache.skin, dL_dgaussians,
                                cache.dL_dbones, dL_dcenter);
        rig_.backward(pose, cache.rig, cache.dL_dbones, cache.dL_dmeans, dL_djoints, dL_dpose);
    }

private:
    template <int Degree>
    [[nodiscard]] SkinnedSplats<B, Degree, T> skin() const {
        return SkinnedSplats<B, Degree, T>(*backend_, params_);
    }
    [[nodiscard]] SkinnedView<const T> posed(SkinnedView<const T> gaussians, const Cache& cache) const {
        gaussians.means = cache.means;
        gaussians.weights = rig_.skin();
        return gaussians;
    }
    void zeros(auto& buffer, std::size_t count, const auto& zero) const {
        buffer.resize(count);
        backend_->fill(Span(buffer.data(), count), zero);
    }

    B* backend_;
    Rig<B, T> rig_;
    SkinnedSplatsParams params_;
};

} // namespace gsh
