// SPDX-License-Identifier: Apache-2.0
/// @file  An avatar that is ready to be shown: canonical Gaussians on a rig, posed by a motion.
#pragma once

#include <gsh/avatar/rig.hpp>
#include <gsh/avatar/skinned_gaussian.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/core/error.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/gaussian/splats.hpp>

#include <concepts>
#include <cstddef>
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
};

/// Poses an avatar. The parameter fields were queried when it was made, so a frame costs skinning and shading alone.
///
/// Frame   see RigData (canonical) and Camera (world).
/// Errors  ShapeError if rig and Gaussians differ in number.
template <Backend B, std::floating_point T = float>
class Avatar {
public:
    /// One per frame in flight.
    struct Cache {
        typename Rig<B, T>::Cache rig;
        typename B::template Buffer<vec3<T>> means; // [N]
    };

    Avatar(B& backend, const AvatarData& data) : backend_(&backend), rig_(backend, data.rig), clamping_(data.clamping) {
        check_size("Avatar", "gaussians", data.gaussians.size(), data.rig.point_count(), "one per point of the rig");
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
        const SkinnedView<const T> view{cache.means,   gaussians_.quats, gaussians_.log_scales, gaussians_.opacity_logits,
                                        gaussians_.sh, {},               rig_.skin()};
        with_sh_degree(gaussians_.sh_degree, [&](auto degree) {
            skinned_splats_forward<decltype(degree)::value>(*backend_, view, cache.rig.bones, center, splats, clamping_);
        });
    }

private:
    B* backend_;
    Rig<B, T> rig_;
    Gaussians<B, T> gaussians_;
    typename B::template Buffer<vec3<T>> joints_;
    ColorClamp clamping_;
};

} // namespace gsh
