// SPDX-License-Identifier: Apache-2.0
/// @file  Fits the motion and the shape of a body to keypoints and masks of photographs.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/keypoints.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/fit/frame_kinematics.hpp>
#include <gsh/fit/motion_fit.hpp>
#include <gsh/fit/motion_fitter.hpp>
#include <gsh/fit/motion_state.hpp>
#include <gsh/fit/time_offsets.hpp>
#include <gsh/fit/view_corrections.hpp>
#include <gsh/fit/view_keypoints.hpp>
#include <gsh/fit/view_misfit.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <limits>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace gsh {

/// Fits one person's motion.
///
/// Stages: (1) sides that other views, or the views before and after, contradict are swapped back, and points that jump
/// are left out; (2) each frame starts in a usual pose, turned and placed by its trunk (motion_start); (3) all frames
/// of a window descend at once, first with strong priors and without fingers; sides that the motion contradicts are
/// swapped back, and offsets of the cameras' clocks and shifts of their principal points are found; (4) the same with
/// weak priors, and, if the person turns in place, with one pose and one axis for all frames; (5) with masks, the
/// outlines of the body are drawn to those of the masks, three times anew, which finds the shape.
///
/// One camera sees depth by perspective and size alone: give the height if it is known.
///
/// Shapes  cameras [C]; photos in any order, at most one for each camera and frame; times [T] ascending, seconds.
/// Frame   the world of the cameras. y need not be up.
/// Errors  ValueError for a camera or frame that does not exist, a photograph that occurs twice, keypoints that are not
///         finite, times that do not ascend, or without any photograph that shows the person.
template <std::same_as<double> Real = double> // compiled only where it is called: Eigen's solvers take seconds
[[nodiscard]] MotionFit fit_motion(const BodyModel& body, const std::vector<Camera<double>>& cameras,
                                   const std::vector<PersonPhoto>& photos, const std::vector<double>& times,
                                   const MotionFitParams& params = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

inline std::vector<std::vector<ViewKeypoints>> checked_views(const std::vector<Camera<double>>& cameras,
                                                             const std::vector<PersonPhoto>& photos,
                                                             const std::vector<double>& times) {
    constexpr const char* where = "fit_motion";
    for (std::size_t t = 1; t < times.size(); ++t)
        check_value(times[t] > times[t - 1], where,
                    "frame " + std::to_string(t) + " is not later than the frame before it; times must ascend");
    std::vector<std::vector<ViewKeypoints>> views(times.size());
    for (const PersonPhoto& photo : photos) {
        const std::string of =
            "photograph of camera " + std::to_string(photo.camera) + " and frame " + std::to_string(photo.frame);
        check_value(photo.camera < cameras.size() && photo.frame < times.size(), where,
                    of + ", expected one of " + std::to_string(cameras.size()) + " cameras and " +
                        std::to_string(times.size()) + " frames");
        ViewKeypoints view{cameras[photo.camera], {}, photo.person.metric, photo.camera, photo.mask};
        for (const Keypoint& point : photo.person.points) {
            check_value(std::isfinite(point.pixel.x) && std::isfinite(point.pixel.y) && point.confidence >= 0 &&
                            point.confidence <= 1,
                        where, of + " has a keypoint that is not finite, or a confidence outside of [0, 1]");
            constexpr double least_confidence = 0.1; // detectors guess what they do not see
            if (point.confidence >= least_confidence) view.points.push_back(point);
        }
        if (view.points.empty()) continue;
        for (const ViewKeypoints& other : views[photo.frame])
            check_value(other.camera_number != photo.camera, where, of + " is given twice");
        views[photo.frame].push_back(std::move(view));
    }
    for (auto& frame : views) // the order of the photographs does not matter
        std::sort(frame.begin(), frame.end(),
                  [](const ViewKeypoints& a, const ViewKeypoints& b) { return a.camera_number < b.camera_number; });
    return views;
}

/// A motion's state as a Motion.
inline Motion motion_of(const BodyModel& model, const FittedBody& body, const MotionState& state,
                        const std::vector<double>& times) {
    Motion motion;
    motion.joint_count = body.parents.size();
    motion.betas = state.betas;
    motion.betas.resize(static_cast<std::size_t>(model.shape_count), 0.0);
    motion.timestamps = times;
    for (const FrameNumbers& frame : state.frames) {
        std::vector<vec3<double>> pose = body.pose(frame.angles);
        pose[0] = axis_angle_from_rotation(frame.root);
        motion.pose.insert(motion.pose.end(), pose.begin(), pose.end());
        motion.transl.push_back(frame.transl);
    }
    return motion;
}

/// Appends the frames of a window whose first `overlap` frames are also the state's last: these go over from one to
/// the other.
inline void append_window(MotionState& state, const MotionState& window, std::size_t overlap) {
    for (std::size_t k = 0; k < window.frames.size(); ++k) {
        if (k >= overlap) {
            state.frames.push_back(window.frames[k]);
            continue;
        }
        FrameNumbers& frame = state.frames[state.frames.size() - overlap + k];
        const FrameNumbers& next = window.frames[k];
        const double u = (static_cast<double>(k) + 1) / (static_cast<double>(overlap) + 1);
        frame.root =
            frame.root * rotation_from_axis_angle(axis_angle_from_rotation(transpose(frame.root) * next.root) * u);
        frame.transl += (next.transl - frame.transl) * u;
        for (std::size_t a = 0; a < frame.angles.size(); ++a) frame.angles[a] += u * (next.angles[a] - frame.angles[a]);
    }
}

} // namespace detail

