// SPDX-License-Identifier: Apache-2.0
/// @file  Sums what points of a body ask of its numbers: per joint, and then along the kinematic tree.
#pragma once

#include <gsh/core/span.hpp>
#include <gsh/fit/frame_kinematics.hpp>
#include <gsh/math/bordered_band.hpp>
#include <gsh/math/linalg.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

namespace gsh {

/// The Gauss-Newton system of one frame from residuals of points.
///
/// A number b that turns a joint about an axis w through P moves each point x of the joint and of its descendants by
/// w × x - w × P, which is linear in the twist (w, -w × P). A residual r with derivative a with respect to x therefore
/// has the row (x × a, a) for twists. The rows' products are summed per joint, [6 + S + 2]², with the shape, the focal
/// length and the residual itself beside the twist; then the sums of a joint's descendants are added to its own. The
/// entry of numbers b and its ancestor c is the product of their twists with the sum at b's joint. The cost for each
/// point is one product of its row with itself, however many joints lie above it.
///
/// Source  Featherstone, "Rigid Body Dynamics Algorithms", 2008, section 6.2, for sums along the tree.
class JointPulls {
public:
    JointPulls(std::size_t joint_count, int shape_count)
        : shape_count_(shape_count), sums_(joint_count, Eigen::MatrixXd::Zero(8 + shape_count, 8 + shape_count)),
          row_(8 + shape_count) {}

    void set_zero() {
        for (Eigen::MatrixXd& sum : sums_) sum.setZero();
    }

    /// Adds weight r² of a point that moves with `joint`: r's derivative with respect to the point is `slope`, to the
    /// shape Σ slope · shape_k, to the focal length's logarithm `focal`.
    template <class Shape>
    void add(std::size_t joint, const vec3<double>& point, const vec3<double>& slope, const Shape& shape, double focal,
             double residual, double weight) {
        const vec3<double> moment = cross(point, slope);
        for (int k = 0; k < 3; ++k) row_[k] = moment[k], row_[3 + k] = slope[k];
        for (int k = 0; k < shape_count_; ++k) row_[6 + k] = dot(slope, shape(static_cast<std::size_t>(k)));
        row_[6 + shape_count_] = focal, row_[7 + shape_count_] = residual;
        sums_[joint].selfadjointView<Eigen::Lower>().rankUpdate(row_, weight);
    }

    /// Adds the sums to a frame's rows and to the shared part of the system.
    void expand(const FittedBody& body, const FrameKinematics& kinematics, BorderedBand::Rows& rows,
                BorderedBand& system) {
        const Eigen::Index shared = shape_count_ + 1, last = shared + 6;
        for (std::size_t j = sums_.size(); j-- > 1;) sums_[static_cast<std::size_t>(body.parents[j])] += sums_[j];
        // Numbers in the order of the system, with their joints: the root's three turns and three shifts come first.
        const auto N = static_cast<std::size_t>(rows.diagonal.rows()); // fingers, the last, may be held
        for (std::size_t b = 0; b < N; ++b) {
            const std::size_t joint = kinematics.joint_of(b);
            const Eigen::MatrixXd& sum = sums_[joint];
            const Twist twist = kinematics.twist(b);
            const Eigen::Matrix<double, 6, 1> pulled =
                sum.topLeftCorner<6, 6>().selfadjointView<Eigen::Lower>() * twist;
            const auto row = static_cast<Eigen::Index>(b);
            for (std::size_t c = 0; c < N; ++c) {
                const std::size_t above = kinematics.joint_of(c);
                if (above == joint ? c > b : !kinematics.is_above(above, joint)) continue;
                rows.diagonal(static_cast<Eigen::Index>(std::max(b, c)), static_cast<Eigen::Index>(std::min(b, c))) +=
                    pulled.dot(kinematics.twist(c));
            }
            rows.border.row(row).head(shared) += (sum.block(6, 0, shared, 6) * twist).transpose();
            rows.right[row] += sum.row(last).head<6>() * twist;
        }
        const Eigen::MatrixXd& whole = sums_[0];
        for (Eigen::Index k = 0; k < shared; ++k) {
            for (Eigen::Index l = 0; l <= k; ++l) {
                const double entry = whole(6 + k, 6 + l);
                system.corner(k, l) += entry;
                if (l < k) system.corner(l, k) += entry;
            }
            system.shared_right[k] += whole(last, 6 + k);
        }
    }

private:
    using Twist = FrameKinematics::Twist;
    int shape_count_;
    std::vector<Eigen::MatrixXd> sums_; // [J] lower triangles
    Eigen::VectorXd row_;
};

} // namespace gsh
