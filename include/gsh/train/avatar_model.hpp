// SPDX-License-Identifier: Apache-2.0
/// @file  The trainable avatar: parameter fields and stored attributes in, posed splats out, and the way back.
#pragma once

#include <gsh/avatar/avatar.hpp>
#include <gsh/avatar/rig.hpp>
#include <gsh/avatar/skinned_gaussian.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/hash_field.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/train/parameters.hpp>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace gsh {

/// Sizes and starting values of an avatar.
struct AvatarConfig {
    double hash_base = 4;                     ///< cells on the coarsest level, along the bounding cube's edge
    double hash_growth = 1.5;                 ///< from one level to the next
    std::uint32_t hash_table_size = 1u << 17; ///< most entries of a level
    int mlp_width = 64;                       ///< neurons of a hidden layer
    int mlp_hidden_layers = 2;
    double initial_opacity = 0.2;
    double bounds_margin = 1.05;              ///< the fields' cube, in sizes of the points' bounding cube
    double sh_dc_scale = 20;                  ///< the network's constant-colour outputs are multiplied by this
    ColorClamp clamping = ColorClamp::both;
};

/// Splats of an avatar at a frame, from parameters that a gradient step can move.
///
///     SH, δx   = fields at x₀ (each a hash grid and a network of its own)
///     x̂₀(t)    = x₀ + δx + per-frame detail of the body (Rig)
///     splats   = SkinnedGaussian(x̂₀, R, s, o, SH; Σ w B(t))
///
/// Two stages, so that an avatar that is only shown evaluates its fields once: `update_canonical` queries them,
/// `pose` does the rest. backward runs both in reverse.
///
/// Ambient occlusion joins as one more field, read by `pose` between the colour's clamp and the splat; a region mask
/// and prior features join as columns of the fields' input. Neither is part of this configuration.
///
/// Source  paper §3.3 to §3.5 in the configuration of its direct baseline, Liu et al., "Animatable 3D Gaussian", 2024.
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
        typename Field::template Cache<B, T> displacement, sh;
        typename Rig<B, T>::Cache rig;
        Buffer<vec3<T>> means;         // [N] x̂₀(t)
        Buffer<vec3<T>> dL_dmeans;     // [N]
        Buffer<vec3<T>> dL_dsh;        // [N, basis]
        Buffer<Affine<T>> dL_dbones;   // [J]
        SkinnedSplatsWorkspace<B, T> workspace;
    };

    /// The rig's points become the Gaussians. `samples` gives their positions and initial scales.
    AvatarModel(B& backend, const RigData& rig, const SurfaceSamples& samples, std::uint64_t seed,
                const AvatarConfig& config = {})
        : backend_(&backend), config_(config), rig_(backend, rig),
          displacement_field_(grid_params(config), network(config, 3)),
          sh_field_(grid_params(config), network(config, 3 * basis_count)), count_(samples.size()) {
        check_size("AvatarModel", "samples", samples.size(), rig.point_count(), "the rig must be made of these samples");
        check_value(count_ > 0, "AvatarModel", "there are no samples, expected at least one");
        check_value(config.initial_opacity > 0 && config.initial_opacity < 1, "AvatarModel",
                    "initial_opacity must lie between 0 and 1");
        set_positions(samples.positions);

        std::vector<T> joints, log_scales;
        for (const auto& joint : rig.joints) joints.insert(joints.end(), {T(joint.x), T(joint.y), T(joint.z)});
        for (const double scale : samples.scales) log_scales.insert(log_scales.end(), 3, T(std::log(scale)));
        std::vector<T> quats(4 * count_, T(0));
        for (std::size_t i = 0; i < count_; ++i) quats[4 * i] = T(1);
        const std::vector<T> opacity_logits(count_, static_cast<T>(logit(config.initial_opacity)));
        const auto set = [&](ParameterGroup group, const std::vector<T>& values) {
            parameters_[group].resize(values.size());
            backend.upload(Span<const T>(values), parameters_[group]);
        };
        set(ParameterGroup::joints, joints);
        set(ParameterGroup::quats, quats);
        set(ParameterGroup::log_scales, log_scales);
        set(ParameterGroup::opacity_logits, opacity_logits);
        // A stream of random numbers for each, all from the one seed.
        set(ParameterGroup::displacement_table, displacement_field_.grid().template initial_table<T>(mix_bits(seed + 1)));
        set(ParameterGroup::displacement_network, displacement_field_.mlp().template initial_weights<T>(mix_bits(seed + 2)));
        set(ParameterGroup::sh_table, sh_field_.grid().template initial_table<T>(mix_bits(seed + 3)));
        set(ParameterGroup::sh_network, sh_field_.mlp().template initial_weights<T>(mix_bits(seed + 4)));
    }

    [[nodiscard]] std::size_t size() const { return count_; }
    [[nodiscard]] const AvatarConfig& config() const { return config_; }
    [[nodiscard]] const Rig<B, T>& rig() const { return rig_; }
    [[nodiscard]] Rig<B, T>& rig() { return rig_; }
    [[nodiscard]] Parameters<B, T>& parameters() { return parameters_; }
    [[nodiscard]] const Parameters<B, T>& parameters() const { return parameters_; }
    /// Table entries that some Gaussian refers to; the others never have a gradient.
    [[nodiscard]] Span<const std::uint32_t> touched_entries() const { return query_.touched; }

    /// Queries the fields: canonical displacements and colours at the present parameters.
    void update_canonical(Cache& cache) {
        displacement_.resize(count_);
        sh_.resize(count_ * basis_count);
        displacement_field_.forward(*backend_, parameters_[ParameterGroup::displacement_table],
                                                   parameters_[ParameterGroup::displacement_network], query_,
                                                   scalars(displacement_), cache.displacement);
        sh_field_.forward(*backend_, parameters_[ParameterGroup::sh_table],
                                         parameters_[ParameterGroup::sh_network], query_, scalars(sh_), cache.sh);
        backend_->for_each(count_, detail::ScaleFirst<T>{sh_, static_cast<std::size_t>(basis_count), T(config_.sh_dc_scale)});
    }

    /// Splats at a frame, as seen from `center` (the camera's, in the world).
    void pose(const RigPose<B, T>& pose, const vec3<T>& center, const SplatView<T>& splats, Cache& cache) {
        rig_.forward(pose, joints(), cache.rig);
        cache.means.resize(count_);
        backend_->for_each(count_, detail::Sum<vec3<T>>{positions_, displacement_, cache.means});
        rig_.add_offsets(cache.rig, cache.means);
        skinned_splats_forward<Degree>(*backend_, gaussians(cache), cache.rig.bones, center, splats, config_.clamping);
    }

    /// Adjoint of update_canonical and pose: adds to dL_dparameters, and to what is asked for of the pose and the
    /// camera's centre.
    void backward(const RigPose<B, T>& pose, const vec3<T>& center, const SplatView<const T>& dL_dsplats, Cache& cache,
                  Parameters<B, T>& dL_dparameters, RigPoseGradient<T> dL_dpose = {}, Span<vec3<T>> dL_dcenter = {}) {
        cache.dL_dmeans.resize(count_);
        cache.dL_dsh.resize(sh_.size());
        cache.dL_dbones.resize(rig_.joint_count());
        backend_->fill(Span<vec3<T>>(cache.dL_dmeans), vec3<T>(T(0)));
        backend_->fill(Span<vec3<T>>(cache.dL_dsh), vec3<T>(T(0)));
        backend_->fill(Span<Affine<T>>(cache.dL_dbones), Affine<T>::zero());
        SkinnedView<T> dL_dgaussians{cache.dL_dmeans,
                                     view_as<quat<T>>(Span<T>(dL_dparameters[ParameterGroup::quats])),
                                     view_as<vec3<T>>(Span<T>(dL_dparameters[ParameterGroup::log_scales])),
                                     dL_dparameters[ParameterGroup::opacity_logits],
                                     cache.dL_dsh};
        skinned_splats_backward<Degree>(*backend_, gaussians(cache), cache.rig.bones, center, dL_dsplats,
                                        cache.workspace, dL_dgaussians, cache.dL_dbones, dL_dcenter, config_.clamping);
        rig_.backward(pose, cache.rig, cache.dL_dbones, cache.dL_dmeans,
                      view_as<vec3<T>>(Span<T>(dL_dparameters[ParameterGroup::joints])), dL_dpose);
        backend_->for_each(count_, detail::ScaleFirst<T>{cache.dL_dsh, static_cast<std::size_t>(basis_count),
                                                         T(config_.sh_dc_scale)});
        sh_field_.backward(*backend_, parameters_[ParameterGroup::sh_network], query_,
                                          scalars(cache.dL_dsh), cache.sh, dL_dparameters[ParameterGroup::sh_table],
                                          dL_dparameters[ParameterGroup::sh_network]);
        displacement_field_.backward(*backend_, parameters_[ParameterGroup::displacement_network], query_,
                                                    scalars(cache.dL_dmeans), cache.displacement,
                                                    dL_dparameters[ParameterGroup::displacement_table],
                                                    dL_dparameters[ParameterGroup::displacement_network]);
    }

    /// The canonical Gaussians of the last update_canonical, on the host: what an avatar file keeps.
    [[nodiscard]] GaussianCloud<T> canonical_gaussians() const {
        GaussianCloud<T> cloud(count_, Degree);
        std::vector<vec3<T>> displacement(count_);
        backend_->download(Span<const vec3<T>>(positions_), cloud.means);
        backend_->download(Span<const vec3<T>>(displacement_), displacement);
        for (std::size_t i = 0; i < count_; ++i) cloud.means[i] += displacement[i];
        backend_->download(view_as<const quat<T>>(Span<const T>(parameters_[ParameterGroup::quats])), cloud.quats);
        backend_->download(view_as<const vec3<T>>(Span<const T>(parameters_[ParameterGroup::log_scales])), cloud.log_scales);
        backend_->download(Span<const T>(parameters_[ParameterGroup::opacity_logits]), cloud.opacity_logits);
        backend_->download(Span<const vec3<T>>(sh_), cloud.sh);
        return cloud;
    }

    /// The avatar as it is now, for files and for Avatar: `rig` with the learned joints, and the canonical Gaussians of
    /// the last update_canonical. `filter` is what they were trained with.
    [[nodiscard]] AvatarData avatar(RigData rig, const PixelFilter& filter) const
        requires std::same_as<T, float>
    {
        std::vector<vec3<T>> learned(rig.joint_count());
        backend_->download(joints(), Span<vec3<T>>(learned));
        for (std::size_t j = 0; j < learned.size(); ++j) rig.joints[j] = vec3<double>(learned[j]);
        return {std::move(rig), canonical_gaussians(), config_.clamping, filter};
    }

    /// Learned joints [J] in the backend's memory.
    [[nodiscard]] Span<const vec3<T>> joints() const {
        return view_as<const vec3<T>>(Span<const T>(parameters_[ParameterGroup::joints]));
    }

