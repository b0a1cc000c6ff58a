// SPDX-License-Identifier: Apache-2.0
/// @file  The frames of an avatar as still Gaussians, with pose, ambient occlusion and light in their own numbers.
#pragma once

#include <gsh/avatar/avatar.hpp>
#include <gsh/avatar/deformation.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/skinning.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/moved_cloud.hpp>
#include <gsh/gaussian/sh_fit.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/light/light.hpp>
#include <gsh/math/polar.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cstddef>
#include <limits>
#include <vector>

namespace gsh {

/// How the colours of an avatar become those of still Gaussians.
struct StillFrameParams {
    int sh_degree = 3;           ///< of the result at most; never more than the avatar's
    std::size_t views = 48;      ///< directions from which a lit avatar's colours are taken
    double view_distance = 3;    ///< metres from those cameras to the middle of the body
    double ridge = 3e-3;         ///< weight of the unlit bands where the views leave the fit open
    double hidden_weight = 0.02; ///< weight of a view from behind the surface, which rarely shows the Gaussian
};

/// Turns posed frames of an avatar into clouds that any program for 3D Gaussians shows as they are. All frames have the
/// same order of Gaussians.
///
/// A blend with linear part A moves F = R S of a canonical Gaussian to A F. Scale and quaternion are the principal axes
/// of A F, so that the covariance is that of Avatar::pose. The SH coefficients turn by the rotation nearest to A. That
/// is exact where A is a rotation. Where A also shears, the direction in which a colour is read differs a little.
///
/// Without a light, ambient occlusion is merged as in shaded_cloud. With a light, the colours of the avatar are
/// computed for cameras all around the body, with shading, shadows and gloss of this pose. Each Gaussian's coefficients
/// are fitted to them (ShFit).
///
/// Frame   the world of the motion.
/// Errors  those of Avatar and of Rig::upload_pose.
template <Backend B>
    requires CpuBackend<B>
class StillFrames {
public:
    /// `data` must outlive this object.
    StillFrames(B& backend, const AvatarData& data, const StillFrameParams& params = {})
        : backend_(&backend), data_(&data), params_(params), avatar_(backend, data),
          degree_(std::min(params.sh_degree, data.gaussians.sh_degree)) {
        check_value(params.sh_degree >= 0 && params.sh_degree <= 4, "StillFrames", "sh_degree must be 0 to 4");
        check_value(params.views > 0 && params.view_distance > 0, "StillFrames", "there must be a view");
        splats_.resize(avatar_.size());
    }

    [[nodiscard]] std::size_t size() const { return avatar_.size(); }
    /// The degree of the clouds.
    [[nodiscard]] int sh_degree() const { return degree_; }

    /// One frame of a motion.
    [[nodiscard]] GaussianCloud<float> frame(const Motion& motion, std::size_t index) {
        avatar_.rig().upload_pose(motion, index, pose_);
        see({0, 0, 0});
        GaussianCloud<float> cloud(size(), degree_);
        detail::with_deformation(data_->deformation, [&](auto policy) { shape<decltype(policy)>(cloud); });
        if (data_->light)
            with_sh_degree(degree_, [&](auto degree) { fit_colors<decltype(degree)::value>(cloud); });
        else if (!ao().empty())
            detail::darken_cloud(cloud, ao());
        return cloud;
    }

    /// The means alone, which cost a single posing.
    [[nodiscard]] std::vector<vec3<float>> means(const Motion& motion, std::size_t index) {
        avatar_.rig().upload_pose(motion, index, pose_);
        see({0, 0, 0});
        return {splats_.means.begin(), splats_.means.end()};
    }

private:
    static constexpr std::size_t grain = 1 << 10;

    void see(const vec3<float>& center) { avatar_.pose(pose_, center, splats_.view(), cache_); }

    [[nodiscard]] Span<const float> ao() const {
        return data_->occlusion_field ? Span<const float>(cache_.ao) : Span<const float>(data_->ao);
    }

