// SPDX-License-Identifier: Apache-2.0
/// @file  The trainable avatar: parameter fields and stored attributes in, posed splats out, and the way back.
#pragma once

#include <gsh/avatar/avatar.hpp>
#include <gsh/avatar/occlusion_field.hpp>
#include <gsh/avatar/rig.hpp>
#include <gsh/avatar/skinned_gaussian.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/frequency.hpp>
#include <gsh/field/hash_field.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/train/avatar_config.hpp>
#include <gsh/train/parameters.hpp>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// What a field is told of the canonical points beside their places. Either may be empty.
///
/// Shapes  region [N], τ of a RegionMask in [0, 1]; features [N, any number] row-major: depths and normals of prior
///         views.
struct CanonicalPriors {
    std::vector<double> region;
    std::vector<double> features;
};

/// What a pass is told of its frame. Shadows that follow the pose need no numbers of the frame: the pose that the model
/// is asked for has them, so that a pose that is refined takes its shadows along.
///
/// Shapes  head [AvatarModel::head_code_size()], ao [AvatarModel::ao_code_size()] in the backend's memory.
template <class T>
struct FrameCode {
    Span<const T> head = {};
    Span<const T> ao = {};
    bool occlusion = true; ///< false leaves ambient occlusion out, as if the avatar had none: ao = 1
};

/// γ(t) of the paper, equations 15 and 24: four octaves and the time itself.
using TimeEncoding = FrequencyEncoding<4>;

namespace detail {

/// means = positions + every stride-th displacement.
template <class T>
struct DisplacedMeans {
    Span<const vec3<T>> positions, displacements;
    std::size_t stride;
    Span<vec3<T>> means;
    GSH_HD void operator()(std::size_t i) const { means[i] = positions[i] + displacements[i * stride]; }
};

/// Every stride-th gradient = that of a mean.
template <class T>
struct DisplacementGradient {
    Span<const vec3<T>> dL_dmeans;
    std::size_t stride;
    Span<vec3<T>> dL_ddisplacements;
    GSH_HD void operator()(std::size_t i) const { dL_ddisplacements[i * stride] = dL_dmeans[i]; }
};

/// Multiplies every stride-th vector: the constant colours among the coefficients.
template <class T>
struct ScaleConstant {
    Span<vec3<T>> values;
    std::size_t stride;
    T factor;
    GSH_HD void operator()(std::size_t i) const { values[i * stride] *= factor; }
};

} // namespace detail

/// Splats of an avatar at a frame, from parameters that a gradient step can move.
///
///     SH, δx   = field(x₀ | τ, priors)      one hash grid and network, or one each, or stored per Gaussian
///     x̂₀(t)    = x₀ + δx + per-frame detail of the body (Rig)
///     ao(t)    = largest · sigmoid(field(x₀, γ(t) or pose) + logit(initial / largest))
///     splats   = SkinnedGaussian(x̂₀, R, s, o, SH, ao; Σ w B(t))
///
/// Two stages, so that an avatar that is only shown evaluates its fields once: `update_canonical` queries them,
/// `pose` does the rest. backward runs both in reverse.
///
/// Source  paper §3.3 to §3.5; with Heads::separate, no region and no features its direct baseline, Liu et al.,
///         "Animatable 3D Gaussian", 2024.
template <Backend B, std::floating_point T = float, int Levels = 16, int Features = 4, int Degree = 2>
class AvatarModel {
public:
    template <class U>
    using Buffer = typename B::template Buffer<U>;
    using Field = HashField<Levels, Features>;
    using Grid = typename Field::Grid;

    static constexpr int sh_degree = Degree;
    static constexpr int basis_count = sh_basis_count(Degree);

