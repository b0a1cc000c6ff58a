// SPDX-License-Identifier: Apache-2.0
/// @file  Names of files that stand in a file: they must not lead out of the folder in which they are looked up.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>

namespace gsh::detail {

/// Whether a path is relative and no part of it leads upwards. Links are not followed: they are the user's own.
[[nodiscard]] inline bool stays_inside(std::string_view name) {
    if (name.empty() || name.front() == '/' || name.find('\0') != std::string_view::npos) return false;
    for (std::size_t begin = 0; begin <= name.size();) {
        const std::size_t end = std::min(name.find('/', begin), name.size());
        if (name.substr(begin, end - begin) == "..") return false;
        begin = end + 1;
    }
    return true;
}

/// Whether a name is that of one file or folder, and no path.
[[nodiscard]] inline bool is_plain_name(std::string_view name) {
    return stays_inside(name) && name != "." && name.find('/') == std::string_view::npos;
}

/// FOLDER/NAME for a name that stands in a file.
/// Errors  ValueError, beginning with `where`, for a name that leads out of the folder.
[[nodiscard]] inline std::filesystem::path named_path(const std::filesystem::path& folder, const std::string& name,
                                                      const std::string& where) {
    check_value(stays_inside(name), where,
                "the file name '" + shortened(name) + "' leads out of its folder, expected one in " + folder.string() +
                    "; a link there may lead elsewhere");
    return folder / name;
}

} // namespace gsh::detail
