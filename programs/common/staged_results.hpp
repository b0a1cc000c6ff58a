// SPDX-License-Identifier: Apache-2.0
/// @file  Results of a run that appear in a folder together or not at all.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/io/file/disk_sync.hpp>
#include <gsh/io/file/exchange.hpp>
#include <gsh/io/file/folder_entries.hpp>
#include <gsh/io/file/folder_lock.hpp>

#include <unistd.h>

#include <filesystem>
#include <list>
#include <set>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh::programs {

/// Results that are written into the subfolder results.partial/ of a folder. commit() moves them into place, in the
/// order in which they were declared, all or none (move_all). Without a commit they are removed. The folder must be
/// locked (LockedFolder), so that no other process has results there. Names may contain a subfolder.
/// Errors  IoError naming the path that cannot be created or moved.
class StagedResults {
public:
    explicit StagedResults(std::filesystem::path folder)
        : folder_(std::move(folder)), staging_(folder_ / "results.partial") {
        gsh::detail::remove_tree(staging_); // left by a run that was killed
    }
    StagedResults(const StagedResults&) = delete;
    StagedResults& operator=(const StagedResults&) = delete;
    ~StagedResults() {
        gsh::detail::remove_tree(staging_);
        for (const auto& folder : removed_from_) ::rmdir(folder.c_str()); // only if it is empty
    }

    /// The path to which the file `name` must be written.
    [[nodiscard]] std::filesystem::path file(const std::string& name) {
        create_folder((staging_ / name).parent_path());
        names_.push_back(name);
        moves_.push_back({staging_ / name, folder_ / name});
        return staging_ / name;
    }

    /// The path of a new folder of files, which takes the place of the folder `name` as a whole. commit() syncs its
    /// files.
    [[nodiscard]] std::filesystem::path whole_folder(const std::string& name) {
        create_folder(staging_ / name);
        whole_.push_back(staging_ / name);
        names_.push_back(name);
        moves_.push_back({staging_ / name, folder_ / name});
        return staging_ / name;
    }

    /// Declares that what is there as `name` gets another name.
    void rename(const std::string& name, const std::string& other) {
        names_.push_back(other);
        moves_.push_back({folder_ / name, folder_ / other});
    }

    /// Declares that what is there as `name`, if anything, is removed. The destructor removes the folder that it was
    /// in, if that is empty then.
    void remove(const std::string& name) {
        std::error_code ignored;
        if (!std::filesystem::exists(folder_ / name, ignored)) return;
        const std::filesystem::path gone = staging_ / "removed" / name;
        create_folder(gone.parent_path());
        removed_from_.insert(folder_of(folder_ / name));
        moves_.push_back({folder_ / name, gone});
    }

    /// Declares a move of a file that is elsewhere.
    void move(FileMove file) { moves_.push_back(std::move(file)); }

    /// Declares a subfolder that has only pictures of this program. commit() removes those of earlier results.
    void own(const std::string& subfolder) { owned_.push_back(subfolder); }

    void commit() {
        std::list<CreatedFolders> created; // after an error, empty ones are removed
        for (const std::string& name : names_) created.emplace_back((folder_ / name).parent_path());
        for (const std::filesystem::path& folder : whole_) sync_files(folder);
        move_all(moves_);
        for (const auto& folder : removed_from_) sync_to_disk(folder);
        for (const std::string& subfolder : owned_) remove_others(folder_ / subfolder);
        names_.clear(), whole_.clear(), moves_.clear();
    }

private:
    static void sync_files(const std::filesystem::path& folder) {
        const int failed =
            gsh::detail::for_each_name(folder, [&](std::string_view name) { sync_to_disk(folder / name); });
        if (failed) throw IoError(folder.string() + ": cannot be listed: " + std::generic_category().message(failed));
    }
    void remove_others(const std::filesystem::path& subfolder) const {
        std::set<std::filesystem::path> kept;
        for (const std::string& name : names_) kept.insert(folder_ / name);
        std::vector<std::filesystem::path> others;
        (void)gsh::detail::for_each_name(subfolder, [&](std::string_view name) {
            const std::filesystem::path path = subfolder / name;
            if (path.extension() == ".png" && !kept.contains(path)) others.push_back(path);
        });
        std::error_code ignored;
        for (const auto& path : others) std::filesystem::remove(path, ignored);
    }

    std::filesystem::path folder_, staging_;
    std::vector<std::string> names_, owned_;
    std::vector<std::filesystem::path> whole_;
    std::set<std::filesystem::path> removed_from_;
    std::vector<FileMove> moves_;
};

} // namespace gsh::programs
