// SPDX-License-Identifier: Apache-2.0
/// @file  An avatar that is ready to be shown: canonical Gaussians on a rig, posed by a motion.
#pragma once

#include <gsh/avatar/deformation.hpp>
#include <gsh/avatar/occlusion_field.hpp>
#include <gsh/avatar/rig.hpp>
#include <gsh/avatar/skinned_gaussian.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/core/error.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/gaussian/splats.hpp>

#include <concepts>
#include <cstddef>
#include <optional>
#include <vector>

namespace gsh {

/// Everything that animating an avatar needs, on the host, as avatar files hold it.
///
/// Shapes  rig with N points; gaussians [N], their means displaced already. rig.joints are the learned joints.
struct AvatarData {
    RigData rig;
    GaussianCloud<float> gaussians;
    ColorClamp clamping = ColorClamp::both;
    PixelFilter filter = {}; ///< for the rasterizer that draws it
    Deformation deformation = Deformation::linear;
    std::vector<float> ao = {}; ///< [N] ambient occlusion that holds in every pose, or empty for 1
    /// Ambient occlusion that follows the pose. `ao` is then its mean over training, for what knows no poses.
    std::optional<OcclusionFieldData> occlusion = {};
};

/// The canonical Gaussians with their `ao` in their colours, for files that know none: exact where a colour lies
/// within [0, 1], ao (Y sh + 1/2) = Y (ao sh) + 1/2 + (ao - 1)/2.
[[nodiscard]] inline GaussianCloud<float> shaded_cloud(const AvatarData& avatar) {
    GaussianCloud<float> cloud = avatar.gaussians;
    if (avatar.ao.empty()) return cloud;
    const auto basis = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        for (std::size_t k = 0; k < basis; ++k) cloud.sh[i * basis + k] *= avatar.ao[i];
        cloud.sh[i * basis] += sh_of_color(vec3<float>(0.5f * avatar.ao[i]));
    }
    return cloud;
}

/// Poses an avatar. The parameter fields were queried when it was made, so a frame costs skinning and shading, and
/// where shadows follow the pose most of one small network.
///
/// Frame   see RigData (canonical) and Camera (world).
/// Errors  ShapeError if rig and Gaussians differ in number, or if the occlusion field is another body's.
template <Backend B, std::floating_point T = float>
class Avatar {
public:
    /// One per frame in flight.
    struct Cache {
        typename Rig<B, T>::Cache rig;
        typename B::template Buffer<vec3<T>> means; // [N]
        typename B::template Buffer<T> ao;          // [N] of this pose, where it follows the pose
        typename OcclusionField<B, T>::Cache occlusion;
        // gradients on their way back
        typename B::template Buffer<vec3<T>> dL_dmeans, dL_djoints;
        typename B::template Buffer<Affine<T>> dL_dbones;
        typename B::template Buffer<T> dL_dao;
        typename B::template Buffer<mat3<T>> dL_drotations;
        SkinnedSplatsWorkspace<B, T> workspace;
    };

    Avatar(B& backend, const AvatarData& data)
        : backend_(&backend), rig_(backend, data.rig), clamping_(data.clamping), deformation_(data.deformation) {
        check_size("Avatar", "gaussians", data.gaussians.size(), data.rig.point_count(), "one per point of the rig");
        if (!data.ao.empty())
            check_size("Avatar", "ao", data.ao.size(), data.rig.point_count(), "one per Gaussian, or none");
        if (data.occlusion)
            occlusion_.emplace(backend, *data.occlusion, data.rig.point_count(), data.rig.joint_count());
        const std::vector<T> ao(data.ao.begin(), data.ao.end());
        ao_.resize(ao.size());
        backend.upload(Span<const T>(ao), ao_);
        GaussianCloud<T> cloud;
        const auto cast = [](const auto& from, auto& to) {
            using To = typename std::remove_cvref_t<decltype(to)>::value_type;
            to.clear();
            for (const auto& value : from) to.push_back(To(value));
        };
        cast(data.gaussians.means, cloud.means);
        cast(data.gaussians.log_scales, cloud.log_scales);
        cast(data.gaussians.opacity_logits, cloud.opacity_logits);
        cast(data.gaussians.sh, cloud.sh);
        for (const quat<float>& q : data.gaussians.quats) cloud.quats.push_back({T(q.w), T(q.x), T(q.y), T(q.z)});
        cloud.sh_degree = data.gaussians.sh_degree;
        upload(backend, cloud, gaussians_);
        joints_.resize(data.rig.joints.size());
        std::vector<vec3<T>> joints;
        for (const auto& joint : data.rig.joints) joints.push_back(vec3<T>(joint));
        backend.upload(Span<const vec3<T>>(joints), joints_);
    }

