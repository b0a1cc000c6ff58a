// SPDX-License-Identifier: Apache-2.0
/// @file  Places of landmarks from several photographs of one moment.
#pragma once

#include <gsh/body/landmarks.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/span.hpp>
#include <gsh/fit/view_keypoints.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

namespace gsh {

/// The point nearest to the rays of several views, and how far it lies from them.
struct TriangulatedPoint {
    vec3<double> position{0};
    double distance = 0; ///< mean over the views, each at most `cap`, metres
};

/// A view of one point.
struct SightLine {
    const Camera<double>* camera = nullptr;
    vec2<double> pixel{0};
    double weight = 1;
};

/// Minimises Σ weight |distance across the ray|² with the depths of the last pass, and views that miss by far counting
/// less (Geman-McClure, scale 3 cm). No value with fewer than two views, or if the rays are parallel.
[[nodiscard]] inline std::optional<TriangulatedPoint> triangulate(Span<const SightLine> lines, double cap = 0.2) {
    if (lines.size() < 2) return std::nullopt;
    TriangulatedPoint result;
    for (int pass = 0; pass < 6; ++pass) {
        mat3<double> A(0.0);
        vec3<double> b(0);
        double sum = 0;
        for (const SightLine& line : lines) {
            const Camera<double>& camera = *line.camera;
            const vec2<double> ray{(line.pixel.x - camera.cx) / camera.fx, (line.pixel.y - camera.cy) / camera.fy};
            const vec3<double> x = to_camera(camera, result.position);
            const double across = std::hypot(x.x - ray.x * x.z, x.y - ray.y * x.z);
            const double distance = x.z > 0.05 ? across : cap;
            sum += std::min(distance, cap);
            double weight = line.weight;
            if (pass > 0) {
                const double far = distance / 0.03, depth = std::max(x.z, 0.05);
                weight /= (1 + far * far) * (1 + far * far) * depth * depth;
            }
            for (const vec3<double>& row : {vec3<double>(1, 0, -ray.x), vec3<double>(0, 1, -ray.y)}) {
                const vec3<double> normal = transposed_times(camera.R, row);
                A += outer(normal, normal) * weight;
                b -= normal * (weight * dot(row, camera.t));
            }
        }
        const double trace = A[0].x + A[1].y + A[2].z;
        if (!(determinant(A) > 1e-7 * trace * trace * trace)) return std::nullopt; // rays within a few degrees
        result.position = inverse(A) * b;
        result.distance = sum / static_cast<double>(lines.size()); // of the pass before
    }
    return result;
}

/// Every landmark that two views or more show.
[[nodiscard]] inline std::vector<std::optional<TriangulatedPoint>>
triangulate_landmarks(const std::vector<ViewKeypoints>& views, double least_confidence = 0.3) {
    std::vector<std::vector<SightLine>> lines(2 * landmark_places.size());
    for (const ViewKeypoints& view : views)
        for (const Keypoint& point : view.points)
            if (point.confidence >= least_confidence)
                lines[static_cast<std::size_t>(point.landmark)].push_back(
                    {&view.camera, point.pixel, point.confidence});
    std::vector<std::optional<TriangulatedPoint>> result;
    for (const auto& of : lines) result.push_back(triangulate(of));
    return result;
}

} // namespace gsh
