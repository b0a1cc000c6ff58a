// SPDX-License-Identifier: Apache-2.0
/// @file  How unusual poses and motion are: the terms of a motion's energy that need no photograph.
#pragma once

#include <gsh/core/span.hpp>
#include <gsh/fit/frame_kinematics.hpp>
#include <gsh/fit/motion_state.hpp>
#include <gsh/fit/pose_axes.hpp>
#include <gsh/math/bordered_band.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <array>
#include <cstddef>
#include <utility>
#include <vector>

namespace gsh {

/// The terms of one frame: usual angles and limits, a held pose, and the acceleration of all numbers.
class MotionPrior {
public:
    /// Shapes  times [T] ascending, seconds.
    MotionPrior(const FittedBody& body, std::vector<double> times) : body_(&body), times_(std::move(times)) {}

    [[nodiscard]] std::size_t frame_count() const { return times_.size(); }
    /// The angles that move.
    [[nodiscard]] std::size_t angle_count(const MotionTerms& terms) const {
        return terms.fingers ? body_->axes.size() : body_->limb_axes;
    }

    /// Adds the frame's part to the system, if one is given, and returns its energy.
    double evaluate(const MotionState& state, const MotionTerms& terms, std::size_t t, BorderedBand* system) const {
        double energy = angles(state, terms, t, system);
        if (terms.statue > 0) energy += upright(state, terms, t, system);
        if (t >= 2) energy += acceleration(state, terms, t, system);
        return energy;
    }

private:
    const FittedBody* body_;
    std::vector<double> times_;

    /// Whoever turns in place turns about one axis of the world: the body does not lean towards the camera in every
    /// view, as it might for all that one camera sees.
    double upright(const MotionState& state, const MotionTerms& terms, std::size_t t, BorderedBand* system) const {
        const mat3<double>& R = state.frames[t].root;
        const vec3<double> off = R[1] - state.axis;
        const double weight = 1 / (terms.axis_spread * terms.axis_spread);
        if (system) { // R exp([d]x) e_y: e_y turns by d x e_y = (-d_z, 0, d_x)
            const vec3<double> columns[3] = {R[2], vec3<double>(0), -R[0]};
            const Eigen::Index axis = system->corner.rows() - 3;
            for (int i = 0; i < 3; ++i) {
                system->rows[t].right[i] += weight * dot(columns[i], off);
                for (int j = 0; j <= i; ++j) system->rows[t].diagonal(i, j) += weight * dot(columns[i], columns[j]);
                for (int k = 0; k < 3; ++k) system->rows[t].border(i, axis + k) -= weight * columns[i][k];
                system->corner(axis + i, axis + i) += weight;
                system->shared_right[axis + i] -= weight * off[i];
            }
        }
        return weight * dot(off, off);
    }

    double angles(const MotionState& state, const MotionTerms& terms, std::size_t t, BorderedBand* system) const {
        double energy = 0;
        for (std::size_t a = 0; a < angle_count(terms); ++a) {
            const PoseAxis& axis = body_->axes[a];
            const double angle = state.frames[t].angles[a];
            const auto add = [&](double off, double weight) {
                energy += weight * off * off;
                if (!system) return;
                const auto row = static_cast<Eigen::Index>(6 + a);
                system->rows[t].diagonal(row, row) += weight;
                system->rows[t].right[row] += weight * off;
            };
            add(angle - axis.mean, (axis.finger ? terms.finger_prior : terms.prior) / (axis.spread * axis.spread));
            if (angle > axis.high) add(angle - axis.high, axis.limit_weight);
            if (angle < axis.low) add(angle - axis.low, axis.limit_weight);
            if (terms.statue <= 0 || axis.finger) continue;
            constexpr double usual = 0.1; // radians
            const double off = angle - state.held_angles[a], weight = terms.statue / (usual * usual);
            add(off, weight);
            if (!system) continue;
            const auto shared = static_cast<Eigen::Index>(state.betas.size() + 1 + a);
            system->rows[t].border(static_cast<Eigen::Index>(6 + a), shared) -= weight;
            system->corner(shared, shared) += weight;
            system->shared_right[shared] -= weight * off;
        }
        return energy;
    }

