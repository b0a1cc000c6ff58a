// SPDX-License-Identifier: Apache-2.0
/// @file  Initial positions of the Gaussians for a mesh without triangles: one on each vertex.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/nearest_points.hpp>
#include <gsh/body/skinning.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace gsh {

/// One sample per vertex, with its weights (those of the max_influences heaviest joints; 0: all) and the root mean
/// square distance to the 3 nearest vertices as its scale. A sample's triangle repeats its vertex three times, so no
/// faces are needed.
///
/// Shapes  vertices [V], the shaped mesh; normals [V], or empty, in which case the samples' normals are zero.
/// Errors  ShapeError.
/// Source  Liu et al., "Animatable 3D Gaussian", 2023, as its code places Gaussians on the bodies of GalaBasketball.
[[nodiscard]] inline SurfaceSamples sample_vertices(const BodyModel& model, Span<const vec3<double>> vertices,
                                                    Span<const vec3<double>> normals = {},
                                                    std::size_t max_influences = 8) {
    constexpr auto where = "sample_vertices";
    const std::size_t V = model.vertex_count(), J = model.joint_count();
    check_size(where, "vertices", vertices.size(), V, "pass the shaped mesh");
    check_size(where, "model.weights", model.weights.size(), V * J);
    if (!normals.empty()) check_size(where, "normals", normals.size(), V, "store one per vertex");
    detail::check_coordinates(where, "vertices", vertices);
    SurfaceSamples samples;
    if (V == 0) return samples;
    const NearestPoints neighbours(vertices);
    SkinWeightBuilder builder(max_influences);
    constexpr double smallest_squared = 1e-7; // square metres: vertices that coincide along seams
    for (const std::size_t v : detail::morton_order(vertices)) {
        const int vertex = static_cast<int>(v);
        samples.positions.push_back(vertices[v]);
        const double size = normals.empty() ? 0 : length(normals[v]);
        samples.normals.push_back(size > 0 ? normals[v] * (1 / size) : vec3<double>(0));
        samples.triangles.push_back({vertex, vertex, vertex});
        samples.barycentric.emplace_back(1, 0, 0);
        samples.sources.push_back(vertex);
        samples.scales.push_back(std::sqrt(std::max(neighbours.mean_squared_distance(v, 3), smallest_squared)));
        builder.add(Span<const double>(model.weights).subspan(v * J, J));
        builder.finish_point();
    }
    samples.weights = builder.table();
    return samples;
}

} // namespace gsh
