// SPDX-License-Identifier: Apache-2.0
/// @file  The actor's colours: procedural patterns over its T-pose surface, sharp at any resolution.
#pragma once

#include <gsh/core/rng.hpp>
#include <gsh/synthetic/actor_shape.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace gsh {

/// Reflectance of a surface point.
struct SurfaceColor {
    vec3<double> albedo{0.5}; ///< linear, 0..1
    double gloss = 0;         ///< strength of a weak highlight
};

namespace detail {

/// Smooth noise in [-1, 1] with features about one unit wide.
inline double value_noise(const Point& p, std::uint64_t seed) {
    const Point cell = glm::floor(p), f = p - cell;
    const Point s = f * f * (Point(3) - f * 2.0);
    const auto at = [&](int dx, int dy, int dz) {
        const auto part = [](double x, int d) {
            return static_cast<std::uint64_t>(static_cast<std::int64_t>(x) + d) & 0xFFFFFu;
        };
        return random_uniform(seed, part(cell.x, dx) | part(cell.y, dy) << 20 | part(cell.z, dz) << 40) * 2 - 1;
    };
    const auto along_x = [&](int dy, int dz) { return at(0, dy, dz) + s.x * (at(1, dy, dz) - at(0, dy, dz)); };
    const auto along_y = [&](int dz) { return along_x(0, dz) + s.y * (along_x(1, dz) - along_x(0, dz)); };
    return along_y(0) + s.z * (along_y(1) - along_y(0));
}

inline double mix(double a, double b, double t) {
    return a + (b - a) * t;
}
inline Point mix(const Point& a, const Point& b, double t) {
    return a + (b - a) * t;
}

/// 1 within half_width of a multiple of period, with edges of width `soft`.
inline double stripe(double x, double period, double half_width, double soft = 0.0008) {
    const double off = std::abs(x - period * std::round(x / period));
    return smooth_step(half_width + soft, half_width - soft, off);
}

inline SurfaceColor skin_color(const Point& p) {
    const double blotch = value_noise(p * 45.0, 11) * 0.06 + value_noise(p * 160.0, 12) * 0.04;
    return {Point(0.56, 0.33, 0.23) * (1 + blotch), 0.12};
}

inline SurfaceColor hand_color(const Point& p) { // p.x >= 0
    SurfaceColor c = skin_color(p);
    for (int finger = 0; finger < 5; ++finger) {
        const int first = smplx::left_index1 + 3 * finger;
        const Point tip = joint_point(actor_fingertips[static_cast<std::size_t>(finger)]),
                    last = actor_joint(first + 2);
        const Point along = normalize(tip - last), up = normalize(Point(0, 1, 0) - along * along.y);
        const Point q = p - tip, side = cross(along, up);
        const double width = finger == 4 ? 0.0052 : 0.0043;
        const double s = dot(q, along) + 0.002, across = dot(q, side) / width;
        const double nail =
            smooth_step(1.1, 0.9, std::hypot(s / 0.0062, across)) * smooth_step(0.0005, 0.002, dot(q, up));
        c.albedo = mix(c.albedo, Point(0.72, 0.46, 0.42), nail);
        c.gloss = mix(c.gloss, 0.6, nail);
        for (int joint = first + 1; joint < first + 3; ++joint) { // creases over the knuckles
            const double d = dot(p - actor_joint(joint), along), near = length(p - actor_joint(joint));
            c.albedo *= 1 - 0.16 * stripe(d, 1, 0.0007, 0.0006) * smooth_step(0.016, 0.012, near);
        }
    }
    return c;
}

inline SurfaceColor eye_color(const Point& p, const Point& eye) {
    const Point n = normalize(p - eye);
    const double off = std::acos(std::clamp(n.z, -1.0, 1.0)) * 0.0134,
                 turn = std::atan2(n.y, n.x); // arc length from the axis
    Point c(0.80, 0.77, 0.74);
    const double rays = 0.75 + 0.35 * value_noise(Point(8 * std::cos(turn), 8 * std::sin(turn), 0), 21);
    c = mix(c, Point(0.10, 0.16, 0.24) * rays, smooth_step(0.0062, 0.0057, off));
    c = mix(c, Point(0.02, 0.03, 0.05), smooth_step(0.0007, 0.0003, std::abs(off - 0.0059)));
    return {mix(c, Point(0.004), smooth_step(0.0027, 0.0023, off)), 1.0};
}

inline SurfaceColor head_color(const Point& p, double x) { // p.x >= 0; x is signed
    const Point eye = actor_joint(smplx::left_eye);
    if (length(p - eye) < 0.0140 && p.z > eye.z && eye_opening(p) < 0.0004)
        return eye_color({x, p.y, p.z}, {x < 0 ? -eye.x : eye.x, eye.y, eye.z});
    const double bend = 0.0030 * (p.x / 0.024) * (p.x / 0.024);
    SurfaceColor c = skin_color({x, p.y, p.z});
    // Cheeks and nose are redder; the chin has a trace of beard.
    c.albedo *=
        mix(Point(1), Point(1.10, 0.86, 0.84), smooth_step(0.030, 0.005, length(p - Point(0.045, 0.640, 0.10))));
    c.albedo *= mix(Point(1), Point(1.03, 0.93, 0.92), smooth_step(0.016, 0.004, length(p - Point(0, 0.640, 0.146))));
    c.albedo *= mix(Point(1), Point(0.82, 0.84, 0.88),
                    smooth_step(0.612, 0.590, p.y - 0.5 * std::max(0.0, p.x - 0.02)) * smooth_step(0.04, 0.075, p.z));
    // Behind the lips: upper teeth in front of a dark cavity.
    const double dy = p.y - actor_mouth_y + bend,
                 lip_front = 0.1385 - 0.0145 * (p.x / actor_mouth_corner_x) * (p.x / actor_mouth_corner_x);
    const bool hollow = p.z > 0.075 && p.z < lip_front - 0.006 && mouth_opening(p) < 0.004;
    if (hollow) return {dy > 0 && p.z > 0.112 ? Point(0.66, 0.62, 0.55) : Point(0.17, 0.035, 0.035), 0.3};
    if (p.z > 0.09) {
        const double outline = smooth_step(0.0020, 0.0011, lips_distance(p));
        c.albedo = mix(c.albedo, Point(0.42, 0.17, 0.15), outline);
        c.gloss = mix(c.gloss, 0.45, outline);
        // Brows: an arch of hairs.
        const double arch = 0.6895 - 14 * (p.x - 0.034) * (p.x - 0.034),
                     hairs = 0.75 + 0.25 * value_noise({p.x * 500, p.y * 900, 0}, 31);
        const double thick = 0.0040 - 0.05 * std::max(0.0, p.x - 0.026);
        const double brow = smooth_step(1.25, 0.75, std::abs(p.y - arch) / std::max(thick, 0.0012)) *
                            smooth_step(0.009, 0.012, p.x) * smooth_step(0.056, 0.050, p.x);
        c.albedo = mix(c.albedo, Point(0.045, 0.025, 0.016) * (0.6 + hairs), brow * 0.95);
        // Lashes and the rim of the lids.
        const double lid =
            smooth_step(0.0022, 0.0008, std::abs(eye_opening(p))) * smooth_step(0.0165, 0.0158, length(p - eye));
        c.albedo = mix(c.albedo, Point(0.09, 0.045, 0.035), lid * 0.85);
        const double nostril = smooth_step(0.0042, 0.0026, length(p - Point(0.0065, 0.6315, 0.1335)));
        c.albedo *= 1 - 0.75 * nostril;
    }
    const double ear = ear_distance(p);
    const double hair =
        smooth_step(0.35, 0.65, hair_amount(p) + 0.10 * value_noise({x * 350, p.y * 120, p.z * 350}, 41)) *
        smooth_step(0.001, 0.003, ear);
    const double strands = value_noise({x * 420, p.y * 90, p.z * 160}, 42),
                 locks = value_noise({x * 70, p.y * 40, p.z * 50}, 43);
    c.albedo = mix(c.albedo, Point(0.085, 0.046, 0.024) * (1 + 0.45 * strands + 0.35 * locks), hair);
    c.gloss = mix(c.gloss, 0.10, hair);
    return c;
}

/// A checked shirt with a breast pocket, a button placket, and a figure on the back.
inline SurfaceColor shirt_color(const Point& p) {
    const double x = std::abs(p.x);
    const bool sleeve = p.y > 0.35 && x > 0.175 - 0.9 * std::max(0.0, p.y - 0.40); // cut as a raglan
    // Coordinates around and along: with these radii the pattern closes after 18 checks around the body, 6 around the
    // arm.
    const double u = sleeve ? 0.0477465 * std::atan2(p.z + 0.008, p.y - 0.455) : 0.1432394 * std::atan2(p.x, p.z);
    const double v = sleeve ? x : p.y;
    const double wide_u = stripe(u, 0.050, 0.011), wide_v = stripe(v, 0.050, 0.011);
    Point c(0.62, 0.60, 0.55);
    c = mix(c, Point(0.06, 0.16, 0.36), 0.55 * wide_u);
    c = mix(c, Point(0.06, 0.16, 0.36), 0.55 * wide_v);
    c = mix(c, Point(0.55, 0.07, 0.06), std::max(stripe(u - 0.025, 0.050, 0.0016), stripe(v - 0.025, 0.050, 0.0016)));
    c *= 1 + 0.05 * value_noise(p * 700.0, 51) + 0.06 * value_noise(p * 30.0, 52);
    if (p.z > 0.02 && !sleeve) {
        c *= 1 - 0.45 * smooth_step(0.0014, 0.0006, std::abs(x - 0.016)) * smooth_step(0.475, 0.470, p.y);
        const double button = std::hypot(p.x, p.y - 0.07 * std::round(p.y / 0.07));
        c = mix(c, Point(0.80, 0.78, 0.72), smooth_step(0.0058, 0.0048, button));
        const Point pocket(p.x - 0.082, p.y - 0.345, 0); // on the wearer's left
        const double edge = std::max(std::abs(pocket.x) - 0.038, std::abs(pocket.y) - 0.044);
        c *= 1 - 0.55 * smooth_step(0.0016, 0.0006, std::abs(edge));
        c = mix(c, Point(0.06, 0.16, 0.36), 0.8 * smooth_step(0.001, -0.001, std::max(edge, 0.030 - pocket.y)));
    }
    if (p.z < -0.02 && !sleeve) { // a ring and a bar, so that the back has a visible orientation
        const double ring = std::abs(std::hypot(p.x - 0.045, p.y - 0.30) - 0.040) - 0.009;
        const double bar = std::max(std::abs(p.x + 0.055) - 0.010, std::abs(p.y - 0.30) - 0.050);
        c = mix(c, Point(0.75, 0.42, 0.03), smooth_step(0.001, -0.001, std::min(ring, bar)));
    }
    const double hem =
        sleeve ? ActorOutfit::sleeve_x - x : std::min(p.y - ActorOutfit::shirt_hem_y, ActorOutfit::collar_y - p.y);
    return {c * (1 - 0.5 * smooth_step(0.013, 0.011, hem) * smooth_step(0.009, 0.010, hem)), 0.04};
}

inline SurfaceColor trouser_color(const Point& p, double x) { // p.x >= 0; x is signed
    const Point from_axis(p.x - 0.115, p.y, p.z + 0.01);
    const double weave = value_noise(Point(x, p.y, p.z) * 900.0, 61),
                 fade = value_noise(Point(x, p.y * 0.5, p.z) * 22.0, 62);
    Point c = Point(0.055, 0.095, 0.190) * (1 + 0.18 * weave + 0.30 * fade);
    const double thigh = smooth_step(0.09, 0.0, std::abs(p.y + 0.27)) * smooth_step(0.02, 0.07, from_axis.z);
    c = mix(c, Point(0.16, 0.22, 0.34), 0.45 * thigh);
    const double seam = std::abs(from_axis.z) + (p.x < 0.115 && p.y > -0.15 ? 1 : 0); // along outer and inner side
    c = mix(c, Point(0.50, 0.27, 0.07), 0.8 * smooth_step(0.0016, 0.0008, std::abs(seam - 0.004)));
    c = mix(c, Point(0.50, 0.27, 0.07),
            0.8 * smooth_step(0.0016, 0.0008, std::abs(p.y - ActorOutfit::trouser_hem_y - 0.018)));
    if (p.z < -0.02) { // back pocket
        const double edge = std::max(std::abs(p.x - 0.085) - 0.045,
                                     std::abs(p.y + 0.115) - 0.050 + 0.3 * std::max(0.0, 0.0 - std::abs(p.x - 0.085)));
        c = mix(c, Point(0.50, 0.27, 0.07), 0.8 * smooth_step(0.0016, 0.0008, std::abs(edge)));
    }
    const double knee = length(Point(x + 0.118, p.y + 0.45, p.z - 0.07)); // a patch on the right knee
    return {mix(c, Point(0.34, 0.05, 0.05) * (1 + 0.3 * weave), smooth_step(0.047, 0.045, knee)), 0.03};
}

inline SurfaceColor shoe_color(const Point& p) { // p.x >= 0
    const double height = p.y - ActorOutfit::sole_y;
    Point c(0.42, 0.05, 0.04);
    const double lace =
        stripe(p.z, 0.018, 0.0035) * smooth_step(0.030, 0.027, std::abs(p.x - 0.145 - 0.14 * (p.z - 0.03))) *
        smooth_step(0.030, 0.040, p.z) * smooth_step(0.125, 0.120, p.z) * smooth_step(0.050, 0.055, height);
    c = mix(c, Point(0.75), lace);
    c = mix(c, Point(0.70), stripe(p.z - 0.004, 10, 0.006) * smooth_step(0.020, 0.024, height)); // a stripe on the side
    c = mix(c, Point(0.70, 0.69, 0.66), smooth_step(0.0200, 0.0190, height));
    c = mix(c, Point(0.05), smooth_step(0.0060, 0.0050, height));
    return {c, 0.2};
}

} // namespace detail

