// SPDX-License-Identifier: Apache-2.0
/// @file  Reads flat JSON files of settings as pairs of name and value, as text.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/json_file.hpp>

#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// Reads {"name": 0.5, "other": true, "third": "text"} in the file's order.
///
/// Errors  IoError for a file that is not a JSON object, or for a member that is a list, an object or null.
[[nodiscard]] inline std::vector<std::pair<std::string, std::string>> read_settings(const InputFile& input) {
    const detail::OwnedJson owned(detail::read_json(input, "settings"));
    const detail::Json& json = *owned;
    if (!json.is_object()) throw IoError(input.name() + ": must hold one JSON object, names and values");
    std::vector<std::pair<std::string, std::string>> settings;
    for (const auto& [name, value] : json.items()) {
        if (value.is_structured() || value.is_null())
            throw IoError(input.name() + ": " + detail::shortened(name) +
                          " must be a number, true, false, or text in quotes");
        settings.emplace_back(name, value.is_string() ? value.get<std::string>() : value.dump());
    }
    return settings;
}

} // namespace gsh
