// SPDX-License-Identifier: Apache-2.0
/// @file  The 55 joints of SMPL-X among MakeHuman's bones: positions, merged weights, and the turn to a T-pose.
#pragma once

#include <gsh/body/joint_names.hpp>
#include <gsh/body/rest_pose.hpp>
#include <gsh/body/skeleton.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/io/body/makehuman_rig.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// A weight of one vertex.
struct JointWeight {
    int joint = 0;
    double weight = 0;
};

/// The joints of SMPL-X on the base mesh.
struct MakeHumanSkeleton {
    std::vector<int> parents;                    // [55]
    std::vector<std::vector<int>> joints;        // [55] vertices whose mean is the joint
    std::array<std::vector<int>, 8> finger_tips; ///< index, middle, ring and pinky of the left, then of the right hand
    std::vector<std::vector<JointWeight>> weights; // [vertices of the base mesh] at most 6, they sum to 1

    /// The positions of the joints, or their displacements.
    [[nodiscard]] std::vector<vec3<double>> joints_of(Span<const vec3<double>> vertices) const;
};

[[nodiscard]] inline bool is_head_joint(std::string_view name) {
    return name == "head" || name == "jaw" || name == "left_eye" || name == "right_eye";
}

/// Finds the joints. A bone that is none of them follows its nearest ancestor that is one: the spine's upper half the
/// chest, toes the foot, eyelids the head.
///
/// Errors  ValueError naming `where`, for a bone that the rig does not have.
[[nodiscard]] inline MakeHumanSkeleton makehuman_skeleton(const MakeHumanRig& rig, const MakeHumanWeights& weights,
                                                          std::size_t vertex_count, const std::string& where);

/// Rotations of the joints relative to their parents that turn a body from MakeHuman's rest pose to a T-pose: arms
/// along x with elbows that bend forward, palms down, straight fingers, legs in the plane of the body. Feet and head
/// keep their directions in the world.
///
/// Errors  ValueError for bones of arms, legs and fingers that have no length, and for elbows that are straight.
[[nodiscard]] inline std::vector<mat3<double>> t_pose_rotations(const MakeHumanSkeleton& skeleton,
                                                                Span<const vec3<double>> vertices);

/// Skins vertices with these rotations, and moves the pelvis to the origin. For given rotations the result is linear
/// in the vertices, joints included: displacements go the same way as positions.
[[nodiscard]] inline std::vector<vec3<double>>
turned(const MakeHumanSkeleton& skeleton, Span<const mat3<double>> rotations, Span<const vec3<double>> vertices);

/// The same for the joints alone.
[[nodiscard]] inline std::vector<vec3<double>>
turned_joints(const MakeHumanSkeleton& skeleton, Span<const mat3<double>> rotations, Span<const vec3<double>> vertices);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

inline constexpr std::array<int, 55> smplx_parents = {
    -1, 0,  0,  0,  1,  2,  3,  4,  5,  6,  7,  8,  9,  9,  9,  12, 13, 14, 16, 17, 18, 19, 15, 15, 15, 20, 25, 26,
    20, 28, 29, 20, 31, 32, 20, 34, 35, 20, 37, 38, 21, 40, 41, 21, 43, 44, 21, 46, 47, 21, 49, 50, 21, 52, 53};

/// The bones that are a joint: the mean of their heads is its position, and it receives their weights.
inline std::vector<std::string> bones_of_joint(std::string_view joint) {
    const bool left = joint.starts_with("left_"), right = joint.starts_with("right_");
    if (!left && !right) {
        constexpr std::array<std::pair<std::string_view, const char*>, 7> names = {{{"pelvis", "spine05"},
                                                                                    {"spine1", "spine04"},
                                                                                    {"spine2", "spine03"},
                                                                                    {"spine3", "spine02"},
                                                                                    {"neck", "neck01"},
                                                                                    {"head", "head"},
                                                                                    {"jaw", "jaw"}}};
        for (const auto& [name, bone] : names)
            if (name == joint) return {bone};
        return {};
    }
    const std::string side = left ? ".L" : ".R";
    const std::string part(joint.substr(joint.find('_') + 1));
    if (part == "foot") {
        std::vector<std::string> toes;
        for (int k = 1; k <= 5; ++k) toes.push_back("toe" + std::to_string(k) + "-1" + side);
        return toes;
    }
    constexpr std::array<std::pair<std::string_view, const char*>, 8> limbs = {{{"collar", "clavicle"},
                                                                                {"shoulder", "upperarm01"},
                                                                                {"elbow", "lowerarm01"},
                                                                                {"wrist", "wrist"},
                                                                                {"hip", "upperleg01"},
                                                                                {"knee", "lowerleg01"},
                                                                                {"ankle", "foot"},
                                                                                {"eye", "eye"}}};
    for (const auto& [name, bone] : limbs)
        if (name == part) return {bone + side};
    constexpr std::array<std::string_view, 5> fingers = {"thumb", "index", "middle", "ring", "pinky"};
    for (std::size_t k = 0; k < fingers.size(); ++k)
        if (part.starts_with(fingers[k])) return {"finger" + std::to_string(k + 1) + "-" + part.back() + side};
    return {};
}

