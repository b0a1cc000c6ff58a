// SPDX-License-Identifier: Apache-2.0
/// @file  Descriptions of the differences between a reading and a capture's files: fault, hypothesis and remedy.
#pragma once

#include <gsh/check/capture_aspects.hpp>
#include <gsh/check/capture_reading.hpp>
#include <gsh/io/capture/capture_data.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

namespace gsh {

/// The fault's name, the hypothesis that corrects it ("with …"), and the remedy for the capture's author.
[[nodiscard]] inline std::string fault_name(const Aspect& aspect, const CaptureReading& reading);
[[nodiscard]] inline std::string hypothesis_text(const Aspect& aspect, const CaptureReading& reading);
[[nodiscard]] inline std::string remedy_text(const Aspect& aspect, const CaptureReading& reading,
                                             const Capture& capture, const std::vector<CheckedPerson>& people);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

inline std::string digits(double value, int count) {
    char text[64];
    std::snprintf(text, sizeof text, "%.*f", count, value);
    return text;
}

inline constexpr auto absence_remedy = "no person in the images has these poses: leave them out of --poses, or look "
                                       "for another fault of these poses, or for masks that omit a person";

/// How to leave out a photograph: every layout has a place for it.
inline constexpr auto leave_out_remedy = "leave them out with an empty mask (black, or alpha 0 everywhere)";

} // namespace detail

inline std::string fault_name(const Aspect& aspect, const CaptureReading& reading) {
    const CameraReading& camera = reading.cameras[aspect.cameras.front()];
    const bool own = camera.extrinsics == Extrinsics::world_to_camera; // then only the unit differs
    switch (aspect.kind) {
    case Aspect::Kind::inverted_mask:
        return "inverted-masks";
    case Aspect::Kind::mirrored_image:
        return "mirrored-images";
    case Aspect::Kind::extrinsics:
        return own                                                ? "camera-units"
               : camera.extrinsics == Extrinsics::camera_to_world ? "camera-to-world"
               : camera.extrinsics == Extrinsics::transposed      ? "transposed-rotation"
               : camera.extrinsics == Extrinsics::position        ? "camera-position"
                                                                  : "opengl-cameras";
    case Aspect::Kind::resolution:
        return "other-resolution";
    case Aspect::Kind::order:
        return "frame-order";
    case Aspect::Kind::shift:
        return "principal-point";
    case Aspect::Kind::zoom:
        return "focal-length";
    case Aspect::Kind::absent:
        return "absent-person";
    case Aspect::Kind::sides:
        return "mirrored-poses";
    case Aspect::Kind::degrees:
        return "degrees";
    case Aspect::Kind::translation_unit:
        return "translation-units";
    case Aspect::Kind::translation:
        return "translation-origin";
    case Aspect::Kind::world:
        return "world-axes";
    case Aspect::Kind::size:
        return "body-size";
    case Aspect::Kind::offset:
        return "displaced-body";
    }
    return {};
}

