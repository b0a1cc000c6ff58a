// SPDX-License-Identifier: Apache-2.0
/// @file  The actor's shape in T-pose as a signed distance: a dressed adult, 1.7 m tall.
#pragma once

#include <gsh/synthetic/actor_skeleton.hpp>
#include <gsh/synthetic/signed_distance.hpp>

#include <array>
#include <cmath>

namespace gsh {

/// Borders of the garments, in T-pose metres. The shape is slightly thicker under a garment and its colour differs.
struct ActorOutfit {
    static constexpr double sleeve_x = 0.335, shirt_hem_y = -0.045, collar_y = 0.487, trouser_hem_y = -0.825;
    static constexpr double sole_y = -0.918, shirt_thickness = 0.006, trouser_thickness = 0.005;
};

namespace detail {

inline Point joint_point(const std::array<double, 3>& p) {
    return {p[0], p[1], p[2]};
}

/// Distance to one left finger; `finger` follows the joint order: index, middle, pinky, ring, thumb.
inline double finger_distance(const Point& p, int finger) {
    constexpr double radius[5][4] = {{0.0094, 0.0082, 0.0075, 0.0062}, // at each joint and at the tip
                                     {0.0096, 0.0084, 0.0077, 0.0064},
                                     {0.0082, 0.0070, 0.0064, 0.0054},
                                     {0.0092, 0.0079, 0.0072, 0.0060},
                                     {0.0145, 0.0108, 0.0095, 0.0075}};
    const int first = smplx::left_index1 + 3 * finger;
    const double* r = radius[finger];
    const Point tip = joint_point(actor_fingertips[static_cast<std::size_t>(finger)]);
    double d = capsule(p, actor_joint(first), actor_joint(first + 1), r[0], r[1]);
    d = std::min(d, capsule(p, actor_joint(first + 1), actor_joint(first + 2), r[1], r[2]));
    return std::min(d, capsule(p, actor_joint(first + 2), tip, r[2], r[3]));
}

/// Distance to the left hand's palm, from wrist to knuckles.
inline double palm_distance(const Point& p) {
    constexpr Station palm[] = {{0.655, 0.4550, -0.0010, 0.0200, 0.0270},
                                {0.680, 0.4550, 0.0010, 0.0180, 0.0300},
                                {0.715, 0.4545, 0.0025, 0.0165, 0.0390},
                                {0.745, 0.4550, 0.0015, 0.0140, 0.0405},
                                {0.758, 0.4555, 0.0015, 0.0120, 0.0400}};
    return loft(palm, 0.010, p.x, p.y, p.z);
}

inline double hand_distance(const Point& p) {
    double d = palm_distance(p), fingers = finger_distance(p, 0);
    for (int finger = 1; finger < 4; ++finger) fingers = std::min(fingers, finger_distance(p, finger));
    d = smooth_union(d, fingers, 0.006);
    const double thenar = capsule(p, {0.690, 0.446, 0.014}, {0.722, 0.442, 0.036}, 0.0155, 0.0115);
    return smooth_union(smooth_union(d, thenar, 0.012), finger_distance(p, 4), 0.007);
}

inline double arm_distance(const Point& p) {
    constexpr Station arm[] = {{0.145, 0.450, -0.008, 0.056, 0.052}, {0.185, 0.455, -0.008, 0.058, 0.056},
                               {0.240, 0.456, -0.008, 0.050, 0.054}, {0.310, 0.456, -0.006, 0.045, 0.050},
                               {0.380, 0.456, -0.008, 0.041, 0.044}, {0.430, 0.456, -0.010, 0.038, 0.041},
                               {0.485, 0.455, -0.007, 0.039, 0.044}, {0.560, 0.455, -0.004, 0.033, 0.037},
                               {0.625, 0.455, -0.002, 0.025, 0.030}, {0.672, 0.455, 0.000, 0.021, 0.028}};
    return loft(arm, 0.02, p.x, p.y, p.z) - ActorOutfit::shirt_thickness * smooth_step(ActorOutfit::sleeve_x + 0.002,
                                                                                       ActorOutfit::sleeve_x - 0.004,
                                                                                       p.x);
}

inline double leg_distance(const Point& p) {
    // Columns: y, then x and z of the centre, then radii along x and z.
    constexpr Station leg[] = {{-0.850, 0.136, -0.025, 0.034, 0.042}, {-0.820, 0.134, -0.024, 0.034, 0.042},
                               {-0.760, 0.131, -0.025, 0.037, 0.045}, {-0.680, 0.128, -0.030, 0.047, 0.053},
                               {-0.590, 0.124, -0.030, 0.054, 0.060}, {-0.515, 0.119, -0.016, 0.052, 0.056},
                               {-0.445, 0.116, 0.000, 0.053, 0.056},  {-0.370, 0.112, 0.004, 0.060, 0.063},
                               {-0.260, 0.105, 0.008, 0.072, 0.077},  {-0.150, 0.099, 0.006, 0.083, 0.089},
                               {-0.060, 0.094, 0.000, 0.080, 0.092}};
    double d = loft(leg, 0.04, p.y, p.x, p.z);
    d = smooth_union(d, ellipsoid(p - Point(0.075, -0.060, -0.052), {0.078, 0.082, 0.066}), 0.05); // glute
    return d - ActorOutfit::trouser_thickness *
                   smooth_step(ActorOutfit::trouser_hem_y - 0.002, ActorOutfit::trouser_hem_y + 0.004, p.y);
}

/// A shoe whose toe points outward by 8 degrees.
inline double shoe_distance(Point p) {
    const Point ankle = actor_joint(smplx::left_ankle);
    const double c = std::cos(0.14), s = std::sin(0.14), dx = p.x - ankle.x, dz = p.z - ankle.z;
    p = {c * dx - s * dz, p.y, s * dx + c * dz};
    // Columns: z, then x and y of the centre, then radii along x and y.
    constexpr Station shoe[] = {{-0.048, 0.000, -0.878, 0.036, 0.050}, {-0.010, 0.000, -0.868, 0.039, 0.058},
                                {0.040, 0.002, -0.874, 0.042, 0.054},  {0.090, 0.003, -0.888, 0.048, 0.042},
                                {0.140, 0.002, -0.895, 0.050, 0.034},  {0.180, -0.002, -0.899, 0.042, 0.029}};
    const double d = loft(shoe, 0.028, p.z, p.x, p.y);
    return -smooth_union(-d, -(ActorOutfit::sole_y - p.y), 0.008); // flat sole
}

inline double torso_distance(const Point& p) {
    constexpr Station torso[] = {
        {-0.090, 0, 0.000, 0.120, 0.085}, {-0.040, 0, 0.000, 0.162, 0.102}, {0.010, 0, 0.004, 0.166, 0.109},
        {0.070, 0, 0.012, 0.153, 0.108},  {0.140, 0, 0.026, 0.136, 0.096},  {0.200, 0, 0.028, 0.134, 0.096},
        {0.270, 0, 0.022, 0.146, 0.105},  {0.340, 0, 0.014, 0.158, 0.112},  {0.400, 0, 0.002, 0.156, 0.104},
        {0.445, 0, -0.006, 0.135, 0.086}, {0.480, 0, -0.010, 0.085, 0.064}};
    double d = loft(torso, 0.035, p.y, p.x, p.z);
    d = smooth_union(d, ellipsoid(p - Point(0.070, 0.355, 0.070), {0.070, 0.055, 0.052}), 0.04);  // chest
    d = smooth_union(d, ellipsoid(p - Point(0.085, 0.380, -0.055), {0.070, 0.090, 0.040}), 0.05); // shoulder blade
    d = smooth_union(d, capsule(p, {0.020, 0.505, -0.022}, {0.155, 0.462, -0.012}, 0.044, 0.052), 0.05); // trapezius
    // A shallow furrow down the spine.
    d = smooth_difference(d, capsule(p, {0, 0.08, -0.125}, {0, 0.36, -0.132}, 0.022, 0.022), 0.05);
    const double shirt = smooth_step(ActorOutfit::shirt_hem_y - 0.002, ActorOutfit::shirt_hem_y + 0.004, p.y) *
                         smooth_step(ActorOutfit::collar_y + 0.02, ActorOutfit::collar_y, p.y);
    return d - ActorOutfit::trouser_thickness - ActorOutfit::shirt_thickness * shirt;
}

inline double neck_distance(const Point& p) {
    constexpr Station neck[] = {{0.440, 0, -0.012, 0.064, 0.060},
                                {0.490, 0, -0.012, 0.056, 0.056},
                                {0.530, 0, -0.004, 0.052, 0.053},
                                {0.580, 0, 0.008, 0.053, 0.056},
                                {0.620, 0, 0.016, 0.054, 0.058}};
    return loft(neck, 0.02, p.y, p.x, p.z);
}

/// Front outline of the open eye around its centre: negative between the lids, which are arcs from corner to corner.
inline double eye_opening(const Point& p) {
    const Point eye = actor_joint(smplx::left_eye);
    const double u = (p.x - eye.x) / 0.0140, v = p.y - eye.y - 0.0012 * u, arc = 1 - u * u;
    return std::max({v - 0.0058 * arc, -v - 0.0046 * arc, eye.z + 0.001 - p.z});
}

/// The gap between the lips and the cavity behind it, curved so that the corners are a little lower.
inline double mouth_opening(const Point& p) {
    const double bend = 0.0030 * (p.x / 0.024) * (p.x / 0.024);
    const Point q(p.x, p.y - actor_mouth_y + bend, p.z);
    const double gap = ellipsoid(q - Point(0, 0, 0.120), {actor_mouth_corner_x, 0.0011, 0.034});
    const double hollow = ellipsoid(q - Point(0, -0.001, 0.102), {0.024, 0.0065, 0.024});
    return std::min(gap, hollow);
}

inline double lips_distance(const Point& p) {
    const double upper = std::min(capsule(p, {0.0035, 0.6115, 0.1330}, {0.0110, 0.6103, 0.1305}, 0.0044, 0.0042),
                                  capsule(p, {0.0110, 0.6103, 0.1305}, {0.0235, 0.6043, 0.1215}, 0.0042, 0.0015));
    const double lower = std::min(capsule(p, {0.0000, 0.6012, 0.1322}, {0.0100, 0.6015, 0.1302}, 0.0054, 0.0050),
                                  capsule(p, {0.0100, 0.6015, 0.1302}, {0.0230, 0.6033, 0.1210}, 0.0050, 0.0015));
    return std::min(upper, lower);
}

inline double ear_distance(Point p) {
    p -= Point(0.0765, 0.655, 0.012);
    const double c = std::cos(0.35), s = std::sin(0.35); // flares backward
    p = {c * p.x + s * p.z, p.y + 0.25 * p.z, -s * p.x + c * p.z};
    const double d = ellipsoid(p, {0.0085, 0.031, 0.019});
    return smooth_difference(d, ellipsoid(p - Point(0.009, 0.003, 0.001), {0.006, 0.019, 0.010}), 0.004);
}

/// The degree to which a point is covered by hair, in [0, 1].
inline double hair_amount(const Point& p) {
    const double front = 0.735 - 0.35 * std::max(0.0, 0.085 - p.z) - 0.6 * std::max(0.0, std::abs(p.x) - 0.045);
    const double line = p.z > 0.03 ? front : std::max(0.605, front - 1.6 * (0.03 - p.z));
    return smooth_step(line - 0.004, line + 0.006, p.y);
}

inline double head_distance(const Point& p) {
    double d = ellipsoid(p - Point(0, 0.692, 0.034), {0.073, 0.086, 0.096});                            // skull
    d = smooth_union(d, ellipsoid(p - Point(0, 0.626, 0.060), {0.060, 0.062, 0.070}), 0.035);           // face and jaw
    d = smooth_union(d, capsule(p, {0.052, 0.618, 0.025}, {0.018, 0.574, 0.098}, 0.012, 0.014), 0.025); // jaw line
    d = smooth_union(d, ellipsoid(p - Point(0, 0.573, 0.112), {0.021, 0.015, 0.018}), 0.020);           // chin
    d = smooth_union(d, ellipsoid(p - Point(0.043, 0.645, 0.093), {0.022, 0.018, 0.024}), 0.020);       // cheekbone
    d = smooth_union(d, ellipsoid(p - Point(0, 0.608, 0.112), {0.030, 0.024, 0.020}), 0.015); // around the mouth
    d = smooth_union(d, capsule(p, {0.010, 0.690, 0.121}, {0.046, 0.687, 0.102}, 0.0085, 0.0060), 0.014); // brow
    d = smooth_difference(d, ellipsoid(p - Point(0.031, 0.671, 0.134), {0.019, 0.0115, 0.0135}), 0.014);  // socket
    d = smooth_union(d, capsule(p, {0, 0.676, 0.1225}, {0, 0.641, 0.1405}, 0.0068, 0.0092), 0.010);       // nose
    d = smooth_union(d, ellipsoid(p - Point(0.0105, 0.6375, 0.1310), {0.0075, 0.0065, 0.0090}), 0.006); // nostril wing
    d = smooth_difference(d, ellipsoid(p - Point(0.0065, 0.6305, 0.1340), {0.0030, 0.0040, 0.0045}), 0.003);
    d = smooth_union(d, lips_distance(p), 0.005);
    d = smooth_difference(d, capsule(p, {0, 0.618, 0.1400}, {0, 0.628, 0.1405}, 0.0028, 0.0028), 0.005); // philtrum
    const Point eye = actor_joint(smplx::left_eye);
    const double lids = length(p - eye) - 0.0152;
    d = smooth_union(d, lids, 0.005);
    d = std::max(d, -eye_opening(p));
    d = std::min(d, length(p - eye) - 0.0134); // eyeball
    d -= 0.009 * hair_amount(p);
    d = smooth_union(d, ear_distance(p), 0.006);
    return std::max(d, -mouth_opening(p));
}

} // namespace detail

/// Signed distance to the actor's skin and clothes at a T-pose point, negative inside; symmetric in x.
[[nodiscard]] inline double actor_distance(vec3<double> p) {
    using namespace detail;
    p.x = std::abs(p.x);
    // A group is skipped if the point is too far from its bounding sphere to affect the result, including the seams.
    const auto near = [&](const Point& centre, double radius, double d) {
        return length(p - centre) - radius < std::max(d, 0.0) + 0.08;
    };
    double d = torso_distance(p);
    if (near({0.40, 0.455, 0}, 0.33, d)) d = smooth_union(d, arm_distance(p), 0.035);
    if (near({0.115, -0.45, 0}, 0.53, d)) {
        // The thighs join in the middle without a crease, because the distance to the plane x = 0 is rounded there.
        const Point q(std::sqrt(p.x * p.x + 1e-5), p.y, p.z);
        d = smooth_union(d, leg_distance(q), 0.045);
    }
    if (near({0.14, -0.88, 0.05}, 0.17, d)) d = smooth_union(d, shoe_distance(p), 0.012);
    if (near({0, 0.53, 0}, 0.12, d)) d = smooth_union(d, neck_distance(p), 0.03);
    if (near({0, 0.66, 0.04}, 0.16, d)) d = smooth_union(d, head_distance(p), 0.016);
    if (near({0.75, 0.455, 0.015}, 0.13, d)) d = smooth_union(d, hand_distance(p), 0.012);
    return d;
}

} // namespace gsh