/// Keeps the six largest weights, which then sum to 1.
inline void keep_six(std::vector<JointWeight>& weights) {
    std::sort(weights.begin(), weights.end(), [](const JointWeight& a, const JointWeight& b) {
        return a.weight != b.weight ? a.weight > b.weight : a.joint < b.joint;
    });
    weights.resize(std::min<std::size_t>(weights.size(), 6));
    double sum = 0;
    for (const JointWeight& w : weights) sum += w.weight;
    for (JointWeight& w : weights) w.weight /= sum;
}

inline vec3<double> mean_of(Span<const vec3<double>> vertices, const std::vector<int>& chosen) {
    vec3<double> sum(0);
    for (const int v : chosen) sum += vertices[static_cast<std::size_t>(v)];
    return sum / static_cast<double>(chosen.size());
}

/// A unit vector; `what` names it in the message for a length of 0.
inline vec3<double> unit_of(const vec3<double>& v, const std::string& what) {
    const double size = length(v);
    check_value(size > 1e-9, "t_pose_rotations", what + " has no length");
    return v / size;
}

/// The rotation with columns a, b and a × b, for orthogonal unit vectors.
inline mat3<double> frame(const vec3<double>& a, const vec3<double>& b) {
    return {a, b, cross(a, b)};
}

inline std::vector<Affine<double>> turned_bones(const MakeHumanSkeleton& skeleton, Span<const mat3<double>> rotations,
                                                const std::vector<vec3<double>>& joints) {
    std::vector<Affine<double>> bones(joints.size());
    bone_transforms<double>(skeleton.parents, rotations, joints, -joints[0], bones);
    return bones;
}

} // namespace detail

inline std::vector<vec3<double>> MakeHumanSkeleton::joints_of(Span<const vec3<double>> vertices) const {
    std::vector<vec3<double>> positions;
    for (const std::vector<int>& joint : joints) positions.push_back(detail::mean_of(vertices, joint));
    return positions;
}

inline MakeHumanSkeleton makehuman_skeleton(const MakeHumanRig& rig, const MakeHumanWeights& weights,
                                            std::size_t vertex_count, const std::string& where) {
    MakeHumanSkeleton skeleton;
    skeleton.parents.assign(detail::smplx_parents.begin(), detail::smplx_parents.end());
    std::map<std::string, int> joint_of; // bones that are joints
    const auto bone = [&](const std::string& name) -> const MakeHumanBone& {
        const auto found = rig.find(name);
        check_value(found != rig.end(), where, "the rig has no bone '" + name + "', expected MakeHuman's default rig");
        return found->second;
    };
    for (std::size_t j = 0; j < smplx_joint_names.size(); ++j) {
        std::vector<int>& vertices = skeleton.joints.emplace_back();
        for (const std::string& name : detail::bones_of_joint(smplx_joint_names[j])) {
            const MakeHumanBone& found = bone(name);
            vertices.insert(vertices.end(), found.head.begin(), found.head.end());
            joint_of[name] = static_cast<int>(j);
        }
    }
    for (std::size_t k = 0; k < skeleton.finger_tips.size(); ++k)
        skeleton.finger_tips[k] = bone("finger" + std::to_string(k % 4 + 2) + "-3" + (k < 4 ? ".L" : ".R")).tail;

    std::vector<std::map<int, double>> sums(vertex_count);
    for (const auto& [name, list] : weights) {
        const std::string* owner = &name;
        while (!owner->empty() && !joint_of.contains(*owner)) owner = &rig.at(*owner).parent;
        const int joint = owner->empty() ? 0 : joint_of[*owner]; // what has no such ancestor follows the pelvis
        for (const auto& [vertex, weight] : list)
            if (weight > 0) sums[static_cast<std::size_t>(vertex)][joint] += weight;
    }
    for (const auto& sum : sums) {
        std::vector<JointWeight>& row = skeleton.weights.emplace_back();
        for (const auto& [joint, weight] : sum) row.push_back({joint, weight});
        if (!row.empty()) detail::keep_six(row);
    }
    return skeleton;
}

