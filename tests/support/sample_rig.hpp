// SPDX-License-Identifier: Apache-2.0
/// @file  Skeletons and motions as other programs make them: names, rest poses, units and axes differ. Made by code.
#pragma once

#include "support/gradient.hpp"

#include <gsh/math/vec.hpp>

#include <array>
#include <cmath>
#include <cstddef>
#include <initializer_list>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace gsh::test {

enum class Names { smplx, mixamo, vrm, cmu, bvh, mhr, unreal };
enum class Rest { T, A, down };

struct SampleOptions {
    Names names = Names::mixamo;
    Rest rest = Rest::T;
    int spine = 3; ///< 1 to 4 bones
    bool toes = true, twist = false, fingers = false;
    double units = 1;  ///< per metre
    bool z_up = false; ///< the person stands along z and faces -y, as in Blender
    double turn = 0;   ///< radians about the vertical axis, of the rest pose
    double size = 1;   ///< of the person
    std::size_t frames = 4;
    unsigned seed = 3;
};

/// A skeleton whose rest frames are the axes, and its motion.
struct SampleRig {
    std::vector<std::string> names, parts; // parts: the joint of SMPL-X, or "" for one that has none
    std::vector<int> parents;
    std::vector<vec3<double>> rest;                // world positions
    std::vector<std::vector<vec3<double>>> angles; // [T][J] about the parent's axes x, y, z
    std::vector<vec3<double>> root;                // [T] position of joint 0
    mat3<double> world_from_person = mat3<double>(1.0);

    [[nodiscard]] int joint(const std::string& part) const {
        for (std::size_t j = 0; j < parts.size(); ++j)
            if (parts[j] == part) return static_cast<int>(j);
        return -1;
    }
};

/// Rotation about a coordinate axis, written out here so that tests do not rely on the library's.
inline mat3<double> turn_about(int axis, double angle) {
    mat3<double> R(1.0);
    const int a = (axis + 1) % 3, b = (axis + 2) % 3;
    R[a][a] = R[b][b] = std::cos(angle), R[a][b] = std::sin(angle), R[b][a] = -std::sin(angle);
    return R;
}
/// The product of turns in an order such as "ZXY", as listed.
inline mat3<double> turned_in_order(const vec3<double>& angles, const std::string& order) {
    mat3<double> R(1.0);
    for (const char axis : order) R = R * turn_about(axis - 'X', angles[axis - 'X']);
    return R;
}

