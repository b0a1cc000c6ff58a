// SPDX-License-Identifier: Apache-2.0
/// @file  Reads animations of glTF and GLB files, of VRM models and of VRM animations (.vrma).
#pragma once

#include <gsh/body/joint_map.hpp>
#include <gsh/body/rest_pose.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/body/rig_up.hpp>
#include <gsh/body/turned_limbs.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/file/claimed_size.hpp>
#include <gsh/io/file/gltf_channel.hpp>
#include <gsh/io/file/gltf_file.hpp>
#include <gsh/io/file/gltf_nodes.hpp>
#include <gsh/io/file/gltf_numbers.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/text_lines.hpp>
#include <gsh/io/motion/frame_rate.hpp>
#include <gsh/io/motion/gltf_frame_times.hpp>
#include <gsh/io/motion/gltf_joints.hpp>
#include <gsh/io/motion/unit_guess.hpp>
#include <gsh/io/motion/up_warning.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/polar.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/signed_axis.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

namespace gsh {

/// Reads one animation of a file: the one called `animation`, or the first with rotations of nodes.
///
/// Joints    the nodes that the animation, a skin or VRM's humanoid bones use, with those above and below; all nodes if
///           limbs are missing among them, as where only the upper body is animated. In a VRM file, humanoid bones have
///           VRM's names. Names may be repeated: the second node called NAME is NAME#2.
/// Rest      of VRM files the nodes' own transforms, as VRM demands; else the pose in which the largest skin was bound
///           (its inverse bind matrices), and the nodes' transforms without a skin.
/// Frames    the key frames if they are evenly spaced, 10 a second or more. Otherwise, and where curves between keys
///           bend, more, so that the curves are kept (io/motion/gltf_frame_times.hpp). rates.input changes the rate of
///           key frames that are even.
/// Frame     y up, as in glTF. A body that stands on a ground along another axis (find_up) is turned. Scales of nodes
///           count, for instance an armature scaled by 0.01.
/// Units     metres; other units are guessed from the legs, with a warning. Of files that gsh wrote, neither unit nor
///           vertical is guessed.
/// Errors    IoError, ValueError naming file and place: no animation, an index out of range, a tree with a cycle, times
///           that do not ascend, a buffer that is short, a mirrored joint, an animation without nodes.
[[nodiscard]] inline RigMotion load_gltf_motion(const InputFile& input, const JointMap& map = {},
                                                std::vector<std::string>* warnings = nullptr,
                                                const std::string& animation = {}, const FrameRates& rates = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

class GltfMotionReader {
public:
    explicit GltfMotionReader(const InputFile& input)
        : file_(input), nodes_(file_), joints_(file_, nodes_), numbers_(file_, most_numbers()) {}

    RigMotion read(const JointMap& map, std::vector<std::string>* warnings, const std::string& wanted,
                   const FrameRates& rates) {
        choose_animation(wanted, warnings);
        joints_.keep_joints([&](int node) { return channels_.contains(node); });
        if (!has_limbs(map)) joints_.keep_joints([](int) { return true; }); // an animation of the upper body alone
        const GltfFrameTimes frames(file_, channels_, joints_.joint_count(), held_bytes());
        const std::vector<double>& times = frames.times();
        if (frames.error() > 1 && warnings)
            warnings->push_back(file_.name() + ": between frames, at " +
                                std::to_string(std::lround(1 / (times[1] - times[0]))) +
                                " a second, joints are up to " + number_text(std::round(frames.error())) +
                                " degrees off the animation's curves");
        check_rig_size(file_.name(), joints_.joint_count(), times.size());
        check_claimed_poses(file_.name(), joints_.joint_count(), times.size(), held_bytes());
        joints_.describe(rig_);
        rig_.rest_joints.resize(rig_.joint_count()), rig_.rest_rotations.resize(rig_.joint_count());
        pose({}, 0, rig_.rest_joints.data(), rig_.rest_rotations.data());
        rig_.joints.resize(times.size() * rig_.joint_count());
        rig_.rotations.resize(times.size() * rig_.joint_count());
        for (std::size_t t = 0; t < times.size(); ++t)
            pose(channels_, times[t], &rig_.joints[t * rig_.joint_count()], &rig_.rotations[t * rig_.joint_count()]);
        rig_.timestamps = times;
        if (rates.input > 0) state_rate(rates, frames.frames_a_key(), warnings);
        validate(rig_, file_.name());
        if (!joints_.has_humanoid()) rest_of_skin(map);
        return std::move(rig_);
    }
    /// Whether gsh wrote the file.
    [[nodiscard]] bool is_own() const { return file_.model().asset.generator.starts_with("gsh "); }

private:
    using Channels = GltfNodes::Channels;
    GltfFile file_;
    GltfNodes nodes_;
    GltfJoints joints_;
    GltfNumbers numbers_;
    Channels channels_;
    RigMotion rig_;

    /// Bytes of all buffers.
    [[nodiscard]] std::size_t held_bytes() const {
        std::size_t sum = 0;
        for (const tinygltf::Buffer& buffer : file_.model().buffers) sum += buffer.data.size();
        return sum;
    }
    /// Accessors may share bytes, and are read as doubles.
    [[nodiscard]] std::size_t most_numbers() const {
        const std::size_t most = std::max<std::size_t>(unquestioned_memory, most_inflation * held_bytes());
        return std::min(std::size_t(1) << 27, most / sizeof(double));
    }
    [[nodiscard]] static bool moves(const tinygltf::AnimationChannel& channel) {
        return channel.target_node != -1 && channel.target_path == "rotation";
    }

    void choose_animation(const std::string& wanted, std::vector<std::string>* warnings) {
        const auto& all = file_.model().animations;
        std::vector<std::string> names;
        int chosen = -1;
        for (std::size_t a = 0; a < all.size(); ++a) {
            names.push_back(all[a].name.empty() ? "animation_" + std::to_string(a) : all[a].name);
            const bool useful = std::any_of(all[a].channels.begin(), all[a].channels.end(), moves);
            if (chosen < 0 && (wanted.empty() ? useful : names.back() == wanted)) chosen = static_cast<int>(a);
        }
        if (chosen < 0 && !wanted.empty())
            file_.fail("has no animation '" + shortened(wanted) + "', but " + list_of_names(names, 30));
        if (chosen < 0)
            file_.fail(all.empty() ? "holds no animations"
                                   : "holds " + std::to_string(all.size()) + " animations, but none rotates a node");
        if (wanted.empty() && all.size() > 1 && warnings)
            warnings->push_back(file_.name() + ": holds " + std::to_string(all.size()) + " animations (" +
                                list_of_names(names) + "); '" + shortened(names[static_cast<std::size_t>(chosen)]) +
                                "' is read");
        const std::string where = "animation '" + shortened(names[static_cast<std::size_t>(chosen)]) + "'";
        channels_ = nodes_.channels(all[static_cast<std::size_t>(chosen)], numbers_, where);
        if (channels_.empty()) file_.fail(where + " moves no node");
    }

    /// Whether the joints that are kept hold a person's limbs.
    [[nodiscard]] bool has_limbs(const JointMap& map) const {
        RigMotion rig;
        joints_.describe(rig);
        try {
            check_limbs(rig, map.match(rig, file_.name()), file_.name());
        } catch (const ValueError&) {
            return false;
        }
        return true;
    }

    /// Gives the frames the rate that the caller states for the key frames, if they are even.
    void state_rate(FrameRates rates, std::size_t frames_a_key, std::vector<std::string>* warnings) {
        rates.input *= static_cast<double>(frames_a_key);
        if (frames_a_key > 0)
            rig_.timestamps = frame_times(rig_.frame_count(), {rig_.timestamps, 0, file_.name() + ": key frames"},
                                          rates, file_.name(), warnings);
        else if (warnings)
            warnings->push_back(file_.name() + ": --input-fps is not applied, because its key frames are not even and "
                                               "their times are seconds");
    }

    /// World frames of all joints at a time; without channels, of the nodes' own transforms.
    void pose(const Channels& channels, double time, vec3<double>* joints, mat3<double>* rotations) const {
        std::vector<Affine<double>> world(joints_.joint_count());
        for (std::size_t j = 0; j < joints_.joint_count(); ++j) {
            const GltfTransform own = nodes_.transform(joints_.node_of(j), channels, time);
            const int parent = joints_.parent_of(j);
            const mat3<double> above = parent < 0 ? mat3<double>(1.0) : rotations[parent];
            world[j] = parent < 0 ? own.matrix() : world[static_cast<std::size_t>(parent)] * own.matrix();
            joints[j] = world[j].translation;
            const mat3<double>& L = world[j].linear;
            const double volume = determinant(L), size = dot(L[0], L[0]) + dot(L[1], L[1]) + dot(L[2], L[2]);
            const double flat = 1e-9 * size * std::sqrt(size);
            if (volume < -flat)
                file_.fail("the joint '" + shortened(joints_.name_of(j)) +
                           "' is mirrored by a negative scale, expected scales above 0");
            rotations[j] = volume > flat ? polar_rotation(L) : above * own.rotation; // a scale of 0 has no rotation
        }
    }

    /// Takes the pose in which the largest skin was bound as rest pose, if it holds all limbs. It is in the axes and
    /// the unit of the skin's mesh: lengths are scaled to those of the frames.
    void rest_of_skin(const JointMap& map) {
        const tinygltf::Skin* skin = joints_.largest_skin();
        if (!skin || skin->inverseBindMatrices < 0) return;
        const std::vector<double> inverse = numbers_.read(skin->inverseBindMatrices, 16, "inverseBindMatrices");
        if (inverse.size() != 16 * skin->joints.size())
            file_.fail("a skin has " + std::to_string(skin->joints.size()) + " joints, but " +
                       std::to_string(inverse.size() / 16) + " inverse bind matrices");
        const std::size_t J = rig_.joint_count();
        std::vector<Affine<double>> bound(J);
        std::vector<bool> known(J, false);
        for (std::size_t k = 0; k < skin->joints.size(); ++k) {
            const double* m = &inverse[16 * k]; // by columns
            const Affine<double> joint_from_mesh({{m[0], m[1], m[2]}, {m[4], m[5], m[6]}, {m[8], m[9], m[10]}},
                                                 {m[12], m[13], m[14]});
            const double volume = determinant(joint_from_mesh.linear);
            const std::size_t j = joints_.joint_of(skin->joints[k]);
            if (!(volume > 1e-30) || !std::isfinite(volume)) return; // not a bind pose
            const mat3<double> back = glm::inverse(joint_from_mesh.linear);
            bound[j] = {back, back * joint_from_mesh.translation * -1.0};
            known[j] = true;
        }
        const MatchedJoints matched = map.match(rig_, file_.name());
        for (const int joint : matched)
            if (joint >= 0 && !known[static_cast<std::size_t>(joint)]) {
                const auto parent = rig_.parents[static_cast<std::size_t>(joint)];
                if (parent < 0 || !known[static_cast<std::size_t>(parent)]) return; // the skin is not of the body
            }
        if (!has_trunk(matched) || leg_length(rig_, matched, "left_") <= 0) return;
        RigMotion rest = rig_;
        for (std::size_t j = 0; j < J; ++j) {
            const int parent = rig_.parents[j];
            if (!known[j]) {
                const GltfTransform own = nodes_.transform(joints_.node_of(j));
                bound[j] = parent < 0 ? own.matrix() : bound[static_cast<std::size_t>(parent)] * own.matrix();
            }
            rest.rest_joints[j] = bound[j].translation;
            rest.rest_rotations[j] = polar_rotation(bound[j].linear);
        }
        if (!fit_rest_to_frames(rest, matched)) return;
        validate(rest, file_.name());
        rig_ = std::move(rest);
    }
};

} // namespace detail

inline RigMotion load_gltf_motion(const InputFile& input, const JointMap& map, std::vector<std::string>* warnings,
                                  const std::string& animation, const FrameRates& rates) {
    detail::GltfMotionReader reader(input);
    RigMotion rig = reader.read(map, warnings, animation, rates);
    const MatchedJoints matched = map.match(rig, input.name());
    LengthUnit unit = guess_length_unit(rig, matched);
    RigUp up = find_up(rig, matched, false); // a skin may be bound in axes of its own
    if (!up.doubt.empty()) up = {};          // glTF demands y up
    if (reader.is_own()) up = {}, unit.metres = 1; // also where a person lies, and where a doll's legs are short
    const auto warn = [&](const std::string& text) {
        if (warnings && !text.empty()) warnings->push_back(input.name() + ": " + text);
    };
    if (unit.metres != 1) warn(detail::unit_warning(unit));
    warn(detail::up_warning(up));
    if (unit.metres != 1 || up.axis != SignedAxis{}) move_rig(rig, turn_to_y(up.axis), unit.metres);
    turn_limbs_to_joints(rig, matched);
    return rig;
}

} // namespace gsh
