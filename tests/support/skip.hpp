// SPDX-License-Identifier: Apache-2.0
/// @file  Test cases that cannot run on this machine: named and counted by scripts/test, not passed in silence.
#pragma once

#include <filesystem>
#include <initializer_list>
#include <string>
#include <system_error>

namespace gsh::test {

/// Notes that the running test case is skipped, and why, in a line "SKIPPED: CASE: WHY"; the case then returns. A run
/// of which all cases are skipped ends with 77, which ctest counts as skipped. Defined in support/main.cpp.
void skip(const std::string& why);

/// A path below the folder shared/data beside the checkout: captures and bodies that are too large for it.
inline std::filesystem::path shared_data(const char* path) {
    return std::filesystem::path(GSH_SOURCE_DIR) / "../shared/data" / path;
}

/// Whether one of the files is missing, for which the running test case is then skipped.
[[nodiscard]] inline bool skip_without(std::initializer_list<std::filesystem::path> files) {
    for (const auto& file : files)
        if (std::error_code ignored; !std::filesystem::exists(file, ignored)) {
            skip(file.string() + " is not there");
            return true;
        }
    return false;
}

} // namespace gsh::test