    /// What the passes leave for each other.
    struct Cache {
        typename Field::template Cache<B, T> head, displacement, ao;
        typename Rig<B, T>::Cache rig;
        Buffer<vec3<T>> means;         // [N] x̂₀(t)
        Buffer<T> occlusion, dL_docclusion; // [N]
        Buffer<vec3<T>> dL_dmeans;     // [N]
        Buffer<vec3<T>> dL_dhead;      // [N, basis (+ 1)], laid out as the head's output
        Buffer<Affine<T>> dL_dbones;   // [J]
        Buffer<vec3<T>> dL_djoints;    // [J], where nobody asks for it
        Buffer<T> pose_code, dL_dpose_code; // [9 (J - 1)], where shadows follow the pose
        Buffer<mat3<T>> dL_drotations;      // [J], likewise
        Buffer<T> dL_dao_network;           // where nobody asks for it
        SkinnedSplatsWorkspace<B, T> workspace;
    };

    /// The rig's points become the Gaussians. `samples` gives their positions, normals and initial scales.
    /// Errors  ShapeError, ValueError: samples and priors must be of the rig's points, configurations make sense.
    AvatarModel(B& backend, const RigData& rig, const SurfaceSamples& samples, std::uint64_t seed,
                const AvatarConfig& config = {}, const CanonicalPriors& priors = {})
        : backend_(&backend), config_(config), rig_(backend, rig), count_(samples.size()) {
        check_size("AvatarModel", "samples", samples.size(), rig.point_count(),
                   "the rig must be made of these samples");
        check_size("AvatarModel", "samples.normals", samples.normals.size(), count_, "one per sample");
        check_value(count_ > 0, "AvatarModel", "there are no samples, expected at least one");
        check_value(config.initial_opacity > 0 && config.initial_opacity < 1, "AvatarModel",
                    "initial_opacity must lie between 0 and 1");
        check_value(config.initial_thickness > 0 && config.initial_thickness <= 1, "AvatarModel",
                    "initial_thickness must lie above 0 and be at most 1");
        check_value(config.prior_scale > 0 && std::isfinite(config.prior_scale), "AvatarModel",
                    "prior_scale must be above 0");
        check_value(config.initial_ao > 0 && config.initial_ao < config.largest_ao, "AvatarModel",
                    "initial_ao must lie between 0 and largest_ao");
        check_value(config.bounds_margin >= 1 && std::isfinite(config.bounds_margin), "AvatarModel",
                    "bounds_margin must be at least 1: all points lie within the fields' bounds");
        if (!priors.region.empty()) {
            check_size("AvatarModel", "priors.region", priors.region.size(), count_, "one τ per sample, or none");
            check_value(config.fine_level >= 0 && config.fine_level <= Levels, "AvatarModel",
                        "fine_level is " + std::to_string(config.fine_level) + ", expected 0 to " +
                            std::to_string(Levels));
        }
        check_value(priors.features.size() % count_ == 0, "AvatarModel",
                    "priors.features must hold the same number of features for every sample");
        check_value(!config.head_time || config.hash_sh || config.hash_displacement, "AvatarModel",
                    "head_time needs a field that reads it");
        set_positions(samples.positions, priors);

        std::vector<T> joints, log_scales;
        for (const auto& joint : rig.joints) joints.insert(joints.end(), {T(joint.x), T(joint.y), T(joint.z)});
        std::vector<T> quats;
        for (std::size_t i = 0; i < count_; ++i) {
            const double scale = samples.scales[i];
            const bool round = config.initial_thickness == 1 || samples.normals[i] == vec3<double>(0);
            const quat<double> q = round ? quat<double>() : quat_from_z_axis(samples.normals[i]);
            const double thickness = round ? scale : scale * config.initial_thickness;
            log_scales.insert(log_scales.end(), {T(std::log(scale)), T(std::log(scale)), T(std::log(thickness))});
            quats.insert(quats.end(), {T(q.w), T(q.x), T(q.y), T(q.z)});
        }
        set(ParameterGroup::joints, joints);
        set(ParameterGroup::quats, quats);
        set(ParameterGroup::log_scales, log_scales);
        set(ParameterGroup::opacity_logits, std::vector<T>(count_, static_cast<T>(logit(config.initial_opacity))));
        make_fields(seed, priors.features.size() / count_);
    }

