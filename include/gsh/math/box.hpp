// SPDX-License-Identifier: Apache-2.0
/// @file  A box along the axes, and the one around points.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>

namespace gsh {

/// A box along the axes, by its lowest and its highest corner.
struct Box {
    vec3<double> low = vec3<double>(0.0), high = vec3<double>(0.0);
};

/// The smallest box that contains all points.
/// Errors  ValueError if there are none.
[[nodiscard]] inline Box box_of_points(Span<const vec3<double>> points) {
    check_value(!points.empty(), "box_of_points", "there are no points, expected at least one");
    Box box{points[0], points[0]};
    for (const auto& p : points)
        for (int k = 0; k < 3; ++k) box.low[k] = std::min(box.low[k], p[k]), box.high[k] = std::max(box.high[k], p[k]);
    return box;
}

} // namespace gsh
