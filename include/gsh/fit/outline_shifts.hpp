// SPDX-License-Identifier: Apache-2.0
/// @file  By how much cameras point beside their calibration, found from outlines of masks.
#pragma once

#include <gsh/core/span.hpp>
#include <gsh/fit/frame_kinematics.hpp>
#include <gsh/fit/motion_state.hpp>
#include <gsh/fit/outlines.hpp>
#include <gsh/fit/view_keypoints.hpp>
#include <gsh/math/spread.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

namespace gsh {

/// A shift of a camera's image, and its standard error along both axes, pixels.
struct OutlineShift {
    vec2<double> shift{0}, error{1e9};
};

/// How far a camera's masks lie beside the posed bodies: in each view the shift s and the growth g for which
/// n · s + g is nearest to the distances of the mask's outline from the body's along its normals n, pseudo-Huber beyond
/// 3 pixels; then the median of s over the camera's views, less the mean over cameras: a shift of all cameras is one of
/// the body, and soles and hair look like one. Growth is what clothes and the mask's threshold add all around. Errors
/// follow from how much views differ.
///
/// Shapes  views [T]; the result has `camera_count` elements. Cameras of fewer than five views with masks have none.
/// Units   pixels.
[[nodiscard]] inline std::vector<OutlineShift> outline_shifts(const FittedBody& body, const OutlineSamples& samples,
                                                              const MotionState& state,
                                                              const std::vector<std::vector<ViewKeypoints>>& views,
                                                              std::size_t camera_count);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// n · s + g = distance.
struct OutlineEquation {
    vec2<double> normal{0};
    double distance = 0;
};

/// The shift that solves the equations best, or none if they do not determine it.
inline std::optional<vec2<double>> solve_outline_shift(Span<const OutlineEquation> equations) {
    vec3<double> x(0);
    constexpr int rounds = 6;
    const double n = static_cast<double>(equations.size());
    for (int round = 0; round < rounds; ++round) {
        mat3<double> A(0.0);
        vec3<double> b(0);
        for (const auto& [normal, distance] : equations) {
            const vec3<double> row(normal.x, normal.y, 1);
            constexpr double far = 3; // pixels
            const double off = (distance - dot(row, x)) / far;
            const double weight = 1 / std::sqrt(1 + off * off);
            A += outer(row, row) * weight, b += row * (distance * weight);
        }
        if (!(std::abs(determinant(A)) > 1e-3 * n * n * n)) return std::nullopt;
        x = inverse(A) * b;
    }
    return vec2<double>(x.x, x.y);
}

} // namespace detail

inline std::vector<OutlineShift> outline_shifts(const FittedBody& body, const OutlineSamples& samples,
                                                const MotionState& state,
                                                const std::vector<std::vector<ViewKeypoints>>& views,
                                                std::size_t camera_count) {
    constexpr double reach = 0.06; // metres
    constexpr std::size_t fewest_points = 40, fewest_views = 5;
    std::vector<std::vector<double>> xs(camera_count), ys(camera_count);
    std::vector<detail::OutlineEquation> equations;
    for (std::size_t t = 0; t < views.size(); ++t) {
        const FrameKinematics kinematics(body, state.frames[t], state.betas);
        for (const ViewKeypoints& view : views[t]) {
            if (!view.mask) continue;
            equations.clear();
            for (const RimPoint& point :
                 samples.rim(body, kinematics, state.betas, view.camera, std::exp(state.log_focal)))
                if (const auto distance = OutlineSamples::mask_distance(point, view.mask, reach))
                    equations.push_back({point.normal, *distance});
            if (equations.size() < fewest_points) continue;
            if (const auto shift = detail::solve_outline_shift(equations))
                xs[view.camera_number].push_back(shift->x), ys[view.camera_number].push_back(shift->y);
        }
    }
    std::vector<OutlineShift> result(camera_count);
    vec2<double> sum(0);
    double count = 0;
    for (std::size_t c = 0; c < camera_count; ++c) {
        if (xs[c].size() < fewest_views) continue;
        // The standard error of a median of normal numbers is 1.25 times that of their mean.
        const double share = 1.25 / std::sqrt(static_cast<double>(xs[c].size()));
        const Spread x = robust_spread(std::move(xs[c])), y = robust_spread(std::move(ys[c]));
        result[c] = {{x.median, y.median}, {share * x.deviation, share * y.deviation}};
        sum += result[c].shift, count += 1;
    }
    for (OutlineShift& of : result)
        if (of.error.x < 1e8) of.shift -= sum / count;
    return result;
}

} // namespace gsh