    [[nodiscard]] std::size_t size() const { return count_; }
    [[nodiscard]] const AvatarConfig& config() const { return config_; }
    [[nodiscard]] const Rig<B, T>& rig() const { return rig_; }
    [[nodiscard]] Rig<B, T>& rig() { return rig_; }
    [[nodiscard]] Parameters<B, T>& parameters() { return parameters_; }
    [[nodiscard]] const Parameters<B, T>& parameters() const { return parameters_; }
    /// Numbers that a FrameCode must have.
    [[nodiscard]] std::size_t head_code_size() const { return config_.head_time ? TimeEncoding::output_count : 0; }
    [[nodiscard]] std::size_t ao_code_size() const {
        return config_.ao == AmbientOcclusion::time ? TimeEncoding::output_count : 0;
    }
    /// For a hash table, the entries that some Gaussian refers to, the only ones that ever have a gradient; null for
    /// groups that are not tables.
    [[nodiscard]] const Buffer<std::uint32_t>* touched_entries(ParameterGroup group) const {
        switch (group) {
        case ParameterGroup::joint_table:
        case ParameterGroup::displacement_table:
        case ParameterGroup::sh_table: return &query_.touched;
        case ParameterGroup::ao_table: return &ao_query_.touched;
        default: return nullptr;
        }
    }
    /// Numbers at the end of the joint network's weights that make displacements; colours have the rest.
    [[nodiscard]] std::size_t displacement_weights() const {
        return joint() ? 3 * head_->mlp().layer_inputs(head_->mlp().layer_count() - 1) : 0;
    }
    /// Table rows that the fields of colour and displacement read in one pass.
    [[nodiscard]] std::size_t lookups() const {
        return query_.lookups() * ((head_ ? 1u : 0u) + (displacement_ ? 1u : 0u));
    }

    /// Queries the fields: canonical displacements and colours at the present parameters.
    void update_canonical(Cache& cache, const FrameCode<T>& code = {}) {
        const FieldInputs<T> inputs{features_, code.head};
        if (head_) {
            head_outputs_.resize(count_ * head_stride());
            head_->forward(*backend_, parameters_[head_table()], parameters_[head_network()], query_,
                           scalars(head_outputs_), cache.head, inputs);
        }
        if (config_.hash_sh)
            backend_->for_each(count_, detail::ScaleConstant<T>{head_outputs_, head_stride(), T(config_.sh_dc_scale)});
        if (displacement_) {
            displacements_.resize(count_);
            displacement_->forward(*backend_, parameters_[ParameterGroup::displacement_table],
                                   parameters_[ParameterGroup::displacement_network], query_, scalars(displacements_),
                                   cache.displacement, inputs);
        }
    }

    /// Splats at a frame, as seen from `center` (the camera's, in the world).
    void pose(const RigPose<B, T>& pose, const vec3<T>& center, const SplatView<T>& splats, Cache& cache,
              const FrameCode<T>& code = {}) {
        rig_.forward(pose, joints(), cache.rig);
        cache.means.resize(count_);
        backend_->for_each(count_, displaced_means(cache.means));
        rig_.add_offsets(cache.rig, cache.means);
        cache.occlusion.resize(ao_ && code.occlusion ? count_ : 0);
        if (cache.occlusion.size()) query_occlusion(occlusion_code(code.ao, cache), cache);
        skinned_splats_forward<Degree>(*backend_, gaussians(cache), cache.rig.bones, center, splats, cache.workspace,
                                       config_.clamping, config_.deformation);
    }

