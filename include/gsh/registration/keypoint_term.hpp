// SPDX-License-Identifier: Apache-2.0
/// @file  The keypoint term: landmarks are projected and compared with what a detector found, with adjoint.
#pragma once

#include <gsh/avatar/rig.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/body/blend_shapes.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/keypoints.hpp>
#include <gsh/body/landmarks.hpp>
#include <gsh/body/motion_landmarks.hpp>
#include <gsh/body/skeleton.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/ordered_indices.hpp>
#include <gsh/core/span.hpp>
#include <gsh/fit/view_keypoints.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/photo/loss_term.hpp>

#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

struct KeypointTermParams {
    double weight = 0.02;
    double reach = 0.01; ///< share of an image's height beyond which a distance counts linearly
};

namespace detail {

/// A keypoint as the term reads it.
struct PulledKeypoint {
    vec2<double> pixel;
    vec3<double> offset;      // of its landmark from the joint, in the joint's frame
    double confidence, delta; // delta in pixels
    std::uint32_t view;       // of all frames' views
};

/// Element j: what the keypoints at joint j cost and how they pull its bone. They are summed in their order, so the
/// bits are the same on any number of threads.
template <class T>
struct KeypointPull {
    Span<const PulledKeypoint> points; // of all frames, each frame's by joint
    Span<const std::uint32_t> first;   // [J + 1] of the frame
    Span<const Camera<double>> views;
    Span<const vec3<T>> joints;
    Span<const Affine<T>> bones;
    double scale;              // weight / n
    Span<double> cost;         // [J]
    Span<Affine<T>> dL_dbones; // [J]
    Span<vec3<T>> dL_djoints;  // [J]

    GSH_HD void operator()(std::size_t j) const {
        double sum = 0;
        Affine<T> dL_dbone = Affine<T>::zero();
        vec3<T> dL_djoint(T(0));
        for (std::uint32_t k = first[j]; k < first[j + 1]; ++k) {
            const PulledKeypoint& point = points[k];
            const Camera<double>& camera = views[point.view];
            const vec3<double> rest = vec3<double>(joints[j]) + point.offset;
            const vec3<double> world(bones[j](vec3<T>(rest)));
            const vec3<double> p = to_camera(camera, world);
            if (p.z < 0.01) continue;
            const vec2<double> off = (to_pixel(camera, p) - point.pixel) * (1 / point.delta);
            const double root = sqrt(1 + off.x * off.x + off.y * off.y);
            sum += point.confidence * (root - 1);
            CameraGradient<double> ignored{};
            vec3<double> dL_dp(0), dL_dworld(0);
            to_pixel_backward(camera, p, off * (scale * point.confidence / (root * point.delta)), dL_dp, ignored);
            to_camera_backward(camera, world, dL_dp, dL_dworld, ignored);
            const vec3<T> dL_dx(dL_dworld); // x = L (J + offset) + t
            dL_dbone.linear += outer(dL_dx, vec3<T>(rest));
            dL_dbone.translation += dL_dx;
            dL_djoint += transpose(bones[j].linear) * dL_dx;
        }
        cost[j] = scale * sum;
        dL_dbones[j] = dL_dbone;
        dL_djoints[j] = dL_djoint;
    }
};

} // namespace detail

/// E = weight / n Σ c (√(1 + d²/δ²) - 1) over the n keypoints of a frame: d is the distance in pixels of a keypoint to
/// its projected landmark, c its confidence, δ the image's height times `reach`. A keypoint that is far off, for
/// instance that of the other arm, pulls no harder than one that is a few δ away (pseudo-Huber). Landmarks behind a
/// camera do not count.
///
/// Shapes  views [T] of each frame; marks with the rig's joints (landmarks_of).
/// Frame   cameras and poses in the world.
/// Errors  ValueError for a weight, reach or confidence out of range, a pixel that is not finite, or a landmark that
///         the rig does not have.
template <Backend B, std::floating_point T = float>
class KeypointTerm final : public LossTerm<B, T> {
public:
    KeypointTerm(B& backend, const RigData& rig, const std::vector<std::vector<ViewKeypoints>>& views,
                 const Landmarks& marks, const KeypointTermParams& params = {})
        : backend_(&backend), weight_(params.weight), skeleton_(backend, rig.body.parents),
          shapes_(backend, rig.joint_count(),
                  {joint_directions(rig.body, rig.body.shapedirs), joint_directions(rig.body, rig.body.exprdirs)}) {
        check_value(params.weight >= 0 && std::isfinite(params.weight) && params.reach > 0, "KeypointTerm",
                    "weight must not be negative and reach must be above 0");
        std::vector<vec3<T>> joints;
        for (const vec3<double>& joint : rig.joints) joints.push_back(vec3<T>(joint));
        assign(*backend_, joints, rest_);
        std::vector<T> initial(rig.betas.begin(), rig.betas.end());
        initial.resize(rig.betas.size() + static_cast<std::size_t>(rig.body.expression_count), T(0));
        assign(*backend_, initial, initial_);
        put_keypoints(views, marks, params.reach);
    }

