// SPDX-License-Identifier: Apache-2.0
/// @file  An avatar that is ready for display: canonical Gaussians on a rig, posed by a motion.
#pragma once

#include <gsh/avatar/avatar_pass.hpp>
#include <gsh/avatar/deformation.hpp>
#include <gsh/avatar/light_place.hpp>
#include <gsh/avatar/occlusion_field.hpp>
#include <gsh/avatar/rig.hpp>
#include <gsh/avatar/skinned_gaussian.hpp>
#include <gsh/avatar/skinned_splats.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/image/color.hpp>
#include <gsh/light/light.hpp>
#include <gsh/light/light_buffers.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/light/surface_light.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

namespace gsh {

/// The data of an animatable avatar on the host, as avatar files store it.
///
/// Shapes  rig with N points; gaussians [N], with displaced means. rig.joints are the learned joints.
struct AvatarData {
    RigData rig;
    GaussianCloud<float> gaussians;
    ColorClamp clamping = ColorClamp::both;
    PixelFilter filter = {}; ///< for the rasterizer
    Deformation deformation = Deformation::linear;
    std::vector<float> ao = {}; ///< [N] ambient occlusion, the same in every pose, or empty for 1
    /// Gives the ao of each pose. The member `ao` is then its mean over training, for formats without poses.
    std::optional<OcclusionFieldData> occlusion_field = {};
    /// The light of the capture. Colours are then those of the surface, without light.
    std::optional<LightData> light = {};
    /// [V] canonical offsets of the mesh's unit normals, for the light; or empty for none.
    std::vector<vec3<float>> normal_offsets = {};
    /// Where the light was estimated. light_at brings it to another motion.
    MotionPlace light_place = {};
    /// [N] irradiance, mean over training, for formats without light; or empty for 1.
    std::vector<float> mean_irradiance = {};
};

namespace detail {

/// Multiplies the colours of a cloud by an irradiance [N], in linear light.
inline void light_cloud(GaussianCloud<float>& cloud, ColorClamp clamping, Span<const float> irradiance) {
    const auto basis = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        vec3<float>* const sh = cloud.sh.data() + i * basis;
        const vec3<float> color = unclamped_color<0>(sh, vec3<float>(0, 0, 1));
        vec3<float> lit{}, slope{};
        for (int c = 0; c < 3; ++c) {
            const float base = clamp_color(color[c], clamping);
            const float linear = srgb_to_linear(base) * irradiance[i];
            float dlit_dlinear = 0, dlit_dbase = 0;
            linear_to_srgb_backward(linear, 1.0f, dlit_dlinear);
            srgb_to_linear_backward(base, dlit_dlinear * irradiance[i], dlit_dbase);
            lit[c] = clamp_color(linear_to_srgb(linear), clamping), slope[c] = dlit_dbase;
        }
        sh[0] = sh_of_color(lit);
        for (std::size_t k = 1; k < basis; ++k) sh[k] = sh[k] * slope;
    }
}

/// Merges an ambient occlusion for each Gaussian: ao (Y sh + 1/2) = Y (ao sh) + 1/2 + (ao - 1)/2.
inline void darken_cloud(GaussianCloud<float>& cloud, Span<const float> ao) {
    const auto basis = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        for (std::size_t k = 0; k < basis; ++k) cloud.sh[i * basis + k] *= ao[i];
        cloud.sh[i * basis] += sh_of_color(vec3<float>(0.5f * ao[i]));
    }
}

} // namespace detail

/// The canonical Gaussians with `ao` and the mean light of training merged into their colours, for file formats without
/// them. For ao exact where a colour lies within [0, 1]. For light, the constant colour is exact, and bands that depend
/// on the view are scaled by the slope of lit over base colour there. There is no gloss.
/// Errors  ShapeError for an irradiance that is not one per Gaussian.
[[nodiscard]] inline GaussianCloud<float> shaded_cloud(const AvatarData& avatar) {
    GaussianCloud<float> cloud = avatar.gaussians;
    if (!avatar.ao.empty()) detail::darken_cloud(cloud, avatar.ao);
    if (!avatar.mean_irradiance.empty()) {
        check_size("shaded_cloud", "mean_irradiance", avatar.mean_irradiance.size(), cloud.size(), "one per Gaussian");
        detail::light_cloud(cloud, avatar.clamping, avatar.mean_irradiance);
    }
    return cloud;
}

