// SPDX-License-Identifier: Apache-2.0
/// @file  The trainable avatar: appearance, occlusion, rig and skinning turn learned arrays into splats of a pose.
#pragma once

#include <gsh/avatar/avatar_pass.hpp>
#include <gsh/avatar/deformation.hpp>
#include <gsh/avatar/rig.hpp>
#include <gsh/avatar/skinned_gaussian.hpp>
#include <gsh/avatar/skinned_splats.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/learn/learned_array.hpp>
#include <gsh/learn/learned_light.hpp>
#include <gsh/learn/part_size.hpp>
#include <gsh/light/light.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/light/surface_light.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/model/appearance.hpp>
#include <gsh/model/avatar_start.hpp>
#include <gsh/model/canonical_points.hpp>
#include <gsh/model/filled_points.hpp>
#include <gsh/model/occlusion.hpp>

#include <concepts>
#include <cstddef>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

namespace gsh {

namespace detail {

/// means = positions + every stride-th displacement.
template <class T>
struct DisplacedMeans {
    Span<const vec3<T>> positions, displacements;
    std::size_t stride;
    Span<vec3<T>> means;
    GSH_HD void operator()(std::size_t i) const { means[i] = positions[i] + displacements[i * stride]; }
};

} // namespace detail

/// The light of a model. Several models may share one; the one with `announces` lists its arrays in learned().
template <Backend B, std::floating_point T = float>
struct ModelLight {
    SharedLight<B, T> light = {}; ///< null: no light
    bool announces = true;
};

/// Splats of an avatar in a pose, from learned arrays:
///
///     SH, δx   = appearance(x₀)
///     x̂₀       = x₀ + δx + the body's own offsets at this pose and expression (Rig)
///     ao       = occlusion(x₀, frame or pose)
///     splats   = SkinnedGaussian(x̂₀, R, s, o, SH, ao; Σ w B(pose)), shaded by SurfaceLight if there is a light
///
/// A frame takes three calls. `update_canonical` runs the appearance, `move` the rig, `write_splats` the rest
/// (AvatarPass), so that several views of a frame run appearance and rig once. `backward` is the adjoint of all.
///
/// D is a DeformationPolicy, or Params::deformation names one of gsh's. Files can store only the latter.
///
/// Shapes  N points, J joints of the rig.
/// Source  paper §3.3 to §3.5; with SeparateFields and neither regions nor prior features its direct baseline,
///         Liu et al., "Animatable 3D Gaussian", 2024.
template <Backend B, class Appearance, class Occlusion = NoOcclusion<B>, std::floating_point T = float,
          class D = NamedDeformation>
    requires AppearancePolicy<Appearance, T> && OcclusionPolicy<Occlusion, B, T>
class AvatarModel {
public:
    using Scalar = T;
    using Params = AvatarModelParams;
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    static constexpr int sh_degree = Appearance::sh_degree;

    /// What a frame stores for backward. ao and dL_dao are [N], or empty without ambient occlusion.
    using Cache = typename AvatarPass<B, T, D>::Cache;

    /// There is a Gaussian at each point of the rig. `samples` gives normals and initial scales. Appearance and
    /// occlusion must be made of the same `points`.
    /// Errors  ValueError for a light on a body without triangles.
    AvatarModel(B& backend, const RigData& rig, const SurfaceSamples& samples, SharedPoints<B, T> points,
                Appearance appearance, Occlusion occlusion = {}, const Params& params = {}, ModelLight<B, T> light = {})
        : AvatarModel(backend, rig, detail::GaussianStart<T>(rig, samples, params), std::move(points),
                      std::move(appearance), std::move(occlusion), params, std::move(light)) {}

    /// The size of the model's own arrays, without appearance and occlusion.
    [[nodiscard]] static PartSize own_size(std::size_t joint_count) {
        return {.learned = {{.name = "joints", .fixed = 3 * joint_count},
                            {.name = "quats", .per_point = 4},
                            {.name = "log_scales", .per_point = 3},
                            {.name = "opacity_logits", .per_point = 1}}};
    }

