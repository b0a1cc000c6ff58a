// SPDX-License-Identifier: Apache-2.0
/// @file  Settings of an avatar whose parts are chosen at run time: those of its parts, and the choices.
#pragma once

#include <gsh/core/enum_names.hpp>
#include <gsh/core/setting.hpp>
#include <gsh/learn/learned_light.hpp>
#include <gsh/light/light.hpp>
#include <gsh/model/avatar_start.hpp>
#include <gsh/model/canonical_points.hpp>
#include <gsh/model/field_appearance.hpp>
#include <gsh/model/field_occlusion.hpp>
#include <gsh/model/occlusion.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace gsh {

/// Which fields give colours and displacements.
enum class Heads {
    shared,  ///< one field for both, as in the paper
    separate ///< a field for each, as in its direct baseline
};
template <>
struct EnumNames<Heads> { // files and options have "joint" for Heads::shared
    static constexpr std::array<std::string_view, 2> names{"joint", "separate"};
};

/// The name of StoredAttributes among the appearances of make_avatar's list.
inline constexpr std::string_view stored_appearance = "stored";

/// The settings of all parts of an avatar, and which parts it has.
struct ConfiguredAvatarParams {
    CanonicalPointsParams points = {};

    Heads heads = Heads::shared;
    bool hash_displacement = true; ///< δx from a field; if false, stored with each Gaussian
    bool hash_sh = true;           ///< SH from a field; if false, stored with each Gaussian
    /// The heads also read γ(t), so that colours and displacements change with the frame. A new motion has their mean.
    bool head_time = false;
    /// Name of the appearance among those of make_avatar's list. Empty: the three settings above choose one.
    std::string appearance_type = {};
    AppearanceParams appearance = {}; ///< its time_frames and seed are those of the run

    /// Name of the ambient occlusion among those of make_avatar's list, for instance AmbientOcclusion::time.
    std::string ao = AmbientOcclusion::none;
    FieldOcclusionParams occlusion =
        {}; ///< grid.base, hidden_layers and seed are not read: the appearance's and the run's

    /// Colours are those of the surface, shaded by light that falls on the posed mesh. Light is also right in a new
    /// motion. `ao` is then what light does not explain.
    bool light = false;
    LightParams lights = {};
    LightRates light_rates = {};

    AvatarModelParams model = {};

    /// The appearance's name: appearance_type, or what heads, hash_sh and hash_displacement say.
    [[nodiscard]] std::string_view appearance_name() const {
        if (!appearance_type.empty()) return appearance_type;
        if (hash_sh && hash_displacement) return heads == Heads::shared ? "shared_field" : "separate_fields";
        return hash_sh ? "color_field" : hash_displacement ? "displacement_field" : stored_appearance;
    }
    /// Settings of the appearance in a run whose motion has `frame_count` frames.
    [[nodiscard]] AppearanceParams appearance_of(std::size_t frame_count, std::uint64_t seed) const {
        AppearanceParams params = appearance;
        params.time_frames = head_time ? frame_count : 0;
        params.seed = seed;
        return params;
    }
    /// Settings of the ambient occlusion in a run.
    [[nodiscard]] FieldOcclusionParams occlusion_of(std::uint64_t seed) const {
        FieldOcclusionParams params = occlusion;
        params.grid.base = appearance.field.grid.base;
        params.hidden_layers = appearance.field.hidden_layers;
        params.seed = seed;
        return params;
    }

    template <class Self, class F>
    static void for_each_setting(Self& self, const F& f) {
        CanonicalPointsParams::for_each_setting(self.points, f);
        f("appearance", self.appearance_type, SettingRange());
        f("heads", self.heads, SettingRange());
        f("heads.time", self.head_time, SettingRange());
        f("hash_sh", self.hash_sh, SettingRange());
        f("hash_displacement", self.hash_displacement, SettingRange());
        AppearanceParams::for_each_setting(self.appearance, f);
        f("ao", self.ao, SettingRange());
        FieldOcclusionParams::for_each_setting(self.occlusion, f);
        f("light", self.light, SettingRange());
        LightParams::for_each_setting(self.lights, f);
        LightRates::for_each_setting(self.light_rates, f);
        AvatarModelParams::for_each_setting(self.model, f);
    }
};

} // namespace gsh
