// SPDX-License-Identifier: Apache-2.0
/// @file  Refinement: estimated poses, shape, expressions and cameras are corrected while the avatar learns.
#pragma once

#include <gsh/avatar/rig.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/camera/camera_input.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/loss/motion_terms.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/refine/camera_increments.hpp>
#include <gsh/refine/estimated_motion.hpp>
#include <gsh/refine/frame_increments.hpp>
#include <gsh/refine/refinement_params.hpp>
#include <gsh/refine/refinement_tables.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// Corrections of a motion and its cameras. What is learned are increments w, all zero at first:
///
///     frame   EstimatedMotion::forward(frame, w[frame] + bias)
///     camera  moved_camera(camera, the root's mean place, w)
///
/// A step uses some frames and cameras (one of each, in training). Only their rows move (RefinementTables). The terms
/// between frames (loss/motion_terms.hpp) are gathered for those rows. The steps therefore descend Σ photometric +
/// terms, with the terms counted once per visit.
///
/// Gauges  No picture shows a common movement of all cameras and the body; the first camera therefore stays. Betas have
///         the same effect as learned joints and displacements, and are off. A shift of transl in all frames and the
///         opposite shift of joints and displacements cancel; the pull to the estimate chooses one solution.
/// Shapes  T frames, J joints, S betas and E expression coefficients of the rig, C cameras.
/// Errors  ShapeError, ValueError before any work starts.
template <Backend B, std::floating_point T = float>
class MotionRefinement {
public:
    using Scalar = T;
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    /// `cameras` is empty if no camera is refined. A motion with fewer coefficients than the rig is extended: motion()
    /// returns all of them.
    MotionRefinement(B& backend, const RigData& rig, const Motion& motion, std::vector<Camera<double>> cameras,
                     const RefinementParams& config = {})
        : backend_(&backend), config_(config), estimate_(backend, rig, motion),
          cameras_(backend, std::move(cameras), mean_root(estimate_.motion(), rig)),
          tables_(backend, {.frames = frame_count(),
                            .joints = estimate_.joint_count(),
                            .expression = estimate_.expression_count(),
                            .betas = estimate_.shape_count(),
                            .cameras = cameras_.size(),
                            .pose_bias = config.pose_bias.rate > 0,
                            .transl_bias = config.transl_bias.rate > 0}),
          frame_increments_(backend) {
        constexpr std::string_view where = "MotionRefinement";
        validate(config_, estimate_.joint_count(), cameras_.size(), where);
        for (std::size_t c = 0; c < cameras_.size(); ++c)
            check_camera(where, "camera " + std::to_string(c), cameras_.initial(c));
        const Motion& initial = estimate_.motion();
        const std::vector<FrameLink> links = link_frames(initial.timestamps, config_.left_out, config_.longest_gap);
        left_out_.assign(frame_count(), false);
        for (const std::size_t frame : config_.left_out) left_out_[frame] = true;
        fixed_camera_.assign(cameras_.size(), false);
        for (const std::size_t camera : config_.fixed_cameras)
            if (camera < cameras_.size()) fixed_camera_[camera] = true;
        assign(*backend_, links, links_);
        assign(*backend_, std::vector<T>(config_.joint_rates.begin(), config_.joint_rates.end()), joint_rates_);
    }

    [[nodiscard]] const RefinementParams& config() const { return config_; }
    [[nodiscard]] std::size_t frame_count() const { return estimate_.frame_count(); }
    [[nodiscard]] std::size_t camera_count() const { return cameras_.size(); }
    [[nodiscard]] std::uint64_t step_count() const { return steps_; }

    /// progress in [0, 1] is the share of the run that is over. Groups start at their RefinedGroup::start, and rates
    /// fall to final_rate.
    void set_progress(double progress) { progress_ = std::clamp(progress, 0.0, 1.0); }

