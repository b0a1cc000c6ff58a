// SPDX-License-Identifier: Apache-2.0
/// @file  Writes motions as GLB files: a skeleton of nodes with a skin's bind pose, and an animation of it.
#pragma once

#include <gsh/body/rig_motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <tiny_gltf.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <filesystem>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// Writes a rig as a GLB file, atomically: a node for each joint, at rest in the rig's rest pose, rotations of all
/// joints and positions of the roots as animation `name`, and a skin with the rest pose as bind pose, which makes
/// programs see bones. Numbers are floats.
///
/// Frame   y up, metres, as in glTF.
/// Errors  ValueError for an invalid rig, or times that do not ascend; IoError.
inline void save_gltf_motion(const std::filesystem::path& path, const RigMotion& rig,
                             const std::string& name = "motion");

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// A glTF model while it is filled: one buffer, with an accessor for each array.
class GltfBuilder {
public:
    tinygltf::Model model;

    GltfBuilder() {
        model.asset.version = "2.0";
        model.asset.generator = "gsh";
        model.buffers.emplace_back();
    }
    /// Adds an array of elements of `type` (TINYGLTF_TYPE_…). With `bounds`, minimum and maximum are stored.
    int add(const std::vector<float>& numbers, int type, bool bounds = false) {
        auto& bytes = model.buffers[0].data;
        const auto width = static_cast<std::size_t>(tinygltf::GetNumComponentsInType(static_cast<unsigned>(type)));
        tinygltf::BufferView view;
        view.buffer = 0, view.byteOffset = bytes.size(), view.byteLength = numbers.size() * sizeof(float);
        bytes.resize(bytes.size() + view.byteLength);
        std::memcpy(bytes.data() + view.byteOffset, numbers.data(), view.byteLength);
        model.bufferViews.push_back(view);
        tinygltf::Accessor accessor;
        accessor.bufferView = static_cast<int>(model.bufferViews.size()) - 1;
        accessor.componentType = TINYGLTF_COMPONENT_TYPE_FLOAT, accessor.type = type;
        accessor.count = numbers.size() / width;
        for (std::size_t k = 0; bounds && k < width; ++k) {
            accessor.minValues.push_back(numbers[k]), accessor.maxValues.push_back(numbers[k]);
            for (std::size_t i = k; i < numbers.size(); i += width) {
                accessor.minValues[k] = std::min(accessor.minValues[k], static_cast<double>(numbers[i]));
                accessor.maxValues[k] = std::max(accessor.maxValues[k], static_cast<double>(numbers[i]));
            }
        }
        model.accessors.push_back(std::move(accessor));
        return static_cast<int>(model.accessors.size()) - 1;
    }
    /// Writes the model as GLB.
    void save(const std::filesystem::path& path) {
        std::ostringstream bytes;
        tinygltf::TinyGLTF writer;
        if (!writer.WriteGltfSceneToStream(&model, bytes, false, true))
            throw IoError(path.string() + ": the glTF writer failed");
        write_file(path, bytes.view());
    }
};

/// The three numbers of vectors in a row, as floats.
inline void append_floats(std::vector<float>& numbers, const vec3<double>& v) {
    for (int k = 0; k < 3; ++k) numbers.push_back(static_cast<float>(v[k]));
}

} // namespace detail

inline void save_gltf_motion(const std::filesystem::path& path, const RigMotion& rig, const std::string& name) {
    validate(rig, "save_gltf_motion");
    const std::size_t J = rig.joint_count(), T = rig.frame_count();
    detail::GltfBuilder builder;
    tinygltf::Model& model = builder.model;
    tinygltf::Scene scene;
    tinygltf::Skin skin;
    std::vector<float> times, inverse;
    for (std::size_t t = 0; t < T; ++t) {
        times.push_back(static_cast<float>(rig.timestamps[t]));
        check_value(t == 0 || times[t] > times[t - 1], path.string(),
                    "the times of frames " + std::to_string(t - 1) + " and " + std::to_string(t) +
                        " do not ascend, as glTF demands");
    }
    tinygltf::Animation animation;
    animation.name = name;
    const int input = builder.add(times, TINYGLTF_TYPE_SCALAR, true);
    const auto animate = [&](std::size_t node, const char* target, std::vector<float> numbers, int type) {
        tinygltf::AnimationSampler sampler;
        sampler.input = input, sampler.output = builder.add(numbers, type);
        tinygltf::AnimationChannel channel;
        channel.sampler = static_cast<int>(animation.samplers.size());
        channel.target_node = static_cast<int>(node), channel.target_path = target;
        animation.samplers.push_back(sampler);
        animation.channels.push_back(channel);
    };
    for (std::size_t j = 0; j < J; ++j) {
        const int parent = rig.parents[j];
        const auto p = static_cast<std::size_t>(std::max(parent, 0));
        const mat3<double> above = parent < 0 ? mat3<double>(1.0) : rig.rest_rotations[p];
        const vec3<double> from = parent < 0 ? vec3<double>(0) : rig.rest_joints[p];
        const vec3<double> place = transpose(above) * (rig.rest_joints[j] - from);
        const quat<double> rest = quat_from_rotation(transpose(above) * rig.rest_rotations[j]);
        tinygltf::Node node;
        node.name = rig.names[j];
        node.translation = {place.x, place.y, place.z};
        if (rest.w < 1) node.rotation = {rest.x, rest.y, rest.z, rest.w};
        model.nodes.push_back(std::move(node));
        if (parent < 0)
            scene.nodes.push_back(static_cast<int>(j));
        else
            model.nodes[p].children.push_back(static_cast<int>(j));
        skin.joints.push_back(static_cast<int>(j));
        const mat3<double> back = transpose(rig.rest_rotations[j]);
        for (int column = 0; column < 3; ++column) detail::append_floats(inverse, back[column]), inverse.push_back(0);
        detail::append_floats(inverse, back * rig.rest_joints[j] * -1.0), inverse.push_back(1);

        std::vector<float> turns, places;
        quat<double> before{1, 0, 0, 0};
        for (std::size_t t = 0; t < T; ++t) {
            const mat3<double> world = rig.rotation(t, static_cast<int>(j));
            quat<double> q = quat_from_rotation(parent < 0 ? world : transpose(rig.rotation(t, parent)) * world);
            if (dot(q, before) < 0) q = {-q.w, -q.x, -q.y, -q.z}; // interpolation takes the shorter way
            before = q;
            for (const double x : {q.x, q.y, q.z, q.w}) turns.push_back(static_cast<float>(x));
            if (parent < 0) detail::append_floats(places, rig.joint(t, static_cast<int>(j)));
        }
        animate(j, "rotation", std::move(turns), TINYGLTF_TYPE_VEC4);
        if (parent < 0) animate(j, "translation", std::move(places), TINYGLTF_TYPE_VEC3);
    }
    skin.inverseBindMatrices = builder.add(inverse, TINYGLTF_TYPE_MAT4);
    skin.skeleton = scene.nodes[0];
    model.skins.push_back(std::move(skin));
    model.animations.push_back(std::move(animation));
    model.scenes.push_back(std::move(scene));
    model.defaultScene = 0;
    builder.save(path);
}

} // namespace gsh
