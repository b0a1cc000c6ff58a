// SPDX-License-Identifier: Apache-2.0
/// @file  Light that shades a person: a few near points, a coarse set of distant directions, and a gloss.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>
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

    [[nodiscard]] std::size_t size() const { return points.size() + directions.size(); }
    [[nodiscard]] LightView<const double> view() const { return {points, directions, log_intensities, gloss}; }
};

/// Throws ShapeError unless the sizes of a light fit each other.
template <class T>
void check_light(std::string_view where, const LightView<T>& light) {
    check_size(where, "light.log_intensities", light.log_intensities.size(), light.size(),
               "one per point, then one per direction");
    if (!light.gloss.empty())
        check_size(where, "light.gloss", light.gloss.size(), 2, "logarithms of strength and sharpness, or none");
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
