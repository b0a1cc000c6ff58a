// SPDX-License-Identifier: Apache-2.0
/// @file  Messages of programs on standard error, one line each.
#pragma once

#include <cctype>
#include <cstdio>
#include <string>

namespace gsh::examples {

/// Replaces control characters, which may come from file names and libraries, so that a message stays on one line.
inline std::string one_line(std::string text) {
    for (char& c : text)
        if (std::iscntrl(static_cast<unsigned char>(c))) c = ' ';
    return text;
}

inline void warn(const std::string& message) { std::fprintf(stderr, "warning: %s\n", one_line(message).c_str()); }

} // namespace gsh::examples
