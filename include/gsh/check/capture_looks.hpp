// SPDX-License-Identifier: Apache-2.0
/// @file  Comparison of a capture's masks with its posed bodies under a given reading of its files.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/check/capture_masks.hpp>
#include <gsh/check/capture_reading.hpp>
#include <gsh/check/silhouette.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/trimap.hpp>
#include <gsh/io/capture/capture_data.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <map>
#include <utility>
#include <vector>

namespace gsh {

/// Comparison of one posed body with a mask that may contain other people.
struct PersonLook {
    double inside = 0;                 ///< fraction of the vertices that project into the image
    std::size_t area = 0, covered = 0; ///< pixels of the body, and how many of them the mask covers
    double own = 0;                    ///< pixels of the body; a pixel of several people counts in equal parts
};

/// Comparison of all posed bodies with the mask of one image.
struct ViewLook {
    bool valid = false; ///< whether the image has a pose
    Overlap overlap;
    double mask_share = 0, border_share = 0; ///< fraction inside the mask, of all pixels and of those at the border
    vec2<double> mask_center = vec2<double>(0.0), body_center = vec2<double>(0.0); ///< pixels of the reduced image
    std::size_t mask_area = 0, body_area = 0;                                      ///< of all people
    std::vector<PersonLook> people;
};

/// Evaluates readings of a capture. A `size` is the length of the longer side in pixels to which images are reduced.
template <HostExecutor E>
class CaptureLooks {
public:
    using Views = std::vector<CaptureView>;
    using Vertices = Span<const vec3<double>>; ///< of one body; empty for a person who is absent

    CaptureLooks(E& executor, const Capture& capture, const std::vector<CheckedPerson>& people)
        : executor_(executor), capture_(capture), masks_(capture), people_(people), posed_(people.size()) {
        for (const CheckedPerson& person : people)
            counterparts_.push_back(joint_counterparts(*person.body, person.motion->betas));
    }

    [[nodiscard]] E& executor() const { return executor_; }
    [[nodiscard]] const Capture& capture() const { return capture_; }
    [[nodiscard]] const std::vector<CheckedPerson>& people() const { return people_; }

    /// Keeps the poses under this reading of the motions until the next call.
    void start_from(const std::vector<MotionReading>& readings) {
        for (std::size_t p = 0; p < people_.size(); ++p) {
            auto& [start, tried] = posed_[p];
            if (tried.reading == readings[p]) std::swap(start, tried);
            if (!(start.reading == readings[p])) start = {readings[p], {}};
        }
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

    /// IoU of each view, -1 if the view has no pose.
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
        Silhouette result = masks_.reduced(view, reduction(view.camera, size));
        if (own.inverted_mask) result.invert();
        if (own.mirrored_image) result.mirror();
        return result;
    }
    [[nodiscard]] Camera<double> camera(std::size_t c, const CaptureReading& reading, int size) const {
        return reduced_camera(read_as(capture_.cameras[c].camera, reading.cameras[c]), reduction(c, size));
    }

    /// Removes the pixels of a view where something is in front of the people.
    void hide(Silhouette& silhouette, CaptureView view, const CaptureReading& reading, int size) const {
        const int width = capture_.cameras[view.camera].camera.width, factor = reduction(view.camera, size);
        for (const UnknownPixel& pixel : capture_.hidden_in(view)) {
            const int y = static_cast<int>(pixel.index) / width / factor;
            int x = static_cast<int>(pixel.index) % width / factor;
            if (x >= silhouette.width || y >= silhouette.height) continue;
            if (reading.cameras[view.camera].mirrored_image) x = silhouette.width - 1 - x;
            silhouette.inside[static_cast<std::size_t>(y) * static_cast<std::size_t>(silhouette.width) +
                              static_cast<std::size_t>(x)] = 0;
        }
    }