/// A joint's name in a convention, of a joint of SMPL-X; `spine` bones are spine1, spine2, ….
inline std::string sample_name(Names names, const std::string& part, int spine) {
    if (names == Names::smplx) return part;
    if (part.starts_with("spine")) {
        const int n = part.back() - '0';
        const std::string number = n == 1 ? "" : std::to_string(n - 1);
        if (names == Names::vrm) return n == 1 ? "spine" : n == 2 ? "chest" : n == 3 ? "upperChest" : "topChest";
        if (names == Names::mhr) return "c_spine" + std::to_string(n - 1);
        if (names == Names::unreal) return "spine_0" + std::to_string(n);
        if (names == Names::cmu) return n == 1 ? "LowerBack" : n == 2 ? "Spine" : "Spine" + std::to_string(n - 2);
        if (names == Names::bvh) return n == 1 && spine > 1 ? "Abdomen" : "Chest" + number;
        return "mixamorig:Spine" + number;
    }
    static const std::map<std::string, std::array<std::string, 6>> table = {
        // mixamo, vrm, cmu, bvh, mhr, unreal; L stands for the side
        {"pelvis", {"Hips", "hips", "Hips", "Hips", "root", "pelvis"}},
        {"neck", {"Neck", "neck", "Neck", "Neck", "c_neck", "neck_01"}},
        {"head", {"Head", "head", "Head", "Head", "c_head", "head"}},
        {"collar", {"LShoulder", "LShoulder", "LShoulder", "LCollar", "l_clavicle", "clavicle_l"}},
        {"shoulder", {"LArm", "LUpperArm", "LArm", "LShoulder", "l_uparm", "upperarm_l"}},
        {"elbow", {"LForeArm", "LLowerArm", "LForeArm", "LElbow", "l_lowarm", "lowerarm_l"}},
        {"wrist", {"LHand", "LHand", "LHand", "LWrist", "l_wrist", "hand_l"}},
        {"hip", {"LUpLeg", "LUpperLeg", "LUpLeg", "LHip", "l_upleg", "thigh_l"}},
        {"knee", {"LLeg", "LLowerLeg", "LLeg", "LKnee", "l_lowleg", "calf_l"}},
        {"ankle", {"LFoot", "LFoot", "LFoot", "LAnkle", "l_foot", "foot_l"}},
        {"foot", {"LToeBase", "LToes", "LToeBase", "LToe", "l_ball", "ball_l"}},
        {"index1", {"LHandIndex1", "LIndexProximal", "LHandIndex1", "LIndex1", "l_index1", "index_01_l"}},
        {"index2", {"LHandIndex2", "LIndexIntermediate", "LHandIndex2", "LIndex2", "l_index2", "index_02_l"}},
        {"index3", {"LHandIndex3", "LIndexDistal", "LHandIndex3", "LIndex3", "l_index3", "index_03_l"}},
        {"middle1", {"LHandMiddle1", "LMiddleProximal", "LHandMiddle1", "LMiddle1", "l_middle1", "middle_01_l"}},
        {"middle2", {"LHandMiddle2", "LMiddleIntermediate", "LHandMiddle2", "LMiddle2", "l_middle2", "middle_02_l"}},
        {"thumb1", {"LHandThumb1", "LThumbMetacarpal", "LThumb", "LThumb1", "l_thumb1", "thumb_01_l"}},
        {"thumb2", {"LHandThumb2", "LThumbProximal", "LThumb2", "LThumb2", "l_thumb2", "thumb_02_l"}},
        {"pinky1", {"LHandPinky1", "LLittleProximal", "LHandPinky1", "LPinky1", "l_pinky1", "pinky_01_l"}},
    };
    const bool right = part.starts_with("right_"), side = right || part.starts_with("left_");
    std::string name = table.at(side ? part.substr(part.find('_') + 1) : part)[static_cast<std::size_t>(names) - 1];
    const bool small = names == Names::vrm;
    if (side && names != Names::mhr && names != Names::unreal)
        name = (right ? (small ? "right" : "Right") : (small ? "left" : "Left")) + name.substr(1);
    if (right && names == Names::mhr) name[0] = 'r';
    if (right && names == Names::unreal) name.back() = 'r';
    return names == Names::mixamo ? "mixamorig:" + name : name;
}