    /// Means, scales, quaternions, opacities, and coefficients turned into the world.
    template <class D>
    void shape(GaussianCloud<float>& cloud) {
        using Bone = typename D::template Bone<float>;
        const Span<const Bone> bones =
            detail::bones_of<D>(*backend_, Span<const Affine<float>>(cache_.rig.bones), cache_.skin);
        const SkinWeights<float> skin = avatar_.rig().skin();
        const GaussianCloud<float>& from = data_->gaussians;
        const auto basis = static_cast<std::size_t>(sh_basis_count(degree_)),
                   stride = static_cast<std::size_t>(sh_basis_count(from.sh_degree));
        backend_->for_chunks(size(), grain, [&](std::size_t, std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) {
                const Bone bone = blend(skin, i, bones);
                const typename D::template Transform<float> transform(bone);
                const mat3<double> A(transform.turn());
                cloud.means[i] = splats_.means[i];
                cloud.quats[i] = from.quats[i], cloud.log_scales[i] = from.log_scales[i];
                move_shape(A, cloud.quats[i], cloud.log_scales[i]);
                cloud.opacity_logits[i] = from.opacity_logits[i];
                std::copy_n(from.sh.data() + i * stride, basis, cloud.sh.data() + i * basis);
                with_sh_degree(degree_, [&](auto degree) {
                    turn_sh<decltype(degree)::value>(polar_rotation(A), cloud.sh.data() + i * basis);
                });
            }
        });
    }

    /// Colours of this pose as seen from all around.
    template <int Degree>
    void fit_colors(GaussianCloud<float>& cloud) {
        constexpr std::size_t basis = sh_basis_count(Degree);
        vec3<double> low(std::numeric_limits<double>::infinity()), high(-low);
        for (const vec3<float>& mean : cloud.means)
            low = glm::min(low, vec3<double>(mean)), high = glm::max(high, vec3<double>(mean));
        std::vector<vec3<double>> centers;
        for (const vec3<double>& direction : even_directions(params_.views))
            centers.push_back((low + high) * 0.5 + direction * params_.view_distance);
        colors_.resize(centers.size() * size());
        for (std::size_t k = 0; k < centers.size(); ++k) {
            see(vec3<float>(centers[k]));
            std::copy(splats_.colors.begin(), splats_.colors.end(),
                      colors_.begin() + static_cast<std::ptrdiff_t>(k * size()));
        }
        // The bands that depend on the view, with the slope of the lit colour, are what the fit starts from.
        const Span<const LitShading<float>> shading = avatar_.shading(cache_);
        std::vector<float> irradiance(size());
        for (std::size_t i = 0; i < size(); ++i) irradiance[i] = shading[i].x;
        detail::light_cloud(cloud, data_->clamping, irradiance);

        const Span<const vec3<float>> normals = cache_.light.surface.normals;
        backend_->for_chunks(size(), grain, [&](std::size_t, std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) {
                vec3<double> prior[basis], fitted[basis], normal(0);
                for (std::size_t k = 0; k < basis; ++k) prior[k] = vec3<double>(cloud.sh[i * basis + k]);
                for (std::size_t corner = 0; corner < 3; ++corner)
                    normal += vec3<double>(normals[static_cast<std::size_t>(data_->rig.triangles[i][corner])]) *
                              data_->rig.barycentric[i][static_cast<int>(corner)];
                ShFit<Degree> fit(prior);
                for (std::size_t k = 0; k < centers.size(); ++k) {
                    const vec3<double> dir = normalize(vec3<double>(cloud.means[i]) - centers[k]);
                    const double facing = std::clamp(0.5 - 2 * dot(normal, dir), params_.hidden_weight, 1.0);
                    fit.add(dir, vec3<double>(colors_[k * size() + i]), facing);
                }
                fit.solve(params_.ridge, fitted);
                for (std::size_t k = 0; k < basis; ++k) cloud.sh[i * basis + k] = vec3<float>(fitted[k]);
            }
        });
    }

    B* backend_;
    const AvatarData* data_;
    StillFrameParams params_;
    Avatar<B> avatar_;
    int degree_;
    RigPose<B, float> pose_;
    typename Avatar<B>::Cache cache_;
    Splats<B, float> splats_;
    std::vector<vec3<float>> colors_; // [views, N]
};

} // namespace gsh