    /// Whether a frame has keypoints.
    [[nodiscard]] bool counts(std::size_t frame) const override { return frame < counts_.size() && counts_[frame] > 0; }

    /// E of a frame in a pose. Waits for the backend.
    [[nodiscard]] double value(std::size_t frame, const RigPose<B, T>& pose) {
        if (!counts(frame)) return 0;
        pull(frame, pose);
        const std::vector<double> cost = downloaded(*backend_, Span<const double>(cost_));
        return std::accumulate(cost.begin(), cost.end(), 0.0);
    }

    /// Adds to the parts of dL_dpose that are not empty.
    void backward(std::size_t frame, const RigPose<B, T>& pose, const RigPoseGradient<T>& dL_dpose) override {
        if (!counts(frame) || dL_dpose.empty() || weight_ == 0) return;
        pull(frame, pose);
        dL_dtransl_.resize(1);
        dL_drotations_.resize(rest_.size());
        backend_->fill(Span<vec3<T>>(dL_dtransl_), vec3<T>(T(0)));
        backend_->fill(Span<mat3<T>>(dL_drotations_), mat3<T>(T(0)));
        skeleton_.bones_backward(rotations_, joints_, bones_, Span<const Affine<T>>(dL_dbones_), dL_drotations_,
                                 dL_djoints_, dL_dtransl_);
        if (!dL_dpose.pose.empty()) skeleton_.rotations_backward(pose.pose, dL_drotations_, dL_dpose.pose);
        if (!dL_dpose.transl.empty()) backend_->for_each(1, detail::Accumulate<vec3<T>>{dL_dtransl_, dL_dpose.transl});
        if (!dL_dpose.coefficients.empty())
            shapes_.backward(Span<const vec3<T>>(dL_djoints_), dL_dpose.coefficients, workspace_);
    }

private:
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    /// Brings the keypoints to the backend, each frame's by joint.
    void put_keypoints(const std::vector<std::vector<ViewKeypoints>>& frames, const Landmarks& marks, double reach) {
        constexpr const char* where = "KeypointTerm";
        const std::size_t J = rest_.size();
        std::vector<Camera<double>> views;
        std::vector<detail::PulledKeypoint> points;
        std::vector<std::uint32_t> first; // [frames, J + 1]
        for (const std::vector<ViewKeypoints>& of_frame : frames) {
            std::vector<std::vector<detail::PulledKeypoint>> at(J);
            std::size_t& count = counts_.emplace_back(0);
            for (const ViewKeypoints& view : of_frame) {
                count += view.points.size();
                for (const Keypoint& point : view.points) {
                    const bool known = point.landmark >= 0 && static_cast<std::size_t>(point.landmark) < marks.size();
                    const Landmark mark =
                        known ? marks[static_cast<std::size_t>(point.landmark)] : Landmark{.joint = -1};
                    check_value(mark.joint >= 0 && static_cast<std::size_t>(mark.joint) < J, where,
                                "keypoint of landmark " + std::to_string(point.landmark) +
                                    ", which the rig does not have");
                    check_value(point.confidence >= 0 && point.confidence <= 1, where,
                                "a confidence lies outside of [0, 1]");
                    check_value(std::isfinite(point.pixel.x) && std::isfinite(point.pixel.y), where,
                                "a keypoint's pixel is not finite");
                    at[static_cast<std::size_t>(mark.joint)].push_back({point.pixel, mark.offset, point.confidence,
                                                                        reach * view.camera.height,
                                                                        static_cast<std::uint32_t>(views.size())});
                }
                views.push_back(view.camera);
            }
            for (const auto& of_joint : at) {
                first.push_back(static_cast<std::uint32_t>(points.size()));
                points.insert(points.end(), of_joint.begin(), of_joint.end());
            }
            first.push_back(static_cast<std::uint32_t>(points.size()));
        }
        assign(*backend_, views, views_), assign(*backend_, points, points_), assign(*backend_, first, first_);
    }
    /// Poses the joints, and finds what the frame's keypoints cost and how they pull.
    void pull(std::size_t frame, const RigPose<B, T>& pose) {
        const std::size_t J = rest_.size();
        coefficients_.resize(initial_.size());
        rotations_.resize(J), joints_.resize(J), bones_.resize(J);
        cost_.resize(J), dL_dbones_.resize(J), dL_djoints_.resize(J);
        backend_->for_each(initial_.size(), detail::Difference<T>{pose.coefficients, initial_, coefficients_});
        skeleton_.rotations(pose.pose, rotations_);
        backend_->copy(Span<const vec3<T>>(rest_), Span<vec3<T>>(joints_));
        shapes_.forward(Span<const T>(coefficients_), joints_);
        skeleton_.bones(rotations_, joints_, pose.transl, bones_);
        const auto first = Span<const std::uint32_t>(first_).subspan(frame * (J + 1), J + 1);
        const double scale = weight_ / static_cast<double>(counts_[frame]);
        backend_->for_each(
            J, detail::KeypointPull<T>{points_, first, views_, joints_, bones_, scale, cost_, dL_dbones_, dL_djoints_});
    }

