// SPDX-License-Identifier: Apache-2.0
/// @file  Reads MakeHuman's base mesh: a Wavefront OBJ of quads in named groups, with joints as groups of vertices.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/io/file/text_lines.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <map>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

namespace gsh {

/// The base mesh in metres; the file is in decimetres.
///
/// Frame  y up, facing +z, its left at +x.
struct MakeHumanMesh {
    struct Quad {
        std::array<int, 4> corners; ///< vertices, counter-clockwise from outside
        std::array<int, 4> texture; ///< indices into vt
    };

    std::vector<vec3<double>> vertices;
    std::vector<vec2<double>> vt;                    ///< texture coordinates, v up
    std::map<std::string, std::vector<Quad>> groups; ///< by name: "body", "helper-l-eye", "joint-pelvis"

    /// The vertices of a group, ascending.
    [[nodiscard]] std::vector<int> vertices_of(const std::string& group) const;
};

/// Reads lines "v x y z", "vt u v", "g NAME" and "f v/vt v/vt v/vt v/vt"; others are skipped.
///
/// Errors  IoError naming file and line, for lines that are damaged, other polygons than quads, and indices out of
///         range.
[[nodiscard]] inline MakeHumanMesh parse_makehuman_mesh(std::string_view text, const std::string& name);

// -------------------------------------------------------------------------------------------------------------

inline std::vector<int> MakeHumanMesh::vertices_of(const std::string& group) const {
    std::vector<int> found;
    if (const auto quads = groups.find(group); quads != groups.end())
        for (const Quad& quad : quads->second) found.insert(found.end(), quad.corners.begin(), quad.corners.end());
    std::sort(found.begin(), found.end());
    found.erase(std::unique(found.begin(), found.end()), found.end());
    return found;
}

namespace detail {

inline constexpr double most_decimetres = 1000; ///< of a coordinate, or of a displacement

/// A corner "12/34" of a face.
inline void read_corner(const TextLines& lines, std::string_view word, std::size_t vertices, std::size_t textures,
                        int& corner, int& texture) {
    const auto index = [&](std::string_view digits, std::size_t count, const char* of) {
        std::size_t value = 0;
        const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
        if (error != std::errc() || end != digits.data() + digits.size())
            lines.fail("holds the corner '" + shortened(word) + "', expected VERTEX/TEXTURE");
        if (value < 1 || value > count)
            lines.fail("names " + std::string(of) + " " + std::to_string(value) + ", expected 1 to " +
                       std::to_string(count) + ", those before it");
        return static_cast<int>(value - 1);
    };
    const std::size_t slash = word.find('/');
    const std::string_view rest = slash == std::string_view::npos ? std::string_view() : word.substr(slash + 1);
    corner = index(word.substr(0, slash), vertices, "vertex");
    texture = index(rest.substr(0, rest.find('/')), textures, "texture coordinate");
}

} // namespace detail

inline MakeHumanMesh parse_makehuman_mesh(std::string_view text, const std::string& name) {
    constexpr std::size_t most_vertices = 100000; // MakeHuman's mesh has 19158
    MakeHumanMesh mesh;
    std::vector<MakeHumanMesh::Quad>* group = nullptr;
    detail::TextLines lines(text, name);
    while (lines.next()) {
        const std::string_view key = detail::first_word(lines.line()), rest = lines.line().substr(key.size());
        if (key == "v") {
            const auto p = lines.numbers(rest, 3);
            if (std::max({std::abs(p[0]), std::abs(p[1]), std::abs(p[2])}) > detail::most_decimetres)
                lines.fail("holds a coordinate beyond 100 m, expected decimetres");
            if (mesh.vertices.size() == most_vertices)
                lines.fail("is vertex " + std::to_string(most_vertices + 1) + ", expected at most " +
                           std::to_string(most_vertices));
            mesh.vertices.emplace_back(p[0] / 10, p[1] / 10, p[2] / 10);
        } else if (key == "vt") {
            const auto p = lines.numbers(rest, 2);
            mesh.vt.emplace_back(p[0], p[1]);
        } else if (key == "g") {
            group = &mesh.groups[std::string(detail::trimmed(rest))];
        } else if (key == "f") {
            const auto words = detail::words_in(rest);
            if (words.size() != 4)
                lines.fail("has " + std::to_string(words.size()) + " corners, expected 4: the body consists of quads");
            if (!group) lines.fail("stands before the first group, expected a line 'g NAME' above");
            MakeHumanMesh::Quad quad;
            for (std::size_t k = 0; k < 4; ++k)
                detail::read_corner(lines, words[k], mesh.vertices.size(), mesh.vt.size(), quad.corners[k],
                                    quad.texture[k]);
            group->push_back(quad);
        }
    }
    if (mesh.groups.empty()) throw IoError(name + ": holds no groups, expected MakeHuman's base mesh");
    return mesh;
}

} // namespace gsh
