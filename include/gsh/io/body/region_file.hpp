// SPDX-License-Identifier: Apache-2.0
/// @file  Reads regions of a body from JSON: lists of vertices, or an importance per vertex.
#pragma once

#include <gsh/body/region_mask.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/json_file.hpp>

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// Reads {"face_vertices": [...], "left_hand_vertices": [...], "right_hand_vertices": [...], "high": [...],
/// "importance": [...]}; at least one of them must be present. The lists hold vertex indices below `vertex_count`,
/// "importance" one number in [0, 1] per vertex. RegionLists states their precedence.
///
/// Errors  IoError: a missing file, invalid JSON, an unknown field (it may be misspelt), a list of another type;
///         ValueError: an index or importance out of range; ShapeError: importance of another size.
[[nodiscard]] inline RegionLists read_regions(const InputFile& input, std::size_t vertex_count);

// -------------------------------------------------------------------------------------------------------------

inline RegionLists read_regions(const InputFile& input, std::size_t vertex_count) {
    const detail::OwnedJson owned(detail::read_json(input, "regions"));
    const detail::Json& json = *owned;
    const detail::JsonObject object(json, input.name());
    RegionLists lists;
    const std::array<std::pair<const char*, std::optional<std::vector<int>>*>, 4> fields = {
        {{"face_vertices", &lists.face},
         {"left_hand_vertices", &lists.left_hand},
         {"right_hand_vertices", &lists.right_hand},
         {"high", &lists.high}}};
    for (const auto& [field, list] : fields) {
        if (!object.has(field)) continue;
        *list = object.integers(field);
        detail::check_index_range(input.name(), field, **list, vertex_count);
    }
    if (object.has("importance")) {
        lists.importance = object.numbers("importance", vertex_count);
        for (std::size_t v = 0; v < vertex_count; ++v)
            if (!(lists.importance[v] >= 0 && lists.importance[v] <= 1))
                throw ValueError(input.name() + ": importance[" + std::to_string(v) + "] is " +
                                 detail::number_text(lists.importance[v]) + ", expected a number in [0, 1]");
    }
    object.expect_only({"face_vertices", "left_hand_vertices", "right_hand_vertices", "high", "importance"});
    if (json.empty())
        throw IoError(input.name() + ": names no region, expected face_vertices, left_hand_vertices, "
                                     "right_hand_vertices, high or importance");
    return lists;
}

} // namespace gsh
