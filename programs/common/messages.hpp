// SPDX-License-Identifier: Apache-2.0
/// @file  Messages of programs on standard error, one line each, and command lines in them.
#pragma once

#include "common/reports.hpp"

#include <unistd.h>

#include <cctype>
#include <cstdio>
#include <string>

namespace gsh::programs {

/// Replaces control characters, which may come from file names and libraries, so that a message stays on one line.
inline std::string one_line(std::string text) {
    for (char& c : text)
        if (std::iscntrl(static_cast<unsigned char>(c))) c = ' ';
    return text;
}

/// Prints a warning, on a terminal in place of the line of progress, which is drawn again below it.
inline void warn(const std::string& message) {
    std::fprintf(stderr, "%swarning: %s\n", isatty(STDERR_FILENO) == 1 ? "\r\033[K" : "", one_line(message).c_str());
    send_report({"warning", message});
}

/// A word of a command line.
[[nodiscard]] inline std::string shell_word(const std::string& text) {
    if (text.find_first_not_of("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-./=:,+@%") ==
        std::string::npos)
        return text;
    std::string word = "'";
    for (const char c : text) word += c == '\'' ? "'\\''" : std::string(1, c);
    return word + "'";
}

} // namespace gsh::programs
