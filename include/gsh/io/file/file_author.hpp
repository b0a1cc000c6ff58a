// SPDX-License-Identifier: Apache-2.0
/// @file  The name that files state as their author.
#pragma once

#include <gsh/core/config.hpp>

#include <string>

namespace gsh {

/// "gsh 0.1.0", the author of a file.
[[nodiscard]] inline std::string file_author() {
    return "gsh " GSH_VERSION_TEXT;
}

} // namespace gsh