    /// Whether the next step moves the group, so that its gradient is needed.
    [[nodiscard]] bool learns(RefinementGroup group) const {
        return config_[group].rate > 0 && progress_ >= config_[group].start;
    }
    [[nodiscard]] bool learns_motion(std::size_t frame) const {
        check_frame("MotionRefinement::learns_motion", frame, frame_count());
        return !left_out_[frame] && (learns_pose() || learns_transl() || learns(RefinementGroup::expression) ||
                                     learns(RefinementGroup::betas));
    }
    [[nodiscard]] bool learns_camera(std::size_t camera) const {
        check_camera_index("learns_camera", camera);
        return !fixed_camera_[camera] &&
               (learns(RefinementGroup::camera_rotation) || learns(RefinementGroup::camera_translation) ||
                learns(RefinementGroup::camera_focal) || learns(RefinementGroup::camera_principal_point));
    }

    /// Computes a frame's present pose in the backend's memory, without an upload. Before the first step it is
    /// bit-identical to that of Rig::upload_pose, except that rotations beyond half a turn are those of the shorter
    /// way.
    void pose(std::size_t frame, RigPose<B, T>& pose) const {
        check_frame("MotionRefinement::pose", frame, frame_count());
        estimate_.forward(frame, frame_increments_.forward(tables_, frame), pose);
    }

    /// A present camera. Its nine numbers are downloaded from the backend.
    template <std::floating_point U = T>
    [[nodiscard]] Camera<U> camera(std::size_t camera) const {
        check_camera_index("camera", camera);
        return cameras_.template download<U>(tables_, camera);
    }

    /// The same for work on the backend. It is computed there, without a wait, and holds until the next call or step.
    [[nodiscard]] CameraInput<T> camera_input(std::size_t camera) const {
        check_camera_index("camera_input", camera);
        return cameras_.forward(tables_, camera);
    }

    /// Zeros to which a model's backward adds; empty for what does not learn. Pass the result to accumulate.
    [[nodiscard]] RigPoseGradient<T> pose_gradient() {
        RigPoseGradient<T> gradient;
        const auto zeros = [&](auto& buffer, std::size_t count, auto zero) {
            buffer.resize(count);
            backend_->fill(Span(buffer.data(), count), zero);
            return Span(buffer.data(), count);
        };
        if (learns_pose()) gradient.pose = zeros(dL_dpose_, estimate_.joint_count(), vec3<T>(T(0)));
        if (learns_transl()) gradient.transl = zeros(dL_dtransl_, 1, vec3<T>(T(0)));
        if (learns(RefinementGroup::expression) || learns(RefinementGroup::betas))
            gradient.coefficients =
                zeros(dL_dcoefficients_, estimate_.shape_count() + estimate_.expression_count(), T(0));
        return gradient;
    }

    /// Adds a photograph's gradient with respect to the pose of `frame`, in the backend's memory. Empty spans are
    /// skipped.
    /// Errors  ValueError for a frame that is left out.
    void accumulate(std::size_t frame, const RigPoseGradient<T>& dL_dpose) {
        check_frame("MotionRefinement::accumulate", frame, frame_count());
        check_value(!left_out_[frame], "MotionRefinement::accumulate",
                    "frame " + std::to_string(frame) + " is left out, yet has a gradient");
        frame_increments_.backward(tables_, frame, [&](const auto& increments, const auto& dL_dincrements) {
            estimate_.backward(frame, increments, dL_dpose, dL_dincrements);
        });
        touch(frames_touched_, frame);
    }

    /// Adds a photograph's gradient with respect to the camera that camera() returned, and with respect to its centre
    /// if viewing directions depend on it. Both are in the backend's memory, one element each. The gradient of a fixed
    /// camera is ignored.
    void accumulate_camera(std::size_t camera, Span<const CameraGradient<T>> dL_dcamera,
                           Span<const vec3<T>> dL_dcenter = {}) {
        constexpr std::string_view where = "MotionRefinement::accumulate_camera";
        check_camera_index("accumulate_camera", camera);
        check_size(where, "dL_dcamera", dL_dcamera.size(), 1, "a camera at a time");
        if (!dL_dcenter.empty()) check_size(where, "dL_dcenter", dL_dcenter.size(), 1, "one vector, or none");
        if (fixed_camera_[camera]) return;
        cameras_.backward(tables_, camera, dL_dcamera, dL_dcenter);
        touch(cameras_touched_, camera);
    }

