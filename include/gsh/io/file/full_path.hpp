// SPDX-License-Identifier: Apache-2.0
/// @file  Full paths, and what links lead to, with errors of gsh.
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

/// What a path leads to, be it there or not. Links at its end are followed; std::filesystem does not follow those that
/// lead to nothing.
///
/// Errors  as full_path.
[[nodiscard]] inline std::filesystem::path followed(std::filesystem::path path) {
    constexpr int most = 40; // as Linux
    const std::filesystem::path given = path;
    for (int links = 0;; ++links) {
        std::error_code error;
        if (!std::filesystem::is_symlink(path, error)) return path;
        const std::filesystem::path next = std::filesystem::read_symlink(path, error);
        if (error == std::errc::not_enough_memory) throw std::bad_alloc();
        if (!error && links == most) error = std::make_error_code(std::errc::too_many_symbolic_link_levels);
        if (error) throw IoError(given.string() + ": cannot be followed: " + error.message());
        path = path.parent_path() / next; // an absolute path replaces what is before it
    }
}

} // namespace gsh