inline std::string hypothesis_text(const Aspect& aspect, const CaptureReading& reading) {
    using Kind = Aspect::Kind;
    const CameraReading& camera = reading.cameras[aspect.cameras.front()];
    const MotionReading motion = aspect.of_motion() ? reading.motions[aspect.people.front()] : MotionReading();
    const auto unit = [](double metres) { return metres == 0.001 ? "millimetres" : "centimetres"; };
    switch (aspect.kind) {
    case Kind::inverted_mask:
        return "with inverted masks";
    case Kind::mirrored_image:
        return "with images flipped left to right";
    case Kind::extrinsics: {
        std::string text = "with ";
        switch (camera.extrinsics) {
        case Extrinsics::world_to_camera:
            return text + "t in " + unit(camera.unit);
        case Extrinsics::camera_to_world:
            text += "R, t read as camera to world";
            break;
        case Extrinsics::opengl:
            text += "R, t read in OpenGL's axes (y up, z backward)";
            break;
        case Extrinsics::opengl_camera_to_world:
            text += "R, t read as camera to world in OpenGL's axes (y up, z backward)";
            break;
        case Extrinsics::transposed:
            text += "R transposed";
            break;
        case Extrinsics::position:
            text += "t read as the camera's position";
            break;
        }
        return text + (camera.unit == 1 ? "" : std::string(" and t in ") + unit(camera.unit));
    }
    case Kind::resolution:
        return "with K divided by " + detail::digits(camera.resolution, 2);
    case Kind::order:
        return camera.order.kind == FrameOrder::Kind::reversed ? "in reversed order"
               : camera.order.kind == FrameOrder::Kind::offset
                   ? "with the pose of " + std::to_string(std::abs(camera.order.offset)) + " frame" +
                         (std::abs(camera.order.offset) == 1 ? "" : "s") +
                         (camera.order.offset > 0 ? " later" : " earlier")
                   : "with images taken in the order of words (1, 10, 2)";
    case Kind::shift:
        return "with a moved principal point";
    case Kind::zoom:
        return "with another focal length";
    case Kind::absent:
        return "without these poses";
    case Kind::sides:
        return motion.sides == MotionReading::Sides::mirrored ? "with left and right of the pose mirrored"
                                                              : "with left and right joints exchanged";
    case Kind::degrees:
        return "with angles in degrees";
    case Kind::translation_unit:
        return std::string("with transl in ") + unit(motion.translation_unit);
    case Kind::translation:
        return motion.translation == MotionReading::Translation::of_root_joint
                   ? "with transl as the root joint's position"
                   : "with transl added to a body turned about the origin";
    case Kind::world:
        return motion.world == MotionReading::World::z_up         ? "with z upwards in the poses"
               : motion.world == MotionReading::World::minus_z_up ? "with -z upwards in the poses"
                                                                  : "with y and z of the poses negated";
    case Kind::size:
        return "with the body scaled by " + detail::digits(motion.size, motion.size < 0.1 ? 3 : 2);
    case Kind::offset:
        return "with the body moved by (" + detail::digits(motion.offset.x, 3) + ", " +
               detail::digits(motion.offset.y, 3) + ", " + detail::digits(motion.offset.z, 3) + ") m";
    }
    return {};
}

