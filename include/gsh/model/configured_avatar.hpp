// SPDX-License-Identifier: Apache-2.0
/// @file  An avatar whose parts are chosen at run time: the choices of a configuration become types here.
#pragma once

#include <gsh/avatar/rig.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/core/error.hpp>
#include <gsh/learn/part_size.hpp>
#include <gsh/model/appearance.hpp>
#include <gsh/model/avatar_config.hpp>
#include <gsh/model/avatar_model.hpp>
#include <gsh/model/canonical_points.hpp>
#include <gsh/model/field_appearance.hpp>
#include <gsh/model/field_shadow.hpp>
#include <gsh/model/shadow.hpp>
#include <gsh/model/shared_field.hpp>
#include <gsh/model/split_appearance.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <type_traits>
#include <utility>

namespace gsh {

/// The avatar of a configuration. Its type is the same for every choice of parts, so a trainer of it is compiled once.
/// Code that names the types of the parts in AvatarModel pays no virtual call.
template <Backend B, std::floating_point T = float, int Degree = 2>
using ConfiguredAvatar = AvatarModel<B, AnyAppearance<T, Degree>, AnyShadow<B, T>, T>;

/// The settings of a configuration as those of its parts: fields, appearance, shadow, and the model's own arrays.
[[nodiscard]] inline FieldParams field_params(const AvatarConfig& config, std::uint32_t table_size) {
    return {.base = config.hash_base,
            .growth = config.hash_growth,
            .table_size = table_size,
            .width = config.mlp_width,
            .hidden_layers = config.mlp_hidden_layers};
}
[[nodiscard]] inline AppearanceParams appearance_params(const AvatarConfig& config, std::size_t frame_count,
                                                        std::uint64_t seed) {
    return {.field = field_params(config, config.hash_table_size),
            .fine_level = config.fine_level,
            .separate_tables = config.separate_tables,
            .sh_dc_scale = config.sh_dc_scale,
            .time_frames = config.head_time ? frame_count : 0,
            .sh_rate = config.rates.sh,
            .displacement_rate = config.rates.displacement,
            .stored_sh_rate = config.rates.stored_sh,
            .stored_displacement_rate = config.rates.stored_displacements,
            .seed = seed};
}
[[nodiscard]] inline FieldShadowParams shadow_params(const AvatarConfig& config, std::uint64_t seed) {
    FieldParams field = field_params(config, config.ao_table_size);
    field.growth = config.ao_growth, field.width = config.ao_width;
    return {.field = field,
            .largest = config.largest_ao,
            .initial = config.initial_ao,
            .rate = config.rates.ao,
            .seed = seed};
}
[[nodiscard]] inline AvatarModelParams model_params(const AvatarConfig& config) {
    return {.initial_opacity = config.initial_opacity,
            .initial_thickness = config.initial_thickness,
            .clamping = config.clamping,
            .deformation = config.deformation,
            .shadow_start = config.ao_start,
            .sh_start = config.sh_start,
            .joint_rate = config.rates.joints,
            .quat_rate = config.rates.quats,
            .log_scale_rate = config.rates.log_scales,
            .opacity_logit_rate = config.rates.opacity_logits,
            .normal_offset_rate = config.rates.light_normals};
}

/// Calls use(std::type_identity<A>()) with the appearance A of a configuration.
template <Backend B, std::floating_point T, int Levels, int Features, int Degree, class Use>
auto with_appearance_type(const AvatarConfig& config, const Use& use) {
    if (config.has_shared_field()) return use(std::type_identity<SharedField<B, T, Degree, Levels, Features>>());
    if (config.hash_sh && config.hash_displacement)
        return use(std::type_identity<SeparateFields<B, T, Degree, Levels, Features>>());
    if (config.hash_sh)
        return use(std::type_identity<FieldColorsStoredDisplacements<B, T, Degree, Levels, Features>>());
    if (config.hash_displacement)
        return use(std::type_identity<StoredColorsFieldDisplacements<B, T, Degree, Levels, Features>>());
    return use(std::type_identity<StoredAttributes<B, T, Degree, Levels, Features>>());
}

/// The number of inputs of each kind of shadow: a code per frame, or the pose's features.
struct ShadowInputCounts {
    std::size_t frames, pose_features;
};

/// Calls use(std::type_identity<S>(), count) with the shadow S of a configuration and the number of its inputs, or
/// use(std::type_identity<NoShadow<B, T>>()).
template <Backend B, std::floating_point T, int Levels, int Features, class Use>
auto with_shadow_type(const AvatarConfig& config, const ShadowInputCounts& counts, const Use& use) {
    switch (config.ao) {
    case AmbientOcclusion::time: return use(std::type_identity<TimeShadow<B, T, Levels, Features>>(), counts.frames);
    case AmbientOcclusion::pose:
        return use(std::type_identity<PoseShadow<B, T, Levels, Features>>(), counts.pose_features);
    case AmbientOcclusion::none: break;
    }
    return use(std::type_identity<NoShadow<B, T>>());
}

/// Makes the avatar that a configuration describes, from a rig and the samples of which the rig was made. `frame_count`
/// is the length of the training motion, for parts that depend on the time. Without a light, the avatar is not lit,
/// whatever Configuration::light says: a capture's light is estimated first (estimate_light).
///
/// Errors  ShapeError, ValueError: samples or priors that are not of the rig's points, a configuration out of range.
template <Backend B, std::floating_point T = float, int Levels = 16, int Features = 4, int Degree = 2>
[[nodiscard]] ConfiguredAvatar<B, T, Degree> make_avatar(B& backend, const RigData& rig, const SurfaceSamples& samples,
                                                         std::size_t frame_count, std::uint64_t seed,
                                                         const AvatarConfig& config = {},
                                                         const CanonicalPriors& priors = {},
                                                         ModelLight<B, T> light = {}) {
    check_value(!config.head_time || config.hash_sh || config.hash_displacement, "AvatarConfig",
                "head_time needs a field that reads it");
    check_value(config.initial_ao > 0 && config.initial_ao < config.largest_ao, "AvatarConfig",
                "initial_ao must lie between 0 and largest_ao");
    check_size("make_avatar", "samples", samples.size(), rig.point_count(), "the rig must be made of these samples");
    const auto points = std::make_shared<const CanonicalPoints<B, T>>(
        backend, samples.positions, priors,
        CanonicalPointsParams{config.bounds, config.bounds_margin, config.prior_scale});

    const AppearanceParams params = appearance_params(config, frame_count, seed);
    const auto appearance = [&]<class A>(std::type_identity<A>) -> AnyAppearance<T, Degree> {
        return A(backend, points, params);
    };
    const auto shadow = [&]<class S>(std::type_identity<S>, auto... count) -> AnyShadow<B, T> {
        if constexpr (sizeof...(count) == 0) return S();
        else return S(backend, *points, count..., shadow_params(config, seed));
    };
    return {backend,
            rig,
            samples,
            points,
            with_appearance_type<B, T, Levels, Features, Degree>(config, appearance),
            with_shadow_type<B, T, Levels, Features>(config, {frame_count, rig.body.pose_feature_count()}, shadow),
            model_params(config),
            std::move(light)};
}

/// The size of the avatar that make_avatar would make, on a rig of `joint_count` joints. Allocates no array.
template <Backend B, std::floating_point T = float, int Levels = 16, int Features = 4, int Degree = 2>
[[nodiscard]] PartSize avatar_size(const AvatarConfig& config, std::size_t joint_count, const PriorInputs& inputs) {
    constexpr std::size_t frame_count = 1; // no array depends on the motion's length
    const std::size_t pose_feature_count = joint_count > 0 ? 9 * (joint_count - 1) : 0;
    PartSize size = ConfiguredAvatar<B, T, Degree>::own_size(joint_count);
    append(size, with_appearance_type<B, T, Levels, Features, Degree>(config, [&]<class A>(std::type_identity<A>) {
               return A::size(appearance_params(config, frame_count, 0), inputs);
           }));
    const auto shadow_size = [&]<class S>(std::type_identity<S>, auto... count) {
        if constexpr (sizeof...(count) == 0) return PartSize();
        else return S::size(shadow_params(config, 0), count...);
    };
    append(size, with_shadow_type<B, T, Levels, Features>(config, {frame_count, pose_feature_count}, shadow_size));
    return size;
}

} // namespace gsh