template <std::same_as<double> Real>
MotionFit fit_motion(const BodyModel& body, const std::vector<Camera<double>>& cameras,
                     const std::vector<PersonPhoto>& photos, const std::vector<double>& times,
                     const MotionFitParams& params) {
    constexpr const char* where = "fit_motion";
    check_value(!times.empty(), where, "there are no frames");
    check_value(params.window > 60, where, "window must be above 60 frames");
    check_value(!params.height || (*params.height > 0.3 && *params.height < 3), where,
                "height must lie between 0.3 and 3 metres");
    const std::optional<CameraFindings>& known = params.cameras;
    check_value(
        !known || (known->time_offsets.size() == cameras.size() && known->shifts.size() == cameras.size()), where,
        "what is known of the cameras must have an offset and a shift for each of " + std::to_string(cameras.size()));
    std::vector<std::vector<ViewKeypoints>> views = detail::checked_views(cameras, photos, times);
    check_value(std::any_of(views.begin(), views.end(), [](const auto& frame) { return !frame.empty(); }), where,
                "no photograph shows the person");
    MotionFit fit;
    static_cast<ViewCorrections&>(fit) = correct_views(views, cameras.size());
    const FittedBody fitted(body, params.betas, params.landmarks);
    fit.time_offsets.assign(cameras.size(), 0.0);
    fit.shifts.assign(cameras.size(), vec2<double>(0));
    fit.time_errors.assign(cameras.size(), TimeOffset{}.error);
    const auto at_found_times = [&](std::vector<std::vector<ViewKeypoints>>& shown, Span<const double> of) {
        if (std::any_of(fit.time_offsets.begin(), fit.time_offsets.end(), [](double s) { return s != 0; }))
            shown = at_common_times(shown, of, fit.time_offsets);
        for (auto& frame : shown)
            for (ViewKeypoints& view : frame)
                view.camera.cx += fit.shifts[view.camera_number].x, view.camera.cy += fit.shifts[view.camera_number].y;
    };
    if (known) {
        static_cast<CameraFindings&>(fit) = *known;
        at_found_times(views, times);
        for (auto& frame : views)
            for (ViewKeypoints& view : frame) view.camera.fx *= known->focal, view.camera.fy *= known->focal;
    }
    MotionFitParams of_window = params;
    of_window.learn_focal = params.learn_focal && !known;

    // Windows of frames; the later ones begin a little before the end of those before, and keep shape and focal length.
    const std::size_t T = times.size(), overlap = 20;
    MotionState state;
    fit.frame_fit.assign(T, std::numeric_limits<double>::quiet_NaN());
    std::vector<std::vector<double>> pixels(cameras.size()), metres(cameras.size());
    for (std::size_t begin = 0; begin < T;) {
        const bool first = begin == 0;
        // a short rest is fitted with the window before it
        const std::size_t end = T - begin <= params.window + params.window / 2 ? T : begin + params.window;
        const auto part = [&](const auto& all) {
            using List = std::decay_t<decltype(all)>;
            return List(all.begin() + static_cast<std::ptrdiff_t>(begin),
                        all.begin() + static_cast<std::ptrdiff_t>(end));
        };
        auto shown = part(views);
        if (!first && !known) at_found_times(shown, part(times));
        detail::MotionFitter<Real> fitter(body, fitted, std::move(shown), part(times), cameras.size(), of_window);
        if (!first) fitter.hold_shared(state);
        fitter.run(fit, begin, first && !known, [&](double share) {
            if (params.progress)
                params.progress((static_cast<double>(begin) + share * static_cast<double>(end - begin)) /
                                static_cast<double>(T));
        });
        for (std::size_t t = begin; t < end; ++t) {
            const auto places = detail::places_of(
                fitted, FrameKinematics(fitted, fitter.state().frames[t - begin], fitter.state().betas));
            std::vector<double> of_frame;
            for (const ViewKeypoints& view : fitter.views()[t - begin]) {
                const ViewMisfit misfit = view_misfit(view, places, std::exp(fitter.state().log_focal));
                of_frame.insert(of_frame.end(), misfit.metres.begin(), misfit.metres.end());
                auto& px = pixels[view.camera_number];
                auto& m = metres[view.camera_number];
                px.insert(px.end(), misfit.pixels.begin(), misfit.pixels.end());
                m.insert(m.end(), misfit.metres.begin(), misfit.metres.end());
            }
            fit.frame_fit[t] = detail::median_or_nan(of_frame);
        }
        if (first) state = fitter.state();
        else detail::append_window(state, fitter.state(), overlap);
        begin = end == T ? T : end - overlap;
    }
    for (std::size_t c = 0; c < cameras.size(); ++c)
        fit.camera_fit.push_back(
            {detail::median_or_nan(pixels[c]), detail::median_or_nan(metres[c]), pixels[c].size()});
    std::sort(fit.swapped.begin(), fit.swapped.end());
    if (!known) fit.focal = std::exp(state.log_focal);
    fit.motion = detail::motion_of(body, fitted, state, times);
    fit.state = std::move(state);
    return fit;
}

} // namespace gsh
