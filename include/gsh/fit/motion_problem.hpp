// SPDX-License-Identifier: Apache-2.0
/// @file  The energy of a motion against keypoints, and its normal equations.
#pragma once

#include <gsh/body/landmarks.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/fit/frame_kinematics.hpp>
#include <gsh/fit/joint_pulls.hpp>
#include <gsh/fit/motion_prior.hpp>
#include <gsh/fit/motion_state.hpp>
#include <gsh/fit/outlines.hpp>
#include <gsh/fit/view_keypoints.hpp>
#include <gsh/math/bordered_band.hpp>
#include <gsh/math/linalg.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace gsh {

/// E of a motion: how far landmarks lie from the rays of their keypoints, and how unusual poses and motion are.
///
///     E = Σ_points c w / √V ρ(|r|²) + Σ_metric … + Σ_angles … + Σ_accelerations … + shape + focal length + height
///
/// r = (x / z - ray_x, y / z - ray_y) depth / spread, with (x, y, z) the landmark in the camera, ray = (pixel - centre)
/// / focal length, and depth that of the body when the descent began: the distance across the ray, in units by which
/// detections usually miss. ρ(s) = 2 (√(1 + s) - 1) is quadratic for small distances and linear for outliers. V is the
/// number of photographs of the frame, because detections err alike in all views.
///
/// Source  for ρ, Charbonnier et al., 1994, as in "Bundle Adjustment: A Modern Synthesis".
class MotionProblem {
public:
    /// Shapes  views [T]; times [T] ascending, seconds.
    MotionProblem(const FittedBody& body, const std::vector<std::vector<ViewKeypoints>>& views,
                  std::vector<double> times)
        : body_(&body), views_(&views), prior_(body, std::move(times)) {
        check_size("MotionProblem", "times", prior_.frame_count(), views.size(), "one per frame");
    }

    [[nodiscard]] std::size_t frame_count() const { return prior_.frame_count(); }
    /// Betas, the focal length, and with `statue` the held angles and the body's axis.
    [[nodiscard]] int shared_count(const MotionTerms& terms) const {
        return body_->shape_count + 1 + (terms.statue > 0 ? static_cast<int>(body_->limb_axes) + 3 : 0);
    }
    /// A system for the numbers that move: those of fingers come last.
    [[nodiscard]] BorderedBand make_system(const MotionTerms& terms) const {
        return {frame_count(), static_cast<int>(6 + prior_.angle_count(terms)), shared_count(terms)};
    }

    /// Height of the body at rest: mean + Σ betas directions.
    void set_height(double mean, std::vector<double> directions) {
        height_mean_ = mean, height_directions_ = std::move(directions);
    }

    /// Gives each view of each frame points of its outline: [T] of [views]. `samples` are those of which they are, and
    /// betas those with which they were found.
    void set_outlines(const OutlineSamples& samples, std::vector<std::vector<std::vector<OutlinePoint>>> points,
                      std::vector<double> betas) {
        samples_ = &samples, outlines_ = std::move(points), outline_betas_ = std::move(betas);
    }

    /// Takes the depths of the bodies, by which distances in pixels become metres, from a state: once for each descent,
    /// because E would otherwise fall when a body shrinks towards the camera. The state's held pose and axis become the
    /// means of its frames.
    void set_reference(MotionState& state) {
        state.held_angles.assign(body_->limb_axes, 0.0);
        state.axis = vec3<double>(0);
        for (const FrameNumbers& frame : state.frames) {
            const double share = 1 / static_cast<double>(frame_count());
            for (std::size_t a = 0; a < body_->limb_axes; ++a) state.held_angles[a] += frame.angles[a] * share;
            state.axis += frame.root[1] * share;
        }
        reference_.assign(frame_count(), {});
        for (std::size_t t = 0; t < frame_count(); ++t)
            for (const ViewKeypoints& view : (*views_)[t])
                reference_[t].push_back(
                    std::max(0.3, to_camera(view.camera, state.frames[t].transl + body_->joints[0]).z));
    }

