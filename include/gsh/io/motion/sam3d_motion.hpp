// SPDX-License-Identifier: Apache-2.0
/// @file  Reads motions of SAM 3D Body: its predictions for each image and the rest pose of its rig (MHR), in one .npz.
#pragma once

#include <gsh/body/joint_map.hpp>
#include <gsh/body/joint_names.hpp>
#include <gsh/body/rest_pose.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/body/turned_limbs.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/npz.hpp>
#include <gsh/io/motion/frame_rate.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// Reads names [J], parents [J], rest_joints [J, 3] and rest_rotations [J, 3, 3] of the rig, pred_joint_coords
/// [T, J, 3] and pred_global_rots [T, J, 3, 3] of the frames, and optionally pred_cam_t [T, 3] and fps, or another of
/// frame_rate_keys. The page
/// `captures` has the program that writes it.
///
/// Frame   SAM 3D Body gives positions in the camera's axes (y down, z forward) and rotations with y up. Both are taken
///         to y up: half a turn about x from the camera's axes. Positions that are y up already are recognised, because
///         bones must point where the rotations turn them.
/// Hands   positions count: limbs, hands and fingers are turned to where the joints are (body/turned_limbs.hpp). Where
///         hands were refined, SAM 3D Body's positions are of the refined hands, its rotations of those before. If
///         positions and rotations differ by more than 5 degrees in limbs or 10 in fingers, a warning is added.
/// Errors  IoError, ShapeError, ValueError naming file and key; rotations and positions that do not belong together.
[[nodiscard]] inline RigMotion load_sam3d_motion(const InputFile& input, const JointMap& map = {},
                                                 std::vector<std::string>* warnings = nullptr,
                                                 const FrameRates& rates = {});

/// From axes with y up to those of a camera, y down and z forward, or back.
[[nodiscard]] inline mat3<double> half_turn_about_x() {
    return {vec3<double>(1, 0, 0), vec3<double>(0, -1, 0), vec3<double>(0, 0, -1)};
}

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// The mean angle, in radians, between bones of limbs in the frames and the directions to which the joints' rotations
/// turn those of the rest pose; `turn` is applied to the frames' bones.
inline double bone_disagreement(const RigMotion& rig, const MatchedJoints& matched, const mat3<double>& turn) {
    double sum = 0;
    std::size_t count = 0;
    const std::size_t frames = std::min<std::size_t>(rig.frame_count(), 20);
    for (const auto& [from, to] :
         {std::pair{"hip", "knee"}, {"knee", "ankle"}, {"shoulder", "elbow"}, {"elbow", "wrist"}})
        for (const std::string side : {"left_", "right_"}) {
            const int a = matched_joint(matched, side + from), b = matched_joint(matched, side + to);
            if (a < 0 || b < 0) continue;
            const auto i = static_cast<std::size_t>(a), k = static_cast<std::size_t>(b);
            for (std::size_t t = 0; t < frames; ++t) {
                const vec3<double> expected =
                    rig.rotation(t, a) * transpose(rig.rest_rotations[i]) * (rig.rest_joints[k] - rig.rest_joints[i]);
                const vec3<double> found = turn * (rig.joint(t, b) - rig.joint(t, a));
                sum += std::atan2(length(cross(expected, found)), dot(expected, found)), ++count;
            }
        }
    return count ? sum / static_cast<double>(count) : std::numeric_limits<double>::infinity();
}

} // namespace detail

