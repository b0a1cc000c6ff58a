// SPDX-License-Identifier: Apache-2.0
/// @file  The node tree of a glTF file, checked: transforms at rest, animated, and to the world.
#pragma once

#include <gsh/io/file/gltf_channel.hpp>
#include <gsh/io/file/gltf_file.hpp>
#include <gsh/io/file/gltf_numbers.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/polar.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace gsh::detail {

/// Errors  IoError for children out of range, a node with two parents or on a cycle, more than 256 levels, a transform
///         that is not finite.
class GltfNodes {
public:
    using Channels = std::map<int, GltfNodeChannels>; ///< by node

    /// The file must outlive this object.
    explicit GltfNodes(const GltfFile& file) : file_(file) {
        read_tree();
        read_transforms();
    }
    [[nodiscard]] std::size_t size() const { return parents_.size(); }
    [[nodiscard]] int parent(int node) const { return parents_[static_cast<std::size_t>(node)]; }
    /// All nodes, parents first.
    [[nodiscard]] const std::vector<int>& order() const { return order_; }
    [[nodiscard]] const GltfTransform& transform(int node) const { return transforms_[static_cast<std::size_t>(node)]; }
    /// With the animated properties at a time in seconds; before the first and after the last key, theirs.
    [[nodiscard]] GltfTransform transform(int node, const Channels& channels, double time) const {
        const auto found = channels.find(node);
        return transform(node).moved(found == channels.end() ? nullptr : &found->second, time);
    }

    /// What an animation does to translation, rotation and scale of nodes. `where` begins messages.
    /// Errors  those of GltfChannel; IoError for an index out of range, a node with a matrix, a property twice.
    [[nodiscard]] Channels channels(const tinygltf::Animation& animation, GltfNumbers& numbers,
                                    const std::string& where) const;

    /// For each node, the map from its frame to the world; none for nodes that the file's scene does not show, or that
    /// it states to be invisible (KHR_node_visibility). A file without scenes shows all nodes.
    [[nodiscard]] std::vector<std::optional<Affine<double>>> world_maps(const Channels& channels, double time) const;

private:
    const GltfFile& file_;
    std::vector<int> parents_, order_;
    std::vector<GltfTransform> transforms_;

    [[nodiscard]] static bool is_visible(const tinygltf::Node& node) {
        const auto found = node.extensions.find("KHR_node_visibility");
        if (found == node.extensions.end() || !found->second.Has("visible")) return true;
        const tinygltf::Value& visible = found->second.Get("visible");
        return !visible.IsBool() || visible.Get<bool>();
    }

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
            if (read(node.rotation, 4, "rotation")) {
                if (std::all_of(node.rotation.begin(), node.rotation.end(), [](double x) { return x == 0; }))
                    file_.fail("node " + std::to_string(n) + ": rotation is 0, expected a quaternion of length 1");
                own.rotation = GltfTransform::rotation_of(
                    {node.rotation[0], node.rotation[1], node.rotation[2], node.rotation[3]});
            }
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
};

// -------------------------------------------------------------------------------------------------------------

inline GltfNodes::Channels GltfNodes::channels(const tinygltf::Animation& animation, GltfNumbers& numbers,
                                               const std::string& where) const {
    Channels result;
    for (std::size_t c = 0; c < animation.channels.size(); ++c) {
        const auto& channel = animation.channels[c];
        const std::string what = where + ", channel " + std::to_string(c);
        const bool rotation = channel.target_path == "rotation";
        if (channel.target_node == -1 ||
            (!rotation && channel.target_path != "translation" && channel.target_path != "scale"))
            continue; // weights of morph targets, or a target of an extension
        file_.check_index(channel.target_node, size(), what + ": node");
        file_.check_index(channel.sampler, animation.samplers.size(), what + ": sampler");
        if (transform(channel.target_node).has_matrix)
            file_.fail(what + " animates node " + std::to_string(channel.target_node) +
                       ", which has a matrix; expected translation, rotation and scale");
        const auto& sampler = animation.samplers[static_cast<std::size_t>(channel.sampler)];
        GltfChannel read(file_, numbers, sampler, rotation ? 4 : 3, what);
        GltfNodeChannels& own = result[channel.target_node];
        GltfChannel& place = rotation ? own.rotation : channel.target_path == "scale" ? own.scale : own.translation;
        if (!place.empty()) file_.fail(what + " animates the same property as a channel before it");
        place = std::move(read);
    }
    return result;
}

inline std::vector<std::optional<Affine<double>>> GltfNodes::world_maps(const Channels& channels, double time) const {
    std::vector<std::optional<Affine<double>>> maps(size());
    const tinygltf::Model& model = file_.model();
    std::vector<bool> listed(size(), false);
    for (const int node : order_) listed[static_cast<std::size_t>(node)] = model.scenes.empty() && parent(node) < 0;
    if (!model.scenes.empty()) {
        const int shown = std::max(model.defaultScene, 0);
        file_.check_index(shown, model.scenes.size(), "scene");
        for (const int node : model.scenes[static_cast<std::size_t>(shown)].nodes) {
            file_.check_index(node, size(), "a node of scene " + std::to_string(shown));
            listed[static_cast<std::size_t>(node)] = true;
        }
    }
    for (const int node : order_) {
        const int above = parent(node);
        const auto n = static_cast<std::size_t>(node);
        if (!is_visible(model.nodes[n])) continue; // nor are those below
        const Affine<double> own = transform(node, channels, time).matrix();
        if (above >= 0 && maps[static_cast<std::size_t>(above)])
            maps[n] = *maps[static_cast<std::size_t>(above)] * own;
        else if (listed[n])
            maps[n] = own;
    }
    return maps;
}

} // namespace gsh::detail
