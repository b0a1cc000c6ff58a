// SPDX-License-Identifier: Apache-2.0
/// @file  Refinement: estimated poses, shape, expressions and cameras are corrected while the avatar learns.
#pragma once

#include <gsh/avatar/rig.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/camera/camera_increment.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/loss/motion_terms.hpp>
#include <gsh/math/rotation_increment.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/train/refinement_config.hpp>
#include <gsh/train/refinement_tables.hpp>

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

template <class T>
struct PullGradient {
    T weight;
    Span<const T> increments;
    Span<T> gradient;
    GSH_HD void operator()(std::size_t i) const { gradient[i] += weight * increments[i]; }
};

/// One camera: gradients of the camera and of its centre become the gradient of its increment.
template <class T>
struct MovedCameraBackward {
    Camera<T> initial;
    vec3<T> pivot;
    Span<const CameraIncrement<T>> increment;
    Span<const CameraGradient<T>> dL_dcamera;
    Span<const vec3<T>> dL_dcenter; // or empty
    Span<CameraIncrement<T>> dL_dincrement;
    GSH_HD void operator()(std::size_t) const {
        CameraGradient<T> dL_dmoved = dL_dcamera[0];
        if (!dL_dcenter.empty()) center_backward(moved_camera(initial, pivot, increment[0]), dL_dcenter[0], dL_dmoved);
        moved_camera_backward(initial, pivot, increment[0], dL_dmoved, dL_dincrement[0]);
    }
};

} // namespace detail