    [[nodiscard]] std::size_t size() const { return gaussians_.size(); }
    [[nodiscard]] const Rig<B, T>& rig() const { return rig_; }

    /// Splats of a pose as seen from `center` (Camera::center()); splats must have size() elements.
    void pose(const RigPose<B, T>& pose, const vec3<T>& center, const SplatView<T>& splats, Cache& cache) const {
        rig_.forward(pose, joints_, cache.rig);
        cache.means.resize(size());
        backend_->copy(Span<const vec3<T>>(gaussians_.means), cache.means);
        rig_.add_offsets(cache.rig, cache.means);
        if (occlusion_) {
            cache.ao.resize(size());
            occlusion_->forward(rig_.skeleton(), cache.rig.rotations, cache.ao, cache.occlusion);
        }
        with_sh_degree(gaussians_.sh_degree, [&](auto degree) {
            skinned_splats_forward<decltype(degree)::value>(*backend_, view(cache), cache.rig.bones, center, splats,
                                                            cache.workspace, clamping_, deformation_);
        });
    }

    /// Adjoint of pose with respect to the pose alone, the avatar being what it is: adds to what is asked for in
    /// dL_dpose, and to dL_dcenter [1] if given. The other arguments are those of the forward pass that filled the
    /// cache.
    void pose_backward(const RigPose<B, T>& pose, const vec3<T>& center, const SplatView<const T>& dL_dsplats,
                       Cache& cache, const RigPoseGradient<T>& dL_dpose, Span<vec3<T>> dL_dcenter = {}) {
        const auto zeros = [&](auto& buffer, std::size_t count, auto zero) {
            buffer.resize(count);
            backend_->fill(Span(buffer.data(), count), zero);
        };
        zeros(cache.dL_dmeans, size(), vec3<T>(T(0)));
        zeros(cache.dL_djoints, joints_.size(), vec3<T>(T(0)));
        zeros(cache.dL_dbones, joints_.size(), Affine<T>::zero());
        const bool shadows_move = occlusion_ && !dL_dpose.pose.empty();
        zeros(cache.dL_dao, shadows_move ? size() : 0, T(0));
        const SkinnedView<T> dL_dgaussians{.means = cache.dL_dmeans,
                                           .quats = {},
                                           .log_scales = {},
                                           .opacity_logits = {},
                                           .sh = {},
                                           .ao = cache.dL_dao};
        with_sh_degree(gaussians_.sh_degree, [&](auto degree) {
            skinned_splats_backward<decltype(degree)::value>(*backend_, view(cache), cache.rig.bones, center,
                                                             dL_dsplats, cache.workspace, dL_dgaussians,
                                                             cache.dL_dbones, dL_dcenter, clamping_, deformation_);
        });
        rig_.backward(pose, cache.rig, cache.dL_dbones, cache.dL_dmeans, cache.dL_djoints, dL_dpose);
        if (shadows_move) {
            zeros(cache.dL_drotations, joints_.size(), mat3<T>(T(0)));
            occlusion_->backward(rig_.skeleton(), cache.ao, cache.dL_dao, cache.occlusion, cache.dL_drotations);
            rig_.skeleton().rotations_backward(pose.pose, cache.dL_drotations, dL_dpose.pose);
        }
    }

private:
    [[nodiscard]] SkinnedView<const T> view(const Cache& cache) const {
        return {cache.means,   gaussians_.quats, gaussians_.log_scales, gaussians_.opacity_logits,
                gaussians_.sh, occlusion_ ? Span<const T>(cache.ao) : Span<const T>(ao_), rig_.skin()};
    }

    B* backend_;
    Rig<B, T> rig_;
    Gaussians<B, T> gaussians_;
    typename B::template Buffer<vec3<T>> joints_;
    ColorClamp clamping_;
    Deformation deformation_;
    typename B::template Buffer<T> ao_; // [N] or empty
    std::optional<OcclusionField<B, T>> occlusion_;
};

} // namespace gsh
