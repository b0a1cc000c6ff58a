// SPDX-License-Identifier: Apache-2.0
/// @file  An estimated motion in a backend's memory, and the pose of a frame with increments added, with adjoint.
#pragma once

#include <gsh/avatar/rig.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/rotation_increment.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// Increments of one frame, or their gradient. Those of betas belong to all frames.
///
/// Shapes  pose [J, 3], transl [3], expression [E], betas [S].
/// Units   radians about the joint's own axes, metres, coefficients.
template <class T>
struct PoseIncrements {
    Span<T> pose, transl, expression, betas;
};

namespace detail {

template <class T>
struct TurnedPose {
    Span<const vec3<T>> initial, increments;
    Span<vec3<T>> pose;
    GSH_HD void operator()(std::size_t j) const { pose[j] = turned(initial[j], increments[j]); }
};

template <class T>
struct TurnedPoseBackward {
    Span<const vec3<T>> initial, increments, dL_dpose;
    Span<vec3<T>> dL_dincrements;
    GSH_HD void operator()(std::size_t j) const {
        turned_backward(increments[j], turned(initial[j], increments[j]), dL_dpose[j], dL_dincrements[j]);
    }
};

template <class T>
struct Incremented {
    Span<const T> initial, increments;
    Span<T> result;
    GSH_HD void operator()(std::size_t i) const { result[i] = initial[i] + increments[i]; }
};

} // namespace detail

/// The estimate of a motion, with as many coefficients as the rig has, on the host and in the backend's memory. The
/// estimate does not change. Increments w are added to it:
///
///     joint   exp(pose) exp(w)           transl + w, expression + w, betas + w
///
/// An increment of a rotation lies in a fixed tangent space near the estimate. It has no singularity within half a
/// turn. Its three numbers are angles about the joint's own axes, so that one rate fits all of them, and Adam's running
/// squares keep their meaning. Axis-angle vectors have none of these properties near pi, where the angle of a person's
/// root often is.
///
/// Shapes  T frames, J joints, S betas and E expression coefficients of the rig.
/// Errors  ShapeError or ValueError for a motion of another body, with more coefficients than the rig, or without
///         frames.
template <Backend B, std::floating_point T = float>
class EstimatedMotion {
public:
    EstimatedMotion(B& backend, const RigData& rig, const Motion& motion) : backend_(&backend), motion_(motion) {
        complete(rig);
        upload();
    }

    /// The estimate. Without betas it has the shape of the rig; coefficients that it lacks are zero.
    [[nodiscard]] const Motion& motion() const { return motion_; }
    [[nodiscard]] std::size_t frame_count() const { return motion_.frame_count(); }
    [[nodiscard]] std::size_t joint_count() const { return motion_.joint_count; }
    [[nodiscard]] std::size_t shape_count() const { return motion_.betas.size(); }
    [[nodiscard]] std::size_t expression_count() const { return motion_.expression_count; }

    /// All frames, in the backend's memory. Rotations beyond half a turn are those of the shorter way.
    [[nodiscard]] Span<const vec3<T>> pose() const { return pose_; }       // [T, J]
    [[nodiscard]] Span<const T> transl() const { return transl_; }         // [T, 3]
    [[nodiscard]] Span<const T> expression() const { return expression_; } // [T, E]

    /// Computes the pose of a frame, in the backend's memory and without an upload. With increments of zero it is
    /// bit-identical to that of Rig::upload_pose, except for rotations beyond half a turn.
    void forward(std::size_t frame, const PoseIncrements<const T>& increments, RigPose<B, T>& pose) const {
        check("EstimatedMotion::forward", frame, increments);
        pose.pose.resize(joint_count());
        pose.transl.resize(1);
        pose.coefficients.resize(shape_count() + expression_count());
        const auto add = [&](Span<const T> initial, Span<const T> w, Span<T> result) {
            backend_->for_each(result.size(), detail::Incremented<T>{initial, w, result});
        };
        const Span<T> coefficients = pose.coefficients;
        backend_->for_each(joint_count(),
                           detail::TurnedPose<T>{pose_at(frame), view_as<const vec3<T>>(increments.pose), pose.pose});
        add(transl().subspan(3 * frame, 3), increments.transl, view_as<T>(Span<vec3<T>>(pose.transl)));
        add(betas_, increments.betas, coefficients.subspan(0, shape_count()));
        add(expression().subspan(frame * expression_count(), expression_count()), increments.expression,
            coefficients.subspan(shape_count(), expression_count()));
    }

