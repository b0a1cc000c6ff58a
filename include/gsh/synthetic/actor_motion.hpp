// SPDX-License-Identifier: Apache-2.0
/// @file  Looping motions for the actor, written as sums of sines.
#pragma once

#include <gsh/body/motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/synthetic/actor_directions.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace gsh {

/// talk: moves both arms, each finger, jaw, face, head, torso and knees; the feet stay. Suitable for a capture. stride:
/// steps on the spot with high arm swings. Its poses differ from talk's, so it suits animating the result. reach: lifts
/// each arm above the head in turn, and bends elbows and knees to 120 degrees, farther than talk.
enum class ActorMotion { talk, stride, reach };

namespace detail {

/// Writes one frame of an actor's pose, joint by joint.
class ActorPose {
public:
    ActorPose(Span<vec3<double>> pose, Span<double> expression) : pose_(pose), expression_(expression) {}

    vec3<double>& at(int joint) { return pose_[static_cast<std::size_t>(joint)]; }
    double& expression(int k) { return expression_[static_cast<std::size_t>(k)]; }
    /// Sets a left body joint and the right one; the mirrored rotation has y and z negated.
    void both(int joint, const vec3<double>& left, const vec3<double>& right) {
        at(joint) = left;
        at(joint + 1) = vec3<double>(right.x, -right.y, -right.z);
    }
    /// Curls one finger (0 index, 1 middle, 2 pinky, 3 ring, 4 thumb) of each hand; 0 straight, 1 nearly a fist.
    void curl(int finger, double left, double right) {
        const vec3<double> bend = finger == 4 ? vec3<double>(0.68, 0.73, -0.07) * 0.55 : vec3<double>(0, 0, -1.15);
        for (int k = 0; k < 3; ++k) {
            const vec3<double> l = bend * left, r = bend * right;
            at(smplx::left_index1 + 3 * finger + k) = l;
            at(smplx::right_index1 + 3 * finger + k) = vec3<double>(r.x, -r.y, -r.z);
        }
    }
    /// Bends hips by `hip` and knees by `knee` with level soles. Returns the distance by which the body sinks on that
    /// leg.
    double leg(int side, double hip, double knee) {
        at(smplx::left_hip + side).x = -hip;
        at(smplx::left_knee + side).x = knee;
        at(smplx::left_ankle + side).x = hip - knee;
        const double thigh = actor_joint(smplx::left_hip).y - actor_joint(smplx::left_knee).y,
                     shin = actor_joint(smplx::left_knee).y - actor_joint(smplx::left_ankle).y;
        return thigh * (1 - std::cos(hip)) + shin * (1 - std::cos(knee - hip));
    }

private:
    Span<vec3<double>> pose_;
    Span<double> expression_;
};

inline vec3<double> talk(ActorPose pose, double a) { // a: phase, radians
    const auto wave = [a](double shift, double times = 1) { return std::sin(times * a + shift); };
    pose.at(smplx::pelvis) = {0, 0.22 * wave(0.4), 0};
    const double knee = 0.30 - 0.24 * std::cos(a), sink = pose.leg(0, 0.52 * knee, knee);
    pose.leg(1, 0.52 * knee, knee);
    for (const int joint : {smplx::spine1, smplx::spine2, smplx::spine3})
        pose.at(joint) = {0.02 + 0.03 * wave(1.0), 0.09 * wave(0.2), 0.05 * wave(1.9)};
    pose.at(smplx::neck) = {0.05 * wave(2.0), 0.12 * wave(2.6), 0.04 * wave(0.7)};
    pose.at(smplx::head) = {0.10 * wave(0.9, 2), 0.26 * wave(2.6), 0.08 * wave(1.4)};
    pose.both(smplx::left_collar, {0, 0, 0.06 * wave(0)}, {0, 0, 0.06 * wave(2)});
    pose.both(smplx::left_shoulder, {0.15 * wave(1), -0.35 - 0.30 * wave(0.3), -0.78 + 0.42 * wave(0)},
              {0.15 * wave(2), -0.35 - 0.30 * wave(2.2), -0.78 + 0.42 * wave(2.4)});
    pose.both(smplx::left_elbow, {0, -0.85 - 0.65 * wave(0.8), 0}, {0, -0.85 - 0.65 * wave(3.0), 0});
    pose.both(smplx::left_wrist, {0.3 * wave(0.5), 0, 0.25 * wave(1.5)}, {0.3 * wave(2.5), 0, 0.25 * wave(3.6)});
    for (int finger = 0; finger < 5; ++finger) // one after the other
        pose.curl(finger, 0.38 + 0.34 * wave(0.7 * finger), 0.38 + 0.34 * wave(2.0 - 0.7 * finger, 2));
    pose.at(smplx::jaw) = {0.09 - 0.08 * std::cos(2 * a), 0, 0};
    for (const int eye : {smplx::left_eye, smplx::right_eye}) pose.at(eye) = {0, 0.22 * wave(2.0), 0};
    pose.expression(0) = 0.45 + 0.45 * wave(0.6);                 // smile
    pose.expression(4) = std::max(0.0, wave(2.2));                // brows up
    pose.expression(5) = std::max(0.0, -wave(2.2)) * 0.7;         // brows down
    pose.expression(6) = std::pow(std::max(0.0, wave(4.0)), 6.0); // blink
    return {0.03 * wave(0.5), -sink, 0.02 * wave(1.1)};
}

inline vec3<double> stride(ActorPose pose, double a) {
    const auto wave = [a](double shift, double times = 1) { return std::sin(times * a + shift); };
    pose.at(smplx::pelvis) = {0, 0.45 * wave(0.3), 0.05 * wave(1.6)};
    const double left = std::max(0.0, wave(0)), right = std::max(0.0, -wave(0));
    const double sink = std::min(pose.leg(0, 0.10 + 0.85 * left, 0.20 + 1.25 * left),
                                 pose.leg(1, 0.10 + 0.85 * right, 0.20 + 1.25 * right));
    for (const int joint : {smplx::spine1, smplx::spine2, smplx::spine3})
        pose.at(joint) = {0.04, -0.16 * wave(0.3), 0.06 * wave(1.6)};
    pose.at(smplx::head) = {0.12 * wave(1.0, 2), -0.30 * wave(0.9), 0.10 * wave(0.2)};
    pose.both(smplx::left_shoulder, {0.2 * wave(1), -0.25 + 0.7 * wave(0.2), -0.35 + 0.75 * wave(1.8)},
              {0.2 * wave(3), -0.25 + 0.7 * wave(3.3), -0.35 + 0.75 * wave(4.9)});
    pose.both(smplx::left_elbow, {0, -0.70 - 0.60 * wave(0.2), 0}, {0, -0.70 - 0.60 * wave(3.3), 0});
    pose.both(smplx::left_wrist, {0, 0, 0.3 * wave(0.5, 2)}, {0, 0, 0.3 * wave(2.5, 2)});
    for (int finger = 0; finger < 5; ++finger)
        pose.curl(finger, 0.35 + 0.35 * wave(0.4 * finger), finger == 0 ? 0.05 : 0.7);
    pose.at(smplx::jaw) = {0.12 + 0.12 * wave(1.0), 0, 0};
    pose.expression(0) = 0.8;
    pose.expression(4) = 0.5 + 0.5 * wave(0.5);
    pose.expression(6) = std::pow(std::max(0.0, wave(1.0)), 6.0);
    return {0.06 * wave(1.6), -sink, 0};
}

inline vec3<double> reach(ActorPose pose, double a) {
    const auto wave = [a](double shift, double times = 1) { return std::sin(times * a + shift); };
    constexpr double half = std::numbers::pi; // the other side is half a loop later
    constexpr double far_bend = 120 * std::numbers::pi / 180;
    pose.at(smplx::pelvis) = {0, 0.30 * wave(0.7), 0};
    const auto leg = [&](int side, double shift) {
        const double lift = std::max(0.0, wave(shift));
        return pose.leg(side, 0.10 + 1.20 * lift, 0.15 + (far_bend - 0.15) * lift);
    };
    const double sink = std::min(leg(0, 0), leg(1, half));
    for (const int joint : {smplx::spine1, smplx::spine2, smplx::spine3}) pose.at(joint) = {0.02, 0.08 * wave(0.7), 0};
    pose.at(smplx::head) = {0.10 * wave(0.5), 0.35 * wave(1.1), 0.05 * wave(2.0)};
    pose.both(smplx::left_collar, {0, 0, 0.10 + 0.10 * wave(0.4)}, {0, 0, 0.10 + 0.10 * wave(0.4 + half)});
    pose.both(smplx::left_shoulder, {0.1 * wave(1), -0.30, 0.30 + 1.00 * wave(0.4)},
              {0.1 * wave(2), -0.30, 0.30 + 1.00 * wave(0.4 + half)});
    const auto elbow = [&](double shift) { return -far_bend * (0.5 + 0.5 * wave(shift)); };
    pose.both(smplx::left_elbow, {0, elbow(1.9), 0}, {0, elbow(1.9 + half), 0});
    for (int finger = 0; finger < 5; ++finger)
        pose.curl(finger, 0.4 + 0.3 * wave(0.5 * finger), 0.4 - 0.3 * wave(0.5 * finger));
    pose.at(smplx::jaw) = {0.10 + 0.08 * wave(0.3), 0, 0};
    pose.expression(0) = 0.5 + 0.4 * wave(1.3);
    return {0.04 * wave(0.2), -sink, 0};
}

} // namespace detail