    [[nodiscard]] std::size_t size() const { return points_->size(); }
    [[nodiscard]] const Params& params() const { return params_; }
    [[nodiscard]] const Rig<B, T>& rig() const { return pass_.rig(); }
    [[nodiscard]] Appearance& appearance() { return appearance_; }
    [[nodiscard]] const Appearance& appearance() const { return appearance_; }
    [[nodiscard]] Occlusion& occlusion() { return occlusion_; }
    [[nodiscard]] const Occlusion& occlusion() const { return occlusion_; }
    [[nodiscard]] const Cache& cache() const { return cache_; }

    /// The light, or null.
    [[nodiscard]] const SharedLight<B, T>& light() const { return light_.light; }

    /// progress in [0, 1] is the share of the run that is over. Ambient occlusion joins at Params::occlusion_start, and
    /// colours depend on the direction from Params::sh_start on.
    void set_progress(double progress) {
        occlusion_joined_ = progress >= params_.occlusion_start;
        view_dependent_ = progress >= params_.sh_start;
    }
    /// Whether there is ambient occlusion and it has joined.
    [[nodiscard]] bool occludes() const { return occlusion_.occludes() && occlusion_joined_; }
    /// Whether colours depend on the direction. If not, only the constant coefficients are used and learned.
    [[nodiscard]] bool is_view_dependent() const { return view_dependent_; }

    /// Evaluates colours and displacements at a frame of the training motion.
    void update_canonical(std::size_t frame = 0) {
        appearance_.forward(frame);
        if (filled_) filled_->forward(appearance_.view(), std::as_const(opacity_logits_).values());
    }

    /// From the next update_canonical on, some Gaussians have what `fill` gives them. For a model that is finished:
    /// backward() is refused until the fill is taken away, and then the model is what it was.
    void fill(const PointFill<T>& fill) { filled_.emplace(*backend_, size(), sh_basis_count(sh_degree), fill); }
    void end_fill() { filled_.reset(); }

    /// Frees what frames and passes keep for the next one, but for the results of update_canonical.
    void release_memory() {
        release_memory_of(appearance_);
        cache_ = {};
    }

    /// Brings the model to a pose. caster() and write_splats() are for this pose then.
    void move(const RigPose<B, T>& pose) { pass_.move(pose, joints(), cache_); }

    /// The mesh that casts shadows on others, after move(). It is valid until the next call of this or of write_splats.
    /// Errors  ValueError without a light.
    [[nodiscard]] ShadowCaster<T> caster() { return pass_.caster(cache_); }

    /// After move(pose): splats of the pose, which is that of `frame`, seen from `center`, the camera's centre in the
    /// world. With a light, `others` cast shadows beside the body itself.
    void write_splats(const RigPose<B, T>& pose, std::size_t frame, const Deferred<vec3<T>>& center,
                      const SplatView<T>& splats, Span<const ShadowCaster<T>> others = {}) {
        const auto displace = [&](Span<vec3<T>> means) { write_means(means); };
        const auto occlude = [&] {
            cache_.ao.resize(occludes() ? size() : 0);
            if (occludes()) occlusion_.forward(occlusion_input(pose, frame), cache_.ao);
            return Span<const T>(cache_.ao);
        };
        with_present_degree([&](auto degree) {
            pass_.template forward<degree()>(gaussians(), displace, occlude, center, splats, cache_, in_light(others));
        });
    }

    /// move() and write_splats().
    void pose(const RigPose<B, T>& pose, std::size_t frame, const Deferred<vec3<T>>& center, const SplatView<T>& splats,
              Span<const ShadowCaster<T>> others = {}) {
        move(pose);
        write_splats(pose, frame, center, splats, others);
    }

