// SPDX-License-Identifier: Apache-2.0
/// @file  The lines of a source file, and its includes.
#pragma once

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <vector>

namespace gsh::test {

inline std::vector<std::string> lines_of(const std::filesystem::path& path) {
    std::vector<std::string> lines;
    std::ifstream file(path);
    for (std::string line; std::getline(file, line);) lines.push_back(line);
    return lines;
}

struct Include {
    std::string path; ///< as written between the brackets
    int line;
    bool quoted;
};

inline std::vector<Include> includes_of(const std::vector<std::string>& lines) {
    std::vector<Include> includes;
    for (std::size_t i = 0; i < lines.size(); ++i) {
        std::string_view text = lines[i];
        const auto skip_blanks = [&] { text.remove_prefix(std::min(text.find_first_not_of(" \t"), text.size())); };
        skip_blanks();
        if (!text.starts_with('#')) continue;
        text.remove_prefix(1);
        skip_blanks();
        if (!text.starts_with("include")) continue;
        const auto open = text.find_first_of("<\""), close = text.find_last_of(">\"");
        if (open == std::string_view::npos || close <= open) continue;
        includes.push_back(
            {std::string(text.substr(open + 1, close - open - 1)), static_cast<int>(i) + 1, text[open] == '"'});
    }
    return includes;
}

} // namespace gsh::test