/// One loop of a motion in `frames` even steps; a frame after the last would equal the first.
///
/// Frame   the pelvis starts at the origin, soles stay on y = ActorOutfit::sole_y for betas of zero.
/// Errors  ValueError if frames or fps is not positive.
[[nodiscard]] inline Motion actor_motion(ActorMotion kind, int frames, double fps = 10) {
    check_value(frames > 0, "actor_motion", "frames must be positive");
    check_value(fps > 0, "actor_motion", "fps must be positive");
    Motion motion;
    const auto T = static_cast<std::size_t>(frames);
    motion.joint_count = actor_joint_count;
    motion.expression_count = actor_expression_names.size();
    motion.betas.assign(actor_shape_names.size(), 0);
    motion.pose.assign(T * motion.joint_count, vec3<double>(0));
    motion.expression.assign(T * motion.expression_count, 0);
    for (std::size_t t = 0; t < T; ++t) {
        const double time = static_cast<double>(t), phase = 2 * std::numbers::pi * time / frames;
        detail::ActorPose pose({&motion.pose[t * motion.joint_count], motion.joint_count},
                               {&motion.expression[t * motion.expression_count], motion.expression_count});
        motion.transl.push_back(kind == ActorMotion::talk     ? detail::talk(pose, phase)
                                : kind == ActorMotion::stride ? detail::stride(pose, phase)
                                                              : detail::reach(pose, phase));
        motion.timestamps.push_back(time / fps);
    }
    return motion;
}

} // namespace gsh
