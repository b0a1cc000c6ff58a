// SPDX-License-Identifier: Apache-2.0
/// @file  One window of frames whose motion is fitted, stage by stage.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/landmarks.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/fit/body_height.hpp>
#include <gsh/fit/frame_kinematics.hpp>
#include <gsh/fit/motion_descent.hpp>
#include <gsh/fit/motion_fit.hpp>
#include <gsh/fit/motion_problem.hpp>
#include <gsh/fit/motion_start.hpp>
#include <gsh/fit/motion_state.hpp>
#include <gsh/fit/outline_shifts.hpp>
#include <gsh/fit/outlines.hpp>
#include <gsh/fit/stuck_limbs.hpp>
#include <gsh/fit/time_offsets.hpp>
#include <gsh/fit/turn.hpp>
#include <gsh/fit/view_corrections.hpp>
#include <gsh/fit/view_keypoints.hpp>
#include <gsh/math/spread.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <functional>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

namespace gsh::detail {

/// The places of a frame's landmarks, as view_misfit() asks for them.
inline auto places_of(const FittedBody& body, FrameKinematics kinematics) {
    return [&body, kinematics = std::move(kinematics)](int landmark) -> std::optional<vec3<double>> {
        if (body.marks[static_cast<std::size_t>(landmark)].joint < 0) return std::nullopt;
        return kinematics.landmark(landmark);
    };
}

/// NaN of none.
inline double median_or_nan(const std::vector<double>& values) {
    return values.empty() ? std::numeric_limits<double>::quiet_NaN() : median(values);
}

/// One fit in progress. A template so that Eigen's solvers are compiled only where a motion is fitted.
template <std::same_as<double> Real = double>
class MotionFitter {
public:
    MotionFitter(const BodyModel& model, const FittedBody& body, std::vector<std::vector<ViewKeypoints>> views,
                 std::vector<double> times, std::size_t camera_count, const MotionFitParams& params)
        : model_(&model), body_(&body), params_(&params), views_(std::move(views)), times_(std::move(times)),
          camera_count_(camera_count), problem_(body, views_, times_), state_(motion_start(body, views_)) {
        const BodyHeight height(model, body.shape_count);
        problem_.set_height(height.mean, height.directions);
        terms_.height = params.height;
        if (params.learn_focal) terms_.focal_spread = 0.15;
    }

    /// Continues a longer motion: with its shape and focal length.
    void hold_shared(const MotionState& from) {
        state_.betas = from.betas, state_.log_focal = from.log_focal;
        terms_.hold_shared = true;
    }

    void run(MotionFit& fit, std::size_t first_frame, bool find_offsets, const std::function<void(double)>& done) {
        terms_.metric = 2, terms_.prior = 1, terms_.fingers = false;
        descend(problem_, state_, terms_, 12, 1e-2);
        if (swap_back(fit, first_frame)) descend(problem_, state_, terms_, 8, 1e-2);
        free_limbs();
        done(0.2);
        terms_.metric = 0.3, terms_.prior = 0.3;
        if (find_offsets && camera_count_ > 1) {
            descend(problem_, state_, terms_, 8, 1e-3);
            find_time_offsets(fit);
            find_shifts(fit);
        }
        done(0.3);
        fit.turn = turn_of(*body_, state_);
        fit.held = params_->turn.value_or(one_camera() && fit.turn);
        if (fit.held) terms_.statue = 30, terms_.metric = 0.05;
        descend(problem_, state_, terms_, 25, 1e-3);
        if (swap_back(fit, first_frame)) descend(problem_, state_, terms_, 8, 1e-3);
        free_limbs();
        done(0.5);
        const bool masks = std::any_of(views_.begin(), views_.end(), [](const auto& frame) {
            return std::any_of(frame.begin(), frame.end(), [](const ViewKeypoints& view) { return bool(view.mask); });
        });
        if (masks) {
            const OutlineSamples samples(*model_, *body_);
            const auto draw = [&](double reach, int steps, double tolerance) {
                find_outlines(fit, samples, reach);
                descend(problem_, state_, terms_, steps, tolerance);
            };
            terms_.outline = 80, terms_.fingers = false;
            draw(0.10, 4, 1e-3);
            if (find_offsets)
                for (int pass = 0; pass < 8 && refine_shifts(fit, samples); ++pass) draw(0.06, 4, 1e-3);
            done(0.7);
            draw(0.06, 4, 1e-3);
            done(0.8);
            terms_.fingers = true;
            draw(0.06, 10, 3e-4);
            problem_.set_outlines(samples, {}, {}); // they end with this function
        } else {
            terms_.fingers = true;
            descend(problem_, state_, terms_, 12, 3e-4);
        }
        done(1);
    }

    [[nodiscard]] const MotionState& state() const { return state_; }
    [[nodiscard]] const std::vector<std::vector<ViewKeypoints>>& views() const { return views_; }

private:
    const BodyModel* model_;
    const FittedBody* body_;
    const MotionFitParams* params_;
    std::vector<std::vector<ViewKeypoints>> views_;
    std::vector<double> times_;
    std::size_t camera_count_;
    MotionProblem problem_; // sees views_
    MotionState state_;
    MotionTerms terms_;

