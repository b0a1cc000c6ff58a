// SPDX-License-Identifier: Apache-2.0
/// @file  Puts new files into the places of older ones, all of them or none.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/io/file/disk_sync.hpp>

#include <fcntl.h>
#include <stdio.h>

#include <cstddef>
#include <filesystem>
#include <set>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh {

/// A file and the path that it moves to.
struct FileMove {
    std::filesystem::path from, to;
};

/// Moves files into place, in order. If one cannot be moved, those before it go back, and the files that they replaced
/// are there again. Contents are on the disk before the first name changes, and names when the function returns. After
/// a power failure in between, each name has its old file or its new one.
///
/// What is replaced is removed, or left at `from`, which is for the caller to remove. On a file system that cannot
/// exchange two names, it is not there again after an error.
/// Errors  IoError naming the path that cannot be synced or moved.
inline void move_all(const std::vector<FileMove>& moves);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Exchanges two names in one step. Returns false, and nothing has changed, if that is not possible.
[[nodiscard]] inline bool exchange_names([[maybe_unused]] const std::filesystem::path& a,
                                         [[maybe_unused]] const std::filesystem::path& b) {
#if defined(RENAME_EXCHANGE)
    return ::renameat2(AT_FDCWD, a.c_str(), AT_FDCWD, b.c_str(), RENAME_EXCHANGE) == 0;
#else
    return false;
#endif
}

} // namespace detail

inline void move_all(const std::vector<FileMove>& moves) {
    for (const FileMove& move : moves) sync_to_disk(move.from);
    std::set<std::filesystem::path> folders;
    for (const FileMove& move : moves) folders.insert(folder_of(move.to));
    std::vector<bool> exchanged;
    exchanged.reserve(moves.size()); // so that nothing throws between the moves
    const auto go_back = [&] {
        for (std::size_t i = exchanged.size(); i-- > 0;) {
            std::error_code ignored;
            if (!exchanged[i])
                std::filesystem::rename(moves[i].to, moves[i].from, ignored);
            else
                (void)detail::exchange_names(moves[i].from, moves[i].to);
        }
    };
    for (const FileMove& move : moves) {
        std::error_code error;
        const auto there = std::filesystem::symlink_status(move.to, error);
        const bool is_file = std::filesystem::is_regular_file(there) || std::filesystem::is_symlink(there);
        const bool exchange = is_file && detail::exchange_names(move.from, move.to);
        error.clear();
        if (!exchange) std::filesystem::rename(move.from, move.to, error);
        if (error) {
            go_back();
            throw IoError(move.to.string() + ": cannot be written: " + error.message());
        }
        exchanged.push_back(exchange);
    }
    for (const auto& folder : folders) sync_to_disk(folder);
}

} // namespace gsh
