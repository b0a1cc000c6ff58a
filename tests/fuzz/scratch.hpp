// SPDX-License-Identifier: Apache-2.0
/// @file  A folder in memory, for readers of several files and for what is written again.
#pragma once

#include <filesystem>
#include <string_view>

namespace gsh::fuzz {

/// The folder of this process. It is removed at the end.
[[nodiscard]] const std::filesystem::path& scratch();

/// Replaces the contents of scratch() / name by the members of a zip archive, and returns that folder. Members whose
/// names lead out of it are left out. Bytes that are no archive make an empty folder.
std::filesystem::path unpack_to_scratch(std::string_view name, std::string_view archive);

} // namespace gsh::fuzz