    /// Adjoint of update_canonical and pose: adds to dL_dparameters, and to what is asked for of the pose and the
    /// camera's centre.
    void backward(const RigPose<B, T>& pose, const vec3<T>& center, const SplatView<const T>& dL_dsplats, Cache& cache,
                  Parameters<B, T>& dL_dparameters, RigPoseGradient<T> dL_dpose = {}, Span<vec3<T>> dL_dcenter = {},
                  const FrameCode<T>& code = {}) {
        start(cache.dL_docclusion, cache.occlusion.size(), T(0));
        if (head_) start(cache.dL_dhead, head_outputs_.size(), vec3<T>(T(0)));
        SkinnedView<T> dL_dgaussians{
            .quats = view_as<quat<T>>(Span<T>(dL_dparameters[ParameterGroup::quats])),
            .log_scales = view_as<vec3<T>>(Span<T>(dL_dparameters[ParameterGroup::log_scales])),
            .opacity_logits = dL_dparameters[ParameterGroup::opacity_logits],
            .sh = config_.hash_sh ? Span<vec3<T>>(cache.dL_dhead)
                                  : view_as<vec3<T>>(Span<T>(dL_dparameters[ParameterGroup::sh])),
            .ao = cache.dL_docclusion,
            .sh_stride = sh_stride()};
        rig_backward(pose, center, dL_dsplats, cache, dL_dgaussians,
                     view_as<vec3<T>>(Span<T>(dL_dparameters[ParameterGroup::joints])), dL_dpose, dL_dcenter);

        const FieldInputs<T> inputs{features_, code.head};
        if (cache.occlusion.size()) {
            backend_->for_each(count_, occlusion_from_logit_backward(cache));
            const Span<T> dL_dcode = start_pose_code(cache, dL_dpose);
            ao_->backward(*backend_, parameters_[ParameterGroup::ao_network], ao_query_, cache.dL_docclusion, cache.ao,
                          dL_dparameters[ParameterGroup::ao_table], dL_dparameters[ParameterGroup::ao_network],
                          {{}, occlusion_code(code.ao, cache)}, dL_dcode);
            pose_code_backward(pose, cache, dL_dpose);
        }
        if (displacement_)
            displacement_->backward(*backend_, parameters_[ParameterGroup::displacement_network], query_,
                                    scalars(cache.dL_dmeans), cache.displacement,
                                    dL_dparameters[ParameterGroup::displacement_table],
                                    dL_dparameters[ParameterGroup::displacement_network], inputs);
        else if (config_.hash_displacement)
            backend_->for_each(count_,
                               detail::DisplacementGradient<T>{cache.dL_dmeans, head_stride(),
                                                               displacement_part(Span<vec3<T>>(cache.dL_dhead))});
        else
            backend_->for_each(3 * count_, detail::Accumulate<T>{scalars(cache.dL_dmeans),
                                                                 dL_dparameters[ParameterGroup::displacements]});
        if (config_.hash_sh)
            backend_->for_each(count_, detail::ScaleConstant<T>{cache.dL_dhead, head_stride(), T(config_.sh_dc_scale)});
        if (head_)
            head_->backward(*backend_, parameters_[head_network()], query_, scalars(cache.dL_dhead), cache.head,
                            dL_dparameters[head_table()], dL_dparameters[head_network()], inputs);
    }

    /// Adjoint of pose with respect to the pose alone, the avatar being what it is.
    void pose_backward(const RigPose<B, T>& pose, const vec3<T>& center, const SplatView<const T>& dL_dsplats,
                       Cache& cache, const RigPoseGradient<T>& dL_dpose, Span<vec3<T>> dL_dcenter = {}) {
        const bool shadows_move =
            config_.ao == AmbientOcclusion::pose && cache.occlusion.size() && !dL_dpose.pose.empty();
        start(cache.dL_djoints, rig_.joint_count(), vec3<T>(T(0)));
        start(cache.dL_docclusion, shadows_move ? count_ : 0, T(0));
        rig_backward(pose, center, dL_dsplats, cache, {.ao = cache.dL_docclusion}, cache.dL_djoints, dL_dpose,
                     dL_dcenter);
        if (!shadows_move) return;
        const Span<const T> features(cache.ao.features);
        start(cache.dL_dao_network, ao_->mlp().parameter_count(), T(0));
        backend_->for_each(count_, occlusion_from_logit_backward(cache));
        ao_->mlp().backward(*backend_, parameters_[ParameterGroup::ao_network],
                            {blocked(features, Grid::output_count, Features), {}, cache.pose_code}, cache.dL_docclusion,
                            cache.ao.mlp, cache.dL_dao_network, {}, Write::add, start_pose_code(cache, dL_dpose));
        pose_code_backward(pose, cache, dL_dpose);
    }