inline RigMotion load_sam3d_motion(const InputFile& input, const JointMap& map, std::vector<std::string>* warnings,
                                   const FrameRates& rates) {
    const NpzReader file(input);
    RigMotion rig;
    for (const char* key :
         {"names", "parents", "rest_joints", "rest_rotations", "pred_joint_coords", "pred_global_rots"})
        if (!file.has(key))
            throw IoError(file.name_of(key) + " is missing; expected the rig's names, parents, rest_joints and "
                                              "rest_rotations beside the frames' pred_joint_coords and "
                                              "pred_global_rots");
    const Shape shape = file.header("pred_global_rots").shape;
    const std::size_t T = shape.empty() ? 0 : shape[0], J = shape.size() < 2 ? 0 : shape[1];
    check_value(T > 0 && J > 0, file.name_of("pred_global_rots"), "holds no frames or no joints");
    check_value(J <= 4096, file.name_of("pred_global_rots"),
                "holds " + std::to_string(J) + " joints, expected at most 4096; MHR has 127");
    check_rig_size(input.name(), J, T);
    const auto frames = static_cast<std::int64_t>(T), joints = static_cast<std::int64_t>(J);
    rig.names = file.read_texts("names");
    check_size(input.name(), "names", rig.names.size(), J, "as many as pred_global_rots has joints");
    for (const std::string& name : rig.names)
        check_value(name.size() <= longest_joint_name, file.name_of("names"),
                    "holds a name of " + std::to_string(name.size()) + " bytes, expected at most " +
                        std::to_string(longest_joint_name));
    for (const auto parent : file.read<std::int64_t>("parents", {joints}).data)
        rig.parents.push_back(parent < 0 || parent >= joints ? -1 : static_cast<int>(parent));
    const auto vectors = [&](const NpyArray<double>& array, std::vector<vec3<double>>& to) {
        for (std::size_t i = 0; i + 2 < array.size(); i += 3) to.emplace_back(array[i], array[i + 1], array[i + 2]);
    };
    const auto matrices = [&](const NpyArray<double>& array, std::vector<mat3<double>>& to) { // stored by rows
        for (std::size_t i = 0; i + 8 < array.size(); i += 9)
            to.push_back(transpose(mat3<double>(vec3<double>(array[i], array[i + 1], array[i + 2]),
                                                vec3<double>(array[i + 3], array[i + 4], array[i + 5]),
                                                vec3<double>(array[i + 6], array[i + 7], array[i + 8]))));
    };
    vectors(file.read<double>("rest_joints", {joints, 3}), rig.rest_joints);
    matrices(file.read<double>("rest_rotations", {joints, 3, 3}), rig.rest_rotations);
    vectors(file.read<double>("pred_joint_coords", {frames, joints, 3}), rig.joints);
    matrices(file.read<double>("pred_global_rots", {frames, joints, 3, 3}), rig.rotations);
    std::vector<vec3<double>> camera;
    if (file.has("pred_cam_t")) vectors(file.read<double>("pred_cam_t", {frames, 3}), camera);
    rig.timestamps = frame_times(T, stated_time(file, T), rates, input.name(), warnings);
    validate(rig, input.name());

    const MatchedJoints matched = map.match(rig, input.name());
    const mat3<double> half = half_turn_about_x();
    const double as_camera = detail::bone_disagreement(rig, matched, half),
                 as_it_is = detail::bone_disagreement(rig, matched, mat3<double>(1.0));
    check_value(!(std::min(as_camera, as_it_is) > 0.5) || !std::isfinite(as_camera), input.name(),
                "bones point " + std::to_string(std::lround(std::min(as_camera, as_it_is) * 57.29578)) +
                    " degrees away from where the rotations turn them; expected rest_joints and rest_rotations of the "
                    "same rig, at rest");
    const bool turned = as_camera <= as_it_is;
    for (std::size_t i = 0; i < rig.joints.size(); ++i) {
        const vec3<double> from_camera = camera.empty() ? vec3<double>(0) : half * camera[i / J];
        rig.joints[i] = (turned ? half * rig.joints[i] : rig.joints[i]) + from_camera;
    }
    fit_rest_to_frames(rig, matched);
    const LimbTurns turns = turn_limbs_to_joints(rig, matched);
    const auto warn_of = [&](const char* what, double radians, double most) {
        const double degrees = radians * 57.29578;
        if (degrees > most && warnings)
            warnings->push_back(input.name() + ": " + what + " point " + std::to_string(std::lround(degrees)) +
                                " degrees away from where pred_global_rots turn them; the positions of "
                                "pred_joint_coords are taken");
    };
    warn_of("limbs", turns.limbs, 5);
    warn_of("fingers", turns.fingers, 10);
    return rig;
}

} // namespace gsh