    [[nodiscard]] bool one_camera() const {
        return std::all_of(views_.begin(), views_.end(), [](const auto& frame) { return frame.size() <= 1; });
    }

    void free_limbs() {
        if (free_stuck_limbs(*body_, state_, views_, times_, terms_) > 0) descend(problem_, state_, terms_, 8, 1e-3);
    }

    bool swap_back(MotionFit& fit, std::size_t first_frame) {
        const auto places = [&](std::size_t t) {
            return places_of(*body_, FrameKinematics(*body_, state_.frames[t], state_.betas));
        };
        return swap_sides_against_motion(views_, places, fit.swapped, std::exp(state_.log_focal), first_frame);
    }

    /// Moves the keypoints of cameras whose clocks differ to the common times.
    void find_time_offsets(MotionFit& fit) {
        const auto taken = views_;
        const double frame =
            times_.size() > 1 ? (times_.back() - times_.front()) / static_cast<double>(times_.size() - 1) : 1;
        std::vector<double> offsets(camera_count_, 0.0);
        for (int pass = 0; pass < 4; ++pass) {
            const auto found = time_offsets(*body_, state_, views_, times_, camera_count_);
            double most = 0;
            for (std::size_t c = 0; c < camera_count_; ++c) {
                fit.time_errors[c] = found[c].error;
                double next = std::clamp(offsets[c] + found[c].seconds, -2 * frame, 2 * frame);
                if (std::abs(next) < std::max(0.1 * frame, 4 * found[c].error)) next = 0;
                most = std::max(most, std::abs(next - offsets[c]));
                offsets[c] = next;
            }
            if (most < 0.02 * frame) break;
            views_ = at_common_times(taken, times_, offsets);
            descend(problem_, state_, terms_, 8, 1e-3);
        }
        fit.time_offsets = offsets;
    }

    /// Moves the principal points of cameras that point beside their calibration: of three or more cameras, those whose
    /// keypoints lie beside the body by more than 0.5% of the image, which is more than detectors err on average.
    void find_shifts(MotionFit& fit) {
        if (camera_count_ < 3) return;
        for (int pass = 0; pass < 4; ++pass) {
            const auto found = time_offsets(*body_, state_, views_, times_, camera_count_);
            bool any = false;
            for (std::size_t c = 0; c < camera_count_; ++c) {
                constexpr double least = 0.005; // of the longer side
                const vec2<double> next = fit.shifts[c] + found[c].shift;
                if (std::hypot(next.x, next.y) >= least * longer_side(c)) any |= move_camera(fit, c, found[c].shift);
            }
            if (!any) return;
            descend(problem_, state_, terms_, 6, 1e-3);
        }
    }

    /// The same by outlines, which tell shifts of less than a pixel: those four times as large as their errors. The
    /// body has followed them in part, so cameras that have moved go on as long as there is something left. Returns
    /// whether any camera moved.
    bool refine_shifts(MotionFit& fit, const OutlineSamples& samples) {
        if (camera_count_ < 3) return false;
        const std::vector<OutlineShift> found = outline_shifts(*body_, samples, state_, views_, camera_count_);
        bool any = false;
        for (std::size_t c = 0; c < camera_count_; ++c) {
            constexpr double worth = 0.25, rest = 0.1; // pixels
            const auto& [shift, error] = found[c];
            const double least =
                fit.shifts[c] == vec2<double>(0) ? std::max(worth, 4 * std::hypot(error.x, error.y)) : rest;
            if (std::hypot(shift.x, shift.y) > least) any |= move_camera(fit, c, shift);
        }
        return any;
    }

    /// Of a camera's images; 0 without any.
    [[nodiscard]] double longer_side(std::size_t camera) const {
        for (const auto& frame : views_)
            for (const ViewKeypoints& view : frame)
                if (view.camera_number == camera) return std::max(view.camera.width, view.camera.height);
        return 0;
    }
    /// Moves a camera's principal point by some pixels, unless it would be farther from its calibration than is likely.
    bool move_camera(MotionFit& fit, std::size_t camera, const vec2<double>& by) {
        constexpr double most = 0.03; // of the longer side
        const vec2<double> next = fit.shifts[camera] + by;
        if (std::hypot(next.x, next.y) > most * longer_side(camera)) return false;
        for (auto& frame : views_)
            for (ViewKeypoints& view : frame)
                if (view.camera_number == camera) view.camera.cx += by.x, view.camera.cy += by.y;
        fit.shifts[camera] = next;
        return true;
    }

    void find_outlines(MotionFit& fit, const OutlineSamples& samples, double reach) {
        std::vector<std::vector<std::vector<OutlinePoint>>> points(views_.size());
        fit.outlines = 0;
        for (std::size_t t = 0; t < views_.size(); ++t)
            for (const ViewKeypoints& view : views_[t]) {
                auto& found = points[t].emplace_back();
                if (!view.mask) continue;
                found = samples.find(*body_, state_.frames[t], state_.betas, view.camera, std::exp(state_.log_focal),
                                     view.mask, reach);
                fit.outlines += !found.empty();
            }
        problem_.set_outlines(samples, std::move(points), state_.betas);
    }
};

} // namespace gsh::detail