    /// Ambient occlusion [N] at a pose, or at the frame's code where it knows no poses.
    [[nodiscard]] Span<const T> occlusion(const RigPose<B, T>& pose, Span<const T> code, Cache& cache) {
        rig_.forward(pose, joints(), cache.rig);
        return occlusion(occlusion_code(code, cache), cache);
    }
    /// Ambient occlusion [N] at a frame's code.
    [[nodiscard]] Span<const T> occlusion(Span<const T> code, Cache& cache) {
        query_occlusion(code, cache);
        return cache.occlusion;
    }

    /// The canonical Gaussians of the last update_canonical, on the host.
    [[nodiscard]] GaussianCloud<T> canonical_gaussians() const {
        GaussianCloud<T> cloud(count_, Degree);
        Buffer<vec3<T>> means(count_);
        backend_->for_each(count_, displaced_means(means));
        backend_->download(Span<const vec3<T>>(means), cloud.means);
        backend_->download(view_as<const quat<T>>(Span<const T>(parameters_[ParameterGroup::quats])), cloud.quats);
        backend_->download(view_as<const vec3<T>>(Span<const T>(parameters_[ParameterGroup::log_scales])),
                           cloud.log_scales);
        backend_->download(Span<const T>(parameters_[ParameterGroup::opacity_logits]), cloud.opacity_logits);
        std::vector<vec3<T>> sh(sh_view().size());
        backend_->download(sh_view(), Span<vec3<T>>(sh));
        for (std::size_t i = 0; i < count_; ++i)
            std::copy_n(sh.begin() + static_cast<std::ptrdiff_t>(i * sh_stride()), basis_count,
                        cloud.sh.begin() + static_cast<std::ptrdiff_t>(i * basis_count));
        return cloud;
    }

    /// The avatar as it is now, for files and for Avatar: `rig` with the learned joints, and canonical Gaussians (those
    /// of the last update_canonical, or a mean over frames). `filter` is what they were trained with.
    [[nodiscard]] AvatarData avatar(RigData rig, GaussianCloud<T> gaussians, const PixelFilter& filter) const
        requires std::same_as<T, float>
    {
        std::vector<vec3<T>> learned(rig.joint_count());
        backend_->download(joints(), Span<vec3<T>>(learned));
        for (std::size_t j = 0; j < learned.size(); ++j) rig.joints[j] = vec3<double>(learned[j]);
        return {.rig = std::move(rig),
                .gaussians = std::move(gaussians),
                .clamping = config_.clamping,
                .filter = filter,
                .deformation = config_.deformation};
    }

    /// The field of shadows that follow the pose, for AvatarData; nothing where shadows know the time or none, or where
    /// the network is a single matrix.
    [[nodiscard]] std::optional<OcclusionFieldData> occlusion_field() const
        requires std::same_as<T, float>
    {
        if (config_.ao != AmbientOcclusion::pose || ao_->mlp().params().hidden_layers < 1) return std::nullopt;
        Buffer<T> encoding(count_ * Grid::output_count);
        ao_->grid().forward(*backend_, parameters_[ParameterGroup::ao_table], ao_query_.grids[0],
                            row_major(Span<T>(encoding), Grid::output_count));
        return bake_occlusion_field(*backend_, ao_->mlp(), Span<const T>(parameters_[ParameterGroup::ao_network]),
                                    FeatureView<const T>(row_major(Span<const T>(encoding), Grid::output_count)),
                                    occlusion_bias(), config_.largest_ao);
    }

    /// Learned joints [J] in the backend's memory.
    [[nodiscard]] Span<const vec3<T>> joints() const {
        return view_as<const vec3<T>>(Span<const T>(parameters_[ParameterGroup::joints]));
    }

private:
    /// The head is the field of colours, the joint field, or, where colours are stored, there is none and displacements
    /// have their own.
    [[nodiscard]] bool joint() const { return config_.has_joint_head(); }
    [[nodiscard]] ParameterGroup head_table() const {
        return joint() ? ParameterGroup::joint_table : ParameterGroup::sh_table;
    }
    [[nodiscard]] ParameterGroup head_network() const {
        return joint() ? ParameterGroup::joint_network : ParameterGroup::sh_network;
    }
    /// Vectors in a row of the head's output: SH, then δx of a joint head.
    [[nodiscard]] std::size_t head_stride() const { return basis_count + (joint() ? 1u : 0u); }
    [[nodiscard]] std::size_t sh_stride() const { return config_.hash_sh ? head_stride() : basis_count; }
    template <class V>
    [[nodiscard]] static Span<V> displacement_part(Span<V> head_rows) {
        return head_rows.subspan(basis_count, head_rows.size() - basis_count);
    }

