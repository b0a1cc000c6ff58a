// SPDX-License-Identifier: Apache-2.0
/// @file  Test cases that cannot run on this machine. scripts/test names and counts them.
#pragma once

#include <filesystem>
#include <initializer_list>
#include <string>
#include <system_error>

namespace gsh::test {

/// Reports that the running test case is skipped, in a line "SKIPPED: CASE: WHY". The case then returns. If all cases
/// are skipped, the program returns 77, which ctest counts as skipped. Defined in support/main.cpp.
void skip(const std::string& why);

/// A path in the folder shared/data beside the checkout, for captures and bodies that are too large for the repository.
inline std::filesystem::path shared_data(const char* path) {
    return std::filesystem::path(GSH_SOURCE_DIR) / "../shared/data" / path;
}

/// Whether one of the files is missing. If so, the running test case is reported as skipped.
[[nodiscard]] inline bool skip_without(std::initializer_list<std::filesystem::path> files) {
    for (const auto& file : files)
        if (std::error_code ignored; !std::filesystem::exists(file, ignored)) {
            skip(file.string() + " is not there");
            return true;
        }
    return false;
}

} // namespace gsh::test
