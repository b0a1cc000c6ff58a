// SPDX-License-Identifier: Apache-2.0
/// @file  The node tree of a glTF file, checked, and the nodes of it that are joints.
#pragma once

#include <gsh/body/rig_motion.hpp>
#include <gsh/io/file/gltf_file.hpp>
#include <gsh/io/motion/gltf_channel.hpp>
#include <gsh/math/polar.hpp>
#include <gsh/math/vec.hpp>

#include <nlohmann/json.hpp>

#include <cmath>
#include <cstddef>
#include <map>
#include <set>
#include <string>
#include <vector>

namespace gsh::detail {

/// Errors  IoError for children out of range, a node with two parents or on a cycle, more than 256 levels, a transform
///         that is not finite, humanoid bones that are not nodes.
class GltfNodes {
public:
    /// The file must outlive this object.
    explicit GltfNodes(const GltfFile& file) : file_(file) {
        read_tree();
        read_transforms();
        read_humanoid();
    }
    [[nodiscard]] std::size_t size() const { return parents_.size(); }
    [[nodiscard]] bool has_matrix(int node) const { return transform(node).has_matrix; }
    [[nodiscard]] const GltfTransform& transform(int node) const { return transforms_[static_cast<std::size_t>(node)]; }
    [[nodiscard]] bool has_humanoid() const { return !humanoid_.empty(); }

    /// Takes as joints the nodes for which `moves` is true, those of skins and the humanoid bones, with all nodes above
    /// and below them.
    template <class Moves>
    void keep_joints(const Moves& moves);
    [[nodiscard]] std::size_t joint_count() const { return joints_.size(); }
    [[nodiscard]] int node_of(std::size_t joint) const { return joints_[joint]; }
    [[nodiscard]] bool is_joint(int node) const { return numbers_[static_cast<std::size_t>(node)] >= 0; }
    [[nodiscard]] std::size_t joint_of(int node) const {
        return static_cast<std::size_t>(numbers_[static_cast<std::size_t>(node)]);
    }
    [[nodiscard]] int parent_of(std::size_t joint) const {
        const int parent = parents_[static_cast<std::size_t>(joints_[joint])];
        return parent < 0 ? -1 : numbers_[static_cast<std::size_t>(parent)];
    }
    [[nodiscard]] const std::string& name_of(std::size_t joint) const { return names_[joint]; }

    /// Sets names and parents of a rig.
    void describe(RigMotion& rig) const {
        rig.names = names_;
        for (std::size_t j = 0; j < joints_.size(); ++j) rig.parents.push_back(parent_of(j));
    }
    /// The skin with most joints, or null.
    [[nodiscard]] const tinygltf::Skin* largest_skin() const {
        const tinygltf::Skin* largest = nullptr;
        for (const auto& skin : file_.model().skins)
            if (!largest || skin.joints.size() > largest->joints.size()) largest = &skin;
        return largest;
    }

private:
    const GltfFile& file_;
    std::vector<int> parents_, order_; // order_: parents first
    std::vector<GltfTransform> transforms_;
    std::map<int, std::string> humanoid_; // VRM's name of a node
    std::vector<int> joints_, numbers_;   // nodes of the joints; number of a node's joint, or -1
    std::vector<std::string> names_;

    void read_tree() {
        const auto& nodes = file_.model().nodes;
        parents_.assign(nodes.size(), -1);
        for (std::size_t n = 0; n < nodes.size(); ++n)
            for (const int child : nodes[n].children) {
                const std::string what = "node " + std::to_string(n) + ": child";
                file_.check_index(child, nodes.size(), what);
                int& parent = parents_[static_cast<std::size_t>(child)];
                if (parent >= 0)
                    file_.fail("node " + std::to_string(child) + " is a child of nodes " + std::to_string(parent) +
                               " and " + std::to_string(n) + ", expected one parent");
                parent = static_cast<int>(n);
            }
        std::vector<std::size_t> depth(nodes.size(), 1);
        for (std::size_t n = 0; n < nodes.size(); ++n)
            if (parents_[n] < 0) order_.push_back(static_cast<int>(n));
        for (std::size_t i = 0; i < order_.size(); ++i) // order_ grows
            for (const int child : nodes[static_cast<std::size_t>(order_[i])].children) {
                auto& own = depth[static_cast<std::size_t>(child)];
                own = depth[static_cast<std::size_t>(order_[i])] + 1;
                if (own > 256) file_.fail("nodes are nested deeper than 256 levels");
                order_.push_back(child);
            }
        if (order_.size() != nodes.size())
            file_.fail(std::to_string(nodes.size() - order_.size()) + " nodes lie on a cycle, expected a tree");
    }