    [[nodiscard]] Span<const vec3<T>> sh_view() const {
        return config_.hash_sh ? Span<const vec3<T>>(head_outputs_)
                               : view_as<const vec3<T>>(Span<const T>(parameters_[ParameterGroup::sh]));
    }
    [[nodiscard]] detail::DisplacedMeans<T> displaced_means(Span<vec3<T>> means) const {
        if (joint()) return {positions_, displacement_part(Span<const vec3<T>>(head_outputs_)), head_stride(), means};
        if (displacement_) return {positions_, displacements_, 1, means};
        return {positions_, view_as<const vec3<T>>(Span<const T>(parameters_[ParameterGroup::displacements])), 1,
                means};
    }

    static Span<T> scalars(Buffer<vec3<T>>& buffer) { return view_as<T>(Span<vec3<T>>(buffer)); }

    [[nodiscard]] SkinnedView<const T> gaussians(const Cache& cache) const {
        return {.means = cache.means,
                .quats = view_as<const quat<T>>(Span<const T>(parameters_[ParameterGroup::quats])),
                .log_scales = view_as<const vec3<T>>(Span<const T>(parameters_[ParameterGroup::log_scales])),
                .opacity_logits = parameters_[ParameterGroup::opacity_logits],
                .sh = sh_view(),
                .ao = cache.occlusion,
                .weights = rig_.skin(),
                .sh_stride = sh_stride()};
    }

    template <class Buffer>
    void start(Buffer& buffer, std::size_t size, const auto& zero) {
        buffer.resize(size);
        backend_->fill(Span(buffer.data(), buffer.size()), zero);
    }
    /// From splats back to what they were posed from: adds to dL_dgaussians' attributes, and overwrites
    /// cache.dL_dmeans.
    void rig_backward(const RigPose<B, T>& pose, const vec3<T>& center, const SplatView<const T>& dL_dsplats,
                      Cache& cache, SkinnedView<T> dL_dgaussians, Span<vec3<T>> dL_djoints,
                      const RigPoseGradient<T>& dL_dpose, Span<vec3<T>> dL_dcenter) {
        start(cache.dL_dmeans, count_, vec3<T>(T(0)));
        start(cache.dL_dbones, rig_.joint_count(), Affine<T>::zero());
        dL_dgaussians.means = cache.dL_dmeans;
        skinned_splats_backward<Degree>(*backend_, gaussians(cache), cache.rig.bones, center, dL_dsplats,
                                        cache.workspace, dL_dgaussians, cache.dL_dbones, dL_dcenter, config_.clamping,
                                        config_.deformation);
        rig_.backward(pose, cache.rig, cache.dL_dbones, cache.dL_dmeans, dL_djoints, dL_dpose);
    }

