// SPDX-License-Identifier: Apache-2.0
/// @file  Reads rigs of MakeHuman for Blender (MPFB2), and skinning weights: bones by name, in JSON.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/io/body/makehuman_mesh.hpp>
#include <gsh/io/file/json_file.hpp>

#include <cmath>
#include <cstddef>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// A bone lies between two points, each the mean of some vertices of the base mesh.
struct MakeHumanBone {
    std::string parent; ///< empty for the root
    std::vector<int> head, tail;
};

/// The bones by name.
using MakeHumanRig = std::map<std::string, MakeHumanBone>;

/// The weights of each bone: vertex and weight.
using MakeHumanWeights = std::map<std::string, std::vector<std::pair<int, double>>>;

/// Reads each bone's parent, head and tail, which are a CUBE (a group of the mesh), a VERTEX, or a MEAN of vertices.
///
/// Errors  IoError or ValueError naming file and bone: fields that are missing or of another type, strategies that are
///         not known, groups and vertices that the mesh does not have, parents that do not lead to a root.
[[nodiscard]] inline MakeHumanRig parse_makehuman_rig(std::string_view text, const std::string& name,
                                                      const MakeHumanMesh& mesh);

/// Reads {"weights": {BONE: [[VERTEX, WEIGHT], ...]}}.
///
/// Errors  IoError or ValueError naming file and bone: bones that the rig does not have, vertices out of range, weights
///         that are not in 0 .. 1.
[[nodiscard]] inline MakeHumanWeights parse_makehuman_weights(std::string_view text, const std::string& name,
                                                              const MakeHumanRig& rig, std::size_t vertex_count);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// The vertices whose mean is an end of a bone.
inline std::vector<int> bone_end_vertices(const Json& json, const std::string& where, const MakeHumanMesh& mesh) {
    const JsonObject end(json, where);
    const std::string strategy = end.text("strategy");
    std::vector<int> vertices;
    if (strategy == "CUBE") {
        const std::string group = end.text("cube_name");
        const auto quads = mesh.groups.find(group);
        check_value(quads != mesh.groups.end() && !quads->second.empty(), where,
                    "the mesh has no group '" + shortened(group) + "'");
        check_value(quads->second.size() <= 100, where,
                    "the group '" + shortened(group) + "' has " + std::to_string(quads->second.size()) +
                        " faces, expected a small cube");
        vertices = mesh.vertices_of(group);
    } else if (strategy == "VERTEX") {
        vertices = {end.integer("vertex_index")};
    } else if (strategy == "MEAN") {
        vertices = end.integers("vertex_indices");
        check_value(!vertices.empty() && vertices.size() <= 1000, where,
                    "vertex_indices holds " + std::to_string(vertices.size()) + " vertices, expected 1 to 1000");
    } else {
        throw IoError(where + ": strategy is '" + shortened(strategy) + "', expected CUBE, VERTEX or MEAN");
    }
    for (const int v : vertices)
        check_value(v >= 0 && static_cast<std::size_t>(v) < mesh.vertices.size(), where,
                    "names vertex " + std::to_string(v) + ", expected one below " +
                        std::to_string(mesh.vertices.size()));
    return vertices;
}

} // namespace detail

inline MakeHumanRig parse_makehuman_rig(std::string_view text, const std::string& name, const MakeHumanMesh& mesh) {
    const detail::Json json = detail::parse_json(text, name);
    const detail::JsonObject file(json, name);
    const detail::Json& bones = file.has("bones") ? file.at("bones") : json;
    check_value(bones.is_object() && bones.size() <= 1000, name, "expected an object with at most 1000 bones");
    MakeHumanRig rig;
    for (const auto& [bone, value] : bones.items()) {
        const std::string where = name + ": bone '" + detail::shortened(bone) + "'";
        const detail::JsonObject object(value, where);
        rig[bone] = {object.has("parent") ? object.text("parent") : std::string(),
                     detail::bone_end_vertices(object.at("head"), where + ": head", mesh),
                     detail::bone_end_vertices(object.at("tail"), where + ": tail", mesh)};
    }
    for (const auto& [bone, unused] : rig) {
        const std::string where = name + ": bone '" + detail::shortened(bone) + "'";
        std::size_t steps = 0;
        for (const std::string* parent = &rig[bone].parent; !parent->empty(); parent = &rig[*parent].parent) {
            check_value(rig.contains(*parent), where,
                        "has an ancestor '" + detail::shortened(*parent) + "', which is no bone of the file");
            check_value(++steps <= rig.size(), where, "lies on a cycle of parents");
        }
    }
    return rig;
}

inline MakeHumanWeights parse_makehuman_weights(std::string_view text, const std::string& name, const MakeHumanRig& rig,
                                                std::size_t vertex_count) {
    const detail::Json json = detail::parse_json(text, name);
    const detail::Json& bones = detail::JsonObject(json, name).at("weights");
    check_value(bones.is_object(), name, "weights is no object, expected one list per bone");
    MakeHumanWeights weights;
    for (const auto& [bone, rows] : bones.items()) {
        const std::string where = name + ": weights of '" + detail::shortened(bone) + "'";
        check_value(rig.contains(bone), where, "the rig has no such bone");
        check_value(rows.is_array(), where, "is no list, expected rows [VERTEX, WEIGHT]");
        auto& list = weights[bone];
        for (const detail::Json& row : rows) {
            if (!row.is_array() || row.size() != 2 || !row[0].is_number_integer() || !row[1].is_number())
                throw IoError(where + ": row " + std::to_string(list.size()) + " is not [VERTEX, WEIGHT]");
            const double vertex = row[0].get<double>(), weight = row[1].get<double>();
            check_value(vertex >= 0 && vertex < static_cast<double>(vertex_count), where,
                        "names vertex " + detail::number_text(vertex) + ", expected one below " +
                            std::to_string(vertex_count));
            check_value(weight >= 0 && weight <= 1.001, where,
                        "gives vertex " + detail::number_text(vertex) + " the weight " + detail::number_text(weight) +
                            ", expected 0 to 1");
            list.emplace_back(static_cast<int>(vertex), weight);
        }
    }
    return weights;
}

} // namespace gsh
