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

#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

struct KeypointTermParams {
    double weight = 0.02;
    double reach = 0.01; ///< share of an image's height beyond which a distance counts linearly
};

/// E = weight / n Σ c (√(1 + d²/δ²) - 1) over the n keypoints of a frame: d is the distance in pixels of a keypoint to
/// its projected landmark, c its confidence, δ the image's height times `reach`. A keypoint that is far off, for
/// instance that of the other arm, pulls no harder than one that is a few δ away (pseudo-Huber). Landmarks behind a
/// camera do not count.
///
/// Shapes  views [T] of each frame; marks with the rig's joints (landmarks_of).
/// Frame   cameras and poses in the world.
/// Errors  ValueError for a weight, reach or confidence out of range, a pixel that is not finite, or a landmark that
///         the rig does not have.
template <CpuBackend B, std::floating_point T = float>
class KeypointTerm {
public:
    KeypointTerm(B& backend, const RigData& rig, std::vector<std::vector<ViewKeypoints>> views, const Landmarks& marks,
                 const KeypointTermParams& params = {})
        : backend_(&backend), params_(params), views_(std::move(views)), marks_(marks),
          skeleton_(backend, rig.body.parents),
          shapes_(backend, rig.joint_count(),
                  {joint_directions(rig.body, rig.body.shapedirs), joint_directions(rig.body, rig.body.exprdirs)}),
          shape_count_(rig.betas.size()) {
        constexpr const char* where = "KeypointTerm";
        check_value(params.weight >= 0 && std::isfinite(params.weight) && params.reach > 0, where,
                    "weight must not be negative and reach must be above 0");
        for (const auto& frame : views_)
            for (const ViewKeypoints& view : frame)
                for (const Keypoint& point : view.points) {
                    const bool known = point.landmark >= 0 && static_cast<std::size_t>(point.landmark) < marks.size();
                    const int joint = known ? marks[static_cast<std::size_t>(point.landmark)].joint : -1;
                    check_value(joint >= 0 && static_cast<std::size_t>(joint) < rig.joint_count(), where,
                                "keypoint of landmark " + std::to_string(point.landmark) +
                                    ", which the rig does not have");
                    check_value(point.confidence >= 0 && point.confidence <= 1, where,
                                "a confidence lies outside of [0, 1]");
                    check_value(std::isfinite(point.pixel.x) && std::isfinite(point.pixel.y), where,
                                "a keypoint's pixel is not finite");
                }
        std::vector<vec3<T>> joints;
        for (const vec3<double>& joint : rig.joints) joints.push_back(vec3<T>(joint));
        rest_.resize(joints.size());
        backend.upload(Span<const vec3<T>>(joints), rest_);
        for (const double beta : rig.betas) initial_.push_back(T(beta));
        initial_.resize(static_cast<std::size_t>(rig.body.expression_count) + shape_count_, T(0));
    }

    /// Whether a frame has keypoints that count.
    [[nodiscard]] bool has(std::size_t frame) const {
        if (frame >= views_.size()) return false;
        for (const ViewKeypoints& view : views_[frame])
            if (!view.points.empty()) return true;
        return false;
    }
    [[nodiscard]] double weight() const { return params_.weight; }
    void set_weight(double weight) { params_.weight = weight; }

