// SPDX-License-Identifier: Apache-2.0
/// @file  Runs another program as a stage of this one.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace gsh::examples {

/// Runs a program to its end, with the output and the errors of this one, and returns its exit code, or 128 and the
/// signal that ended it. An interrupt of the terminal reaches it as well as this program.
///
/// Errors  IoError if it cannot be started.
int run_stage(const std::vector<std::string>& words);

/// The folder of this program, where gsh's other programs are.
[[nodiscard]] std::filesystem::path folder_of_programs();

} // namespace gsh::examples
