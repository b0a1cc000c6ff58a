// SPDX-License-Identifier: Apache-2.0
/// @file  The respects in which a reading differs from a capture's files, with the cameras or people concerned.
#pragma once

#include <gsh/check/capture_reading.hpp>

#include <algorithm>
#include <cstddef>
#include <vector>

namespace gsh {

/// One respect in which a reading differs from the files, and the cameras or people concerned.
struct Aspect {
    enum class Kind {
        inverted_mask,
        mirrored_image,
        extrinsics,
        resolution,
        order,
        shift,
        zoom,
        // the kinds below concern motions
        absent,
        sides,
        degrees,
        translation_unit,
        translation,
        world,
        size,
        offset,
    };
    Kind kind;
    std::vector<std::size_t> cameras;     ///< all of them if the aspect concerns motions
    std::vector<std::size_t> people = {}; ///< empty if the aspect concerns cameras

    [[nodiscard]] bool of_motion() const { return kind >= Kind::absent; }
};

/// All respects in which a reading differs from the files. Cameras and people that differ in the same way are grouped.
/// Mean hands are not included.
[[nodiscard]] inline std::vector<Aspect> aspects_of(const CaptureReading& reading);

/// Resets one aspect of the reading to the default.
inline void reset(CaptureReading& reading, const Aspect& aspect);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Calls visit(kind, member) for each aspect of a MotionReading.
template <class Visit>
void for_motion_aspects(const Visit& visit) {
    using Kind = Aspect::Kind;
    visit(Kind::absent, &MotionReading::absent);
    visit(Kind::sides, &MotionReading::sides);
    visit(Kind::degrees, &MotionReading::degrees);
    visit(Kind::translation_unit, &MotionReading::translation_unit);
    visit(Kind::translation, &MotionReading::translation);
    visit(Kind::world, &MotionReading::world);
    visit(Kind::size, &MotionReading::size);
    visit(Kind::offset, &MotionReading::offset);
}

} // namespace detail

inline std::vector<Aspect> aspects_of(const CaptureReading& reading) {
    using Kind = Aspect::Kind;
    std::vector<Aspect> result;
    const CameraReading usual;
    const MotionReading as_given;
    std::vector<std::size_t> all;
    for (std::size_t c = 0; c < reading.cameras.size(); ++c) all.push_back(c);
    const auto of_cameras = [&](Kind kind, const auto& differs, const auto& alike) {
        const std::size_t begin = result.size();
        for (std::size_t c = 0; c < reading.cameras.size(); ++c) {
            if (!differs(reading.cameras[c])) continue;
            const auto same =
                std::find_if(result.begin() + static_cast<std::ptrdiff_t>(begin), result.end(), [&](const Aspect& a) {
                    return alike(reading.cameras[a.cameras.front()], reading.cameras[c]);
                });
            if (same == result.end())
                result.push_back({kind, {c}});
            else
                same->cameras.push_back(c);
        }
    };
    const auto any = [](const CameraReading&, const CameraReading&) { return true; };
    of_cameras(
        Kind::inverted_mask, [](const CameraReading& r) { return r.inverted_mask; }, any);
    of_cameras(
        Kind::mirrored_image, [](const CameraReading& r) { return r.mirrored_image; }, any);
    of_cameras(
        Kind::extrinsics,
        [&](const CameraReading& r) { return r.extrinsics != usual.extrinsics || r.unit != usual.unit; },
        [](const CameraReading& a, const CameraReading& b) {
            return a.extrinsics == b.extrinsics && a.unit == b.unit;
        });
    of_cameras(
        Kind::resolution, [&](const CameraReading& r) { return r.resolution != usual.resolution; }, any);
    of_cameras(
        Kind::order, [&](const CameraReading& r) { return !(r.order == usual.order); },
        [](const CameraReading& a, const CameraReading& b) { return a.order == b.order; });
    of_cameras(
        Kind::shift, [&](const CameraReading& r) { return r.shift != usual.shift; }, any);
    of_cameras(
        Kind::zoom, [&](const CameraReading& r) { return r.zoom != usual.zoom; }, any);

    detail::for_motion_aspects([&](Kind kind, const auto member) {
        const std::size_t begin = result.size();
        for (std::size_t p = 0; p < reading.motions.size(); ++p) {
            const auto& value = reading.motions[p].*member;
            if (value == as_given.*member) continue;
            const auto same =
                std::find_if(result.begin() + static_cast<std::ptrdiff_t>(begin), result.end(),
                             [&](const Aspect& a) { return reading.motions[a.people.front()].*member == value; });
            if (same == result.end())
                result.push_back({kind, all, {p}});
            else
                same->people.push_back(p);
        }
    });
    return result;
}

inline void reset(CaptureReading& reading, const Aspect& aspect) {
    using Kind = Aspect::Kind;
    const CameraReading usual;
    for (const std::size_t c : aspect.cameras) {
        CameraReading& camera = reading.cameras[c];
        if (aspect.kind == Kind::inverted_mask) camera.inverted_mask = usual.inverted_mask;
        if (aspect.kind == Kind::mirrored_image) camera.mirrored_image = usual.mirrored_image;
        if (aspect.kind == Kind::extrinsics) camera.extrinsics = usual.extrinsics, camera.unit = usual.unit;
        if (aspect.kind == Kind::resolution) camera.resolution = usual.resolution;
        if (aspect.kind == Kind::order) camera.order = usual.order;
        if (aspect.kind == Kind::shift) camera.shift = usual.shift;
        if (aspect.kind == Kind::zoom) camera.zoom = usual.zoom;
    }
    detail::for_motion_aspects([&](Kind kind, const auto member) {
        if (aspect.kind != kind) return;
        for (const std::size_t p : aspect.people) reading.motions[p].*member = MotionReading().*member;
    });
}

} // namespace gsh
