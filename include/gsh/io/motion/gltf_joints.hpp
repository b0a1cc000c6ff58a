// SPDX-License-Identifier: Apache-2.0
/// @file  The nodes of a glTF file that are joints of a rig.
#pragma once

#include <gsh/body/joint_names.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/io/file/gltf_file.hpp>
#include <gsh/io/file/gltf_nodes.hpp>
#include <gsh/io/file/text_lines.hpp>

#include <nlohmann/json.hpp>

#include <cstddef>
#include <map>
#include <set>
#include <string>
#include <vector>

namespace gsh::detail {

/// Errors  IoError for humanoid bones and joints of skins that are not nodes.
class GltfJoints {
public:
    /// Both must outlive this object.
    GltfJoints(const GltfFile& file, const GltfNodes& nodes) : file_(file), nodes_(nodes) { read_humanoid(); }
    [[nodiscard]] bool has_humanoid() const { return !humanoid_.empty(); }

    /// Takes as joints the nodes for which `moves` is true, those of skins and the humanoid bones, with all nodes above
    /// and below them.
    template <class Moves>
    void keep_joints(const Moves& moves);
    [[nodiscard]] std::size_t joint_count() const { return joints_.size(); }
    [[nodiscard]] int node_of(std::size_t joint) const { return joints_[joint]; }
    [[nodiscard]] std::size_t joint_of(int node) const {
        return static_cast<std::size_t>(numbers_[static_cast<std::size_t>(node)]);
    }
    [[nodiscard]] int parent_of(std::size_t joint) const {
        const int parent = nodes_.parent(joints_[joint]);
        return parent < 0 ? -1 : numbers_[static_cast<std::size_t>(parent)];
    }
    [[nodiscard]] const std::string& name_of(std::size_t joint) const { return names_[joint]; }

    /// Sets names and parents of a rig. Of nodes with the same name, the second is NAME#2.
    void describe(RigMotion& rig) const {
        rig.names = names_;
        rig.parents.clear();
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
    const GltfNodes& nodes_;
    std::map<int, std::string> humanoid_; // VRM's name of a node
    std::vector<int> joints_, numbers_;   // nodes of the joints; number of a node's joint, or -1
    std::vector<std::string> names_;

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
                file_.check_index(node, nodes_.size(), std::string(extension) + ": the node of " + shortened(name));
                humanoid_[node] = name;
            }
        }
    }
};

template <class Moves>
void GltfJoints::keep_joints(const Moves& moves) {
    std::vector<bool> keep(nodes_.size(), false);
    for (const auto& [node, name] : humanoid_) keep[static_cast<std::size_t>(node)] = true;
    for (std::size_t s = 0; s < file_.model().skins.size(); ++s)
        for (const int joint : file_.model().skins[s].joints) {
            file_.check_index(joint, nodes_.size(), "skin " + std::to_string(s) + ": joint");
            keep[static_cast<std::size_t>(joint)] = true;
        }
    for (std::size_t n = 0; n < nodes_.size(); ++n)
        if (moves(static_cast<int>(n))) keep[n] = true;
    for (const int node : nodes_.order()) // downwards
        if (const int parent = nodes_.parent(node); parent >= 0 && keep[static_cast<std::size_t>(parent)])
            keep[static_cast<std::size_t>(node)] = true;
    for (auto node = nodes_.order().rbegin(); node != nodes_.order().rend(); ++node) // upwards
        if (const int parent = nodes_.parent(*node); parent >= 0 && keep[static_cast<std::size_t>(*node)])
            keep[static_cast<std::size_t>(parent)] = true;
    numbers_.assign(nodes_.size(), -1);
    joints_.clear(), names_.clear();
    std::set<std::string> bones;
    std::map<std::string, int> taken;
    for (const auto& [node, name] : humanoid_) bones.insert(name);
    for (const int node : nodes_.order()) {
        if (!keep[static_cast<std::size_t>(node)]) continue;
        std::string name = file_.model().nodes[static_cast<std::size_t>(node)].name;
        const auto bone = humanoid_.find(node);
        if (bone != humanoid_.end())
            name = bone->second;
        else if (name.empty() || bones.contains(name))
            name += "node_" + std::to_string(node);
        constexpr std::size_t longest = 3 * longest_joint_name; // a byte that was no UTF-8 takes three in JSON
        if (name.size() > longest)
            file_.fail("node " + std::to_string(node) + " has a name of " + std::to_string(name.size()) +
                       " bytes, expected at most " + std::to_string(longest));
        numbers_[static_cast<std::size_t>(node)] = static_cast<int>(joints_.size());
        joints_.push_back(node);
        names_.push_back(unique_joint_name(name, taken)); // glTF does not ask for unique names
    }
}

} // namespace gsh::detail