    /// E of a frame in a pose.
    [[nodiscard]] double value(std::size_t frame, const RigPose<B, T>& pose) {
        if (!has(frame)) return 0;
        forward(pose);
        return compare(frame, [](std::size_t, const vec3<double>&, const vec3<double>&) {});
    }
    /// Adds to the parts of dL_dpose that are not empty.
    void backward(std::size_t frame, const RigPose<B, T>& pose, const RigPoseGradient<T>& dL_dpose) {
        if (!has(frame) || params_.weight == 0) return;
        const std::size_t J = rest_.size();
        forward(pose);
        std::vector<Affine<T>> dL_dbones(J, Affine<T>::zero());
        std::vector<vec3<T>> dL_djoints(J, vec3<T>(T(0))), dL_dtransl(1, vec3<T>(T(0)));
        (void)compare(frame, [&](std::size_t j, const vec3<double>& rest, const vec3<double>& dL_dplace) {
            const vec3<T> dL_dx(dL_dplace); // x = L (J + offset) + t
            dL_dbones[j].linear += outer(dL_dx, vec3<T>(rest));
            dL_dbones[j].translation += dL_dx;
            dL_djoints[j] += transpose(host_bones_[j].linear) * dL_dx;
        });
        put(dL_dbones, dL_dbones_), put(dL_djoints, dL_djoints_), put(dL_dtransl, dL_dtransl_);
        dL_drotations_.resize(J);
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

    template <class U>
    void put(const std::vector<U>& from, Buffer<U>& to) {
        to.resize(from.size());
        backend_->upload(Span<const U>(from), to);
    }
    void forward(const RigPose<B, T>& pose) {
        const std::size_t J = rest_.size();
        std::vector<T> coefficients(initial_.size());
        backend_->download(Span<const T>(pose.coefficients), Span<T>(coefficients));
        for (std::size_t k = 0; k < coefficients.size(); ++k) coefficients[k] -= initial_[k];
        put(coefficients, coefficients_);
        rotations_.resize(J), joints_.resize(J), bones_.resize(J);
        skeleton_.rotations(pose.pose, rotations_);
        backend_->copy(Span<const vec3<T>>(rest_), Span<vec3<T>>(joints_));
        shapes_.forward(Span<const T>(coefficients_), joints_);
        skeleton_.bones(rotations_, joints_, pose.transl, bones_);
        host_joints_.resize(J), host_bones_.resize(J);
        backend_->download(Span<const vec3<T>>(joints_), Span<vec3<T>>(host_joints_));
        backend_->download(Span<const Affine<T>>(bones_), Span<Affine<T>>(host_bones_));
    }
    /// E; pull(joint, point at rest, gradient with respect to the posed point) is called for each keypoint.
    template <class Pull>
    double compare(std::size_t frame, const Pull& pull) const {
        double sum = 0, count = 0;
        for (const ViewKeypoints& view : views_[frame]) count += static_cast<double>(view.points.size());
        const double scale = params_.weight / count;
        for (const ViewKeypoints& view : views_[frame]) {
            const double delta = params_.reach * view.camera.height;
            for (const Keypoint& point : view.points) {
                const Landmark& mark = marks_[static_cast<std::size_t>(point.landmark)];
                const auto j = static_cast<std::size_t>(mark.joint);
                const vec3<double> rest = vec3<double>(host_joints_[j]) + mark.offset;
                const vec3<double> world(host_bones_[j](vec3<T>(rest)));
                const vec3<double> p = to_camera(view.camera, world);
                if (p.z < 0.01) continue;
                const vec2<double> off = (to_pixel(view.camera, p) - point.pixel) * (1 / delta);
                const double root = std::sqrt(1 + off.x * off.x + off.y * off.y);
                sum += point.confidence * (root - 1);
                CameraGradient<double> ignored{};
                vec3<double> dL_dp(0), dL_dworld(0);
                to_pixel_backward(view.camera, p, off * (scale * point.confidence / (root * delta)), dL_dp, ignored);
                to_camera_backward(view.camera, world, dL_dp, dL_dworld, ignored);
                pull(j, rest, dL_dworld);
            }
        }
        return scale * sum;
    }

    B* backend_;
    KeypointTermParams params_;
    std::vector<std::vector<ViewKeypoints>> views_;
    Landmarks marks_;
    Skeleton<B, T> skeleton_;
    BlendShapes<B, T> shapes_; // of the joints
    std::size_t shape_count_;
    Buffer<vec3<T>> rest_;   // [J] at the rig's shape
    std::vector<T> initial_; // [S + E] coefficients of rest_

    Buffer<T> coefficients_;
    Buffer<mat3<T>> rotations_, dL_drotations_;
    Buffer<vec3<T>> joints_, dL_djoints_, dL_dtransl_;
    Buffer<Affine<T>> bones_, dL_dbones_;
    std::vector<vec3<T>> host_joints_;
    std::vector<Affine<T>> host_bones_;
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