    /// E. If `system` is given, it receives the normal equations of its Gauss-Newton step: half the Hessian, half the
    /// gradient. The shared unknowns are the betas, then the focal length's logarithm.
    double evaluate(const MotionState& state, const MotionTerms& terms, BorderedBand* system = nullptr) const {
        if (system) system->set_zero();
        double energy = 0;
        for (std::size_t t = 0; t < frame_count(); ++t) {
            energy += points(state, terms, t, system);
            energy += prior_.evaluate(state, terms, t, system);
        }
        return energy + shared(state, terms, system);
    }

    /// The state after a step of the solver, which is subtracted.
    [[nodiscard]] MotionState stepped(const MotionState& state, const BorderedBand::Solution& step) const {
        MotionState result = state;
        for (std::size_t t = 0; t < frame_count(); ++t) {
            const auto& x = step.x[t];
            FrameNumbers& frame = result.frames[t];
            frame.root = frame.root * rotation_from_axis_angle(vec3<double>(-x[0], -x[1], -x[2]));
            frame.transl -= vec3<double>(x[3], x[4], x[5]);
            for (Eigen::Index a = 6; a < x.size(); ++a) frame.angles[static_cast<std::size_t>(a - 6)] -= x[a];
        }
        for (std::size_t k = 0; k < result.betas.size(); ++k) result.betas[k] -= step.y[static_cast<Eigen::Index>(k)];
        auto shared = static_cast<Eigen::Index>(result.betas.size());
        result.log_focal -= step.y[shared++];
        if (step.y.size() == shared) return result;
        for (double& angle : result.held_angles) angle -= step.y[shared++];
        for (int k = 0; k < 3; ++k) result.axis[k] -= step.y[shared++];
        return result;
    }

private:
    const FittedBody* body_;
    const std::vector<std::vector<ViewKeypoints>>* views_;
    MotionPrior prior_;
    std::vector<std::vector<double>> reference_; // [T] of [views]
    const OutlineSamples* samples_ = nullptr;
    std::vector<std::vector<std::vector<OutlinePoint>>> outlines_; // [T] of [views]
    std::vector<double> outline_betas_;
    double height_mean_ = 0;
    std::vector<double> height_directions_;

    static constexpr double metric_spread = 0.08; // metres
    static constexpr double nearest_depth = 0.1;

    static double rho(double s) { return 2 * (std::sqrt(1 + s) - 1); }

    double points(const MotionState& state, const MotionTerms& terms, std::size_t t, BorderedBand* system) const {
        const std::vector<ViewKeypoints>& views = (*views_)[t];
        if (views.empty()) return 0;
        const FrameKinematics kinematics(*body_, state.frames[t], state.betas);
        JointPulls pulls(body_->joints.size(), body_->shape_count);
        double energy = keypoints(kinematics, state, terms, t, system ? &pulls : nullptr);
        if (terms.outline > 0 && !outlines_.empty())
            energy += outlines(kinematics, state, terms, t, system ? &pulls : nullptr);
        if (system) pulls.expand(*body_, kinematics, system->rows[t], *system);
        if (terms.metric > 0) energy += metric(kinematics, terms, t, system);
        return energy;
    }

