// SPDX-License-Identifier: Apache-2.0
/// @file  Smooth solids as signed distances, the modelling primitives of the actor.
///
/// Values are first-order distance estimates (f / |∇f|), negative inside. They are exact on the surface and accurate
/// near it, which is sufficient for polygonisation.
#pragma once

#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace gsh::detail {

using Point = vec3<double>;

/// 0 below 0, 1 above 1, smooth in between.
[[nodiscard]] inline double smooth_step(double t) {
    t = std::clamp(t, 0.0, 1.0);
    return t * t * (3 - 2 * t);
}
/// 0 at `low`, 1 at `high`.
[[nodiscard]] inline double smooth_step(double low, double high, double x) {
    return smooth_step((x - low) / (high - low));
}

/// Union with a seam rounded over a width of about k: Quílez's quadratic smooth minimum.
[[nodiscard]] inline double smooth_union(double a, double b, double k) {
    const double h = std::max(k - std::abs(a - b), 0.0) / k;
    return std::min(a, b) - h * h * k * 0.25;
}
/// a minus b, with the edge rounded in the same way.
[[nodiscard]] inline double smooth_difference(double a, double b, double k) {
    return -smooth_union(-a, b, k);
}

/// Ellipsoid of radii r about the origin.
[[nodiscard]] inline double ellipsoid(const Point& p, const Point& r) {
    const Point q = p / r;
    const double k0 = length(q), k1 = length(q / r);
    return k1 < 1e-9 ? -std::min({r.x, r.y, r.z}) : k0 * (k0 - 1) / k1;
}

/// Capsule from a to b whose radius changes linearly from ra to rb.
[[nodiscard]] inline double capsule(const Point& p, const Point& a, const Point& b, double ra, double rb) {
    const Point ab = b - a;
    const double t = std::clamp(dot(p - a, ab) / dot(ab, ab), 0.0, 1.0);
    return length(p - a - ab * t) - (ra + (rb - ra) * t);
}

/// One cross-section of a loft: an ellipse centred at (u, v) with radii (a, b), at s along the axis.
struct Station {
    double s, u, v, a, b;
};

/// Cross-section at s between stations in ascending order: a cubic through all of them (Catmull and Rom, 1974).
[[nodiscard]] inline Station section(Span<const Station> stations, double s) {
    const std::size_t n = stations.size();
    std::size_t i = 0;
    while (i + 2 < n && s > stations[i + 1].s) ++i;
    const Station &p1 = stations[i], &p2 = stations[i + 1];
    const Station &p0 = i ? stations[i - 1] : p1, &p3 = i + 2 < n ? stations[i + 2] : p2;
    const double h = p2.s - p1.s, t = (s - p1.s) / h;
    const auto mix = [&](double Station::*x) {
        const double m1 = (p2.*x - p0.*x) / (p2.s - p0.s) * h, m2 = (p3.*x - p1.*x) / (p3.s - p1.s) * h;
        const double d = p2.*x - p1.*x;
        return p1.*x + t * (m1 + t * (3 * d - 2 * m1 - m2 + t * (m1 + m2 - 2 * d)));
    };
    return {s, mix(&Station::u), mix(&Station::v), mix(&Station::a), mix(&Station::b)};
}

/// A solid with elliptic cross-sections along a coordinate axis, closed by half ellipsoids of length `cap`. `s` is the
/// point's coordinate along the axis, (u, v) the other two.
[[nodiscard]] inline double loft(Span<const Station> stations, double cap, double s, double u, double v) {
    const double inside = std::clamp(s, stations[0].s, stations[stations.size() - 1].s);
    const Station e = section(stations, inside);
    return ellipsoid({u - e.u, v - e.v, s - inside}, {e.a, e.b, cap});
}

} // namespace gsh::detail