    /// The network's output is zero at first: this is what ao starts with.
    [[nodiscard]] double occlusion_bias() const { return logit(config_.initial_ao / config_.largest_ao); }
    void query_occlusion(Span<const T> code, Cache& cache) {
        cache.occlusion.resize(count_);
        ao_->forward(*backend_, parameters_[ParameterGroup::ao_table], parameters_[ParameterGroup::ao_network],
                     ao_query_, cache.occlusion, cache.ao, {{}, code});
        backend_->for_each(count_, detail::OcclusionFromLogit<T>{cache.occlusion,
                                                               static_cast<T>(occlusion_bias()),
                                                               T(config_.largest_ao)});
    }
    [[nodiscard]] detail::OcclusionFromLogitBackward<T> occlusion_from_logit_backward(Cache& cache) const {
        return {cache.occlusion, T(config_.largest_ao), cache.dL_docclusion};
    }
    /// What the occlusion field reads: the frame's code, or the numbers of the pose that cache.rig holds.
    [[nodiscard]] Span<const T> occlusion_code(Span<const T> code, Cache& cache) const {
        if (config_.ao != AmbientOcclusion::pose) return code;
        cache.pose_code.resize(ao_->shared_inputs());
        rig_.skeleton().feature(cache.rig.rotations, cache.pose_code);
        return cache.pose_code;
    }
    /// Zeros for the gradient of the pose's numbers, if anybody asks for it.
    [[nodiscard]] Span<T> start_pose_code(Cache& cache, const RigPoseGradient<T>& dL_dpose) {
        const bool asked = config_.ao == AmbientOcclusion::pose && !dL_dpose.pose.empty();
        start(cache.dL_dpose_code, asked ? ao_->shared_inputs() : 0, T(0));
        return cache.dL_dpose_code;
    }
    /// Carries that gradient to the pose.
    void pose_code_backward(const RigPose<B, T>& pose, Cache& cache, const RigPoseGradient<T>& dL_dpose) {
        if (!cache.dL_dpose_code.size()) return;
        start(cache.dL_drotations, rig_.joint_count(), mat3<T>(T(0)));
        rig_.skeleton().feature_backward(cache.dL_dpose_code, cache.dL_drotations);
        rig_.skeleton().rotations_backward(pose.pose, cache.dL_drotations, dL_dpose.pose);
    }

    void set(ParameterGroup group, const std::vector<T>& values) {
        parameters_[group].resize(values.size());
        backend_->upload(Span<const T>(values), parameters_[group]);
    }

    /// Fields and what they start with; each draws from a stream of random numbers of its own, all from the one seed.
    void make_fields(std::uint64_t seed, std::size_t feature_count) {
        const auto make = [&](int outputs, ParameterGroup table, ParameterGroup network, std::uint64_t stream,
                              std::uint32_t table_size, std::size_t point_inputs, std::size_t shared_inputs,
                              std::size_t tables) {
            Field field({.base = config_.hash_base, .growth = config_.hash_growth, .table_size = table_size},
                        {.outputs = outputs, .width = config_.mlp_width, .hidden_layers = config_.mlp_hidden_layers},
                        point_inputs, shared_inputs);
            std::vector<T> entries;
            for (std::size_t t = 0; t < tables; ++t) {
                const auto more = field.grid().template initial_table<T>(mix_bits(seed + stream + 100 * t));
                entries.insert(entries.end(), more.begin(), more.end());
            }
            set(table, entries);
            set(network, field.mlp().template initial_weights<T>(mix_bits(seed + stream + 1)));
            return field;
        };
        // The encoding starts near zero, and so do displacements and colours. Inputs beside it are of order one: their
        // weights start at zero, or the first picture would be of a body torn to pieces.
        const auto silence = [&](const Field& field, ParameterGroup network) {
            const Mlp& mlp = field.mlp();
            std::vector<T> weights(parameters_[network].size());
            backend_->download(Span<const T>(parameters_[network]), Span<T>(weights));
            for (std::size_t o = 0; o < mlp.layer_outputs(0); ++o)
                for (std::size_t i = Grid::output_count; i < mlp.inputs(); ++i) weights[o * mlp.inputs() + i] = T(0);
            set(network, weights);
        };
        const std::uint32_t size = config_.hash_table_size;
        const std::size_t tables = query_.grids.size(), code = head_code_size();
        constexpr int colors = 3 * basis_count;
        if (joint())
            head_.emplace(make(colors + 3, ParameterGroup::joint_table, ParameterGroup::joint_network, 5, size,
                               feature_count, code, tables));
        else if (config_.hash_sh)
            head_.emplace(make(colors, ParameterGroup::sh_table, ParameterGroup::sh_network, 3, size, feature_count,
                               code, tables));
        if (config_.hash_displacement && !joint())
            displacement_.emplace(make(3, ParameterGroup::displacement_table, ParameterGroup::displacement_network, 1,
                                       size, feature_count, code, tables));
        if (head_) silence(*head_, head_network());
        if (displacement_) silence(*displacement_, ParameterGroup::displacement_network);
        if (!config_.hash_displacement) set(ParameterGroup::displacements, std::vector<T>(3 * count_, T(0)));
        if (!config_.hash_sh) set(ParameterGroup::sh, std::vector<T>(colors * count_, T(0)));
        if (config_.ao != AmbientOcclusion::none) {
            const std::size_t inputs =
                config_.ao == AmbientOcclusion::time ? ao_code_size() : rig_.skeleton().pose_feature_count();
            ao_.emplace(
                make(1, ParameterGroup::ao_table, ParameterGroup::ao_network, 7, config_.ao_table_size, 0, inputs, 1));
            Buffer<vec3<T>> points(unit_.size());
            backend_->upload(Span<const vec3<T>>(unit_), points);
            ao_->prepare(*backend_, Span<const vec3<T>>(points), ao_query_);
            // The last layer starts at zero: no shadow yet, the same everywhere.
            auto& network = parameters_[ParameterGroup::ao_network];
            const std::size_t last = ao_->mlp().layer_inputs(ao_->mlp().layer_count() - 1);
            backend_->fill(Span<T>(network).subspan(network.size() - last, last), T(0));
        }
    }