    void read_transforms() {
        for (std::size_t n = 0; n < size(); ++n) {
            const tinygltf::Node& node = file_.model().nodes[n];
            const auto read = [&](const std::vector<double>& values, std::size_t count, const char* what) {
                if (!values.empty() && values.size() != count)
                    file_.fail("node " + std::to_string(n) + ": " + what + " has " + std::to_string(values.size()) +
                               " numbers, expected " + std::to_string(count));
                for (const double value : values)
                    if (!std::isfinite(value)) file_.fail("node " + std::to_string(n) + ": " + what + " is not finite");
                return !values.empty();
            };
            GltfTransform own;
            if (read(node.translation, 3, "translation"))
                own.translation = {node.translation[0], node.translation[1], node.translation[2]};
            if (read(node.scale, 3, "scale")) own.scale = {node.scale[0], node.scale[1], node.scale[2]};
            if (read(node.rotation, 4, "rotation"))
                own.rotation = GltfTransform::rotation_of(
                    {node.rotation[0], node.rotation[1], node.rotation[2], node.rotation[3]});
            if (read(node.matrix, 16, "matrix")) {
                const auto& m = node.matrix; // by columns
                own.linear = {{m[0], m[1], m[2]}, {m[4], m[5], m[6]}, {m[8], m[9], m[10]}};
                own.translation = {m[12], m[13], m[14]};
                own.rotation = polar_rotation(own.linear);
                own.has_matrix = true;
            }
            transforms_.push_back(own);
        }
    }

    /// VRM 1.0 and .vrma: {"humanBones": {"hips": {"node": 3}, …}}; VRM 0.x: [{"bone": "hips", "node": 3}, …].
    void read_humanoid() {
        for (const char* extension : {"VRMC_vrm", "VRMC_vrm_animation", "VRM"}) {
            const auto& all = file_.extensions();
            if (!all.contains(extension) || !all[extension].is_object() || !all[extension].contains("humanoid"))
                continue;
            const auto& humanoid = all[extension]["humanoid"];
            if (!humanoid.is_object() || !humanoid.contains("humanBones")) continue;
            for (const auto& [key, bone] : humanoid["humanBones"].items()) {
                if (!bone.is_object() || !bone.contains("node")) continue;
                std::string name = key;
                if (bone.contains("bone") && bone["bone"].is_string()) name = bone["bone"].get<std::string>();
                const double number = bone["node"].is_number() ? bone["node"].get<double>() : -1;
                const int node = number >= 0 && number < 1e6 ? static_cast<int>(number) : -1;
                file_.check_index(node, size(), std::string(extension) + ": the node of " + shortened(name));
                humanoid_[node] = name;
            }
        }
    }
};

template <class Moves>
void GltfNodes::keep_joints(const Moves& moves) {
    std::vector<bool> keep(size(), false);
    for (const auto& [node, name] : humanoid_) keep[static_cast<std::size_t>(node)] = true;
    for (std::size_t s = 0; s < file_.model().skins.size(); ++s)
        for (const int joint : file_.model().skins[s].joints) {
            file_.check_index(joint, size(), "skin " + std::to_string(s) + ": joint");
            keep[static_cast<std::size_t>(joint)] = true;
        }
    for (std::size_t n = 0; n < size(); ++n)
        if (moves(static_cast<int>(n))) keep[n] = true;
    for (const int node : order_) // downwards
        if (const int parent = parents_[static_cast<std::size_t>(node)];
            parent >= 0 && keep[static_cast<std::size_t>(parent)])
            keep[static_cast<std::size_t>(node)] = true;
    for (auto node = order_.rbegin(); node != order_.rend(); ++node) // upwards
        if (const int parent = parents_[static_cast<std::size_t>(*node)];
            parent >= 0 && keep[static_cast<std::size_t>(*node)])
            keep[static_cast<std::size_t>(parent)] = true;
    numbers_.assign(size(), -1);
    std::set<std::string> bones;
    for (const auto& [node, name] : humanoid_) bones.insert(name);
    for (const int node : order_) {
        if (!keep[static_cast<std::size_t>(node)]) continue;
        std::string name = file_.model().nodes[static_cast<std::size_t>(node)].name;
        const auto bone = humanoid_.find(node);
        if (bone != humanoid_.end())
            name = bone->second;
        else if (name.empty() || bones.contains(name))
            name += "node_" + std::to_string(node);
        numbers_[static_cast<std::size_t>(node)] = static_cast<int>(joints_.size());
        joints_.push_back(node);
        names_.push_back(std::move(name));
    }
}

} // namespace gsh::detail
