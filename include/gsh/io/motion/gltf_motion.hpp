// SPDX-License-Identifier: Apache-2.0
/// @file  Reads animations of glTF and GLB files, of VRM models and of VRM animations (.vrma).
#pragma once

#include <gsh/body/joint_map.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/body/rig_pose.hpp>
#include <gsh/body/rig_up.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/file/gltf_channel.hpp>
#include <gsh/io/file/gltf_file.hpp>
#include <gsh/io/file/gltf_nodes.hpp>
#include <gsh/io/file/gltf_numbers.hpp>
#include <gsh/io/file/text_lines.hpp>
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
#include <filesystem>
#include <string>
#include <vector>

namespace gsh {

/// Reads one animation of a file: the one called `animation`, or the first with rotations of nodes.
///
/// Joints    the nodes that the animation, a skin or VRM's humanoid bones use, with those above and below. In a VRM
///           file, humanoid bones have VRM's names.
/// Rest      of VRM files the nodes' own transforms, as VRM demands; else the pose in which the largest skin was bound
///           (its inverse bind matrices), and the nodes' transforms without a skin.
/// Frames    the key frames if they are evenly spaced, 5 a second or more; else 30 a second, interpolated.
/// Frame     y up, as in glTF; a body that stands on a ground along another axis (find_up) is turned. Scales of nodes
///           count, for instance an armature scaled by 0.01.
/// Units     metres; other units are guessed from the legs, with a warning.
/// Errors    IoError, ValueError naming file and place: no animation, an index out of range, a tree with a cycle, times
///           that do not ascend, a buffer that is short, a mirrored or repeated joint, an animation without nodes.
[[nodiscard]] inline RigMotion load_gltf_motion(const std::filesystem::path& path, const JointMap& map = {},
                                                std::vector<std::string>* warnings = nullptr,
                                                const std::string& animation = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

class GltfMotionReader {
public:
    explicit GltfMotionReader(const std::filesystem::path& path)
        : file_(path), nodes_(file_), joints_(file_, nodes_), numbers_(file_) {}

    RigMotion read(const JointMap& map, std::vector<std::string>* warnings, const std::string& wanted) {
        choose_animation(wanted, warnings);
        joints_.keep_joints([&](int node) { return channels_.contains(node); });
        const std::vector<double> times = frame_times();
        check_rig_size(file_.name(), joints_.joint_count(), times.size());
        joints_.describe(rig_);
        rig_.rest_joints.resize(rig_.joint_count()), rig_.rest_rotations.resize(rig_.joint_count());
        pose({}, 0, rig_.rest_joints.data(), rig_.rest_rotations.data());
        rig_.joints.resize(times.size() * rig_.joint_count());
        rig_.rotations.resize(times.size() * rig_.joint_count());
        for (std::size_t t = 0; t < times.size(); ++t)
            pose(channels_, times[t], &rig_.joints[t * rig_.joint_count()], &rig_.rotations[t * rig_.joint_count()]);
        rig_.timestamps = times;
        validate(rig_, file_.name());
        if (!joints_.has_humanoid()) rest_of_skin(map);
        return std::move(rig_);
    }

private:
    using Channels = GltfNodes::Channels;
    GltfFile file_;
    GltfNodes nodes_;
    GltfJoints joints_;
    GltfNumbers numbers_;
    Channels channels_;
    RigMotion rig_;

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
            file_.fail("has no animation '" + wanted + "', but " + list_of_names(names, 30));
        if (chosen < 0)
            file_.fail(all.empty() ? "holds no animations"
                                   : "holds " + std::to_string(all.size()) + " animations, but none rotates a node");
        if (wanted.empty() && all.size() > 1 && warnings)
            warnings->push_back(file_.name() + ": holds " + std::to_string(all.size()) + " animations (" +
                                list_of_names(names) + "); '" + names[static_cast<std::size_t>(chosen)] + "' is read");
        const std::string where = "animation '" + shortened(names[static_cast<std::size_t>(chosen)]) + "'";
        channels_ = nodes_.channels(all[static_cast<std::size_t>(chosen)], numbers_, where);
        if (channels_.empty()) file_.fail(where + " moves no node");
    }

    /// The times of the key frames if they are evenly spaced, else 30 times a second from the first to the last.
    [[nodiscard]] std::vector<double> frame_times() const {
        std::vector<double> keys;
        const std::vector<double>* last = nullptr;
        for (const auto& [node, channels] : channels_)
            for (const GltfChannel* channel : {&channels.rotation, &channels.translation, &channels.scale}) {
                if (last && *last == channel->times()) continue; // as most channels are
                last = &channel->times();
                keys.insert(keys.end(), last->begin(), last->end());
            }
        std::sort(keys.begin(), keys.end());
        constexpr double same = 1e-4; // seconds; files round differently
        keys.erase(std::unique(keys.begin(), keys.end(), [](double a, double b) { return b - a < same; }), keys.end());
        const double from = keys.front(), length = keys.back() - from;
        const double step = keys.size() > 1 ? length / static_cast<double>(keys.size() - 1) : 0;
        bool even = step <= 0.2;
        for (std::size_t k = 0; k < keys.size(); ++k)
            even = even && std::abs(keys[k] - from - static_cast<double>(k) * step) <= 0.05 * step + same;
        if (even) return keys;
        constexpr double rate = 30;
        if (length * rate > 16e6) file_.fail("lasts " + number_text(length) + " s, more than is read");
        std::vector<double> times;
        for (double t = 0; t <= length + 0.001; t = static_cast<double>(times.size()) / rate) times.push_back(from + t);
        return times;
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
                file_.fail("the joint '" + joints_.name_of(j) +
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

inline RigMotion load_gltf_motion(const std::filesystem::path& path, const JointMap& map,
                                  std::vector<std::string>* warnings, const std::string& animation) {
    RigMotion rig = detail::GltfMotionReader(path).read(map, warnings, animation);
    const MatchedJoints matched = map.match(rig, path.string());
    const LengthUnit unit = guess_length_unit(rig, matched);
    RigUp up = find_up(rig, matched, false); // a skin may be bound in axes of its own
    if (!up.doubt.empty()) up = {};          // glTF demands y up
    const auto warn = [&](const std::string& text) {
        if (warnings && !text.empty()) warnings->push_back(path.string() + ": " + text);
    };
    if (unit.metres != 1) warn(detail::unit_warning(unit));
    warn(detail::up_warning(up));
    if (unit.metres != 1 || up.axis != SignedAxis{}) move_rig(rig, turn_to_y(up.axis), unit.metres);
    return rig;
}

} // namespace gsh
