// SPDX-License-Identifier: Apache-2.0
/// @file  Where a fit of a motion starts: each frame's body in a usual pose, turned and placed by its trunk.
#pragma once

#include <gsh/body/landmarks.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/fit/frame_kinematics.hpp>
#include <gsh/fit/motion_problem.hpp>
#include <gsh/fit/triangulation.hpp>
#include <gsh/fit/view_keypoints.hpp>
#include <gsh/math/linalg.hpp>
#include <gsh/math/polar.hpp>
#include <gsh/math/vec.hpp>

#include <Eigen/Cholesky>

#include <array>
#include <concepts>
#include <cstddef>
#include <optional>
#include <vector>

namespace gsh {

/// The rotation R that minimises Σ |to - mean(to) - R (from - mean(from))|².
///
[[nodiscard]] inline mat3<double> aligning_rotation(Span<const vec3<double>> from, Span<const vec3<double>> to) {
    vec3<double> a(0), b(0);
    for (std::size_t i = 0; i < from.size(); ++i) a += from[i] / double(from.size()), b += to[i] / double(from.size());
    mat3<double> M(0.0);
    for (std::size_t i = 0; i < from.size(); ++i) M += outer(to[i] - b, from[i] - a);
    return polar_rotation(M);
}

/// A usual pose in each frame, turned by the detector's guesses in metres and placed by the rays of its points. Frames
/// without any take those of the nearest frame.
template <std::same_as<double> Real = double> // see fit_motion
[[nodiscard]] MotionState motion_start(const FittedBody& body, const std::vector<std::vector<ViewKeypoints>>& views) {
    const Landmarks& marks = body.marks;
    constexpr std::array<int, 4> trunk{landmark_number("left_shoulder"), landmark_number("right_shoulder"),
                                       landmark_number("left_hip"), landmark_number("right_hip")};
    MotionState state;
    state.betas.assign(static_cast<std::size_t>(body.shape_count), 0.0);
    std::vector<double> angles;
    for (const PoseAxis& axis : body.axes) angles.push_back(axis.mean);
    std::vector<bool> known;
    for (const auto& frame : views) {
        FrameNumbers numbers{.angles = angles};
        // Places of landmarks, up to a translation: triangulated, or else the mean of the cameras' guesses.
        std::vector<vec3<double>> guess(marks.size(), vec3<double>(0));
        std::vector<double> count(marks.size(), 0.0);
        const auto triangulated = triangulate_landmarks(frame);
        std::size_t clear = 0;
        for (const int mark : trunk) {
            const auto& point = triangulated[static_cast<std::size_t>(mark)];
            clear += point && point->distance < 0.1;
        }
        if (clear >= 3) {
            for (std::size_t l = 0; l < marks.size(); ++l)
                if (triangulated[l] && triangulated[l]->distance < 0.1)
                    guess[l] = triangulated[l]->position, count[l] = 1;
        } else {
            for (const ViewKeypoints& view : frame)
                for (const MetricPoint& point : view.metric) {
                    const auto l = static_cast<std::size_t>(point.landmark);
                    guess[l] += transposed_times(view.camera.R, point.position), count[l] += 1;
                }
        }
        std::vector<vec3<double>> from, to;
        for (const int mark : trunk) {
            const auto l = static_cast<std::size_t>(mark);
            if (count[l] == 0) continue;
            from.push_back(body.joints[static_cast<std::size_t>(marks[l].joint)] + marks[l].offset);
            to.push_back(guess[l] / count[l]);
        }
        known.push_back(from.size() >= 3);
        if (known.back()) {
            numbers.root = aligning_rotation(from, to);
            // What moves the guesses onto the rays of their points: linear in it.
            Eigen::Matrix3d A = Eigen::Matrix3d::Identity() * 1e-6;
            Eigen::Vector3d b = Eigen::Vector3d::Zero();
            for (const ViewKeypoints& view : frame)
                for (const Keypoint& point : view.points) {
                    if (count[static_cast<std::size_t>(point.landmark)] == 0) continue;
                    const auto l = static_cast<std::size_t>(point.landmark);
                    const Camera<double>& camera = view.camera;
                    const double x = (point.pixel.x - camera.cx) / camera.fx,
                                 y = (point.pixel.y - camera.cy) / camera.fy;
                    const vec3<double> offset = camera.R * (guess[l] / count[l]) + camera.t;
                    for (const vec3<double>& row : {vec3<double>(1, 0, -x), vec3<double>(0, 1, -y)}) {
                        const vec3<double> r = transposed_times(camera.R, row);
                        const Eigen::Vector3d e(r.x, r.y, r.z);
                        A += point.confidence * e * e.transpose();
                        b -= point.confidence * e * dot(row, offset);
                    }
                }
            const Eigen::Vector3d moved = A.ldlt().solve(b);
            vec3<double> middle_from(0), middle_to(0);
            for (std::size_t k = 0; k < from.size(); ++k)
                middle_from += from[k] / static_cast<double>(from.size()),
                    middle_to += to[k] / static_cast<double>(from.size());
            numbers.transl = middle_to + vec3<double>(moved[0], moved[1], moved[2]) - body.joints[0] -
                             numbers.root * (middle_from - body.joints[0]);
        }
        state.frames.push_back(std::move(numbers));
    }
    for (std::size_t t = 0; t < known.size(); ++t) {
        if (known[t]) continue;
        for (std::size_t away = 1; away < known.size(); ++away) {
            const std::size_t before = t - away, after = t + away;
            if (away <= t && known[before])
                state.frames[t] = state.frames[before];
            else if (after < known.size() && known[after]) state.frames[t] = state.frames[after];
            else continue;
            break;
        }
    }
    return state;
}

} // namespace gsh