    double keypoints(const FrameKinematics& kinematics, const MotionState& state, const MotionTerms& terms,
                     std::size_t t, JointPulls* pulls) const {
        const std::vector<ViewKeypoints>& views = (*views_)[t];
        const double share = 1 / std::sqrt(static_cast<double>(views.size())), focal = std::exp(state.log_focal);
        double energy = 0;
        for (std::size_t v = 0; v < views.size(); ++v) {
            const Camera<double>& camera = views[v].camera;
            for (const Keypoint& point : views[v].points) {
                const Landmark& mark = body_->marks[static_cast<std::size_t>(point.landmark)];
                const double weight = 2 * share * point.confidence * group_weight(point, terms);
                if (weight <= 0 || mark.joint < 0 || (!terms.fingers && body_->follows_finger(mark.joint))) continue;
                const vec3<double> place = kinematics.landmark(point.landmark), x = to_camera(camera, place);
                const double z = std::max(x.z, nearest_depth), scale = reference_[t][v] / mark.spread;
                const vec2<double> seen{focal * x.x / z, focal * x.y / z};
                const vec2<double> r{(seen.x - (point.pixel.x - camera.cx) / camera.fx) * scale,
                                     (seen.y - (point.pixel.y - camera.cy) / camera.fy) * scale};
                const double squared = r.x * r.x + r.y * r.y;
                energy += weight * rho(squared);
                if (!pulls) continue;
                const double q = weight / std::sqrt(1 + squared), in_front = x.z > nearest_depth ? 1 : 0;
                const auto j = static_cast<std::size_t>(mark.joint);
                const auto add = [&](const vec3<double>& row, double f, double residual) {
                    pulls->add(
                        j, place, transposed_times(camera.R, row) * (scale / z),
                        [&](std::size_t k) { return kinematics.shape_direction(j, k); }, f * scale, residual, q);
                };
                add({focal, 0, -in_front * seen.x}, seen.x, r.x);
                add({0, focal, -in_front * seen.y}, seen.y, r.y);
            }
        }
        return energy;
    }

    /// Points of the outline, by their distance from the mask's outline along its normal.
    double outlines(const FrameKinematics& kinematics, const MotionState& state, const MotionTerms& terms,
                    std::size_t t, JointPulls* pulls) const {
        const std::vector<ViewKeypoints>& views = (*views_)[t];
        const double focal = std::exp(state.log_focal), share = 1 / std::sqrt(static_cast<double>(views.size()));
        double energy = 0;
        for (std::size_t v = 0; v < views.size(); ++v) {
            const Camera<double>& camera = views[v].camera;
            const std::vector<OutlinePoint>& points = outlines_[t][v];
            constexpr double fewest = 100; // points of a small part of the outline weigh no more than in a whole one
            const double weight = 2 * terms.outline * share / std::max(fewest, static_cast<double>(points.size()));
            for (const OutlinePoint& point : points) {
                const auto j = static_cast<std::size_t>(point.joint);
                vec3<double> offset = point.offset;
                const Span<const vec3<double>> directions = samples_->directions(point.sample);
                for (std::size_t k = 0; k < directions.size(); ++k)
                    offset += directions[k] * (state.betas[k] - outline_betas_[k]);
                const vec3<double> place = kinematics.point(j, offset), x = to_camera(camera, place);
                if (x.z < nearest_depth) continue;
                const vec2<double> seen{focal * x.x / x.z, focal * x.y / x.z}, n = point.normal;
                const double off = n.x * (seen.x - (point.target.x - camera.cx) / camera.fx) +
                                   n.y * (seen.y - (point.target.y - camera.cy) / camera.fy);
                const double scale = reference_[t][v] / terms.outline_spread * (off < 0 ? terms.cloth : 1);
                const double r = off * scale;
                energy += weight * rho(r * r);
                if (!pulls) continue;
                const vec3<double> row(focal * n.x, focal * n.y, -n.x * seen.x - n.y * seen.y);
                pulls->add(
                    j, place, transposed_times(camera.R, row) * (scale / x.z),
                    [&](std::size_t k) {
                        return kinematics.shape_direction(j, k) + kinematics.rotation(j) * directions[k];
                    },
                    (n.x * seen.x + n.y * seen.y) * scale, r, weight / std::sqrt(1 + r * r));
            }
        }
        return energy;
    }

    static double group_weight(const Keypoint& point, const MotionTerms& terms) {
        constexpr int first_hand = landmark_number("left_hand_wrist"), first_face = landmark_number("face_nose");
        return point.landmark >= first_face ? terms.face : point.landmark >= first_hand ? terms.hands : 1;
    }

