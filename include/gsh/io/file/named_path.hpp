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

/// Whether messages can show a name: at most 255 bytes of printable text.
[[nodiscard]] inline bool is_printable_name(std::string_view name) {
    constexpr std::size_t longest = 255;
    if (name.size() > longest) return false;
    while (!name.empty()) {
        const std::size_t length = printable_length(name);
        if (length == 0) return false;
        name.remove_prefix(length);
    }
    return true;
}

/// Throws ValueError, beginning with `where`, for a name of a file that messages cannot show.
inline void check_printable_name(std::string_view name, const std::string& where) {
    check_value(is_printable_name(name), where,
                "the file name '" + shortened(name) +
                    "' is longer than 255 bytes or holds characters that cannot be shown; rename the file");
}

/// Whether a name is that of one file or folder, and no path, and messages can show it.
[[nodiscard]] inline bool is_plain_name(std::string_view name) {
    return stays_inside(name) && name != "." && name.find('/') == std::string_view::npos && is_printable_name(name);
}

/// FOLDER/NAME for a name that stands in a file.
/// Errors  ValueError, beginning with `where`, for a name that leads out of the folder, or that messages cannot show.
[[nodiscard]] inline std::filesystem::path named_path(const std::filesystem::path& folder, const std::string& name,
                                                      const std::string& where) {
    check_value(stays_inside(name), where,
                "the file name '" + shortened(name) + "' leads out of its folder, expected one in " + folder.string() +
                    "; a link there may lead elsewhere");
    check_printable_name(name, where);
    return folder / name;
}

} // namespace gsh::detail
