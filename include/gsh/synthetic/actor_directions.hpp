// SPDX-License-Identifier: Apache-2.0
/// @file  The actor's shape and expression directions: displacements of a surface point per unit coefficient.
#pragma once

#include <gsh/synthetic/actor_weights.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <string_view>

namespace gsh {

inline constexpr std::array<std::string_view, 10> actor_shape_names = {
    "stature",   "girth", "leg_length", "arm_length", "shoulder_width",
    "hip_width", "belly", "chest",      "head_size",  "hand_size"};
inline constexpr std::array<std::string_view, 10> actor_expression_names = {
    "smile",      "mouth_open", "pucker",    "corners_down",    "brows_up",
    "brows_down", "blink",      "eyes_wide", "upper_lip_raise", "cheek_puff"};

namespace detail {

/// Smooth, 1 at the centre and 0 from `radius` on.
inline double bump(const Point& p, const Point& centre, double radius) {
    const double t = std::max(0.0, 1 - dot(p - centre, p - centre) / (radius * radius));
    return t * t;
}

/// Offset from the axis of the bone that ends in each joint, blended by the weights: the direction of increasing girth.
inline Point from_bones(const Point& p, const ActorWeights& weights) {
    Point sum(0);
    for (int j = 0; j < smplx::jaw; ++j) {
        const double w = weights[static_cast<std::size_t>(j)];
        if (w == 0 || j == smplx::head || j == smplx::neck) continue;
        const bool leg = j == 1 || j == 2 || j == 4 || j == 5 || j == 7 || j == 8, arm = j >= smplx::left_shoulder;
        const Point at = actor_joint(j);
        sum += w * (arm   ? Point(0, p.y - at.y, p.z - at.z)
                    : leg ? Point(p.x - at.x, 0, p.z - at.z)
                          : Point(p.x, 0, p.z));
    }
    return sum;
}

} // namespace detail

/// Displacements per unit of each shape coefficient. Coefficients between about -2 and 2 give plausible bodies.
[[nodiscard]] inline std::array<vec3<double>, 10> actor_shape_directions(const vec3<double>& p,
                                                                         const ActorWeights& weights) {
    using namespace detail;
    const double x = std::abs(p.x), side = p.x < 0 ? -1 : 1;
    const double arm = smooth_step(0.25, 0.35, p.y),
                 leg = std::clamp((actor_joint(smplx::left_hip).y - p.y) / 0.815, 0.0, 1.0);
    const Point mirror(side, 1, 1);
    std::array<vec3<double>, 10> d{};
    d[0] = p * 0.035;
    d[1] = from_bones(p, weights) * 0.07;
    d[2] = Point(0, -0.030 * leg, 0);
    d[3] = Point(side * 0.022 * std::clamp((x - 0.172) / 0.498, 0.0, 1.0) * arm, 0, 0);
    d[4] = Point(side * 0.014 * smooth_step(0.02, 0.172, x) * arm, 0, 0);
    d[5] = Point(0.011 * std::clamp(p.x / 0.1, -1.0, 1.0) * smooth_step(0.16, -0.04, p.y), 0, 0);
    d[6] = Point(0.05 * p.x, 0, 0.022) * bump(p, {0, 0.09, 0.10}, 0.17);
    d[7] = Point(0, 0, 0.014) * (bump(p, mirror * Point(0.07, 0.35, 0.11), 0.12));
    d[8] = (p - actor_joint(smplx::head)) * 0.045 * smooth_step(0.54, 0.62, p.y) * smooth_step(0.16, 0.12, x);
    d[9] = (p - mirror * actor_joint(smplx::left_wrist)) * 0.045 * smooth_step(0.64, 0.70, x) * arm;
    return d;
}

/// Displacements per unit of each expression coefficient in [0, 1]; exactly zero outside the face.
[[nodiscard]] inline std::array<vec3<double>, 10> actor_expression_directions(const vec3<double>& point) {
    using namespace detail;
    std::array<vec3<double>, 10> d{};
    const double side = point.x < 0 ? -1 : 1;
    const Point p(std::abs(point.x), point.y, point.z), eye = actor_joint(smplx::left_eye);
    if (p.z < 0.03 || p.y < 0.54) return d;

    // Lower-lip share: 1 on the jaw's side of the mouth, 0 above, smooth beyond the corners.
    const double lower = jaw_share(p), upper = 1 - lower;
    const Point corner(0.0230, 0.6045, 0.1215), cheek(0.042, 0.632, 0.105), brow(0.028, 0.690, 0.120);
    const double at_corner = bump(p, corner, 0.026), at_mouth = bump(p, {0, 0.606, 0.130}, 0.040);
    const double at_brow = bump(p, brow, 0.030), inner_brow = bump(p, {0.010, 0.690, 0.125}, 0.022);
    d[0] = Point(0.0085, 0.0090, -0.0055) * at_corner + Point(0.0010, 0.0040, 0.0025) * bump(p, cheek, 0.028);
    d[1] = Point(-0.0012, -0.0110, 0.0005) * at_mouth * lower + Point(-0.0004, 0.0020, 0) * at_mouth * upper +
           Point(0, -0.0040, 0) * bump(p, {0, 0.577, 0.120}, 0.035);
    d[2] = Point(-0.0075, 0, 0.0045) * at_corner + Point(0, 0, 0.0055) * at_mouth;
    d[3] = Point(0.0010, -0.0085, -0.0015) * at_corner;
    d[4] = Point(0, 0.0075, 0.0005) * at_brow;
    d[5] = Point(-0.0025, -0.0055, 0.0015) * inner_brow + Point(-0.0010, -0.0025, 0) * at_brow;
    d[8] = Point(0, 0.0065, 0.0008) * bump(p, {0.008, 0.612, 0.133}, 0.022) * upper;
    d[9] = Point(0.0075, 0.0005, 0.0025) * bump(p, {0.042, 0.612, 0.098}, 0.034);

    // The upper lid rotates about the eye: most in its middle, least far above its edge.
    const Point q = p - eye;
    const double r = length(q), u = q.x / 0.0140, arc = std::max(0.0, 1 - u * u);
    if (q.z > 0 && arc > 0 && r < 0.026) {
        const double height = std::atan2(q.y, q.z), edge = std::asin(0.0058 * arc / 0.0152);
        const double share = smooth_step(0.0136, 0.0145, r) * smooth_step(0.0235, 0.0165, r) *
                             smooth_step(edge + 0.62, edge + 0.22, height) * smooth_step(0.0, 0.10, height);
        const auto turned = [&](double angle) {
            const double c = std::cos(angle), s = std::sin(angle);
            return Point(0, c * q.y - s * q.z, s * q.y + c * q.z) - Point(0, q.y, q.z);
        };
        d[6] = turned(0.77 * arc * share);
        d[7] = turned(-0.16 * arc * share);
    }
    d[7] += Point(0, 0.0030, 0) * at_brow;
    for (auto& v : d) v.x *= side;
    return d;
}

} // namespace gsh