private:
    static typename Grid::Params grid_params(const AvatarConfig& config) {
        return {.base = config.hash_base, .growth = config.hash_growth, .table_size = config.hash_table_size};
    }
    static Mlp::Params network(const AvatarConfig& config, int outputs) {
        return {.inputs = Grid::output_count, .outputs = outputs, .width = config.mlp_width, .hidden_layers = config.mlp_hidden_layers};
    }
    static Span<T> scalars(Buffer<vec3<T>>& buffer) { return view_as<T>(Span<vec3<T>>(buffer)); }

    [[nodiscard]] SkinnedView<const T> gaussians(const Cache& cache) const {
        return {cache.means,
                view_as<const quat<T>>(Span<const T>(parameters_[ParameterGroup::quats])),
                view_as<const vec3<T>>(Span<const T>(parameters_[ParameterGroup::log_scales])),
                parameters_[ParameterGroup::opacity_logits],
                sh_,
                {},
                rig_.skin()};
    }

    /// Keeps x₀ and its place in the fields' unit cube: the points' bounding cube about its centre, a little larger.
    void set_positions(Span<const vec3<double>> positions) {
        vec3<double> low = positions[0], high = positions[0];
        for (const auto& p : positions)
            for (int axis = 0; axis < 3; ++axis) {
                low[axis] = std::min(low[axis], p[axis]);
                high[axis] = std::max(high[axis], p[axis]);
            }
        const vec3<double> center = (low + high) * 0.5, extent = high - low;
        const double edge = config_.bounds_margin * std::max({extent.x, extent.y, extent.z, 1e-6});
        std::vector<vec3<T>> here, unit;
        for (const auto& p : positions) {
            here.push_back(vec3<T>(p));
            unit.push_back(vec3<T>((p - center) / edge + vec3<double>(0.5)));
        }
        positions_.resize(here.size());
        backend_->upload(Span<const vec3<T>>(here), positions_);
        sh_field_.grid().template prepare<B, T>(*backend_, unit, query_);
    }

    B* backend_;
    AvatarConfig config_;
    Rig<B, T> rig_;
    Field displacement_field_, sh_field_;
    std::size_t count_;
    typename Grid::template Query<B, T> query_; // both fields have one geometry
    Buffer<vec3<T>> positions_;                 // [N] x₀
    Parameters<B, T> parameters_;
    Buffer<vec3<T>> displacement_;              // [N] δx
    Buffer<vec3<T>> sh_;                        // [N, basis]
};

} // namespace gsh
