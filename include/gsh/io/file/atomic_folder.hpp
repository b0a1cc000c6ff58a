// SPDX-License-Identifier: Apache-2.0
/// @file  Atomic folders: a folder of files appears completely or not at all.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/io/file/disk_sync.hpp>
#include <gsh/io/file/exchange.hpp>
#include <gsh/io/file/folder_entries.hpp>
#include <gsh/io/file/folder_lock.hpp>
#include <gsh/io/file/full_path.hpp>

#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

namespace gsh {

/// Collects files in a folder beside the target (`NAME.partial`). On commit it takes the place of `NAME` in one step.
/// Where the file system cannot exchange two names, `NAME` is `NAME.old` for a moment. All files are on disk before.
/// Without a commit it is removed, and a folder that was there stays as it is. `NAME.lock` is there meanwhile
/// (FileLock): of two processes, the second is refused. If `NAME` is a link, it is kept, and what it leads to is meant.
///
/// Errors  IoError naming the path. A folder with one of these three names that is in the way is removed only if all of
///         its entries are files that `may_replace` accepts, so that nobody loses other files.
class AtomicFolder {
public:
    AtomicFolder(std::filesystem::path folder, std::function<bool(const std::string& name)> may_replace)
        : folder_(followed(without_slash(std::move(folder)))), staging_(folder_.string() + ".partial"),
          old_(folder_.string() + ".old"), may_replace_(std::move(may_replace)), parents_(folder_of(folder_)),
          lock_(folder_.string() + ".lock", folder_.string()) {
        for (const auto& path : {folder_, staging_, old_}) check_replaceable(path);
        std::error_code error;
        detail::remove_tree(staging_); // left by a run that was killed
        std::filesystem::create_directories(staging_, error);
        if (error) throw IoError(staging_.string() + ": cannot be created: " + error.message());
    }
    AtomicFolder(const AtomicFolder&) = delete;
    AtomicFolder& operator=(const AtomicFolder&) = delete;
    ~AtomicFolder() { detail::remove_tree(staging_); }

    /// The path to which the file `name` must be written.
    [[nodiscard]] std::filesystem::path file(const std::string& name) const { return staging_ / name; }
    [[nodiscard]] const std::filesystem::path& path() const { return folder_; }

    void commit() {
        for (const auto& path : {folder_, old_}) check_replaceable(path); // files may have come since the constructor
        std::error_code error, ignored;
        if (const int failed =
                detail::for_each_name(staging_, [&](std::string_view name) { sync_to_disk(staging_ / name); }))
            throw IoError(staging_.string() + ": cannot be listed: " + std::generic_category().message(failed));
        sync_to_disk(staging_);
        detail::remove_tree(old_);
        const std::filesystem::path parent = folder_of(folder_); // before the rename, after which nothing may fail
        const bool replaces = std::filesystem::exists(folder_, ignored);
        if (!replaces || !detail::exchange_names(staging_, folder_)) {
            if (replaces) std::filesystem::rename(folder_, old_, error);
            if (!error) std::filesystem::rename(staging_, folder_, error);
            if (error) {
                if (replaces) std::filesystem::rename(old_, folder_, ignored);
                throw IoError(folder_.string() + ": cannot be written: " + error.message());
            }
        }
        sync_to_disk(parent);
        detail::remove_tree(old_);
        detail::remove_tree(staging_);
    }

private:
    static std::filesystem::path without_slash(std::filesystem::path path) {
        return path.has_filename() ? path : path.parent_path();
    }

    /// Throws unless all that a folder holds may be removed. A folder that does not exist holds nothing.
    void check_replaceable(const std::filesystem::path& folder) const {
        std::error_code error;
        if (!std::filesystem::exists(folder, error)) return;
        if (!std::filesystem::is_directory(folder, error)) throw IoError(folder.string() + ": a file is in the way");
        const int failed = detail::for_each_name(folder, [&](std::string_view entry) {
            const std::string name(entry);
            std::string written = name;
            if (written.ends_with(".partial")) written.resize(written.size() - 8); // of an AtomicFile
            std::error_code unknown;
            if (!std::filesystem::is_regular_file(folder / name, unknown) || !may_replace_(written))
                throw IoError(folder.string() + ": holds " + name +
                              ", which this program did not write; name another folder");
        });
        if (failed)
            throw IoError(folder.string() + ": cannot be listed: " + std::generic_category().message(failed));
    }

    std::filesystem::path folder_, staging_, old_;
    std::function<bool(const std::string& name)> may_replace_;
    CreatedFolders parents_;
    FileLock lock_;
};

} // namespace gsh