inline SampleRig sample_rig(const SampleOptions& o = {}) {
    SampleRig rig;
    const mat3<double> up = o.z_up ? turn_about(0, 1.5707963267948966) : mat3<double>(1.0);
    const mat3<double> A = up * turn_about(1, o.turn);
    rig.world_from_person = A;
    const auto add = [&](const std::string& name, const std::string& part, int parent, const vec3<double>& place) {
        rig.names.push_back(name), rig.parts.push_back(part), rig.parents.push_back(parent);
        rig.rest.push_back(A * place * (o.units * o.size));
        return static_cast<int>(rig.names.size()) - 1;
    };
    const auto add_part = [&](const std::string& part, int parent, const vec3<double>& place) {
        return add(sample_name(o.names, part, o.spine), part, parent, place);
    };
    const int pelvis = add_part("pelvis", -1, {0, 0.96, 0});
    int chest = pelvis;
    for (int s = 1; s <= o.spine; ++s)
        chest = add_part("spine" + std::to_string(s), chest, {0, 0.96 + 0.42 * s / o.spine, 0.01 * s});
    const int neck = add_part("neck", chest, {0, 1.5, 0});
    add_part("head", neck, {0, 1.6, 0.02});
    const double lowered = o.rest == Rest::T ? 0 : o.rest == Rest::A ? 0.7 : 1.45;
    for (const double s : {1.0, -1.0}) {
        const std::string side = s > 0 ? "left_" : "right_";
        const vec3<double> shoulder(s * 0.19, 1.43, -0.01);
        const auto arm = [&](double along, double forward) { // the forearm is bent forward a little
            return shoulder + vec3<double>(s * along * std::cos(lowered), -along * std::sin(lowered), forward);
        };
        const int collar = add_part(side + "collar", chest, {s * 0.03, 1.42, 0});
        int upper = add_part(side + "shoulder", collar, shoulder);
        const int shoulder_joint = upper;
        if (o.twist) upper = add("Twist" + side + "arm", "", upper, arm(0.15, 0));
        int lower = add_part(side + "elbow", upper, arm(0.31, 0));
        if (o.twist)
            add("Leaf" + side + "twist", "", lower, arm(0.40, 0.01)),
                add("Roll" + side, "", shoulder_joint, arm(0.2, 0));
        const int wrist = add_part(side + "wrist", lower, arm(0.58, 0.03));
        if (o.fingers) {
            const int middle = add_part(side + "middle1", wrist, arm(0.67, 0.035));
            add_part(side + "middle2", middle, arm(0.71, 0.03));
            const int index = add_part(side + "index1", wrist, arm(0.67, 0.06));
            add_part(side + "index3", add_part(side + "index2", index, arm(0.70, 0.06)), arm(0.73, 0.055));
            add_part(side + "thumb2", add_part(side + "thumb1", wrist, arm(0.60, 0.07)), arm(0.62, 0.10));
            add_part(side + "pinky1", wrist, arm(0.65, 0.0));
        }
        int hip = add_part(side + "hip", pelvis, {s * 0.10, 0.93, 0});
        const int knee = add_part(side + "knee", hip, {s * 0.11, 0.50, 0.01});
        const int ankle = add_part(side + "ankle", knee, {s * 0.12, 0.09, -0.02});
        if (o.toes) add_part(side + "foot", ankle, {s * 0.14, 0.02, 0.12});
    }
    Rng rng(o.seed);
    for (std::size_t t = 0; t < o.frames; ++t) {
        std::vector<vec3<double>> angles;
        for (std::size_t j = 0; j < rig.names.size(); ++j)
            angles.push_back(t == 0 || rig.parts[j].empty() ? vec3<double>(0) : rng.vecs(1, -0.6, 0.6)[0]);
        rig.angles.push_back(angles);
        rig.root.push_back(rig.rest[0] +
                           A * vec3<double>(0.1 * static_cast<double>(t), -0.02 * static_cast<double>(t), 0.3) *
                               o.units);
    }
    return rig;
}

/// World positions and rotations of a frame: a joint's rotation is the product of its angles in the order.
struct SamplePose {
    std::vector<vec3<double>> joints;
    std::vector<mat3<double>> rotations;
};
inline SamplePose pose_of(const SampleRig& rig, std::size_t frame, const std::string& order) {
    SamplePose pose;
    for (std::size_t j = 0; j < rig.names.size(); ++j) {
        const mat3<double> local = turned_in_order(rig.angles[frame][j], order);
        const int p = rig.parents[j];
        const auto parent = static_cast<std::size_t>(p < 0 ? 0 : p);
        pose.joints.push_back(p < 0 ? rig.root[frame]
                                    : pose.joints[parent] + pose.rotations[parent] * (rig.rest[j] - rig.rest[parent]));
        pose.rotations.push_back(p < 0 ? local : pose.rotations[parent] * local);
    }
    return pose;
}

} // namespace gsh::test