    /// Keeps x₀, its features, and its place in the fields' unit cube: that cube is the points' bounding cube, or their
    /// box, a little larger (AvatarConfig::bounds, bounds_margin).
    void set_positions(Span<const vec3<double>> positions, const CanonicalPriors& priors) {
        vec3<double> low = positions[0], high = positions[0];
        for (const auto& p : positions)
            for (int axis = 0; axis < 3; ++axis) {
                low[axis] = std::min(low[axis], p[axis]);
                high[axis] = std::max(high[axis], p[axis]);
            }
        const vec3<double> center = (low + high) * 0.5, extent = high - low;
        constexpr double least = 1e-6; // metres, for points that all lie in a plane
        vec3<double> edges(std::max({extent.x, extent.y, extent.z, least}));
        if (config_.bounds == FieldBounds::box)
            for (int axis = 0; axis < 3; ++axis) edges[axis] = std::max(extent[axis], least);
        edges *= config_.bounds_margin;
        std::vector<vec3<T>> here;
        for (const auto& p : positions) {
            here.push_back(vec3<T>(p));
            unit_.push_back(vec3<T>((p - center) / edges + vec3<double>(0.5)));
        }
        const std::vector<T> region(priors.region.begin(), priors.region.end());
        std::vector<T> features;
        for (const double feature : priors.features) features.push_back(static_cast<T>(config_.prior_scale * feature));
        Buffer<T> region_here(region.size());
        Buffer<vec3<T>> points(unit_.size());
        positions_.resize(here.size());
        features_.resize(features.size());
        backend_->upload(Span<const vec3<T>>(here), positions_);
        backend_->upload(Span<const T>(features), features_);
        backend_->upload(Span<const T>(region), region_here);
        backend_->upload(Span<const vec3<T>>(unit_), points);
        const Field geometry(
            {.base = config_.hash_base, .growth = config_.hash_growth, .table_size = config_.hash_table_size},
            {.outputs = 1});
        geometry.prepare(*backend_, Span<const vec3<T>>(points), query_,
                         MultiScale<T>{priors.region.empty() ? 0 : config_.fine_level, config_.separate_tables,
                                       Span<const T>(region_here)});
    }

    B* backend_;
    AvatarConfig config_;
    Rig<B, T> rig_;
    std::optional<Field> head_, displacement_, ao_;
    std::size_t count_;
    typename Field::template Query<B, T> query_, ao_query_; // head and displacement have one geometry
    std::vector<vec3<T>> unit_;                             // [N] x₀ in the unit cube
    Buffer<vec3<T>> positions_;                             // [N] x₀
    Buffer<T> features_;                                    // [N, features]
    Parameters<B, T> parameters_;
    Buffer<vec3<T>> head_outputs_;                          // [N, basis (+ 1)]: SH, and δx of a joint head
    Buffer<vec3<T>> displacements_;                         // [N] δx of a field of its own
};

} // namespace gsh
