// SPDX-License-Identifier: Apache-2.0
/// @file  Alternative readings of a capture's files: their meaning under other conventions.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>
#include <string>
#include <vector>

namespace gsh {

/// A person in a capture. The motion has a pose for each of its frames.
struct CheckedPerson {
    std::string name; ///< in findings, if there are several people
    const BodyModel* body = nullptr;
    const Motion* motion = nullptr;
};

/// Possible meanings of R and t in a camera file.
enum class Extrinsics {
    world_to_camera,        ///< ours: x_cam = R x_world + t, x right, y down, z forward
    camera_to_world,        ///< x_world = R x_cam + t
    opengl,                 ///< world to camera, but y up and z backward
    opengl_camera_to_world, ///< camera to world, y up and z backward
    transposed,             ///< R is stored by columns
    position,               ///< t is the camera's position in the world
};

/// The assignment of poses to images.
struct FrameOrder {
    enum class Kind {
        offset,       ///< pose = frame + offset
        reversed,     ///< the last pose belongs to the first image
        names_from_0, ///< images are numbered 0, 1, …, 10 and sorted as strings: 0, 1, 10, 2
        names_from_1, ///< images are numbered 1, 2, … and sorted as strings
    };
    Kind kind = Kind::offset;
    int offset = 0;

    /// The pose of an image; no value if it has none.
    [[nodiscard]] std::optional<std::size_t> pose_of(std::size_t frame, std::size_t frames) const;
    friend bool operator==(const FrameOrder&, const FrameOrder&) = default;
};

/// The interpretation of a camera's entry and images. The default is our own convention.
struct CameraReading {
    Extrinsics extrinsics = Extrinsics::world_to_camera;
    double unit = 1;                        ///< metres per unit of t
    double resolution = 1;                  ///< K refers to images this many times as wide
    double zoom = 1;                        ///< factor on both focal lengths
    vec2<double> shift = vec2<double>(0.0); ///< pixels, added to the principal point
    bool inverted_mask = false;
    bool mirrored_image = false;
    FrameOrder order = {};

    friend bool operator==(const CameraReading&, const CameraReading&) = default;
};

/// The interpretation of a person's poses. The default is our own convention.
struct MotionReading {
    enum class Sides {
        as_given,
        mirrored, ///< left and right are exchanged and rotations reflected; the root is unchanged
        swapped,  ///< left and right are exchanged, rotations are not reflected: another joint order
    };
    enum class Translation {
        of_canonical_origin, ///< ours: added to a body rotated about its root joint
        of_root_joint,       ///< transl is the position of the root joint
        of_turned_body,      ///< added to a body rotated about the canonical origin (EasyMocap)
    };
    enum class World {
        as_given,
        z_up,       ///< up is z in the poses and y in the cameras
        minus_z_up, ///< up is -z in the poses
        y_down,     ///< y and z are negated
    };
    bool absent = false; ///< the images do not show the person with these poses
    Sides sides = Sides::as_given;
    Translation translation = Translation::of_canonical_origin;
    World world = World::as_given;
    bool degrees = false;
    double translation_unit = 1;             ///< metres per unit of transl
    double size = 1;                         ///< scale of the body
    vec3<double> offset = vec3<double>(0.0); ///< metres, in the world
    int mean_hands = 0;                      ///< multiple of the body's mean hand that is added to the hand poses

