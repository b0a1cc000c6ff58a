// SPDX-License-Identifier: Apache-2.0
/// @file  Where people stand while no photograph shows them.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cstddef>
#include <vector>

namespace gsh {

/// The frames in which a person is out of view: those of spans without a sight of more than a second, and of more than
/// 0.3 seconds at the beginning and at the end. In shorter ones, a detector has missed the person.
///
/// Shapes  seen [T]; times [T] ascending, seconds.
[[nodiscard]] inline std::vector<std::size_t> absent_frames(const std::vector<bool>& seen, Span<const double> times) {
    std::vector<std::size_t> result;
    const std::size_t T = seen.size();
    for (std::size_t begin = 0; begin < T; ++begin) {
        if (seen[begin]) continue;
        std::size_t end = begin;
        while (end < T && !seen[end]) ++end;
        const bool inside = begin > 0 && end < T;
        const double from = times[begin > 0 ? begin - 1 : 0], to = times[end < T ? end : T - 1];
        if (to - from > (inside ? 1.0 : 0.3))
            for (std::size_t t = begin; t < end; ++t) result.push_back(t);
        begin = end;
    }
    return result;
}

/// A place 100 m away, along an axis of the world, that no camera sees, with a margin of a tenth of the image: below
/// the floor if y is up, else the first of the other axes. If there is no such axis, it is below the floor.
[[nodiscard]] inline vec3<double> place_out_of_view(const std::vector<Camera<double>>& cameras) {
    constexpr double far = 100;
    const vec3<double> places[] = {{0, -far, 0}, {0, far, 0}, {0, 0, far}, {0, 0, -far}, {far, 0, 0}, {-far, 0, 0}};
    const auto sees = [](const Camera<double>& camera, const vec3<double>& place) {
        const vec3<double> x = to_camera(camera, place);
        if (x.z <= 2) return false; // a body behind the camera
        const vec2<double> pixel = to_pixel(camera, x);
        const double margin = 0.1 * std::max(camera.width, camera.height);
        return pixel.x > -margin && pixel.y > -margin && pixel.x < camera.width + margin &&
               pixel.y < camera.height + margin;
    };
    for (const vec3<double>& place : places)
        if (std::none_of(cameras.begin(), cameras.end(), [&](const Camera<double>& c) { return sees(c, place); }))
            return place;
    return places[0];
}

} // namespace gsh