    /// Adds the gradients of the terms to the accumulated ones, takes a step of Adam in the visited rows, and clears
    /// the gradients.
    void step() {
        const double decay = std::pow(config_.final_rate, progress_);
        each_touched_row([&](RefinementGroup group, std::size_t row) {
            if (learns(group)) add_terms(group, row); // before any row moves, since rows read neighbours
        });
        tables_.begin_step();
        each_touched_row([&](RefinementGroup group, std::size_t row) {
            if (!learns(group)) return tables_.forget_gradient(group, row);
            const bool pose = group == RefinementGroup::pose || group == RefinementGroup::pose_bias;
            tables_.step(group, row, config_.adam, config_[group].rate * decay,
                         pose ? Span<const T>(joint_rates_) : Span<const T>());
        });
        tables_.end_step();
        frames_touched_.clear();
        cameras_touched_.clear();
        ++steps_;
    }

    /// Takes back the last `steps` steps, which have changed nothing because the backend had halted (RepeatedStep).
    /// Errors  ValueError for more than RefinementTables::remembered_steps.
    void take_back(std::uint64_t steps) {
        tables_.take_back(steps);
        steps_ -= steps;
    }

    /// The present value of all terms, for reports and tests. Waits for the backend.
    [[nodiscard]] double terms() {
        double total = sequence_value(*backend_, pose_sequence(), scratch_);
        for (const auto group : {RefinementGroup::transl, RefinementGroup::expression})
            total += sequence_value(*backend_, number_sequence(group), scratch_);
        auto host = tables_.host_increments();
        for (std::size_t g = static_cast<std::size_t>(RefinementGroup::betas); g < refinement_group_count; ++g) {
            const auto group = static_cast<RefinementGroup>(g);
            for (std::size_t row = 0; row < tables_.rows(group); ++row)
                for (const T number : host(group, row)) {
                    const double w = static_cast<double>(number);
                    total += config_[group].terms.pull / 2 * w * w;
                }
        }
        return total;
    }

    /// Gives frames that are left out the increments of their neighbours in time: linear between two neighbours, those
    /// of the nearer one at the ends. This corrects the estimator's errors without using these frames' photographs.
    void carry_to_left_out() { carry_increments(tables_, estimate_.motion().timestamps, left_out_); }

    /// The present motion, in double. Estimates of rows that never moved are bit-identical to the input.
    [[nodiscard]] Motion motion() const {
        auto host = tables_.host_increments();
        const auto add_bias = [&](RefinementGroup group, RefinementGroup bias, std::size_t frame) {
            const Span<T> own = host(group, frame);
            for (std::size_t i = 0; i < own.size() && tables_.rows(bias) > 0; ++i) own[i] += host(bias, 0)[i];
        };
        return estimate_.corrected([&](std::size_t frame) {
            add_bias(RefinementGroup::pose, RefinementGroup::pose_bias, frame);
            add_bias(RefinementGroup::transl, RefinementGroup::transl_bias, frame);
            return PoseIncrements<const T>{host(RefinementGroup::pose, frame), host(RefinementGroup::transl, frame),
                                           host(RefinementGroup::expression, frame), host(RefinementGroup::betas, 0)};
        });
    }
    [[nodiscard]] std::vector<Camera<double>> cameras() const {
        std::vector<Camera<double>> result;
        for (std::size_t c = 0; c < cameras_.size(); ++c) result.push_back(camera<double>(c));
        return result;
    }

    /// One row's increments, in the backend's memory.
    [[nodiscard]] Span<T> increments(RefinementGroup group, std::size_t row) { return tables_.increments(group, row); }
    [[nodiscard]] Span<const T> increments(RefinementGroup group, std::size_t row) const {
        return tables_.increments(group, row);
    }