inline std::string remedy_text(const Aspect& aspect, const CaptureReading& reading, const Capture& capture,
                               const std::vector<CheckedPerson>& people) {
    using Kind = Aspect::Kind;
    const CameraReading& camera = reading.cameras[aspect.cameras.front()];
    const MotionReading motion = aspect.of_motion() ? reading.motions[aspect.people.front()] : MotionReading();
    // One short phrase per camera, for as many cameras as fit on a line.
    const auto each = [&](const auto& phrase) {
        constexpr std::size_t most = 8;
        std::string text;
        for (std::size_t i = 0; i < std::min(most, aspect.cameras.size()); ++i) {
            const std::size_t c = aspect.cameras[i];
            text += (i ? ", " : "") + (aspect.cameras.size() > 1 ? capture.cameras[c].name + " " : "") +
                    phrase(capture.cameras[c].camera, reading.cameras[c]);
        }
        return text + (aspect.cameras.size() > most ? ", …" : "");
    };
    switch (aspect.kind) {
    case Kind::inverted_mask:
        return "store alpha (or masks/) 255 on the person, 0 elsewhere";
    case Kind::mirrored_image:
        return "flip images and masks back (front cameras of phones mirror)";
    case Kind::extrinsics: {
        const char* metres = camera.unit == 1 ? "" : "; t in metres";
        switch (camera.extrinsics) {
        case Extrinsics::world_to_camera:
            return "store t in metres";
        case Extrinsics::camera_to_world:
            return std::string("store R' = transpose(R), t' = -transpose(R) t") + metres;
        case Extrinsics::opengl:
            return std::string("negate the second and third row of R and t") + metres;
        case Extrinsics::opengl_camera_to_world:
            return std::string(
                       "store R' = transpose(R), t' = -transpose(R) t, then negate the second and third row of both") +
                   metres;
        case Extrinsics::transposed:
            return std::string("store R row by row") + metres;
        case Extrinsics::position:
            return std::string("store t' = -R t") + metres;
        }
        return {};
    }
    case Kind::resolution:
        return "K is for images of another size: " + each([](const Camera<double>& c, const CameraReading& r) {
                   const Camera<double> moved = read_as(c, r);
                   return "store fx " + detail::digits(moved.fx, 1) + ", fy " + detail::digits(moved.fy, 1) + ", cx " +
                          detail::digits(moved.cx, 1) + ", cy " + detail::digits(moved.cy, 1);
               });
    case Kind::order:
        return camera.order.kind == FrameOrder::Kind::offset
                   ? "pair image n with pose n " + std::string(camera.order.offset > 0 ? "+ " : "- ") +
                         std::to_string(std::abs(camera.order.offset))
               : camera.order.kind == FrameOrder::Kind::reversed ? "reverse the poses or the images"
                                                                 : "pad the images' numbers with zeros";
    case Kind::shift:
        return each([](const Camera<double>& c, const CameraReading& r) {
                   const Camera<double> moved = read_as(c, r);
                   return "store cx " + detail::digits(moved.cx, 1) + ", cy " + detail::digits(moved.cy, 1) +
                          " (were " + detail::digits(c.cx, 1) + ", " + detail::digits(c.cy, 1) + ")";
               }) +
               (capture.cameras.size() == 1 ? ", or look for a constant error of transl" : "");
    case Kind::zoom:
        return each([](const Camera<double>& c, const CameraReading& r) {
            const Camera<double> moved = read_as(c, r);
            return "store fx " + detail::digits(moved.fx, 1) + ", fy " + detail::digits(moved.fy, 1) + " (were " +
                   detail::digits(c.fx, 1) + ", " + detail::digits(c.fy, 1) + ")";
        });
    case Kind::absent:
        return detail::absence_remedy;
    case Kind::sides:
        return motion.sides == MotionReading::Sides::mirrored
                   ? "the poses were estimated on mirrored images: exchange left and right joints, and negate y and z "
                     "of each rotation but global_orient"
                   : "list the joints in the body's order, left before right";
    case Kind::degrees:
        return "store axis-angle in radians";
    case Kind::translation_unit:
        return "store transl in metres";
    case Kind::translation:
        return motion.translation == MotionReading::Translation::of_root_joint
                   ? "store transl' = transl - J0, J0 being the root joint at rest"
                   : "store transl' = transl + R J0 - J0, J0 being the root joint at rest, R global_orient";
    case Kind::world: {
        const char* turn = motion.world == MotionReading::World::z_up         ? "(x, z, -y)"
                           : motion.world == MotionReading::World::minus_z_up ? "(x, -z, y)"
                                                                              : "(x, -y, -z)";
        return std::string("turn the poses' world by W, which takes (x, y, z) to ") + turn +
               ": store global_orient' = W global_orient, transl' = W (transl + J0) - J0, J0 being the root joint at "
               "rest";
    }
    case Kind::size: {
        if (motion.size < 0.1)
            return "the body file is not in metres: store v_template, shapedirs and posedirs in metres";
        const bool none = std::all_of(aspect.people.begin(), aspect.people.end(), [&](std::size_t p) {
            const auto& betas = people[p].motion->betas;
            return std::all_of(betas.begin(), betas.end(), [](double b) { return b == 0; });
        });
        return none ? "betas are all zero: store the person's"
                    : "betas are probably of another body model, or K, t and the poses differ in scale";
    }
    case Kind::offset:
        return "add it to transl, or look for another origin of the poses' world";
    }
    return {};
}

} // namespace gsh
