// SPDX-License-Identifier: Apache-2.0
/// @file  Writes motions as BVH files, which Blender, MotionBuilder and others read.
#pragma once

#include <gsh/body/rig_motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <numbers>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// Writes a rig with one root, atomically: its position and the rotations of all joints, in the order Zrotation
/// Xrotation Yrotation. The rest pose of the file is that of the rig, with the axes as rest frames; the root's OFFSET
/// is zero. Angles continue those of the frame before, so they interpolate.
///
/// Names   are kept, except for characters that a reader of lines would lose or misread: control characters, a blank at
///         either end and a brace at the end become '_'. A name that another joint has is made longer by '_'.
/// Units   centimetres, degrees; the time between frames is their mean, with a warning if it varies.
/// Errors  ValueError for a rig that is invalid or has several roots; IoError.
inline void save_bvh(const std::filesystem::path& path, const RigMotion& rig,
                     std::vector<std::string>* warnings = nullptr);

/// The angles a, b, c in radians of R = Rz(a) Rx(b) Ry(c), of the two solutions the one nearest to `before`.
[[nodiscard]] inline vec3<double> zxy_angles(const mat3<double>& R, const vec3<double>& before);

/// Whether a file was written by save_bvh, of any version, so that its lengths are centimetres. BVH has no place for a
/// comment; the file is recognised by how its root is written, down to the digits, blanks and tabs.
[[nodiscard]] inline bool is_saved_bvh(std::string_view text);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Three numbers with 7 digits after the point, each after a blank.
inline void append_numbers(std::string& text, const vec3<double>& v) {
    char digits[400]; // the largest double has 309 before the point
    for (int k = 0; k < 3; ++k) {
        const double number = v[k] == 0 ? 0.0 : v[k]; // no "-0"
        const auto end = std::to_chars(digits, digits + sizeof digits, number, std::chars_format::fixed, 7).ptr;
        text.append(" ").append(digits, end);
    }
}

/// The names of a rig's joints as a line of BVH can hold them, still each once.
inline std::vector<std::string> bvh_names(const std::vector<std::string>& names) {
    std::set<std::string> taken(names.begin(), names.end());
    std::vector<std::string> result;
    for (const std::string& given : names) {
        std::string name = given.empty() ? "_" : given;
        for (char& c : name)
            if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '_';
        if (name.front() == ' ') name.front() = '_';
        if (name.back() == ' ' || name.back() == '{') name.back() = '_';
        while (name != given && !taken.insert(name).second) name += '_';
        result.push_back(std::move(name));
    }
    return result;
}

/// What follows the name of the root in every file of save_bvh.
inline constexpr std::string_view saved_bvh_root =
    "\n{\n\tOFFSET 0.0000000 0.0000000 0.0000000\n"
    "\tCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n";

inline void append_bvh_joint(std::string& text, const RigMotion& rig, const std::vector<std::string>& names,
                             const std::vector<std::vector<int>>& children, int joint, int level) {
    constexpr double centimetres = 100;
    const auto j = static_cast<std::size_t>(joint);
    const std::string indent(static_cast<std::size_t>(level), '\t');
    const int parent = rig.parents[j];
    const vec3<double> offset =
        parent < 0 ? vec3<double>(0) : rig.rest_joints[j] - rig.rest_joints[static_cast<std::size_t>(parent)];
    text += indent + (parent < 0 ? "ROOT " : "JOINT ") + names[j] + "\n" + indent + "{\n" + indent + "\tOFFSET";
    append_numbers(text, offset * centimetres);
    text += "\n" + indent + (parent < 0 ? "\tCHANNELS 6 Xposition Yposition Zposition" : "\tCHANNELS 3") +
            " Zrotation Xrotation Yrotation\n";
    for (const int child : children[j]) append_bvh_joint(text, rig, names, children, child, level + 1);
    if (children[j].empty()) { // programs show a bone as long as this
        text += indent + "\tEnd Site\n" + indent + "\t{\n" + indent + "\t\tOFFSET";
        append_numbers(text, length(offset) > 0 ? offset * (centimetres / 2) : vec3<double>(0, 5, 0));
        text += "\n" + indent + "\t}\n";
    }
    text += indent + "}\n";
}

