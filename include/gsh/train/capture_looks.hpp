// SPDX-License-Identifier: Apache-2.0
/// @file  Masks and posed bodies of a capture side by side, as any reading of its files would have them.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/io/capture.hpp>
#include <gsh/train/capture_reading.hpp>
#include <gsh/train/silhouette.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <map>
#include <utility>
#include <vector>

namespace gsh {

/// What a posed body and a mask have to do with each other in one image.
struct ViewLook {
    bool valid = false; ///< the image has a pose
    Overlap overlap;
    double mask_share = 0, border_share = 0; ///< of the image's pixels, of those at its border
    double inside = 0;                       ///< of the body's vertices, how many project into the image
    vec2<double> mask_center = vec2<double>(0.0), body_center = vec2<double>(0.0); ///< pixels of the reduced image
    std::size_t mask_area = 0, body_area = 0;
};

/// Evaluates readings. Sizes are pixels along the longer side, to which images are reduced.
template <CpuBackend B>
class CaptureLooks {
public:
    using Views = std::vector<CaptureView>;

    CaptureLooks(B& backend, const Capture& capture, const BodyModel& body)
        : backend_(backend), capture_(capture), body_(body),
          counterparts_(joint_counterparts(body, capture.motion.betas)) {}

    [[nodiscard]] B& backend() const { return backend_; }
    [[nodiscard]] const Capture& capture() const { return capture_; }
    [[nodiscard]] const BodyModel& body() const { return body_; }

    /// Poses under this reading of the motion are kept until another is started from.
    void start_from(const MotionReading& reading) {
        if (posed_[1].reading == reading) std::swap(posed_[0], posed_[1]);
        if (!(posed_[0].reading == reading)) posed_[0] = {reading, {}};
    }

    /// Means of both over the views of some cameras that are valid in both.
    [[nodiscard]] std::pair<double, double> means(const Views& views, const std::vector<double>& a,
                                                  const std::vector<double>& b,
                                                  const std::vector<std::size_t>& cameras) const {
        double sum_a = 0, sum_b = 0, count = 0;
        for (std::size_t i = 0; i < views.size(); ++i)
            if (a[i] >= 0 && b[i] >= 0 && std::count(cameras.begin(), cameras.end(), views[i].camera))
                sum_a += a[i], sum_b += b[i], count += 1;
        return {sum_a / std::max(1.0, count), sum_b / std::max(1.0, count)};
    }

    /// IoU of each, -1 where the view has no pose.
    [[nodiscard]] static std::vector<double> overlaps(const std::vector<ViewLook>& looks) {
        std::vector<double> result;
        for (const ViewLook& look : looks) result.push_back(look.valid ? look.overlap.iou() : -1);
        return result;
    }
    [[nodiscard]] int reduction(std::size_t camera, int size) const {
        const auto& c = capture_.cameras[camera].camera;
        return std::max(1, (std::max(c.width, c.height) + size - 1) / size);
    }
    [[nodiscard]] Silhouette mask(CaptureView view, const CaptureReading& reading, int size) const {
        const CameraReading& own = reading.cameras[view.camera];
        Silhouette result = mask_silhouette(capture_.image(view), reduction(view.camera, size));
        if (own.inverted_mask) result.invert();
        if (own.mirrored_image) result.mirror();
        return result;
    }
    [[nodiscard]] Camera<double> camera(std::size_t c, const CaptureReading& reading, int size) const {
        return reduced_camera(read_as(capture_.cameras[c].camera, reading.cameras[c]), reduction(c, size));
    }