    /// Second differences over frames t - 2, t - 1 and t, in units of the usual ones.
    double acceleration(const MotionState& state, const MotionTerms& terms, std::size_t t, BorderedBand* system) const {
        if (terms.acceleration <= 0) return 0;
        const double h1 = times_[t - 1] - times_[t - 2], h2 = times_[t] - times_[t - 1];
        constexpr double unit = 0.01; // s², the square of the frames' distance to which paces refer
        const double scale = 2 * unit / (h1 + h2);
        const double c[3] = {scale / h1, -scale / h1 - scale / h2, scale / h2};
        const FrameNumbers* const frame[3] = {&state.frames[t - 2], &state.frames[t - 1], &state.frames[t]};
        double energy = 0;
        const auto add_number = [&](std::size_t number, double x0, double x1, double x2, double pace) {
            const double weight = terms.acceleration / (pace * pace), off = c[0] * x0 + c[1] * x1 + c[2] * x2;
            energy += weight * off * off;
            if (!system) return;
            const auto k = static_cast<Eigen::Index>(number);
            for (std::size_t p = 0; p < 3; ++p) {
                BorderedBand::Rows& rows = system->rows[t - 2 + p];
                rows.right[k] += weight * c[p] * off;
                rows.diagonal(k, k) += weight * c[p] * c[p];
                if (p >= 1) rows.before(k, k) += weight * c[p] * c[p - 1];
                if (p >= 2) rows.before2(k, k) += weight * c[p] * c[p - 2];
            }
        };
        for (int k = 0; k < 3; ++k)
            add_number(static_cast<std::size_t>(3 + k), frame[0]->transl[k], frame[1]->transl[k], frame[2]->transl[k],
                       0.03);
        for (std::size_t a = 0; a < angle_count(terms); ++a)
            add_number(6 + a, frame[0]->angles[a], frame[1]->angles[a], frame[2]->angles[a], body_->axes[a].pace);

        // The root: the change of its angular velocity, w = log(Rᵀ R').
        constexpr double pace = 0.08;
        const vec3<double> w1 = axis_angle_from_rotation(transpose(frame[0]->root) * frame[1]->root);
        const vec3<double> w2 = axis_angle_from_rotation(transpose(frame[1]->root) * frame[2]->root);
        const vec3<double> off = w2 * (scale / h2) - w1 * (scale / h1);
        const double weight = terms.acceleration / (pace * pace);
        energy += weight * dot(off, off);
        if (!system) return energy;
        const mat3<double> J1 = inverse(axis_angle_jacobian(w1)), J2 = inverse(axis_angle_jacobian(w2));
        const std::array<mat3<double>, 3> blocks{J1 * (scale / h1), J2 * (-scale / h2) - transpose(J1) * (scale / h1),
                                                 transpose(J2) * (scale / h2)};
        for (std::size_t p = 0; p < 3; ++p) {
            BorderedBand::Rows& rows = system->rows[t - 2 + p];
            const vec3<double> pulled = transpose(blocks[p]) * off * weight;
            for (int i = 0; i < 3; ++i) rows.right[i] += pulled[i];
            for (std::size_t q = 0; q <= p; ++q) {
                const mat3<double> product = transpose(blocks[p]) * blocks[q] * weight; // [column][row]
                BorderedBand::Matrix& target = p == q ? rows.diagonal : p == q + 1 ? rows.before : rows.before2;
                for (int i = 0; i < 3; ++i)
                    for (int j = 0; j < 3; ++j) target(i, j) += product[j][i];
            }
        }
        return energy;
    }
};

} // namespace gsh