    B* backend_;
    double weight_;
    std::vector<std::size_t> counts_; // of each frame's keypoints
    Skeleton<B, T> skeleton_;
    BlendShapes<B, T> shapes_; // of the joints
    Buffer<vec3<T>> rest_;     // [J] at the rig's shape
    Buffer<T> initial_;        // [S + E] coefficients of rest_
    Buffer<Camera<double>> views_;
    Buffer<detail::PulledKeypoint> points_;
    Buffer<std::uint32_t> first_; // [T, J + 1] of points_

    Buffer<T> coefficients_;
    Buffer<mat3<T>> rotations_, dL_drotations_;
    Buffer<vec3<T>> joints_, dL_djoints_, dL_dtransl_;
    Buffer<Affine<T>> bones_, dL_dbones_;
    Buffer<double> cost_;
    typename BlendShapes<B, T>::Workspace workspace_;
};

/// The keypoints of each person's views, by frame. In each photograph, the detection of a person is the one that lies
/// nearest to the person's landmarks as estimated, by the mean distance of its confident keypoints; a detection serves
/// one person. Keypoints below `least_confidence`, and landmarks that a body does not have, are left out.
///
/// Shapes  posed [P], the people's estimated landmarks; the result is [P] of [T].
[[nodiscard]] inline std::vector<std::vector<std::vector<ViewKeypoints>>>
keypoints_of_people(const std::vector<PhotoKeypoints>& found, const std::vector<Camera<double>>& cameras,
                    const std::vector<MotionLandmarks>& posed, std::size_t frame_count, double least_confidence = 0.2) {
    std::vector<std::vector<std::vector<ViewKeypoints>>> result(posed.size());
    for (auto& person : result) person.resize(frame_count);
    for (const PhotoKeypoints& photo : found) {
        const Camera<double>& camera = cameras[photo.camera];
        struct Match {
            double distance;
            std::size_t person, detection;
        };
        std::vector<Match> matches;
        std::vector<std::vector<std::vector<Keypoint>>> points(posed.size());
        for (std::size_t p = 0; p < posed.size(); ++p)
            for (std::size_t d = 0; d < photo.people.size(); ++d) {
                double sum = 0, count = 0;
                auto& mine = points[p].emplace_back();
                for (const Keypoint& point : photo.people[d].points) {
                    if (!posed[p].has(point.landmark) || point.confidence < least_confidence) continue;
                    mine.push_back(point);
                    const vec3<double> x = to_camera(camera, posed[p].at(photo.frame, point.landmark));
                    if (x.z < 0.01) continue;
                    const vec2<double> off = to_pixel(camera, x) - point.pixel;
                    sum += point.confidence * std::sqrt(off.x * off.x + off.y * off.y), count += point.confidence;
                }
                if (count > 0) matches.push_back({sum / count, p, d});
            }
        std::vector<bool> person_done(posed.size(), false), detection_done(photo.people.size(), false);
        for (const std::uint32_t m : ordered_indices(matches.size(), [&](std::uint32_t a, std::uint32_t b) {
                 return matches[a].distance < matches[b].distance;
             })) {
            const Match& match = matches[m];
            if (person_done[match.person] || detection_done[match.detection]) continue;
            person_done[match.person] = detection_done[match.detection] = true;
            result[match.person][photo.frame].push_back({.camera = camera,
                                                         .points = points[match.person][match.detection],
                                                         .metric = photo.people[match.detection].metric,
                                                         .camera_number = photo.camera});
        }
    }
    return result;
}

} // namespace gsh