    /// Everything that steps have changed. Gradients that were accumulated since the last step are not part of it.
    [[nodiscard]] RefinementState<T> state() const {
        RefinementState<T> state = tables_.state();
        state.steps = steps_;
        return state;
    }
    /// Continues from state(), bit-identically.
    /// Errors  ShapeError for the state of another motion, rig or number of cameras; then nothing changes.
    void set_state(const RefinementState<T>& state) {
        tables_.set_state(state);
        steps_ = state.steps;
        frames_touched_.clear();
        cameras_touched_.clear();
    }

private:
    static constexpr std::array shared_groups{RefinementGroup::betas, RefinementGroup::pose_bias,
                                              RefinementGroup::transl_bias}; ///< of all frames

    /// The mean position of the root, about which cameras turn.
    static vec3<double> mean_root(const Motion& motion, const RigData& rig) {
        vec3<double> mean(0);
        for (const vec3<double>& transl : motion.transl)
            mean += (transl + rig.joints[0]) * (1 / static_cast<double>(motion.frame_count()));
        return mean;
    }

    [[nodiscard]] bool learns_pose() const {
        return learns(RefinementGroup::pose) || learns(RefinementGroup::pose_bias);
    }
    [[nodiscard]] bool learns_transl() const {
        return learns(RefinementGroup::transl) || learns(RefinementGroup::transl_bias);
    }

    [[nodiscard]] RotationSequence<T> pose_sequence() const {
        return {links_, estimate_.pose(), view_as<const vec3<T>>(tables_.all_increments(RefinementGroup::pose)),
                estimate_.joint_count(), config_.pose.terms};
    }
    [[nodiscard]] NumberSequence<T> number_sequence(RefinementGroup group) const {
        const bool transl = group == RefinementGroup::transl;
        return {links_, transl ? estimate_.transl() : estimate_.expression(), tables_.all_increments(group),
                transl ? 3 : estimate_.expression_count(), config_[group].terms};
    }

    static void touch(std::vector<std::size_t>& touched, std::size_t row) {
        if (std::find(touched.begin(), touched.end(), row) == touched.end()) touched.push_back(row);
    }
    template <class F>
    void each_touched_row(const F& f) {
        for (const std::size_t frame : frames_touched_)
            for (const auto group : frame_groups) f(group, frame);
        for (const auto group : shared_groups)
            if (!frames_touched_.empty() && tables_.rows(group) > 0) f(group, 0);
        for (const std::size_t camera : cameras_touched_)
            for (const auto group : camera_groups) f(group, camera);
    }

    void add_terms(RefinementGroup group, std::size_t row) {
        const Span<T> into = tables_.gradient(group, row);
        if (group == RefinementGroup::pose)
            sequence_backward(*backend_, pose_sequence(), row, view_as<vec3<T>>(into));
        else if (group == RefinementGroup::transl || group == RefinementGroup::expression)
            sequence_backward(*backend_, number_sequence(group), row, into);
        else
            pull_backward(*backend_, T(config_[group].terms.pull), Span<const T>(tables_.increments(group, row)), into);
    }

    void check_camera_index(std::string_view what, std::size_t camera) const {
        if (camera >= cameras_.size())
            throw ValueError("MotionRefinement::" + std::string(what) + ": camera " + std::to_string(camera) +
                             " does not exist; the refinement has " + std::to_string(cameras_.size()) + " cameras");
    }

    B* backend_;
    RefinementParams config_;
    EstimatedMotion<B, T> estimate_;
    mutable CameraIncrements<B, T> cameras_;
    RefinementTables<B, T> tables_;
    mutable FrameIncrements<B, T> frame_increments_;
    std::vector<bool> left_out_, fixed_camera_;

    Buffer<FrameLink> links_; // [T]
    Buffer<T> joint_rates_;   // [J], or empty
    Buffer<vec3<T>> dL_dpose_, dL_dtransl_; // one frame's
    Buffer<T> dL_dcoefficients_, scratch_;
    std::vector<std::size_t> frames_touched_, cameras_touched_;
    std::uint64_t steps_ = 0;
    double progress_ = 0;
};

} // namespace gsh