inline std::vector<mat3<double>> t_pose_rotations(const MakeHumanSkeleton& skeleton,
                                                  Span<const vec3<double>> vertices) {
    const std::vector<vec3<double>> joints = skeleton.joints_of(vertices);
    std::vector<mat3<double>> turns(joints.size(), mat3<double>(1.0)); // in the world
    for (const bool left : {true, false}) {
        const double side = left ? 1 : -1;
        const std::string prefix = left ? "left_" : "right_";
        const auto index = [&](const std::string& name) {
            return static_cast<std::size_t>(smplx_joint(prefix + name));
        };
        const auto at = [&](const std::string& name) { return joints[index(name)]; };
        const auto direction = [&](const std::string& from, const std::string& to) {
            return detail::unit_of(at(to) - at(from), "the bone from " + from + " to " + to);
        };
        // An arm that rises by 50 degrees lifts the collar bone by about 10.
        turns[index("collar")] = rotation_from_axis_angle(vec3<double>(0, 0, side * 0.17));

        const vec3<double> out(side, 0, 0), down(0, -side, 0), front(0, 0, 1);
        const vec3<double> upper = direction("shoulder", "elbow"), lower = direction("elbow", "wrist");
        const vec3<double> hinge = // MakeHuman's elbow is bent a little, forward
            detail::unit_of(cross(upper, lower), "the axis of the elbow, which is straight,");
        turns[index("shoulder")] = detail::frame(out, down) * transpose(detail::frame(upper, hinge));
        const mat3<double> forearm = detail::frame(out, down) * transpose(detail::frame(lower, hinge));
        const vec3<double> hand = detail::unit_of((at("middle1") + at("ring1")) * 0.5 - at("wrist"), "a palm");
        const vec3<double> knuckles = at("index1") - at("pinky1");
        const vec3<double> across = detail::unit_of(knuckles - hand * dot(hand, knuckles), "the row of the knuckles");
        const mat3<double> palm_down = detail::frame(out, front) * transpose(detail::frame(hand, across));
        // The hand is pronated against the elbow's hinge. The forearm takes half of that turn, the wrist the rest.
        const vec3<double> thumb_side = palm_down * transpose(forearm) * front;
        const double twist = std::atan2(dot(cross(front, thumb_side), out), dot(front, thumb_side));
        turns[index("elbow")] = rotation_from_axis_angle(out * (twist / 2)) * forearm;
        turns[index("wrist")] = palm_down;

        constexpr std::array<const char*, 4> fingers = {"index", "middle", "ring", "pinky"};
        for (std::size_t f = 0; f < fingers.size(); ++f) {
            std::array<vec3<double>, 4> chain; // the joints and the tip
            for (std::size_t k = 0; k < 3; ++k) chain[k] = at(fingers[f] + std::to_string(k + 1));
            chain[3] = detail::mean_of(vertices, skeleton.finger_tips[f + (left ? 0 : fingers.size())]);
            vec3<double> straight = palm_down * (chain[3] - chain[0]);
            straight.y = 0;
            for (std::size_t k = 0; k < 3; ++k)
                turns[index(fingers[f] + std::to_string(k + 1))] =
                    shortest_turn(detail::unit_of(palm_down * (chain[k + 1] - chain[k]), "a bone of a finger"),
                                  detail::unit_of(straight, "a finger")) *
                    palm_down;
        }
        for (const char* thumb : {"thumb1", "thumb2", "thumb3"}) turns[index(thumb)] = palm_down; // bent as it is
        const vec3<double> leg = normalize(vec3<double>(side * 0.07, -1, 0)); // heavy thighs touch where it is vertical
        turns[index("hip")] = shortest_turn(direction("hip", "knee"), leg);
        turns[index("knee")] = shortest_turn(direction("knee", "ankle"), leg);
    }
    std::vector<mat3<double>> relative(turns.size(), mat3<double>(1.0));
    for (std::size_t j = 1; j < turns.size(); ++j)
        relative[j] = transpose(turns[static_cast<std::size_t>(skeleton.parents[j])]) * turns[j];
    return relative;
}

inline std::vector<vec3<double>> turned(const MakeHumanSkeleton& skeleton, Span<const mat3<double>> rotations,
                                        Span<const vec3<double>> vertices) {
    const auto bones = detail::turned_bones(skeleton, rotations, skeleton.joints_of(vertices));
    std::vector<vec3<double>> result;
    result.reserve(vertices.size());
    for (std::size_t v = 0; v < vertices.size(); ++v) {
        vec3<double> sum(0);
        for (const JointWeight& w : skeleton.weights[v])
            sum += bones[static_cast<std::size_t>(w.joint)](vertices[v]) * w.weight;
        result.push_back(sum);
    }
    return result;
}

inline std::vector<vec3<double>> turned_joints(const MakeHumanSkeleton& skeleton, Span<const mat3<double>> rotations,
                                               Span<const vec3<double>> vertices) {
    const std::vector<vec3<double>> joints = skeleton.joints_of(vertices);
    const auto bones = detail::turned_bones(skeleton, rotations, joints);
    std::vector<vec3<double>> result;
    for (std::size_t j = 0; j < joints.size(); ++j) result.push_back(bones[j](joints[j]));
    return result;
}

} // namespace gsh