/// How an avatar is shown.
struct AvatarParams {
    /// Metres between the vertices that cast shadows. Training uses default_caster_spacing, which is finer; a coarser
    /// mesh is faster. At 0.03, a person loses 0.08 dB in new motion, at 0.02 less than 0.01 dB.
    double caster_spacing = 0.03;
};

/// Poses an avatar. Its fields were evaluated when it was exported. A frame costs skinning and shading and, with an
/// occlusion field, most of one small network. D is a DeformationPolicy, or the data name one of gsh's.
///
/// Frame   see RigData (canonical) and Camera (world).
/// Errors  ShapeError if rig and Gaussians differ in number, or if the occlusion field belongs to another body.
template <Backend B, std::floating_point T = float, class D = NamedDeformation>
class Avatar {
public:
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    /// One per frame in flight.
    struct Cache : AvatarPass<B, T, D>::Cache {
        Buffer<mat3<T>> dL_drotations; // [J], if there is an occlusion field
        typename OcclusionField<B, T>::Cache occlusion_field;
    };

    Avatar(B& backend, const AvatarData& data, const AvatarParams& params = {})
        : backend_(&backend), pass_(backend, data.rig, {data.clamping, data.deformation}, light_params(data, params)) {
        check_size("Avatar", "gaussians", data.gaussians.size(), data.rig.point_count(), "one per point of the rig");
        if (!data.ao.empty())
            check_size("Avatar", "ao", data.ao.size(), data.rig.point_count(), "one per Gaussian, or none");
        if (data.occlusion_field)
            occlusion_field_.emplace(backend, *data.occlusion_field, data.rig.point_count(), data.rig.joint_count());
        const std::vector<T> ao(data.ao.begin(), data.ao.end());
        assign(backend, ao, ao_);
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
        assign(backend, std::vector<vec3<T>>(data.rig.joints.begin(), data.rig.joints.end()), joints_);
        if (data.light) {
            set_light(*data.light);
            const std::vector<vec3<T>> offsets(data.normal_offsets.begin(), data.normal_offsets.end());
            if (!offsets.empty())
                check_size("Avatar", "normal_offsets", offsets.size(), data.rig.body.vertex_count(),
                           "one per vertex, or none");
            assign(backend, offsets, normal_offsets_);
        }
    }

    /// Whether a light shades the avatar. Only an avatar that was made with a light can be given another.
    [[nodiscard]] bool is_lit() const { return !light_.empty(); }
    /// Puts the avatar in another light. Whether there are shadows stays as it is.
    /// Errors  ValueError for an avatar that was made without a light, and those of check_light.
    void set_light(const LightData& light) {
        check_value(pass_.has_light(), "Avatar::set_light",
                    "the avatar was made without a light; its colours contain the light of its photographs");
        light_.upload(*backend_, light);
    }

    /// Shows the avatar with or without its shadows: those that a light casts, and ambient occlusion.
    void set_shadows(bool shadows) {
        shadows_ = shadows;
        pass_.set_shadows(shadows);
    }

    [[nodiscard]] std::size_t size() const { return gaussians_.size(); }
    [[nodiscard]] const Rig<B, T>& rig() const { return pass_.rig(); }

    /// Brings the cache to a pose. caster() and write_splats() are for this pose then.
    void move(const RigPose<B, T>& pose, Cache& cache) const { pass_.move(pose, joints_, cache); }

    /// The mesh that casts shadows on others, after move(). It is valid until the next call with this cache.
    /// Errors  ValueError without a light.
    [[nodiscard]] ShadowCaster<T> caster(Cache& cache) const { return pass_.caster(cache); }

    /// Irradiance and gloss of each Gaussian in the last splats, [N], in the backend's memory.
    /// Errors  ValueError without a light.
    [[nodiscard]] Span<const LitShading<T>> shading(Cache& cache) const { return pass_.shading(cache); }