    /// The detector's guesses in metres, relative to the middle of the hips, turned into the world. The hips' middle
    /// moves with the root, so a shift of the root changes nothing, and its turns pass through that point.
    double metric(const FrameKinematics& kinematics, const MotionTerms& terms, std::size_t t,
                  BorderedBand* system) const {
        constexpr int left_hip = landmark_number("left_hip"), right_hip = landmark_number("right_hip");
        const auto at_rest = [&](int number) {
            const Landmark& mark = body_->marks[static_cast<std::size_t>(number)];
            return body_->joints[static_cast<std::size_t>(mark.joint)] + mark.offset;
        };
        const vec3<double> hips =
            kinematics.point(0, (at_rest(left_hip) + at_rest(right_hip)) * 0.5 - body_->joints[0]);
        const std::vector<ViewKeypoints>& views = (*views_)[t];
        double energy = 0;
        JointPulls pulls(body_->joints.size(), body_->shape_count);
        for (const ViewKeypoints& view : views)
            for (const MetricPoint& guess : view.metric) {
                const auto j = static_cast<std::size_t>(body_->marks[static_cast<std::size_t>(guess.landmark)].joint);
                const vec3<double> place = kinematics.landmark(guess.landmark);
                const vec3<double> r =
                    (place - hips - transposed_times(view.camera.R, guess.position)) * (1 / metric_spread);
                const double weight = terms.metric / static_cast<double>(views.size()), squared = dot(r, r);
                energy += weight * rho(squared);
                if (!system) continue;
                for (int k = 0; k < 3; ++k) {
                    vec3<double> slope(0);
                    slope[k] = 1 / metric_spread;
                    pulls.add(
                        j, place, slope,
                        [&](std::size_t s) {
                            return kinematics.shape_direction(j, s) - kinematics.shape_direction(0, s);
                        },
                        0, r[k], weight / std::sqrt(1 + squared));
                }
            }
        if (system) pulls.expand(*body_, kinematics.about(hips), system->rows[t], *system);
        return energy;
    }

    double shared(const MotionState& state, const MotionTerms& terms, BorderedBand* system) const {
        const double windows = static_cast<double>(frame_count()) / 20;
        double energy = 0;
        const std::size_t S = state.betas.size();
        for (std::size_t k = 0; k < S; ++k) {
            const double weight = terms.betas * windows;
            energy += weight * state.betas[k] * state.betas[k];
            if (!system) continue;
            const auto row = static_cast<Eigen::Index>(k);
            system->corner(row, row) += weight;
            system->shared_right[row] += weight * state.betas[k];
        }
        const auto focal = static_cast<Eigen::Index>(S);
        if (terms.focal_spread > 0 && !terms.hold_shared) {
            const double weight = windows / (terms.focal_spread * terms.focal_spread);
            energy += weight * state.log_focal * state.log_focal;
            if (system) {
                system->corner(focal, focal) += weight;
                system->shared_right[focal] += weight * state.log_focal;
            }
        } else if (system) { // it stays
            system->corner.row(focal).setZero(), system->corner.col(focal).setZero();
            system->corner(focal, focal) = 1, system->shared_right[focal] = 0;
            for (BorderedBand::Rows& rows : system->rows) rows.border.col(focal).setZero();
        }
        if (terms.height && !height_directions_.empty()) {
            double off = height_mean_ - *terms.height;
            for (std::size_t k = 0; k < S; ++k) off += height_directions_[k] * state.betas[k];
            const double weight = windows / (terms.height_spread * terms.height_spread);
            energy += weight * off * off;
            for (std::size_t k = 0; system && k < S; ++k) {
                const auto row = static_cast<Eigen::Index>(k);
                system->shared_right[row] += weight * off * height_directions_[k];
                for (std::size_t l = 0; l < S; ++l)
                    system->corner(row, static_cast<Eigen::Index>(l)) +=
                        weight * height_directions_[k] * height_directions_[l];
            }
        }
        if (terms.hold_shared && system) {
            const auto held = static_cast<Eigen::Index>(S + 1);
            system->corner.topRows(held).setZero(), system->corner.leftCols(held).setZero();
            system->corner.topLeftCorner(held, held).setIdentity(), system->shared_right.head(held).setZero();
            for (BorderedBand::Rows& rows : system->rows) rows.border.leftCols(held).setZero();
        }
        return energy;
    }
};

} // namespace gsh
