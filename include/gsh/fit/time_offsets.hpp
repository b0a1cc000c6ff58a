// SPDX-License-Identifier: Apache-2.0
/// @file  By how much the clocks of several cameras differ, found from a person's motion.
#pragma once

#include <gsh/body/landmarks.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/span.hpp>
#include <gsh/fit/frame_kinematics.hpp>
#include <gsh/fit/motion_problem.hpp>
#include <gsh/fit/view_keypoints.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace gsh {

/// How a camera's photographs lie against those of the others.
struct TimeOffset {
    double seconds = 0;    ///< by which they were taken later than their time stamps
    double error = 1e9;    ///< standard error, seconds; large if nothing moves
    vec2<double> shift{0}; ///< by which keypoints lie beside their landmarks on average, pixels
};

/// The offset of each camera from the others, which explains best how far its keypoints lie before or behind moving
/// landmarks: τ = -Σ (r - r̄) · (v - v̄) / Σ |v - v̄|², with r the distance of the landmark from the keypoint in the
/// image and v its velocity there, both in metres at the body's depth, and r̄ and v̄ their means. The mean distance
/// does not count, because a camera that points beside its calibration shifts a person who walks straight as a clock
/// would. Distances of more than 6 cm do not count, either.
///
/// Shapes  views [T]; times [T]; the result has `camera_count` elements, whose weighted mean is zero.
[[nodiscard]] inline std::vector<TimeOffset> time_offsets(const FittedBody& body, const MotionState& state,
                                                          const std::vector<std::vector<ViewKeypoints>>& views,
                                                          Span<const double> times, std::size_t camera_count) {
    struct Sums {
        double rv = 0, vv = 0, rr = 0, count = 0;
        vec2<double> r{0}, v{0}, pixels{0};
    };
    std::vector<Sums> sums(camera_count);
    constexpr int first_hand = landmark_number("left_hand_wrist");
    const auto product = [](const vec2<double>& a, const vec2<double>& b) { return a.x * b.x + a.y * b.y; };
    for (std::size_t t = 1; t + 1 < views.size(); ++t) {
        const FrameKinematics before(body, state.frames[t - 1], state.betas), now(body, state.frames[t], state.betas),
            after(body, state.frames[t + 1], state.betas);
        for (const ViewKeypoints& view : views[t])
            for (const Keypoint& point : view.points) {
                if (point.landmark >= first_hand || point.confidence < 0.5) continue;
                if (body.marks[static_cast<std::size_t>(point.landmark)].joint < 0) continue;
                const vec3<double> x = to_camera(view.camera, now.landmark(point.landmark));
                const vec3<double> moved =
                    view.camera.R * ((after.landmark(point.landmark) - before.landmark(point.landmark)) /
                                     (times[t + 1] - times[t - 1]));
                if (x.z < 0.1) continue;
                const double focal = std::exp(state.log_focal);
                const vec2<double> r{focal * x.x - (point.pixel.x - view.camera.cx) / view.camera.fx * x.z,
                                     focal * x.y - (point.pixel.y - view.camera.cy) / view.camera.fy * x.z};
                const vec2<double> v{focal * (moved.x - x.x / x.z * moved.z), focal * (moved.y - x.y / x.z * moved.z)};
                if (std::hypot(r.x, r.y) > 0.06) continue;
                Sums& of = sums[view.camera_number];
                of.rv += product(r, v), of.vv += product(v, v), of.rr += product(r, r), of.count += 1;
                of.r += r, of.v += v;
                of.pixels -= vec2<double>(r.x * view.camera.fx / x.z, r.y * view.camera.fy / x.z);
            }
    }
    std::vector<TimeOffset> result(camera_count);
    double mean = 0, weight = 0;
    for (std::size_t c = 0; c < camera_count; ++c) {
        const Sums& of = sums[c];
        constexpr double fewest = 20;
        if (of.count < fewest) continue;
        result[c].shift = of.pixels / of.count;
        const double vv = of.vv - product(of.v, of.v) / of.count, rv = of.rv - product(of.r, of.v) / of.count;
        if (!(vv > 1e-6 * of.vv) || vv <= 0) continue;
        result[c].seconds = -rv / vv;
        result[c].error =
            std::sqrt((of.rr - product(of.r, of.r) / of.count) / (2 * of.count) / (vv / of.count) / of.count);
        mean += vv * result[c].seconds, weight += vv;
    }
    for (TimeOffset& offset : result)
        if (offset.error < 1e8 && weight > 0) offset.seconds -= mean / weight;
    return result;
}

/// The keypoints of each camera at the common times: between those of the two nearest of its photographs, for a camera
/// whose photographs were taken `offsets` seconds after their time stamps. Cameras without an offset keep theirs; those
/// of another time lose their masks.
[[nodiscard]] inline std::vector<std::vector<ViewKeypoints>>
at_common_times(const std::vector<std::vector<ViewKeypoints>>& views, Span<const double> times,
                Span<const double> offsets) {
    std::vector<std::vector<ViewKeypoints>> result(views.size());
    const auto of_camera = [&](std::size_t t, std::size_t camera) -> const ViewKeypoints* {
        for (const ViewKeypoints& view : views[t])
            if (view.camera_number == camera) return &view;
        return nullptr;
    };
    for (std::size_t t = 0; t < views.size(); ++t)
        for (std::size_t c = 0; c < offsets.size(); ++c) {
            if (offsets[c] == 0) {
                if (const ViewKeypoints* view = of_camera(t, c)) result[t].push_back(*view);
                continue;
            }
            const double stamp = times[t] - offsets[c];
            const auto after =
                static_cast<std::size_t>(std::upper_bound(times.begin(), times.end(), stamp) - times.begin());
            if (after == 0 || after == times.size()) continue;
            const ViewKeypoints* const left = of_camera(after - 1, c);
            const ViewKeypoints* const right = of_camera(after, c);
            if (!left || !right) continue;
            const double u = (stamp - times[after - 1]) / (times[after] - times[after - 1]);
            ViewKeypoints view{left->camera, {}, u < 0.5 ? left->metric : right->metric, c, {}};
            for (const Keypoint& a : left->points)
                for (const Keypoint& b : right->points)
                    if (a.landmark == b.landmark)
                        view.points.push_back(
                            {a.landmark, a.pixel * (1 - u) + b.pixel * u, std::min(a.confidence, b.confidence)});
            result[t].push_back(std::move(view));
        }
    return result;
}

} // namespace gsh
