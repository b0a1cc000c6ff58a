// SPDX-License-Identifier: Apache-2.0
/// @file  The surface that is kept of MakeHuman's base mesh: body, eyes, teeth and tongue, as triangles with texture.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/io/body/makehuman_mesh.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// The names of the parts; a vertex stores the index of its own.
inline constexpr std::array<std::string_view, 6> makehuman_part_names = {"body",      "tongue",      "left_eye",
                                                                         "right_eye", "lower_teeth", "upper_teeth"};

/// Vertices keep the order of the base mesh. Helpers for clothes, cubes of joints and eyelashes are left out.
struct MakeHumanSurface {
    std::vector<int> vertices;                 // [V] of the base mesh, ascending
    std::vector<std::uint8_t> parts;           // [V]
    std::vector<std::array<int, 3>> faces, ft; // two for each quad; ft into vt
    std::vector<vec2<double>> vt;
};

/// Errors  ValueError naming `where`, if a part has no faces.
[[nodiscard]] inline MakeHumanSurface makehuman_surface(const MakeHumanMesh& mesh, const std::string& where);

/// For each vertex the one at the mirrored place, x → -x. Vertices on the plane x = 0 are their own.
///
/// Errors  ValueError naming `where`, if the mesh is not symmetric.
[[nodiscard]] inline std::vector<int> mirrored_vertices(const std::vector<vec3<double>>& vertices,
                                                        const std::string& where);

// -------------------------------------------------------------------------------------------------------------

inline MakeHumanSurface makehuman_surface(const MakeHumanMesh& mesh, const std::string& where) {
    constexpr std::array<const char*, 6> groups = {"body",         "helper-tongue",      "helper-l-eye",
                                                   "helper-r-eye", "helper-lower-teeth", "helper-upper-teeth"};
    MakeHumanSurface surface;
    std::vector<int> place(mesh.vertices.size(), -1), texture_place(mesh.vt.size(), -1);
    std::vector<std::uint8_t> part_of(mesh.vertices.size(), 0);
    for (std::size_t part = 0; part < groups.size(); ++part) {
        const auto quads = mesh.groups.find(groups[part]);
        check_value(quads != mesh.groups.end() && !quads->second.empty(), where,
                    std::string("the group '") + groups[part] + "' is missing, expected MakeHuman's base mesh");
        for (const MakeHumanMesh::Quad& quad : quads->second)
            for (std::size_t k = 0; k < 4; ++k) {
                const auto v = static_cast<std::size_t>(quad.corners[k]);
                place[v] = 0, texture_place[static_cast<std::size_t>(quad.texture[k])] = 0;
                part_of[v] = static_cast<std::uint8_t>(part);
            }
    }
    for (std::size_t v = 0; v < place.size(); ++v) {
        if (place[v] < 0) continue;
        place[v] = static_cast<int>(surface.vertices.size());
        surface.vertices.push_back(static_cast<int>(v));
        surface.parts.push_back(part_of[v]);
    }
    for (std::size_t t = 0; t < texture_place.size(); ++t) {
        if (texture_place[t] < 0) continue;
        texture_place[t] = static_cast<int>(surface.vt.size());
        surface.vt.push_back(mesh.vt[t]);
    }
    for (const char* group : groups)
        for (const MakeHumanMesh::Quad& quad : mesh.groups.at(group))
            for (const auto& corners : {std::array<std::size_t, 3>{0, 1, 2}, std::array<std::size_t, 3>{0, 2, 3}}) {
                std::array<int, 3> face{}, texture{};
                for (std::size_t k = 0; k < 3; ++k) {
                    face[k] = place[static_cast<std::size_t>(quad.corners[corners[k]])];
                    texture[k] = texture_place[static_cast<std::size_t>(quad.texture[corners[k]])];
                }
                surface.faces.push_back(face), surface.ft.push_back(texture);
            }
    return surface;
}

inline std::vector<int> mirrored_vertices(const std::vector<vec3<double>>& vertices, const std::string& where) {
    std::map<std::array<double, 3>, int> at;
    for (std::size_t v = 0; v < vertices.size(); ++v)
        at[{vertices[v].x, vertices[v].y, vertices[v].z}] = static_cast<int>(v);
    std::vector<int> mirrored;
    for (std::size_t v = 0; v < vertices.size(); ++v) {
        const auto found = at.find({-vertices[v].x, vertices[v].y, vertices[v].z});
        check_value(found != at.end(), where,
                    "vertex " + std::to_string(v) + " has no mirror image, expected MakeHuman's symmetric base mesh");
        mirrored.push_back(found->second);
    }
    return mirrored;
}

} // namespace gsh