/// Corrections of a motion and its cameras. What is learned are increments w, all zero at first:
///
///     joint   exp(pose) exp(w)           transl + w, expression + w, betas + w
///     camera  moved_camera(camera, the root's mean place, w)
///
/// An increment of a rotation lies in a fixed tangent space near the estimate. It has no singularity within half a
/// turn. Its three numbers are angles about the joint's own axes, so that one rate fits all of them, and Adam's running
/// squares keep their meaning. Axis-angle vectors have none of these properties near pi, where the angle of a person's
/// root often is.
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
                     const RefinementConfig& config = {})
        : backend_(&backend), config_(config), initial_(motion), cameras_(std::move(cameras)),
          joint_count_(rig.joint_count()), shape_count_(rig.betas.size()),
          expression_count_(static_cast<std::size_t>(rig.body.expression_count)),
          tables_(backend, {frame_count(), joint_count_, expression_count_, shape_count_, cameras_.size()}) {
        complete_motion(rig);
        check_config();
        const std::vector<FrameLink> links = link_frames(initial_.timestamps, config_.left_out, config_.longest_gap);
        left_out_.assign(frame_count(), false);
        for (const std::size_t frame : config_.left_out) left_out_[frame] = true;
        fixed_camera_.assign(cameras_.size(), false);
        for (const std::size_t camera : config_.fixed_cameras)
            if (camera < cameras_.size()) fixed_camera_[camera] = true;
        for (const vec3<double>& transl : initial_.transl)
            pivot_ += (transl + rig.joints[0]) * (1 / static_cast<double>(frame_count()));
        put(links, links_);
        upload_initial();
    }

    [[nodiscard]] const RefinementConfig& config() const { return config_; }
    [[nodiscard]] std::size_t frame_count() const { return initial_.frame_count(); }
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
        check_frame("learns_motion", frame);
        return !left_out_[frame] && (learns(RefinementGroup::pose) || learns(RefinementGroup::transl) ||
                                     learns(RefinementGroup::expression) || learns(RefinementGroup::betas));
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
        check_frame("pose", frame);
        pose.pose.resize(joint_count_);
        pose.transl.resize(1);
        pose.coefficients.resize(shape_count_ + expression_count_);
        backend_->for_each(joint_count_, detail::TurnedPose<T>{initial_pose(frame), pose_increments(frame), pose.pose});
        const auto add = [&](Span<const T> initial, RefinementGroup group, std::size_t row, Span<T> result) {
            backend_->for_each(result.size(), detail::Incremented<T>{initial, tables_.increments(group, row), result});
        };
        add(initial_transl(frame), RefinementGroup::transl, frame, view_as<T>(Span<vec3<T>>(pose.transl)));
        const Span<T> coefficients = pose.coefficients;
        add(initial_betas_, RefinementGroup::betas, 0, coefficients.subspan(0, shape_count_));
        add(initial_expression(frame), RefinementGroup::expression, frame,
            coefficients.subspan(shape_count_, expression_count_));
    }

    /// A present camera. Its nine numbers are downloaded from the backend.
    template <std::floating_point U = T>
    [[nodiscard]] Camera<U> camera(std::size_t camera) const {
        check_camera_index("camera", camera);
        std::array<T, RefinementTables<B, T>::camera_width> host{};
        backend_->download(tables_.camera_increments(camera), Span<T>(host));
        const CameraIncrement<U> increment{{U(host[0]), U(host[1]), U(host[2])},
                                           {U(host[3]), U(host[4]), U(host[5])},
                                           U(host[6]),
                                           {U(host[7]), U(host[8])}};
        return moved_camera(cameras_[camera].template cast<U>(), vec3<U>(pivot_), increment);
    }

    /// Zeros to which a model's backward adds; empty for what does not learn. Pass the result to accumulate.
    [[nodiscard]] RigPoseGradient<T> pose_gradient() {
        RigPoseGradient<T> gradient;
        const auto zeros = [&](auto& buffer, std::size_t count, auto zero) {
            buffer.resize(count);
            backend_->fill(Span(buffer.data(), count), zero);
            return Span(buffer.data(), count);
        };
        if (learns(RefinementGroup::pose)) gradient.pose = zeros(dL_dpose_, joint_count_, vec3<T>(T(0)));
        if (learns(RefinementGroup::transl)) gradient.transl = zeros(dL_dtransl_, 1, vec3<T>(T(0)));
        if (learns(RefinementGroup::expression) || learns(RefinementGroup::betas))
            gradient.coefficients = zeros(dL_dcoefficients_, shape_count_ + expression_count_, T(0));
        return gradient;
    }

    /// Adds a photograph's gradient with respect to the pose of `frame`, in the backend's memory. Empty spans are
    /// skipped.
    /// Errors  ValueError for a frame that is left out.
    void accumulate(std::size_t frame, const RigPoseGradient<T>& dL_dpose) {
        constexpr std::string_view where = "MotionRefinement::accumulate";
        check_frame("accumulate", frame);
        check_value(!left_out_[frame], where, "frame " + std::to_string(frame) + " is left out, yet has a gradient");
        if (!dL_dpose.pose.empty()) {
            check_size(where, "dL_dpose.pose", dL_dpose.pose.size(), joint_count_, "one per joint, or none");
            backend_->for_each(joint_count_, detail::TurnedPoseBackward<T>{
                                                 initial_pose(frame), pose_increments(frame), dL_dpose.pose,
                                                 view_as<vec3<T>>(tables_.gradient(RefinementGroup::pose, frame))});
        }
        if (!dL_dpose.transl.empty()) {
            check_size(where, "dL_dpose.transl", dL_dpose.transl.size(), 1, "one vector, or none");
            add(view_as<const T>(Span<const vec3<T>>(dL_dpose.transl)),
                tables_.gradient(RefinementGroup::transl, frame));
        }
        if (!dL_dpose.coefficients.empty()) {
            check_size(where, "dL_dpose.coefficients", dL_dpose.coefficients.size(), shape_count_ + expression_count_,
                       "betas, then expression, or none");
            const Span<const T> coefficients = dL_dpose.coefficients;
            add(coefficients.subspan(0, shape_count_), tables_.gradient(RefinementGroup::betas, 0));
            add(coefficients.subspan(shape_count_, expression_count_),
                tables_.gradient(RefinementGroup::expression, frame));
        }
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
        backend_->for_each(1, detail::MovedCameraBackward<T>{
                                  cameras_[camera].template cast<T>(), vec3<T>(pivot_),
                                  view_as<const CameraIncrement<T>>(tables_.camera_increments(camera)), dL_dcamera,
                                  dL_dcenter, view_as<CameraIncrement<T>>(tables_.camera_gradient(camera))});
        touch(cameras_touched_, camera);
    }

    /// Adds the gradients of the terms to the accumulated ones, takes a step of Adam in the visited rows, and clears
    /// the gradients.
    void step() {
        const double decay = std::pow(config_.final_rate, progress_);
        each_touched_row([&](RefinementGroup group, std::size_t row) {
            if (learns(group)) add_terms(group, row); // before any row moves, since rows read neighbours
        });
        each_touched_row([&](RefinementGroup group, std::size_t row) {
            if (!learns(group)) return tables_.forget_gradient(group, row);
            const bool pose = group == RefinementGroup::pose;
            tables_.step(group, row, config_.adam, config_[group].rate * decay,
                         pose ? Span<const T>(joint_rates_) : Span<const T>());
        });
        frames_touched_.clear();
        cameras_touched_.clear();
        ++steps_;
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
    void carry_to_left_out() {
        std::vector<std::size_t> kept;
        for (std::size_t t = 0; t < frame_count(); ++t)
            if (!left_out_[t]) kept.push_back(t);
        if (kept.empty()) return;
        const auto& times = initial_.timestamps;
        std::sort(kept.begin(), kept.end(), [&](std::size_t a, std::size_t b) { return times[a] < times[b]; });
        auto host = tables_.host_increments();
        for (std::size_t t = 0; t < frame_count(); ++t) {
            if (!left_out_[t]) continue;
            const auto later =
                std::find_if(kept.begin(), kept.end(), [&](std::size_t k) { return times[k] > times[t]; });
            const std::size_t b = later == kept.end() ? kept.back() : *later,
                              a = later == kept.begin() ? b : *(later - 1);
            const double share = a == b ? 0 : (times[t] - times[a]) / (times[b] - times[a]);
            for (const auto group : frame_groups) {
                const Span<T> mine = host(group, t), before = host(group, a), after = host(group, b);
                for (std::size_t i = 0; i < mine.size(); ++i) mine[i] = T(1 - share) * before[i] + T(share) * after[i];
            }
        }
        tables_.set_increments(host);
    }

    /// The present motion, in double. Estimates of rows that never moved are bit-identical to the input.
    [[nodiscard]] Motion motion() const {
        Motion result = initial_;
        auto host = tables_.host_increments();
        const auto at = [&](RefinementGroup group, std::size_t row, std::size_t i) {
            return static_cast<double>(host(group, row)[i]);
        };
        const auto vector = [&](RefinementGroup group, std::size_t row, std::size_t i) {
            return vec3<double>(at(group, row, 3 * i), at(group, row, 3 * i + 1), at(group, row, 3 * i + 2));
        };
        for (std::size_t t = 0; t < frame_count(); ++t) {
            for (std::size_t j = 0; j < joint_count_; ++j) {
                vec3<double>& v = result.pose[t * joint_count_ + j];
                v = nearest_axis_angle(turned(v, vector(RefinementGroup::pose, t, j)), v);
            }
            result.transl[t] += vector(RefinementGroup::transl, t, 0);
            for (std::size_t k = 0; k < expression_count_; ++k)
                result.expression[t * expression_count_ + k] += at(RefinementGroup::expression, t, k);
        }
        for (std::size_t k = 0; k < shape_count_; ++k) result.betas[k] += at(RefinementGroup::betas, 0, k);
        return result;
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
    static constexpr std::array frame_groups{RefinementGroup::pose, RefinementGroup::transl,
                                             RefinementGroup::expression};
    static constexpr std::array camera_groups{RefinementGroup::camera_rotation, RefinementGroup::camera_translation,
                                              RefinementGroup::camera_focal, RefinementGroup::camera_principal_point};

    void complete_motion(const RigData& rig) {
        constexpr std::string_view where = "MotionRefinement";
        check_value(initial_.betas.size() <= shape_count_, where,
                    "the motion has more betas than the rig; drop the rest, or make the rig with them");
        check_value(initial_.expression_count <= expression_count_, where,
                    "the motion has more expression coefficients than the rig; drop the rest");
        validate(initial_, rig.body, where);
        check_value(frame_count() > 0, where, "the motion has no frames");
        if (initial_.betas.empty()) initial_.betas = rig.betas;
        initial_.betas.resize(shape_count_, 0);
        std::vector<double> expression(frame_count() * expression_count_, 0);
        for (std::size_t t = 0; t < frame_count(); ++t)
            std::copy_n(initial_.expression_at(t).begin(), initial_.expression_count,
                        expression.begin() + static_cast<std::ptrdiff_t>(t * expression_count_));
        initial_.expression = std::move(expression);
        initial_.expression_count = expression_count_;
    }

    void check_config() const {
        constexpr std::string_view where = "MotionRefinement";
        for (std::size_t g = 0; g < refinement_group_count; ++g) {
            const RefinedGroup& group = config_[static_cast<RefinementGroup>(g)];
            const std::string name(refinement_group_names[g]);
            const SequenceWeights& w = group.terms;
            for (const double number : {group.rate, group.start, w.pull, w.drift, w.acceleration})
                check_value(number >= 0 && std::isfinite(number), where,
                            name + " has a rate, start or weight that is negative or not finite");
            check_value(g < static_cast<std::size_t>(RefinementGroup::betas) || (w.drift == 0 && w.acceleration == 0),
                        where,
                        name + " has a weight on drift or acceleration, but only frames follow each other in time; "
                               "give it a pull");
        }
        if (!config_.joint_rates.empty())
            check_size(where, "joint_rates", config_.joint_rates.size(), joint_count_, "one factor per joint, or none");
        for (const double rate : config_.joint_rates)
            check_value(rate >= 0 && std::isfinite(rate), where,
                        "joint_rates holds a factor that is negative or not finite");
        check_value(config_.final_rate > 0 && config_.final_rate <= 1, where, "final_rate must lie in (0, 1]");
        for (std::size_t c = 0; c < cameras_.size(); ++c)
            check_camera(where, "camera " + std::to_string(c), cameras_[c]);
        for (const std::size_t camera : config_.fixed_cameras) // the default contains camera 0 even without cameras
            check_value(camera == 0 || camera < cameras_.size(), where,
                        "camera " + std::to_string(camera) + " is to be fixed, there are " +
                            std::to_string(cameras_.size()));
    }

    template <class From, class To>
    void put(const std::vector<From>& from, To& to) {
        to.resize(from.size());
        backend_->upload(Span<const From>(from), to);
    }
    void upload_initial() {
        std::vector<vec3<T>> pose;
        for (const vec3<double>& v : initial_.pose) {
            const bool long_way =
                dot(v, v) > 3.14159265358979 * 3.14159265358979; // the adjoint requires half a turn at most
            pose.push_back(vec3<T>(long_way ? axis_angle_from_rotation(rotation_from_axis_angle(v)) : v));
        }
        put(pose, initial_pose_);
        std::vector<T> transl;
        for (const vec3<double>& v : initial_.transl) transl.insert(transl.end(), {T(v.x), T(v.y), T(v.z)});
        put(transl, initial_transl_);
        put(std::vector<T>(initial_.expression.begin(), initial_.expression.end()), initial_expression_);
        put(std::vector<T>(initial_.betas.begin(), initial_.betas.end()), initial_betas_);
        put(std::vector<T>(config_.joint_rates.begin(), config_.joint_rates.end()), joint_rates_);
    }

    [[nodiscard]] Span<const vec3<T>> pose_increments(std::size_t frame) const {
        return view_as<const vec3<T>>(tables_.increments(RefinementGroup::pose, frame));
    }
    [[nodiscard]] Span<const vec3<T>> initial_pose(std::size_t frame) const {
        return Span<const vec3<T>>(initial_pose_).subspan(frame * joint_count_, joint_count_);
    }
    [[nodiscard]] Span<const T> initial_transl(std::size_t frame) const {
        return Span<const T>(initial_transl_).subspan(3 * frame, 3);
    }
    [[nodiscard]] Span<const T> initial_expression(std::size_t frame) const {
        return Span<const T>(initial_expression_).subspan(frame * expression_count_, expression_count_);
    }

    [[nodiscard]] RotationSequence<T> pose_sequence() const {
        return {links_, initial_pose_, view_as<const vec3<T>>(tables_.all_increments(RefinementGroup::pose)),
                joint_count_, config_.pose.terms};
    }
    [[nodiscard]] NumberSequence<T> number_sequence(RefinementGroup group) const {
        const bool transl = group == RefinementGroup::transl;
        return {links_, transl ? initial_transl_ : initial_expression_, tables_.all_increments(group),
                transl ? 3 : expression_count_, config_[group].terms};
    }

    void add(Span<const T> from, Span<T> to) { backend_->for_each(to.size(), detail::Accumulate<T>{from, to}); }
    static void touch(std::vector<std::size_t>& touched, std::size_t row) {
        if (std::find(touched.begin(), touched.end(), row) == touched.end()) touched.push_back(row);
    }
    template <class F>
    void each_touched_row(const F& f) {
        for (const std::size_t frame : frames_touched_)
            for (const auto group : frame_groups) f(group, frame);
        if (!frames_touched_.empty()) f(RefinementGroup::betas, 0);
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
            backend_->for_each(into.size(), detail::PullGradient<T>{T(config_[group].terms.pull),
                                                                    tables_.increments(group, row), into});
    }

    void check_frame(std::string_view what, std::size_t frame) const {
        check_value(frame < frame_count(), std::string("MotionRefinement::").append(what),
                    "frame " + std::to_string(frame) + " is asked for, the motion has " +
                        std::to_string(frame_count()) + " frames");
    }
    void check_camera_index(std::string_view what, std::size_t camera) const {
        check_value(camera < cameras_.size(), std::string("MotionRefinement::").append(what),
                    "camera " + std::to_string(camera) + " is asked for, there are " + std::to_string(cameras_.size()));
    }

    B* backend_;
    RefinementConfig config_;
    Motion initial_;
    std::vector<Camera<double>> cameras_;
    std::size_t joint_count_, shape_count_, expression_count_;
    RefinementTables<B, T> tables_;
    std::vector<bool> left_out_, fixed_camera_;
    vec3<double> pivot_ = vec3<double>(0); ///< centre of the cameras' turns: the mean position of the root

    Buffer<FrameLink> links_;      // [T]
    Buffer<vec3<T>> initial_pose_; // [T, J]
    Buffer<T> initial_transl_, initial_expression_, initial_betas_, joint_rates_;
    Buffer<vec3<T>> dL_dpose_, dL_dtransl_; // one frame's
    Buffer<T> dL_dcoefficients_, scratch_;
    std::vector<std::size_t> frames_touched_, cameras_touched_;
    std::uint64_t steps_ = 0;
    double progress_ = 0;
};

} // namespace gsh
