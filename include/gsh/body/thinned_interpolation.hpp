// SPDX-License-Identifier: Apache-2.0
/// @file  Interpolation from a part of the points to all of them, for values that change slowly along a surface.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/nearest_points.hpp>
#include <gsh/body/surface_interpolation.hpp>
#include <gsh/body/thinned_samples.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <vector>

namespace gsh {

/// Interpolation from every stride-th point (thinned_rows), the "vertices", to all points. A point has the value of its
/// three nearest vertices; their weights, w = (1/d - 1/d₄)² of the distances d, fall to zero where the fourth one takes
/// over, so that the result is continuous, and a vertex keeps its own value. Weights add up to one.
///
/// Shapes  points [N] metres.
/// Errors  ValueError for no points, or stride 0.
/// Source  Franke and Nielson, "Smooth interpolation of large sets of scattered data", 1980, for the weights.
template <Backend B, std::floating_point T = float>
[[nodiscard]] SurfaceInterpolation<B, T> thinned_interpolation(B& backend, Span<const vec3<double>> points,
                                                               std::size_t stride) {
    check_value(!points.empty(), "thinned_interpolation", "there are no points, expected at least one");
    const std::vector<vec3<double>> vertices =
        thinned_rows(std::vector<vec3<double>>(points.begin(), points.end()), 1, stride);
    const NearestPoints search{Span<const vec3<double>>(vertices)};
    std::vector<std::array<int, 3>> nearest;
    std::vector<vec3<double>> weights;
    for (const vec3<double>& point : points) {
        const auto found = search.nearest(point, 4); // squared distances
        std::array<int, 3>& vertex = nearest.emplace_back();
        vertex.fill(static_cast<int>(found.front().second));
        vec3<double> w(0.0);
        const double farthest = found.size() < 4 ? 0 : 1 / std::sqrt(found.back().first); // 0: at infinity
        for (std::size_t k = 0; k < 3 && k < found.size(); ++k) {
            vertex[k] = static_cast<int>(found[k].second);
            const double nearness = 1 / std::sqrt(found[k].first) - farthest;
            w[static_cast<int>(k)] = nearness * nearness;
        }
        const double sum = w.x + w.y + w.z;
        // On a vertex a weight is infinite, and between four equally near ones all are zero.
        weights.push_back(std::isfinite(sum) && sum > 0 ? w / sum : vec3<double>(1, 0, 0));
    }
    return SurfaceInterpolation<B, T>(backend, vertices.size(), Span<const std::array<int, 3>>(nearest),
                                      Span<const vec3<double>>(weights));
}

} // namespace gsh
