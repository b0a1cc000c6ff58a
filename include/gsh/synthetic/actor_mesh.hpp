// SPDX-License-Identifier: Apache-2.0
/// @file  The actor's surface as one closed mesh, with short edges on hands and face and long ones on the back.
#pragma once

#include <gsh/synthetic/actor_shape.hpp>
#include <gsh/synthetic/remesh.hpp>

#include <algorithm>
#include <cmath>

namespace gsh {

/// Target edge length at a T-pose point, metres, times `scale`.
[[nodiscard]] inline double actor_edge_length(vec3<double> p, double scale) {
    p.x = std::abs(p.x);
    const auto within = [&](const vec3<double>& centre, double length_there, double radius) {
        return length_there + 0.14 * std::max(0.0, length(p - centre) - radius); // grows with the distance
    };
    double h = 0.0165;
    h = std::min(h, within({0, 0.640, 0.110}, 0.0046, 0.060));      // face
    h = std::min(h, within({0, 0.690, 0.020}, 0.0095, 0.085));      // head
    h = std::min(h, within({0.031, 0.671, 0.120}, 0.0018, 0.014));  // eyes
    h = std::min(h, within({0, 0.6065, 0.124}, 0.0020, 0.022));     // lips
    h = std::min(h, within({0, 0.6350, 0.136}, 0.0027, 0.015));     // nose
    h = std::min(h, within({0.078, 0.655, 0.012}, 0.0048, 0.025));  // ears
    h = std::min(h, within({0.752, 0.450, 0.020}, 0.0046, 0.100));  // hands
    h = std::min(h, within({0.140, -0.890, 0.050}, 0.0095, 0.120)); // shoes
    return h * scale;
}

/// Polygonises actor_distance. Edges are `scale` times the default length; 0.7 to 1.5 is tested.
[[nodiscard]] inline TriangleMesh actor_mesh(double scale = 1) {
    const auto between = [](double low, double high, double x) { return x > low && x < high; };
    const double grid = std::min(scale, 1.0); // coarser cells would lose the gaps between lips, lids and fingers
    GridLines lines;
    lines.x = graded_lines(-0.88, 0.88, [&](double x) {
        x = std::abs(x);
        return grid * (x < 0.05 ? 0.0022 : x < 0.09 ? 0.004 : between(0.665, 0.87, x) ? 0.0038 : 0.010);
    });
    lines.y = graded_lines(-0.95, 0.83, [&](double y) {
        if (between(0.602, 0.609, y)) return 0.0005; // the gap between the lips
        if (between(0.595, 0.615, y)) return 0.0011;
        if (between(0.660, 0.682, y)) return 0.0013 * grid; // the lids
        return grid * (between(0.55, 0.70, y) ? 0.0024 : between(0.42, 0.48, y) ? 0.0035 : y < -0.80 ? 0.007 : 0.010);
    });
    lines.z = graded_lines(-0.17, 0.24, [&](double z) {
        return grid * (between(0.095, 0.155, z) ? 0.0022 : between(-0.06, 0.11, z) ? 0.0038 : 0.007);
    });
    return remesh(
        surface_nets(lines, actor_distance), actor_distance,
        [&](const vec3<double>& p) { return actor_edge_length(p, scale); }, 6);
}

} // namespace gsh