    /// After move(): splats as seen from `center` (Camera::center()); splats must have size() elements. With a light,
    /// `others` cast shadows beside the avatar itself.
    void write_splats(const Deferred<vec3<T>>& center, const SplatView<T>& splats, Cache& cache,
                      Span<const ShadowCaster<T>> others = {}) const {
        const auto stored = [&](Span<vec3<T>> means) { backend_->copy(Span<const vec3<T>>(gaussians_.means), means); };
        const auto occlude = [&] {
            if (occlusion_field_ && shadows_) {
                cache.ao.resize(size());
                occlusion_field_->forward(rig().skeleton(), cache.rig.rotations, cache.ao, cache.occlusion_field);
            }
            return ao(cache);
        };
        with_sh_degree(gaussians_.sh_degree, [&](auto degree) {
            pass_.template forward<decltype(degree)::value>(view(), stored, occlude, center, splats, cache,
                                                            in_light(others));
        });
    }

    /// move() and write_splats().
    void pose(const RigPose<B, T>& pose, const Deferred<vec3<T>>& center, const SplatView<T>& splats, Cache& cache,
              Span<const ShadowCaster<T>> others = {}) const {
        move(pose, cache);
        write_splats(center, splats, cache, others);
    }

    /// Adjoint of pose with respect to the pose alone: adds to the non-empty members of dL_dpose, and to dL_dcenter [1]
    /// if it is given. The other arguments are those of the forward pass that filled the cache.
    void backward_to_pose(const RigPose<B, T>& pose, const Deferred<vec3<T>>& center,
                          const SplatView<const T>& dL_dsplats, Cache& cache, const RigPoseGradient<T>& dL_dpose,
                          Span<vec3<T>> dL_dcenter = {}) {
        const bool ao_follows = occlusion_field_ && shadows_ && !dL_dpose.pose.empty();
        cache.dL_dao.resize(ao_follows ? size() : 0);
        backend_->fill(Span<T>(cache.dL_dao), T(0));
        const auto occluded = [&] {
            if (!ao_follows) return;
            cache.dL_drotations.resize(rig().joint_count());
            backend_->fill(Span<mat3<T>>(cache.dL_drotations), mat3<T>(T(0)));
            occlusion_field_->backward(rig().skeleton(), cache.ao, cache.dL_dao, cache.occlusion_field,
                                       cache.dL_drotations);
            rig().skeleton().rotations_backward(pose.pose, cache.dL_drotations, dL_dpose.pose);
        };
        SkinnedView<const T> gaussians = view();
        gaussians.ao = ao(cache);
        with_sh_degree(gaussians_.sh_degree, [&](auto degree) {
            pass_.template backward<decltype(degree)::value>(
                pose, gaussians, [](Span<vec3<T>>) {}, occluded, center, dL_dsplats, cache,
                {.gaussians = {.ao = cache.dL_dao}, .pose = dL_dpose, .center = dL_dcenter}, in_light());
        });
    }

private:
    [[nodiscard]] static std::optional<SurfaceLightParams> light_params(const AvatarData& data,
                                                                        const AvatarParams& params) {
        if (!data.light) return std::nullopt;
        return SurfaceLightParams{.shadows = data.light->shadows, .caster_spacing = params.caster_spacing};
    }
    [[nodiscard]] SkinnedView<const T> view() const {
        return {.quats = gaussians_.quats,
                .log_scales = gaussians_.log_scales,
                .opacity_logits = gaussians_.opacity_logits,
                .sh = gaussians_.sh};
    }
    [[nodiscard]] Span<const T> ao(const Cache& cache) const {
        if (!shadows_) return {};
        return occlusion_field_ ? Span<const T>(cache.ao) : Span<const T>(ao_);
    }

    [[nodiscard]] FrameLight<T> in_light(Span<const ShadowCaster<T>> others = {}) const {
        return {light_.view(), normal_offsets_, others};
    }

    B* backend_;
    AvatarPass<B, T, D> pass_;
    Gaussians<B, T> gaussians_;
    Buffer<vec3<T>> joints_;
    bool shadows_ = true;
    Buffer<T> ao_; // [N] or empty
    LightBuffers<B, T> light_;       // empty without a light
    Buffer<vec3<T>> normal_offsets_; // [V] or empty
    std::optional<OcclusionField<B, T>> occlusion_field_;
};

} // namespace gsh
