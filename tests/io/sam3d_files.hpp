// SPDX-License-Identifier: Apache-2.0
/// @file  Predictions of sample rigs in the form of SAM 3D Body.
#pragma once

#include "support/sample_rig.hpp"

#include <gsh/io/file/npz_writer.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace gsh::test {

/// The arrays of a file. Tests may change them before it is written.
struct Sam3dArrays {
    std::vector<std::string> names;
    std::vector<std::int64_t> parents;
    std::map<std::string, std::pair<std::vector<double>, Shape>> numbers;

    void save(const std::filesystem::path& path) const {
        NpzWriter file(path);
        if (!names.empty()) file.add_texts("names", names);
        file.add("parents", parents);
        for (const auto& [key, array] : numbers) file.add(key, array.first, array.second);
        file.commit();
    }
};

/// The sample as SAM 3D Body stores it: positions with y and z negated, relative to pred_cam_t; rotations with y up.
inline Sam3dArrays sam3d_arrays(const SampleRig& sample, bool camera_axes = true) {
    const std::size_t J = sample.names.size(), T = sample.root.size();
    Sam3dArrays arrays{sample.names, std::vector<std::int64_t>(sample.parents.begin(), sample.parents.end()), {}};
    Rng rng(8);
    std::vector<double> joints, rotations, camera, rest, axes;
    const auto three = [](std::vector<double>& to, const vec3<double>& v) { to.insert(to.end(), {v.x, v.y, v.z}); };
    const auto rows = [](std::vector<double>& to, const mat3<double>& m) {
        for (int r = 0; r < 3; ++r) to.insert(to.end(), {m[0][r], m[1][r], m[2][r]});
    };
    std::vector<mat3<double>> own;
    for (std::size_t j = 0; j < J; ++j) {
        own.push_back(rotation_from_axis_angle(rng.vec(-2, 2)));
        three(rest, sample.rest[j] * 1.3); // another size than in the frames
        rows(axes, own[j]);
    }
    const double sign = camera_axes ? -1 : 1;
    for (std::size_t t = 0; t < T; ++t) {
        const auto pose = pose_of(sample, t, "ZXY");
        for (std::size_t j = 0; j < J; ++j) {
            const vec3<double> x = pose.joints[j] - sample.root[t];
            three(joints, {x.x, sign * x.y, sign * x.z});
            rows(rotations, pose.rotations[j] * own[j]);
        }
        three(camera, {sample.root[t].x, -sample.root[t].y, -sample.root[t].z});
    }
    arrays.numbers = {{"rest_joints", {rest, {J, 3}}},
                      {"rest_rotations", {axes, {J, 3, 3}}},
                      {"pred_joint_coords", {joints, {T, J, 3}}},
                      {"pred_global_rots", {rotations, {T, J, 3, 3}}},
                      {"pred_cam_t", {camera, {T, 3}}},
                      {"fps", {{25}, {}}}};
    return arrays;
}

} // namespace gsh::test