/// Colour of a point of the actor's T-pose surface (v_template, interpolated at the ray's hit).
[[nodiscard]] inline SurfaceColor actor_color(const vec3<double>& point) {
    using namespace detail;
    const Point p(std::abs(point.x), point.y, point.z);
    const double x = p.x, y = p.y;
    if (x > 0.62) return hand_color(p);
    if (y < -0.78) {
        const bool trouser = y > ActorOutfit::trouser_hem_y,
                   shoe = y < ActorOutfit::trouser_hem_y - 0.006 && shoe_distance(p) < 0.006;
        if (!trouser)
            return shoe ? shoe_color(p)
                        : SurfaceColor{Point(0.55, 0.55, 0.52) * (1 - 0.3 * stripe(y, 0.006, 0.0015)), 0}; // socks
    }
    if (y < ActorOutfit::shirt_hem_y) return trouser_color(p, point.x);
    const double collar = ActorOutfit::collar_y + 0.9 * std::max(0.0, x - 0.045) - 0.30 * p.z;
    const bool neck_hole = y > collar && x < 0.12;
    if (!neck_hole && x < ActorOutfit::sleeve_x && y < 0.56) return shirt_color(point);
    if (y > 0.54 && x < 0.12) return head_color(p, point.x);
    return skin_color(point);
}

} // namespace gsh
