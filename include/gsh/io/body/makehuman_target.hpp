// SPDX-License-Identifier: Apache-2.0
/// @file  Reads MakeHuman's targets: displacements of some vertices of the base mesh.
#pragma once

#include <gsh/core/message.hpp>
#include <gsh/io/body/makehuman_mesh.hpp>
#include <gsh/io/file/text_lines.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// A displacement of one vertex, in metres.
struct MakeHumanOffset {
    int vertex = 0;
    vec3<double> offset;
};

/// Reads lines "VERTEX DX DY DZ" in decimetres, vertices from 0; lines that begin with # are skipped. No line at all is
/// a target that moves nothing, which MakeHuman has.
///
/// Errors  IoError naming file and line, for damaged lines and vertices out of range.
[[nodiscard]] inline std::vector<MakeHumanOffset> parse_makehuman_target(std::string_view text, const std::string& name,
                                                                         std::size_t vertex_count) {
    std::vector<MakeHumanOffset> offsets;
    detail::TextLines lines(text, name);
    while (lines.next()) {
        if (lines.line().front() == '#') continue;
        const auto row = lines.numbers(lines.line(), 4, ": a vertex and its displacement");
        if (!(row[0] >= 0 && row[0] < static_cast<double>(vertex_count)) ||
            row[0] != static_cast<double>(static_cast<int>(row[0])))
            lines.fail("begins with " + detail::number_text(row[0]) + ", expected a vertex below " +
                       std::to_string(vertex_count));
        if (std::max({std::abs(row[1]), std::abs(row[2]), std::abs(row[3])}) > detail::most_decimetres)
            lines.fail("moves a vertex by more than 100 m, expected decimetres");
        offsets.push_back({static_cast<int>(row[0]), vec3<double>(row[1], row[2], row[3]) / 10.0});
    }
    return offsets;
}

} // namespace gsh
