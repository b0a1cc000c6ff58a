// SPDX-License-Identifier: Apache-2.0
/// @file  An avatar whose parts are chosen at run time: the choices of a configuration become types here.
#pragma once

#include <gsh/avatar/rig.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/named_types.hpp>
#include <gsh/core/setting.hpp>
#include <gsh/learn/part_size.hpp>
#include <gsh/model/appearance.hpp>
#include <gsh/model/avatar_model.hpp>
#include <gsh/model/canonical_points.hpp>
#include <gsh/model/configured_avatar_params.hpp>
#include <gsh/model/field_appearance.hpp>
#include <gsh/model/field_occlusion.hpp>
#include <gsh/model/occlusion.hpp>
#include <gsh/model/shared_field.hpp>
#include <gsh/model/split_appearance.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>

namespace gsh {

/// The avatar of a configuration. Its type is the same for every choice of parts, so a trainer of it is compiled once.
/// Code that names the types of the parts in AvatarModel pays no virtual call.
template <Backend B, std::floating_point T = float, int Degree = 2>
using ConfiguredAvatar = AvatarModel<B, AnyAppearance<T, Degree>, AnyOcclusion<B, T>, T>;

/// The appearances and ambient occlusions that a file or a command line can name: the last argument of make_avatar. A
/// list of your own adds types to these, or leaves some out:
///
///     struct MyParts : AvatarParts {
///         template <Backend B, std::floating_point T, int Degree, int Levels, int Features>
///         using Appearances =
///             typename AvatarParts::Appearances<B, T, Degree, Levels, Features>::template With<
///                 Named<"mine", MyAppearance<B, T>>>;
///     };
///
/// A listed type has
///
///     size(params, …)               its PartSize, from the arguments of the constructor that are no arrays
///     A(backend, points, params)    of an appearance: SharedPoints and AppearanceParams
///     S(backend, points, sizes, params)    of an ambient occlusion: CanonicalPoints, OcclusionSizes and
///                                          FieldOcclusionParams; S() where it needs none of them
struct AvatarParts {
    template <Backend B, std::floating_point T, int Degree, int Levels, int Features>
    using Appearances =
        NamedTypes<Named<"shared_field", SharedField<B, T, Degree, Levels, Features>>,
                   Named<"separate_fields", SeparateFields<B, T, Degree, Levels, Features>>,
                   Named<"color_field", FieldColorsStoredDisplacements<B, T, Degree, Levels, Features>>,
                   Named<"displacement_field", StoredColorsFieldDisplacements<B, T, Degree, Levels, Features>>,
                   Named<"stored", StoredAttributes<B, T, Degree, Levels, Features>>>;
    template <Backend B, std::floating_point T, int Levels, int Features>
    using Occlusions =
        NamedTypes<Named<"none", NoOcclusion<B, T>>, Named<"time", TimeOcclusion<B, T, Levels, Features>>,
                   Named<"pose", PoseOcclusion<B, T, Levels, Features>>>;
};

/// Checks that the lists have all parts that the settings name. `where` names the caller in messages.
/// Errors  ValueError that names the setting, and the parts that there are.
template <class Parts = AvatarParts>
void check_part_names(const ConfiguredAvatarParams& params, const std::string& where) {
    using B = cpu::Serial; // names do not depend on the backend
    const std::string prefix = where + ": ";
    Parts::template Appearances<B, float, 2, 16, 4>::check_name(prefix + "appearance", params.appearance_name());
    Parts::template Occlusions<B, float, 16, 4>::check_name(prefix + "ao", params.ao);
}
/// check_part_names(), and settings that depend on each other.
/// Errors  ValueError that names the settings.
template <class Parts = AvatarParts>
void check_parts(const ConfiguredAvatarParams& params, const std::string& where) {
    check_part_names<Parts>(params, where);
    check_ranges(where, params.occlusion);
    const auto text = [](double value) { return detail::setting_text(value); };
    check_value(params.occlusion.initial < params.occlusion.largest, where,
                "ao.initial is " + text(params.occlusion.initial) + " and ao.largest " +
                    text(params.occlusion.largest) + ", expected ao.initial below ao.largest");
    check_value(
        !params.head_time || !params.appearance_type.empty() || params.hash_sh || params.hash_displacement, where,
        "heads.time is true and neither hash_sh nor hash_displacement is, expected a field that reads the time");
}

/// Makes the avatar that the settings describe, from a rig and the samples of which the rig was made. `frame_count` is
/// the length of the training motion, for parts that depend on the time. Without a light, the avatar is not lit,
/// whatever ConfiguredAvatarParams::light says: a capture's light is estimated first (estimate_light).
///
/// Errors  ShapeError, ValueError: samples or priors that are not of the rig's points, settings out of range, parts
///         that no list has.
template <Backend B, class Parts = AvatarParts, std::floating_point T = float, int Levels = 16, int Features = 4,
          int Degree = 2>
[[nodiscard]] ConfiguredAvatar<B, T, Degree>
make_avatar(B& backend, const RigData& rig, const SurfaceSamples& samples, std::size_t frame_count, std::uint64_t seed,
            const ConfiguredAvatarParams& params = {}, const CanonicalPriors& priors = {},
            ModelLight<B, T> light = {}) {
    check_parts<Parts>(params, "make_avatar");
    check_size("make_avatar", "samples", samples.size(), rig.point_count(), "the rig must be made of these samples");
    const auto points =
        std::make_shared<const CanonicalPoints<B, T>>(backend, samples.positions, priors, params.points);

    const auto appearance = [&]<class A>(std::type_identity<A>) -> AnyAppearance<T, Degree> {
        return A(backend, points, params.appearance_of(frame_count, seed));
    };
    const OcclusionSizes sizes{frame_count, rig.body.pose_feature_count()};
    const auto occlusion = [&]<class S>(std::type_identity<S>) -> AnyOcclusion<B, T> {
        if constexpr (std::default_initializable<S>) return S();
        else return S(backend, *points, sizes, params.occlusion_of(seed));
    };
    return {backend,
            rig,
            samples,
            points,
            Parts::template Appearances<B, T, Degree, Levels, Features>::choose("appearance", params.appearance_name(),
                                                                                appearance),
            Parts::template Occlusions<B, T, Levels, Features>::choose("ao", params.ao, occlusion),
            params.model,
            std::move(light)};
}

/// The size of the avatar that make_avatar would make, on a rig of `joint_count` joints. Allocates no array.
template <Backend B, class Parts = AvatarParts, std::floating_point T = float, int Levels = 16, int Features = 4,
          int Degree = 2>
[[nodiscard]] PartSize avatar_size(const ConfiguredAvatarParams& params, std::size_t joint_count,
                                   const PriorInputs& inputs) {
    constexpr std::size_t frame_count = 1; // no array depends on the motion's length
    PartSize size = ConfiguredAvatar<B, T, Degree>::own_size(joint_count);
    append(size, Parts::template Appearances<B, T, Degree, Levels, Features>::choose(
                     "appearance", params.appearance_name(), [&]<class A>(std::type_identity<A>) {
                         return A::size(params.appearance_of(frame_count, 0), inputs);
                     }));
    const OcclusionSizes sizes{frame_count, joint_count > 0 ? 9 * (joint_count - 1) : 0};
    append(size, Parts::template Occlusions<B, T, Levels, Features>::choose(
                     "ao", params.ao, [&]<class S>(std::type_identity<S>) {
                         if constexpr (std::default_initializable<S>) return PartSize();
                         else return S::size(params.occlusion_of(0), sizes);
                     }));
    return size;
}

} // namespace gsh
