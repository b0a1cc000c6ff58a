// SPDX-License-Identifier: Apache-2.0
/// @file  What a message to a user may look like.
#pragma once

#include <gsh/core/message.hpp>

#include <cstddef>
#include <string_view>

namespace gsh::test {

/// Whether a message begins with `begin`, the file or its folder, and is one line of printable UTF-8.
[[nodiscard]] inline bool is_shown_message(std::string_view message, std::string_view begin) {
    if (!message.starts_with(begin)) return false;
    while (!message.empty()) {
        const std::size_t size = detail::printable_length(message);
        if (size == 0) return false;
        message.remove_prefix(size);
    }
    return true;
}

} // namespace gsh::test
