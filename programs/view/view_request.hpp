// SPDX-License-Identifier: Apache-2.0
/// @file  What the page of gsh-view asks for: a picture of given poses from a given camera, as strictly read JSON.
#pragma once

#include <gsh/body/motion.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>
#include <string_view>
#include <vector>

namespace gsh::programs {

/// One picture.
struct ViewRequest {
    enum class Show {
        splats,
        ellipsoids, ///< each Gaussian as a solid
    };
    Camera<double> camera;
    vec3<float> background{0};
    Show show = Show::splats;
    bool shadows = true;
    double light_turn = 0;      ///< radians about the vertical
    bool lossless = false;      ///< a PNG in place of a JPEG
    std::vector<Motion> people; ///< one frame each
};

/// The numbers that a request must have for a person.
struct PersonSize {
    std::size_t joints = 0, betas = 0, expressions = 0;
};

inline constexpr int largest_view = 4096; ///< pixels, width and height of a picture

/// Reads a request:
///
///     {"camera": {"size": [w, h], "focal": [fx, fy], "centre": [cx, cy], "R": [9, row by row], "t": [3]},
///      "background": [r, g, b], "show": "splats" or "ellipsoids", "shadows": true, "light_turn": radians,
///      "format": "jpeg" or "png",
///      "people": [{"pose": [3 J], "betas": [S], "expression": [E], "transl": [3]}, …]}
///
/// Frame   x_cam = R x + t; see Camera and Motion.
/// Errors  ValueError, one line that names the field, what was found and what was expected. Numbers must be within
///         ±1e6, names must be known, and nothing may be missing.
[[nodiscard]] ViewRequest parse_view_request(std::string_view text, const std::vector<PersonSize>& people);

} // namespace gsh::programs
