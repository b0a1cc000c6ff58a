// SPDX-License-Identifier: Apache-2.0
/// @file  Puts new files and folders into the places of older ones, all of them or none.
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

/// A file, or a folder with all that is in it, and the path that it moves to.
struct FileMove {
    std::filesystem::path from, to;
};

/// Moves files and folders into place, in order: a file takes the place of a file, a folder that of a folder. If one
/// cannot be moved, those before it go back, and what they replaced is there again. Contents of files are on the disk
/// before the first name changes, and names when the function returns; the caller syncs the files of a folder. After a
/// power failure in between, each name has its old contents or its new ones.
///
/// What is replaced is removed, or left at `from` or `from`.old, which is for the caller to remove. On a file system
/// that cannot exchange two names, a replaced file is not there again after an error, and a replaced folder is missing
/// for a moment.
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
    std::vector<std::filesystem::path> aside; // where the folder goes that is replaced
    for (const FileMove& move : moves) aside.push_back(move.from.string() + ".old");
    enum class Moved { exchanged, renamed, after_folder };
    std::vector<Moved> moved;
    moved.reserve(moves.size()); // so that nothing throws between the moves
    const auto go_back = [&] {
        for (std::size_t i = moved.size(); i-- > 0;) {
            std::error_code ignored;
            if (moved[i] == Moved::exchanged && detail::exchange_names(moves[i].from, moves[i].to)) continue;
            std::filesystem::rename(moves[i].to, moves[i].from, ignored);
            if (moved[i] == Moved::after_folder) std::filesystem::rename(aside[i], moves[i].to, ignored);
        }
    };
    for (std::size_t i = 0; i < moves.size(); ++i) {
        const auto& [from, to] = moves[i];
        std::error_code error, ignored;
        const auto there = std::filesystem::symlink_status(to, ignored);
        const bool new_folder = std::filesystem::is_directory(from, ignored),
                   is_file = std::filesystem::is_regular_file(there) || std::filesystem::is_symlink(there),
                   is_folder = std::filesystem::is_directory(there) && new_folder;
        Moved how = Moved::renamed;
        if ((is_folder || (is_file && !new_folder)) && detail::exchange_names(from, to)) {
            how = Moved::exchanged;
        } else {
            if (is_folder) std::filesystem::rename(to, aside[i], error);
            if (!error) std::filesystem::rename(from, to, error);
            if (is_folder && error) std::filesystem::rename(aside[i], to, ignored);
            if (is_folder) how = Moved::after_folder;
        }
        if (error) {
            go_back();
            throw IoError(to.string() + ": cannot be written: " + error.message());
        }
        moved.push_back(how);
    }
    for (const auto& folder : folders) sync_to_disk(folder);
}

} // namespace gsh