    /// Calls see(index, vertices) for every view that has a pose, in parallel, not too many poses at a time.
    template <class See>
    void for_views(const Views& views, const CaptureReading& reading, const See& see) {
        constexpr std::size_t batch = 32; // poses
        std::map<std::size_t, std::vector<std::size_t>> by_pose;
        for (std::size_t i = 0; i < views.size(); ++i)
            if (const auto p = reading.cameras[views[i].camera].order.pose_of(views[i].frame, capture_.frame_count()))
                by_pose[*p].push_back(i);
        for (auto first = by_pose.begin(); first != by_pose.end();) {
            std::vector<std::size_t> poses;
            std::vector<std::pair<std::size_t, std::size_t>> work; // view, pose
            for (; first != by_pose.end() && poses.size() < batch; ++first) {
                poses.push_back(first->first);
                for (const std::size_t i : first->second) work.emplace_back(i, first->first);
            }
            const auto& vertices = pose(poses, reading.motion);
            backend_.for_chunks(work.size(), 1, [&](std::size_t, std::size_t begin, std::size_t end) {
                for (std::size_t k = begin; k < end; ++k) see(work[k].first, vertices.at(work[k].second));
            });
        }
    }

    /// What vertices cover, and the share of them in the image.
    [[nodiscard]] Silhouette silhouette(const std::vector<vec3<double>>& vertices, const Camera<double>& seen_by,
                                        double& inside) const {
        std::size_t count = 0;
        for (const auto& v : vertices) {
            const vec3<double> p = to_camera(seen_by, v);
            if (!(p.z > 1e-6)) continue;
            const vec2<double> pixel = to_pixel(seen_by, p);
            count += pixel.x >= 0 && pixel.y >= 0 && pixel.x < seen_by.width && pixel.y < seen_by.height;
        }
        inside = static_cast<double>(count) / static_cast<double>(std::max<std::size_t>(1, vertices.size()));
        if (count == 0) {
            Silhouette nothing{seen_by.height, seen_by.width, {}};
            nothing.inside.assign(static_cast<std::size_t>(seen_by.height) * static_cast<std::size_t>(seen_by.width),
                                  0);
            return nothing;
        }
        return mesh_silhouette(vertices, body_.faces, seen_by);
    }

    [[nodiscard]] std::vector<ViewLook> look(const Views& views, const CaptureReading& reading, int size) {
        std::vector<ViewLook> looks(views.size());
        for_views(views, reading, [&](std::size_t i, const std::vector<vec3<double>>& vertices) {
            ViewLook& result = looks[i];
            result.valid = true;
            const Silhouette body = silhouette(vertices, camera(views[i].camera, reading, size), result.inside);
            const Silhouette person = mask(views[i], reading, size);
            result.overlap = overlap(body, person);
            result.mask_share = person.share(), result.border_share = person.border_share();
            result.mask_center = person.centroid(), result.body_center = body.centroid();
            result.mask_area = person.area(), result.body_area = body.area();
        });
        return looks;
    }

private:
    B& backend_;
    const Capture& capture_;
    const BodyModel& body_;
    std::vector<int> counterparts_;

    struct Posed {
        MotionReading reading;
        std::map<std::size_t, std::vector<vec3<double>>> vertices; ///< by pose
    };
    std::array<Posed, 2> posed_; ///< of the reading that others start from, and of the one that is tried

    /// Vertices of poses under a reading; what was posed before is kept.
    const std::map<std::size_t, std::vector<vec3<double>>>& pose(const std::vector<std::size_t>& poses,
                                                                 const MotionReading& reading) {
        constexpr std::size_t most = 96; // poses that are kept
        Posed& slot = posed_[posed_[0].reading == reading ? 0 : 1];
        if (!(slot.reading == reading) || slot.vertices.size() > most) slot.vertices.clear();
        slot.reading = reading;
        std::vector<std::pair<std::size_t, std::vector<vec3<double>>*>> missing;
        for (const std::size_t p : poses)
            if (!slot.vertices.contains(p)) missing.emplace_back(p, &slot.vertices[p]);
        backend_.for_chunks(missing.size(), 1, [&](std::size_t, std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i)
                *missing[i].second = pose_as(body_, capture_.motion, missing[i].first, reading, counterparts_).vertices;
        });
        return slot.vertices;
    }
};

} // namespace gsh