    /// Adjoint of update_canonical and pose. Adds to the gradients of learned(), and to the gradients of the pose and
    /// of the camera's centre [1] that are not empty.
    void backward(const RigPose<B, T>& pose, std::size_t frame, const Deferred<vec3<T>>& center,
                  const SplatView<const T>& dL_dsplats, RigPoseGradient<T> dL_dpose = {},
                  Span<vec3<T>> dL_dcenter = {}) {
        check_value(!filled_, "AvatarModel::backward", "some Gaussians are filled, so the model does not learn");
        const Span<T> dL_dao = zeros(cache_.dL_dao, cache_.ao.size());
        const ColorGradient<T> dL_dcolors = appearance_.color_gradient();
        const auto displaced = [&](Span<vec3<T>> dL_dmeans) { appearance_.backward(frame, dL_dmeans); };
        const auto occluded = [&] {
            if (!dL_dao.empty()) occlusion_.backward(occlusion_input(pose, frame), cache_.ao, dL_dao, dL_dpose.pose);
        };
        const AvatarGradient<T> dL_dall{.gaussians = {.quats = quats_.gradient(),
                                                      .log_scales = log_scales_.gradient(),
                                                      .opacity_logits = opacity_logits_.gradient(),
                                                      .sh = dL_dcolors.sh,
                                                      .ao = dL_dao,
                                                      .sh_stride = dL_dcolors.sh_stride},
                                        .joints = joints_.gradient(),
                                        .pose = dL_dpose,
                                        .center = dL_dcenter,
                                        .light = light() ? light()->gradient() : LightView<T>(),
                                        .normal_offsets = normal_offsets_.gradient()};
        with_present_degree([&](auto degree) {
            pass_.template backward<degree()>(pose, gaussians(), displaced, occluded, center, dL_dsplats, cache_,
                                              dL_dall, in_light());
        });
    }

    /// Adjoint of pose() with respect to the pose alone. Nothing is added to the gradients of learned().
    void backward_to_pose(const RigPose<B, T>& pose, std::size_t frame, const Deferred<vec3<T>>& center,
                          const SplatView<const T>& dL_dsplats, const RigPoseGradient<T>& dL_dpose,
                          Span<vec3<T>> dL_dcenter = {}) {
        const bool occlusion_moves = occlusion_.follows_pose() && !cache_.ao.empty() && !dL_dpose.pose.empty();
        const Span<T> dL_dao = zeros(cache_.dL_dao, occlusion_moves ? size() : 0);
        const auto occluded = [&] {
            if (occlusion_moves)
                occlusion_.backward_to_pose(occlusion_input(pose, frame), cache_.ao, dL_dao, dL_dpose.pose);
        };
        with_present_degree([&](auto degree) {
            pass_.template backward<degree()>(
                pose, gaussians(), [](Span<vec3<T>>) {}, occluded, center, dL_dsplats, cache_,
                {.gaussians = {.ao = dL_dao}, .pose = dL_dpose, .center = dL_dcenter}, in_light());
        });
    }

    /// The joints, the Gaussians' own attributes, then the arrays of appearance, occlusion and light.
    [[nodiscard]] LearnedArrays<T> learned() {
        LearnedArrays<T> arrays{joints_.announce("joints", params_.joint_rate),
                                quats_.announce("quats", params_.quat_rate),
                                log_scales_.announce("log_scales", params_.log_scale_rate),
                                opacity_logits_.announce("opacity_logits", params_.opacity_logit_rate)};
        append(arrays, appearance_.learned());
        append(arrays, occlusion_.learned());
        if (normal_offsets_.size())
            arrays.push_back(normal_offsets_.announce("normal_offsets", params_.normal_offset_rate));
        if (light() && light_.announces) append(arrays, light()->learned());
        return arrays;
    }

    /// Ambient occlusion [N] of a pose at a frame, whether it has joined or not. Overwrites the cache.
    /// Errors  ValueError without ambient occlusion.
    [[nodiscard]] Span<const T> ao(const RigPose<B, T>& pose, std::size_t frame) {
        check_value(occlusion_.occludes(), "AvatarModel::ao", "the model has no ambient occlusion");
        move(pose);
        cache_.ao.resize(size());
        occlusion_.forward(occlusion_input(pose, frame), cache_.ao);
        return cache_.ao;
    }

