// SPDX-License-Identifier: Apache-2.0
/// @file  Full paths, with errors of gsh.
#pragma once

#include <gsh/core/error.hpp>

#include <filesystem>
#include <new>
#include <system_error>

namespace gsh {

/// The absolute path without "." and "..". Links are followed as far as the path exists.
///
/// Errors  IoError naming the path if it cannot be followed, such as a link to itself; std::bad_alloc without memory,
///         which std::filesystem reports as an error of its own.
[[nodiscard]] inline std::filesystem::path full_path(const std::filesystem::path& path) {
    std::error_code error;
    std::filesystem::path full = std::filesystem::absolute(path, error);
    if (!error) full = std::filesystem::weakly_canonical(full, error);
    if (error == std::errc::not_enough_memory) throw std::bad_alloc();
    if (error) throw IoError(path.string() + ": cannot be followed: " + error.message());
    return full;
}

} // namespace gsh