    /// Calls see(index, vertices of each person) for every view that has a pose, in parallel. Poses are processed in
    /// batches to limit memory.
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
            std::vector<const Poses*> posed; // [person]
            for (std::size_t p = 0; p < people_.size(); ++p) posed.push_back(&pose(p, poses, reading.motions[p]));
            executor_.for_chunks(work.size(), 1, [&](std::size_t, std::size_t begin, std::size_t end) {
                for (std::size_t k = begin; k < end; ++k) {
                    std::vector<Vertices> everybody;
                    for (const Poses* own : posed) everybody.push_back(own->at(work[k].second));
                    see(work[k].first, everybody);
                }
            });
        }
    }

    /// The silhouette of each person.
    [[nodiscard]] std::vector<Silhouette> silhouettes(const std::vector<Vertices>& everybody,
                                                      const Camera<double>& seen_by) const {
        std::vector<Silhouette> result;
        for (std::size_t p = 0; p < people_.size(); ++p) {
            if (share_inside(everybody[p], seen_by) > 0) {
                result.push_back(mesh_silhouette(everybody[p], people_[p].body->faces, seen_by));
                continue;
            }
            result.push_back({seen_by.height, seen_by.width, {}});
            result.back().inside.assign(
                static_cast<std::size_t>(seen_by.height) * static_cast<std::size_t>(seen_by.width), 0);
        }
        return result;
    }

    [[nodiscard]] std::vector<ViewLook> look(const Views& views, const CaptureReading& reading, int size) {
        std::vector<ViewLook> looks(views.size());
        for (ViewLook& result : looks) result.people.resize(people_.size());
        for_views(views, reading, [&](std::size_t i, const std::vector<Vertices>& everybody) {
            ViewLook& result = looks[i];
            const Camera<double> seen_by = camera(views[i].camera, reading, size);
            std::vector<Silhouette> bodies = silhouettes(everybody, seen_by);
            for (Silhouette& silhouette : bodies) hide(silhouette, views[i], reading, size);
            const Silhouette body = united(bodies), person = mask(views[i], reading, size);
            result.valid = true;
            result.overlap = overlap(body, person);
            result.mask_share = person.share(), result.border_share = person.border_share();
            result.mask_center = person.centroid(), result.body_center = body.centroid();
            result.mask_area = person.area(), result.body_area = body.area();
            for (std::size_t p = 0; p < bodies.size(); ++p) {
                PersonLook& one = result.people[p];
                one.inside = share_inside(everybody[p], seen_by);
                one.area = bodies[p].area(), one.covered = overlap(bodies[p], person).both;
            }
            for (std::size_t pixel = 0; pixel < body.inside.size(); ++pixel) {
                if (!body.inside[pixel]) continue;
                double count = 0;
                for (const Silhouette& one : bodies) count += one.inside[pixel];
                for (std::size_t p = 0; p < bodies.size(); ++p) result.people[p].own += bodies[p].inside[pixel] / count;
            }
        });
        return looks;
    }

private:
    E& executor_;
    const Capture& capture_;
    CaptureMasks masks_;
    std::vector<CheckedPerson> people_;
    std::vector<std::vector<int>> counterparts_; // [person]

    using Poses = std::map<std::size_t, std::vector<vec3<double>>>; ///< vertices by pose
    struct Posed {
        MotionReading reading;
        Poses vertices;
    };
    /// [person] under the reading that is kept, and under the one that is tried.
    std::vector<std::array<Posed, 2>> posed_;

    /// Vertices of a person's poses under a reading; poses that were evaluated before are reused.
    const Poses& pose(std::size_t p, const std::vector<std::size_t>& poses, const MotionReading& reading) {
        constexpr std::size_t most = 96; // largest number of poses kept, of all people together
        Posed& slot = posed_[p][posed_[p][0].reading == reading ? 0 : 1];
        if (!(slot.reading == reading) || slot.vertices.size() * people_.size() > most) slot.vertices.clear();
        slot.reading = reading;
        std::vector<std::pair<std::size_t, std::vector<vec3<double>>*>> missing;
        for (const std::size_t pose : poses)
            if (const auto [place, is_new] = slot.vertices.try_emplace(pose); is_new && !reading.absent)
                missing.emplace_back(pose, &place->second);
        const CheckedPerson& person = people_[p];
        executor_.for_chunks(missing.size(), 1, [&](std::size_t, std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i)
                *missing[i].second =
                    pose_as(*person.body, *person.motion, missing[i].first, reading, counterparts_[p]).vertices;
        });
        return slot.vertices;
    }

    /// Fraction of the vertices that project into the image.
    [[nodiscard]] static double share_inside(Vertices vertices, const Camera<double>& seen_by) {
        std::size_t count = 0;
        for (const auto& v : vertices) {
            const vec3<double> p = to_camera(seen_by, v);
            if (!(p.z > 1e-6)) continue;
            const vec2<double> pixel = to_pixel(seen_by, p);
            count += pixel.x >= 0 && pixel.y >= 0 && pixel.x < seen_by.width && pixel.y < seen_by.height;
        }
        return static_cast<double>(count) / static_cast<double>(std::max<std::size_t>(1, vertices.size()));
    }
};

} // namespace gsh
