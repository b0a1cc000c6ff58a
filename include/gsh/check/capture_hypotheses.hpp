// SPDX-License-Identifier: Apache-2.0
/// @file  Hypotheses about the conventions of a capture's files: readings that differ in one respect each.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/check/capture_reading.hpp>
#include <gsh/io/capture/capture_data.hpp>

#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <vector>

namespace gsh::detail {

/// A reading to be tried.
struct CaptureHypothesis {
    CaptureReading reading;
    bool of_motion;
};
using SuspectedPeople = std::vector<std::size_t>;

/// Groups of people whose poses may share a fault: all people, and each one alone. Absent people are left out.
[[nodiscard]] inline std::vector<SuspectedPeople> suspects(const CaptureReading& reading) {
    std::vector<SuspectedPeople> result(1);
    for (std::size_t p = 0; p < reading.motions.size(); ++p)
        if (!reading.motions[p].absent) result[0].push_back(p);
    if (result[0].size() > 1)
        for (const std::size_t p : SuspectedPeople(result[0])) result.push_back({p});
    return result;
}

/// Estimates how many times as wide the images are that K refers to, assuming a principal point near the image's
/// centre. Common factors are preferred, and values near 1 are set to 1.
[[nodiscard]] inline double resolution_of_intrinsics(const Camera<double>& camera) {
    const double wide = 2 * camera.cx / camera.width, high = 2 * camera.cy / camera.height;
    if (!(wide > 0 && high > 0) || std::abs(std::log(wide / high)) > 0.2) return 1;
    const double found = std::sqrt(wide * high);
    for (const double usual : {1.0, 0.125, 0.25, 1.0 / 3, 0.5, 2.0 / 3, 0.75, 1.5, 2.0, 3.0, 4.0, 8.0})
        if (std::abs(std::log(found / usual)) < 0.14) return usual;
    return found;
}

/// Readings that change one convention each; earlier ones are preferred when two are equally good.
[[nodiscard]] inline std::vector<CaptureHypothesis> conventions(const CaptureReading& reading,
                                                                const Capture& capture) {
    std::vector<CaptureHypothesis> result;
    const auto of_cameras = [&](const auto& change) {
        CaptureHypothesis candidate{reading, false};
        for (std::size_t c = 0; c < capture.cameras.size(); ++c) change(candidate.reading.cameras[c], c);
        result.push_back(candidate);
    };
    const std::vector<SuspectedPeople> suspected = suspects(reading);
    const auto of_motion = [&](const auto& change, std::size_t first = 0) {
        for (std::size_t k = first; k < suspected.size(); ++k) {
            CaptureHypothesis candidate{reading, true};
            for (const std::size_t p : suspected[k]) change(candidate.reading.motions[p]);
            if (!(candidate.reading.motions == reading.motions)) result.push_back(candidate);
        }
    };
    of_cameras([](CameraReading& r, std::size_t) { r.inverted_mask = !r.inverted_mask; });
    of_cameras([](CameraReading& r, std::size_t) { r.mirrored_image = !r.mirrored_image; });
    for (const double unit : {1.0, 0.01, 0.001})
        for (const Extrinsics extrinsics :
             {Extrinsics::world_to_camera, Extrinsics::camera_to_world, Extrinsics::opengl,
              Extrinsics::opengl_camera_to_world, Extrinsics::transposed, Extrinsics::position})
            of_cameras([&](CameraReading& r, std::size_t) { r.extrinsics = extrinsics, r.unit = unit; });
    of_cameras([&](CameraReading& r, std::size_t c) {
        r.resolution = resolution_of_intrinsics(capture.cameras[c].camera);
    });
    using Sides = MotionReading::Sides;
    using World = MotionReading::World;
    using Translation = MotionReading::Translation;
    of_motion([](MotionReading& r) { r.absent = true; }, 1); // at least one person must be present
    of_motion([](MotionReading& r) { r.degrees = true; });
    for (const Sides sides : {Sides::mirrored, Sides::swapped}) of_motion([&](MotionReading& r) { r.sides = sides; });
    for (const double unit : {0.01, 0.001}) {
        of_motion([&](MotionReading& r) { r.translation_unit = unit; });
        of_motion([&](MotionReading& r) { r.size = unit; });
    }
    for (const World world : {World::z_up, World::minus_z_up, World::y_down})
        of_motion([&](MotionReading& r) { r.world = world; });
    for (const Translation translation : {Translation::of_root_joint, Translation::of_turned_body})
        of_motion([&](MotionReading& r) { r.translation = translation; });
    const auto order = [&](FrameOrder changed) {
        of_cameras([&](CameraReading& r, std::size_t) { r.order = changed; });
    };
    const auto frames = static_cast<int>(capture.frame_count());
    for (const int offset : {1, -1, 2, -2, 3, -3})
        if (std::abs(offset) < frames) order({FrameOrder::Kind::offset, offset});
    if (frames > 2) order({FrameOrder::Kind::reversed, 0});
    if (frames > 10) order({FrameOrder::Kind::names_from_0, 0});
    if (frames > 9) order({FrameOrder::Kind::names_from_1, 0});
    return result;
}

} // namespace gsh::detail
