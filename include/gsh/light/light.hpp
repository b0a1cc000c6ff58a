// SPDX-License-Identifier: Apache-2.0
/// @file  Light that shades a person: a few near points, a coarse set of distant directions, and a gloss.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/setting.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <string_view>
#include <type_traits>
#include <vector>

namespace gsh {

/// Views of a light; `LightView<const T>` is an input, `LightView<T>` a gradient. An attribute of a gradient may be
/// empty; it is then not computed. Directions are fixed and have no gradient.
///
/// The light is grey: one intensity for all three channels. Colour that is common to all lights belongs to the albedo.
///
/// Shapes  points [P]; directions [D] unit vectors towards the light; log_intensities [P + D], the points first;
///         gloss [2], logarithms of strength and sharpness, or empty for none.
/// Frame   the world.
/// Units   metres. The irradiance on a facing surface is exp(log_intensity) / distance² for a point, and
///         exp(log_intensity) for a direction.
template <class T>
struct LightView {
    using Scalar = std::remove_const_t<T>;
    template <class U>
    using Like = std::conditional_t<std::is_const_v<T>, const U, U>;

    Span<Like<vec3<Scalar>>> points = {};
    Span<const vec3<Scalar>> directions = {};
    Span<T> log_intensities = {};
    Span<T> gloss = {};

    /// P + D, the number of columns of a visibility.
    [[nodiscard]] GSH_HD std::size_t size() const { return points.size() + directions.size(); }
};

/// A light on the host, as avatar files store it. For the members see LightView.
struct LightData {
    std::vector<vec3<double>> points, directions;
    std::vector<double> log_intensities;
    std::vector<double> gloss;
    bool shadows = true; ///< whether bodies hide it from themselves and from each other

    [[nodiscard]] std::size_t size() const { return points.size() + directions.size(); }
    [[nodiscard]] LightView<const double> view() const { return {points, directions, log_intensities, gloss}; }
};

/// The lights of a capture whose light is estimated.
struct LightParams {
    int points = 4;      ///< near lights; each casts sharp shadows and has a gloss
    int directions = 12; ///< distant lights around the body, with soft shadows
    bool shadows = true; ///< if false, only where the surface faces counts
    double distance = 4; ///< metres, of the points from the people before they learn

    template <class Self, class F>
    static void for_each_setting(Self& self, const F& f) {
        f("light.points", self.points, SettingRange::at_least(1).up_to(64));
        f("light.directions", self.directions, SettingRange::at_least(0).up_to(256));
        f("light.shadows", self.shadows, SettingRange());
        f("light.distance", self.distance, SettingRange::above(0));
    }
};

/// `count` unit vectors, evenly spread over the sphere (a Fibonacci lattice).
[[nodiscard]] inline std::vector<vec3<double>> even_directions(std::size_t count) {
    std::vector<vec3<double>> result;
    for (std::size_t k = 0; k < count; ++k) {
        const double y = 1 - (2 * static_cast<double>(k) + 1) / static_cast<double>(count);
        const double angle = static_cast<double>(k) * std::numbers::pi * (3 - std::sqrt(5.0));
        const double radius = std::sqrt(1 - y * y);
        result.push_back({radius * std::cos(angle), y, radius * std::sin(angle)});
    }
    return result;
}

/// A light of the given size with all intensities equal: the same irradiance from every side at `center`.
[[nodiscard]] inline LightData even_light(std::size_t points, std::size_t directions, const vec3<double>& center,
                                          double distance) {
    LightData light{.points = even_directions(points), .directions = even_directions(directions),
                    .log_intensities = {}, .gloss = {std::log(0.02), std::log(20.0)}};
    // A convex surface sees half of the directions, at a mean cosine of one half.
    const double each = 4 / static_cast<double>(std::max<std::size_t>(points + directions, 1));
    for (vec3<double>& point : light.points) point = center + point * distance;
    light.log_intensities.assign(points, std::log(each * distance * distance));
    light.log_intensities.insert(light.log_intensities.end(), directions, std::log(each));
    return light;
}

/// Throws ShapeError unless the sizes of a light fit each other.
template <class T>
void check_light(std::string_view where, const LightView<T>& light) {
    check_size(where, "light.log_intensities", light.log_intensities.size(), light.size(),
               "one per point, then one per direction");
    if (!light.gloss.empty())
        check_size(where, "light.gloss", light.gloss.size(), 2, "logarithms of strength and sharpness, or none");
}

/// Checks a light on the host before it is used or written.
/// Errors  ShapeError for sizes that do not fit each other. ValueError without lights, and for numbers that are not
///         finite.
inline void check_light(std::string_view where, const LightData& light) {
    check_light(where, light.view());
    check_value(light.size() > 0, where, "the light has no points and no directions");
    check_finite<double>(where, "light.points", view_as<const double>(Span<const vec3<double>>(light.points)));
    check_finite<double>(where, "light.directions", view_as<const double>(Span<const vec3<double>>(light.directions)));
    check_finite<double>(where, "light.log_intensities", light.log_intensities);
    check_finite<double>(where, "light.gloss", light.gloss);
}

/// Throws MemoryError unless the backend can access every attribute.
template <Backend B, class T>
void check_memory(const B& backend, std::string_view where, std::string_view argument, const LightView<T>& light) {
    check_memory(backend, where, argument, light.points, "points");
    check_memory(backend, where, argument, light.directions, "directions");
    check_memory(backend, where, argument, light.log_intensities, "log_intensities");
    check_memory(backend, where, argument, light.gloss, "gloss");
}

} // namespace gsh
