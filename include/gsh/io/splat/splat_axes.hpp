// SPDX-License-Identifier: Apache-2.0
/// @file  The axes of splat files: which direction is up, and the one way in which each is turned to gsh's frame.
#pragma once

#include <gsh/gaussian/axis_turn.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/math/vec.hpp>

#include <array>
#include <cstddef>
#include <optional>
#include <string_view>

namespace gsh {

/// The direction that a file's numbers call up. gsh, glTF, SPZ and USD: y. PLY and .splat by custom: minus_y.
enum class UpAxis { x, minus_x, y, minus_y, z, minus_z };

/// In the order of UpAxis, as options and comments spell them.
inline constexpr std::array<std::string_view, 6> up_axis_names = {"x", "-x", "y", "-y", "z", "-z"};

[[nodiscard]] inline std::string_view name_of(UpAxis up) {
    return up_axis_names[static_cast<std::size_t>(up)];
}

/// Errors  none: no axis for another text.
[[nodiscard]] inline std::optional<UpAxis> up_axis_called(std::string_view name) {
    for (std::size_t k = 0; k < up_axis_names.size(); ++k)
        if (up_axis_names[k] == name) return static_cast<UpAxis>(k);
    return std::nullopt;
}

/// The axes of gsh's frame for three letters that say where a file's x, y and z point to: Right or Left, Up or Down,
/// Back or Front, each pair once. gsh's frame is RUB, the custom of PLY files RDF. Others, such as LUB, mirror.
///
/// Errors  none: no axes for other letters.
[[nodiscard]] inline std::optional<mat3<double>> axes_of_letters(std::string_view letters) {
    constexpr std::string_view known = "RLUDBF";
    if (letters.size() != 3) return std::nullopt;
    mat3<double> axes(0.0);
    for (int k = 0; k < 3; ++k) {
        const std::size_t at = known.find(letters[static_cast<std::size_t>(k)]);
        if (at == known.npos) return std::nullopt;
        const int row = static_cast<int>(at / 2);
        for (int before = 0; before < k; ++before)
            if (axes[before][row] != 0) return std::nullopt;
        axes[k][row] = at % 2 ? -1.0 : 1.0;
    }
    return axes;
}

/// The rotation from a frame with this vertical to gsh's, which has y up. This is the one place that decides how a file
/// is turned. Where up is along y or z, x stays: half a turn about x leads from y down to y up, (x, -y, -z), which is
/// how the owners of the formats lead from RDF (PLY) to RUB (SPZ, glTF), and a quarter turn from z up, (x, z, -y).
[[nodiscard]] inline mat3<double> y_up_axes(UpAxis up) {
    constexpr std::array<std::string_view, 6> letters = {"ULB", "DRB", "RUB", "RDF", "RFU", "RBD"};
    return *axes_of_letters(letters[static_cast<std::size_t>(up)]);
}

/// The cloud, which has y up, as a file with this vertical stores it.
[[nodiscard]] inline GaussianCloud<float> as_stored(GaussianCloud<float> cloud, std::optional<UpAxis> up) {
    if (up && *up != UpAxis::y) turn_axes(cloud, transpose(y_up_axes(*up)));
    return cloud;
}

/// The inverse: a cloud as a file with this vertical stores it, with y up. Bit for bit where up is along y.
inline void turn_from_stored(GaussianCloud<float>& cloud, std::optional<UpAxis> up) {
    if (up && *up != UpAxis::y) turn_axes(cloud, y_up_axes(*up));
}

} // namespace gsh