    /// Adds to dL_dincrements. Empty parts of dL_dpose are skipped.
    void backward(std::size_t frame, const PoseIncrements<const T>& increments, const RigPoseGradient<T>& dL_dpose,
                  const PoseIncrements<T>& dL_dincrements) const {
        constexpr std::string_view where = "EstimatedMotion::backward";
        check(where, frame, increments);
        check(where, frame, {dL_dincrements.pose, dL_dincrements.transl, dL_dincrements.expression,
                             dL_dincrements.betas});
        const auto add = [&](Span<const T> from, Span<T> to) {
            backend_->for_each(to.size(), detail::Accumulate<T>{from, to});
        };
        if (!dL_dpose.pose.empty()) {
            check_size(where, "dL_dpose.pose", dL_dpose.pose.size(), joint_count(), "one per joint, or none");
            check_memory(*backend_, where, "dL_dpose.pose", dL_dpose.pose);
            backend_->for_each(joint_count(), detail::TurnedPoseBackward<T>{
                                                  pose_at(frame), view_as<const vec3<T>>(increments.pose),
                                                  dL_dpose.pose, view_as<vec3<T>>(dL_dincrements.pose)});
        }
        if (!dL_dpose.transl.empty()) {
            check_size(where, "dL_dpose.transl", dL_dpose.transl.size(), 1, "one vector, or none");
            check_memory(*backend_, where, "dL_dpose.transl", dL_dpose.transl);
            add(view_as<const T>(Span<const vec3<T>>(dL_dpose.transl)), dL_dincrements.transl);
        }
        if (!dL_dpose.coefficients.empty()) {
            check_size(where, "dL_dpose.coefficients", dL_dpose.coefficients.size(), shape_count() + expression_count(),
                       "betas, then expression, or none");
            check_memory(*backend_, where, "dL_dpose.coefficients", dL_dpose.coefficients);
            const Span<const T> coefficients = dL_dpose.coefficients;
            add(coefficients.subspan(0, shape_count()), dL_dincrements.betas);
            add(coefficients.subspan(shape_count(), expression_count()), dL_dincrements.expression);
        }
    }

    /// The motion with increments added, in double. Frames with increments of zero are bit-identical to the estimate.
    /// increments(t) returns frame t's PoseIncrements<const T> in host memory.
    template <class Increments>
    [[nodiscard]] Motion corrected(const Increments& increments) const {
        Motion result = motion_;
        const auto add = [](Span<const T> w, double* to) {
            for (const T number : w) *to++ += static_cast<double>(number);
        };
        for (std::size_t t = 0; t < frame_count(); ++t) {
            const PoseIncrements<const T> w = increments(t);
            const Span<const vec3<T>> turns = view_as<const vec3<T>>(w.pose);
            for (std::size_t j = 0; j < joint_count(); ++j) {
                vec3<double>& v = result.pose[t * joint_count() + j];
                v = nearest_axis_angle(turned(v, vec3<double>(turns[j])), v);
            }
            result.transl[t] += vec3<double>(view_as<const vec3<T>>(w.transl)[0]);
            add(w.expression, result.expression.data() + t * expression_count());
            if (t == 0) add(w.betas, result.betas.data());
        }
        return result;
    }

private:
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    void complete(const RigData& rig) {
        constexpr std::string_view where = "EstimatedMotion";
        const std::size_t S = rig.betas.size(), E = static_cast<std::size_t>(rig.body.expression_count);
        check_value(motion_.betas.size() <= S, where,
                    "the motion has more betas than the rig; drop the rest, or make the rig with them");
        check_value(motion_.expression_count <= E, where,
                    "the motion has more expression coefficients than the rig; drop the rest");
        validate(motion_, rig.body, where);
        check_value(frame_count() > 0, where, "the motion has no frames");
        if (motion_.betas.empty()) motion_.betas = rig.betas;
        motion_.betas.resize(S, 0);
        std::vector<double> expression(frame_count() * E, 0);
        for (std::size_t t = 0; t < frame_count(); ++t)
            std::copy_n(motion_.expression_at(t).begin(), motion_.expression_count,
                        expression.begin() + static_cast<std::ptrdiff_t>(t * E));
        motion_.expression = std::move(expression);
        motion_.expression_count = E;
    }

    void upload() {
        std::vector<vec3<T>> pose;
        for (const vec3<double>& v : motion_.pose) {
            const bool long_way =
                dot(v, v) > 3.14159265358979 * 3.14159265358979; // the adjoint requires half a turn at most
            pose.push_back(vec3<T>(long_way ? axis_angle_from_rotation(rotation_from_axis_angle(v)) : v));
        }
        assign(*backend_, pose, pose_);
        std::vector<T> transl;
        for (const vec3<double>& v : motion_.transl) transl.insert(transl.end(), {T(v.x), T(v.y), T(v.z)});
        assign(*backend_, transl, transl_);
        assign(*backend_, std::vector<T>(motion_.expression.begin(), motion_.expression.end()), expression_);
        assign(*backend_, std::vector<T>(motion_.betas.begin(), motion_.betas.end()), betas_);
    }

    [[nodiscard]] Span<const vec3<T>> pose_at(std::size_t frame) const {
        return pose().subspan(frame * joint_count(), joint_count());
    }

    void check(std::string_view where, std::size_t frame, const PoseIncrements<const T>& increments) const {
        check_frame(where, frame, frame_count());
        const auto part = [&](std::string_view name, Span<const T> numbers, std::size_t size) {
            check_size(where, name, numbers.size(), size, "pass the increments of one frame");
            check_memory(*backend_, where, name, numbers);
        };
        part("pose", increments.pose, 3 * joint_count());
        part("transl", increments.transl, 3);
        part("expression", increments.expression, expression_count());
        part("betas", increments.betas, shape_count());
    }

    B* backend_;
    Motion motion_;
    Buffer<vec3<T>> pose_;                  // [T, J]
    Buffer<T> transl_, expression_, betas_; // [T, 3], [T, E], [S]
};

} // namespace gsh