/// The mean time between frames, 1/30 s for a single one. `steady` is false if a step differs by more than 1%.
inline double frame_step(const RigMotion& rig, bool& steady) {
    const std::size_t T = rig.frame_count();
    steady = true;
    if (T < 2) return 1.0 / 30;
    const double step = (rig.timestamps[T - 1] - rig.timestamps[0]) / static_cast<double>(T - 1);
    for (std::size_t t = 1; t < T; ++t)
        steady = steady && std::abs(rig.timestamps[t] - rig.timestamps[t - 1] - step) <= 0.01 * step;
    return step > 0 ? step : 1.0 / 30;
}

} // namespace detail

inline vec3<double> zxy_angles(const mat3<double>& R, const vec3<double>& before) {
    constexpr double pi = std::numbers::pi;
    const double cosine = std::hypot(R[0].z, R[2].z); // of b
    const double b = std::atan2(R[1].z, cosine);
    vec3<double> first(std::atan2(-R[1].x, R[1].y), b, std::atan2(-R[0].z, R[2].z));
    if (cosine < 1e-9) first = {std::atan2(R[0].y, R[0].x), b, 0}; // a and c turn about one axis
    const auto near = [&](vec3<double> angles) {
        for (int k = 0; k < 3; ++k) angles[k] -= 2 * pi * std::round((angles[k] - before[k]) / (2 * pi));
        return angles;
    };
    const vec3<double> one = near(first), other = near({first.x + pi, pi - first.y, first.z + pi});
    return length(one - before) <= length(other - before) ? one : other;
}

inline bool is_saved_bvh(std::string_view text) {
    constexpr std::string_view beginning = "HIERARCHY\nROOT ";
    if (!text.starts_with(beginning)) return false;
    text.remove_prefix(beginning.size());
    return text.substr(std::min(text.find('\n'), text.size())).starts_with(detail::saved_bvh_root);
}

inline void save_bvh(const std::filesystem::path& path, const RigMotion& rig, std::vector<std::string>* warnings) {
    validate(rig, "save_bvh");
    const std::size_t J = rig.joint_count(), T = rig.frame_count();
    std::vector<std::vector<int>> children(J);
    for (std::size_t j = 1; j < J; ++j) {
        check_value(rig.parents[j] >= 0, "save_bvh",
                    "'" + rig.names[j] + "' is a second root, expected one skeleton in a file");
        children[static_cast<std::size_t>(rig.parents[j])].push_back(static_cast<int>(j));
    }
    std::string text = "HIERARCHY\n";
    detail::append_bvh_joint(text, rig, detail::bvh_names(rig.names), children, 0, 0);
    std::vector<int> order; // of the channels: depth first, as the hierarchy was written
    for (std::vector<int> open{0}; !open.empty();) {
        const int j = open.back();
        open.pop_back();
        order.push_back(j);
        const auto& own = children[static_cast<std::size_t>(j)];
        open.insert(open.end(), own.rbegin(), own.rend());
    }
    bool steady = true;
    const double step = detail::frame_step(rig, steady);
    if (!steady && warnings)
        warnings->push_back(path.string() + ": the times between frames differ, and BVH stores only one; their mean is "
                                            "written");
    char digits[32];
    const auto end = std::to_chars(digits, digits + sizeof digits, step, std::chars_format::general, 9).ptr;
    text += "MOTION\nFrames: " + std::to_string(T) + "\nFrame Time: " + std::string(digits, end) + "\n";
    AtomicFile file(path);
    file.write(text);
    std::vector<vec3<double>> before(J, vec3<double>(0));
    for (std::size_t t = 0; t < T; ++t) {
        text.clear();
        for (const int joint : order) {
            const auto j = static_cast<std::size_t>(joint);
            const int parent = rig.parents[j];
            const auto turn = [&](int k) { // from the rest pose
                return rig.rotation(t, k) * transpose(rig.rest_rotations[static_cast<std::size_t>(k)]);
            };
            const mat3<double> local = parent < 0 ? turn(joint) : transpose(turn(parent)) * turn(joint);
            before[j] = zxy_angles(local, before[j]);
            if (parent < 0) detail::append_numbers(text, rig.joint(t, joint) * 100.0);
            detail::append_numbers(text, before[j] * (180 / std::numbers::pi));
        }
        file.write(std::string_view(text).substr(1)); // without the first blank
        file.write("\n");
    }
    file.commit();
}

} // namespace gsh