    friend bool operator==(const MotionReading&, const MotionReading&) = default;
};

struct CaptureReading {
    std::vector<MotionReading> motions; ///< [person]
    std::vector<CameraReading> cameras;
};

/// The camera in our convention. Only its parameters change; the caller transforms the masks.
[[nodiscard]] inline Camera<double> read_as(const Camera<double>& camera, const CameraReading& reading);

/// The corresponding joint on the other side of the body, [J]; a joint on the middle plane maps to itself. It is found
/// by the parents and the rest positions mirrored in x.
[[nodiscard]] inline std::vector<int> joint_counterparts(const BodyModel& body, Span<const double> betas = {});

/// Evaluates a pose of the motion under the reading. `counterparts` is the result of joint_counterparts. `joints` and
/// `vertices` of the result follow the reading, `bones` do not.
///
/// Errors  those of pose_body.
[[nodiscard]] inline PosedBody pose_as(const BodyModel& body, const Motion& motion, std::size_t pose,
                                       const MotionReading& reading, Span<const int> counterparts);

/// First joint of the left hand, which has 15 joints; those of the right hand follow. No value for other bodies.
[[nodiscard]] inline std::optional<std::size_t> first_hand_joint(std::size_t joint_count) {
    if (joint_count == 55) return 25;
    if (joint_count == 52) return 22;
    return {};
}

// -------------------------------------------------------------------------------------------------------------

inline std::optional<std::size_t> FrameOrder::pose_of(std::size_t frame, std::size_t frames) const {
    if (kind == Kind::reversed) return frames - 1 - frame;
    if (kind == Kind::offset) {
        const auto pose = static_cast<std::ptrdiff_t>(frame) + offset;
        if (pose < 0 || pose >= static_cast<std::ptrdiff_t>(frames)) return {};
        return static_cast<std::size_t>(pose);
    }
    const std::size_t first = kind == Kind::names_from_1;
    std::vector<std::size_t> order(frames); // frames in order of their file names
    std::iota(order.begin(), order.end(), std::size_t(0));
    std::sort(order.begin(), order.end(),
              [&](std::size_t a, std::size_t b) { return std::to_string(a + first) < std::to_string(b + first); });
    return order[frame];
}

inline Camera<double> read_as(const Camera<double>& camera, const CameraReading& reading) {
    Camera<double> result = camera;
    result.t *= reading.unit;
    switch (reading.extrinsics) {
    case Extrinsics::world_to_camera:
    case Extrinsics::opengl:
        break;
    case Extrinsics::camera_to_world:
    case Extrinsics::opengl_camera_to_world:
        result.t = -transposed_times(result.R, result.t);
        result.R = transpose(result.R);
        break;
    case Extrinsics::transposed:
        result.R = transpose(result.R);
        break;
    case Extrinsics::position:
        result.t = -(result.R * result.t);
        break;
    }
    if (reading.extrinsics == Extrinsics::opengl || reading.extrinsics == Extrinsics::opengl_camera_to_world) {
        for (int column = 0; column < 3; ++column)
            result.R[column].y = -result.R[column].y, result.R[column].z = -result.R[column].z;
        result.t.y = -result.t.y, result.t.z = -result.t.z;
    }
    result.fx *= reading.zoom / reading.resolution, result.fy *= reading.zoom / reading.resolution;
    result.cx = result.cx / reading.resolution + reading.shift.x;
    result.cy = result.cy / reading.resolution + reading.shift.y;
    return result;
}

inline std::vector<int> joint_counterparts(const BodyModel& body, Span<const double> betas) {
    const auto joints = regress_joints(body, shaped_vertices(body, betas));
    std::vector<int> result;
    for (std::size_t j = 0; j < joints.size(); ++j) {
        const vec3<double> wanted(2 * joints[0].x - joints[j].x, joints[j].y, joints[j].z);
        int best = static_cast<int>(j);
        double nearest = std::numeric_limits<double>::infinity();
        for (std::size_t k = 0; k < joints.size(); ++k) {
            const int parent = body.parents[j];
            if (parent >= 0 && body.parents[k] >= 0 && static_cast<std::size_t>(parent) < j &&
                result[static_cast<std::size_t>(parent)] != body.parents[k])
                continue;
            if ((parent < 0) != (body.parents[k] < 0)) continue;
            if (const double distance = length(joints[k] - wanted); distance < nearest)
                nearest = distance, best = static_cast<int>(k);
        }
        result.push_back(best);
    }
    for (std::size_t j = 0; j < result.size(); ++j) // pairs that are not mutual map to themselves
        if (result[static_cast<std::size_t>(result[j])] != static_cast<int>(j)) result[j] = static_cast<int>(j);
    return result;
}

inline PosedBody pose_as(const BodyModel& body, const Motion& motion, std::size_t pose, const MotionReading& reading,
                         Span<const int> counterparts) {
    using Reading = MotionReading;
    check_size("pose_as", "counterparts", counterparts.size(), body.joint_count(), "store one per joint");
    const auto given = motion.pose_at(pose);
    std::vector<vec3<double>> rotations(given.begin(), given.end());
    if (reading.sides != Reading::Sides::as_given)
        for (std::size_t j = 1; j < rotations.size(); ++j) {
            const vec3<double> v = given[static_cast<std::size_t>(counterparts[j])];
            rotations[j] = reading.sides == Reading::Sides::mirrored ? vec3<double>(v.x, -v.y, -v.z) : v;
        }
    if (reading.degrees)
        for (auto& v : rotations) v *= std::numbers::pi / 180;
    if (const auto first = first_hand_joint(body.joint_count()); first && reading.mean_hands != 0) {
        const auto add = [&](const std::vector<vec3<double>>& mean, std::size_t from) {
            for (std::size_t k = 0; k < mean.size(); ++k)
                rotations[from + k] += mean[k] * static_cast<double>(reading.mean_hands);
        };
        add(body.hands_mean_left, *first);
        add(body.hands_mean_right, *first + 15);
    }

    vec3<double> transl = motion.transl[pose] * reading.translation_unit;
    if (reading.translation != Reading::Translation::of_canonical_origin) {
        const vec3<double> root =
            regress_joints(body, shaped_vertices(body, motion.betas, motion.expression_at(pose)))[0];
        transl -= root;
        if (reading.translation == Reading::Translation::of_turned_body)
            transl += rotation_from_axis_angle(rotations[0]) * root;
    }
    PosedBody posed = pose_body(body, rotations, transl, motion.betas, motion.expression_at(pose));
    const auto move = [&](vec3<double>& p) {
        if (reading.size != 1) p = transl + (p - transl) * reading.size;
        switch (reading.world) {
        case Reading::World::as_given:
            break;
        case Reading::World::z_up:
            p = {p.x, p.z, -p.y};
            break;
        case Reading::World::minus_z_up:
            p = {p.x, -p.z, p.y};
            break;
        case Reading::World::y_down:
            p = {p.x, -p.y, -p.z};
            break;
        }
        p += reading.offset;
    };
    for (auto& p : posed.joints) move(p);
    for (auto& p : posed.vertices) move(p);
    return posed;
}

} // namespace gsh
