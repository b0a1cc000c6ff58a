// SPDX-License-Identifier: Apache-2.0
/// @file  Runs another program as a stage of this one.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace gsh::programs {

/// Prints the title of a stage.
void announce_stage(const char* title);

/// Prints a title and runs a program to its end, with the output and the errors of this one. Returns its exit code. If it
/// is interrupted, by Ctrl-C or by SIGTERM to this program, this program ends after it, with exit_interrupted.
///
/// Errors  IoError if it cannot be started; Error for a code that is not in `accepted`.
int run_stage(const char* title, const std::vector<std::string>& words, const std::vector<int>& accepted = {0});

/// The folder of this program, where gsh's other programs are.
[[nodiscard]] std::filesystem::path folder_of_programs();

} // namespace gsh::programs
