// SPDX-License-Identifier: Apache-2.0
/// @file  What programs say on standard error, a line each.
#pragma once

#include <cctype>
#include <cstdio>
#include <string>

namespace gsh::examples {

/// A message that stays on its line, whatever file names and libraries put into it.
inline std::string one_line(std::string text) {
    for (char& c : text)
        if (std::iscntrl(static_cast<unsigned char>(c))) c = ' ';
    return text;
}

inline void warn(const std::string& message) { std::fprintf(stderr, "warning: %s\n", one_line(message).c_str()); }

} // namespace gsh::examples