    /// Irradiance and gloss of each Gaussian at the last pose(), [N], in the backend's memory.
    /// Errors  ValueError without a light.
    [[nodiscard]] Span<const LitShading<T>> shading() {
        return pass_.shading(cache_);
    }
    /// Learned offsets of the mesh's normals [V], in the backend's memory; empty if there are none.
    [[nodiscard]] Span<const vec3<T>> normal_offsets() const { return normal_offsets_.values(); }
    /// The learned joints [J], in the backend's memory.
    [[nodiscard]] Span<const vec3<T>> joints() const { return joints_.values(); }
    /// The canonical Gaussians without means and weights. Colours are those of the last update_canonical.
    [[nodiscard]] SkinnedView<const T> gaussians() const {
        const AppearanceView<T> appearance = appearance_view();
        return {.quats = quats_.values(),
                .log_scales = log_scales_.values(),
                .opacity_logits = filled_ ? filled_->opacity_logits() : opacity_logits_.values(),
                .sh = appearance.sh,
                .ao = cache_.ao,
                .sh_stride = appearance.sh_stride};
    }
    /// means[i] = x₀ + δx, with δx of the last update_canonical. [N] in the backend's memory.
    void write_means(Span<vec3<T>> means) const {
        const AppearanceView<T> appearance = appearance_view();
        backend_->for_each(size(), detail::DisplacedMeans<T>{points_->positions(), appearance.displacements,
                                                             appearance.displacement_stride, means});
    }

private:
    AvatarModel(B& backend, const RigData& rig, const detail::GaussianStart<T>& start, SharedPoints<B, T> points,
                Appearance appearance, Occlusion occlusion, const Params& params, ModelLight<B, T> light)
        : backend_(&backend), params_(params),
          pass_(backend, rig, {params.clamping, params.deformation}, light_params(light)), points_(std::move(points)),
          appearance_(std::move(appearance)), occlusion_(std::move(occlusion)), joints_(backend, start.joints),
          log_scales_(backend, start.log_scales), quats_(backend, start.quats),
          opacity_logits_(backend, start.opacity_logits), light_(std::move(light)),
          normal_offsets_(
              backend, std::vector<vec3<T>>(light_.light && params.normal_offset_rate > 0 ? rig.body.vertex_count() : 0,
                                            vec3<T>(T(0)))) {
        check_size("AvatarModel", "points", points_->size(), rig.point_count(), "one per point of the rig");
    }

    [[nodiscard]] static std::optional<SurfaceLightParams> light_params(const ModelLight<B, T>& light) {
        if (!light.light) return std::nullopt;
        return SurfaceLightParams{.shadows = light.light->shadows()};
    }
    [[nodiscard]] AppearanceView<T> appearance_view() const { return filled_ ? filled_->view() : appearance_.view(); }
    [[nodiscard]] OcclusionInput<B, T> occlusion_input(const RigPose<B, T>& pose, std::size_t frame) const {
        return {frame, rig().skeleton(), pose.pose, cache_.rig.rotations};
    }
    /// Calls f(std::integral_constant<int, D>()) with the degree that colours have now.
    template <class F>
    void with_present_degree(const F& f) {
        if (view_dependent_) f(std::integral_constant<int, sh_degree>());
        else f(std::integral_constant<int, 0>());
    }
    /// Shadows have no gradient, so backward needs no casters.
    [[nodiscard]] FrameLight<T> in_light(Span<const ShadowCaster<T>> others = {}) const {
        return light() ? FrameLight<T>{light()->view(), normal_offsets_.values(), others} : FrameLight<T>{};
    }
    [[nodiscard]] Span<T> zeros(Buffer<T>& buffer, std::size_t count) {
        buffer.resize(count);
        backend_->fill(Span<T>(buffer), T(0));
        return buffer;
    }

    B* backend_;
    Params params_;
    AvatarPass<B, T, D> pass_;
    SharedPoints<B, T> points_; // x₀
    Appearance appearance_;
    Occlusion occlusion_;
    LearnedBuffer<B, vec3<T>> joints_, log_scales_; // [J], [N]
    LearnedBuffer<B, quat<T>> quats_;               // [N]
    LearnedBuffer<B, T> opacity_logits_;            // [N]
    bool occlusion_joined_ = params_.occlusion_start <= 0, view_dependent_ = params_.sh_start <= 0;
    ModelLight<B, T> light_;
    LearnedBuffer<B, vec3<T>> normal_offsets_; // [V], or empty
    std::optional<FilledPoints<B, T>> filled_;
    Cache cache_;
};

} // namespace gsh
