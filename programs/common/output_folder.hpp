// SPDX-License-Identifier: Apache-2.0
/// @file  An output folder in which either all results of a run appear or none.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/io/file/exchange.hpp>
#include <gsh/io/file/folder_entries.hpp>
#include <gsh/io/file/folder_lock.hpp>

#include <filesystem>
#include <set>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh::programs {

/// A folder for results. Files are written into its subfolder results.partial/. commit() moves them into place, in the
/// order of the calls of file(), all or none (move_all). Without a commit they are removed, and so is the folder, if it
/// was created here and is empty. Programs create it before their work begins: a second one is refused then
/// (LockedFolder).
/// Errors  IoError naming the path that cannot be created or moved, or the process that writes to the folder.
class OutputFolder {
public:
    explicit OutputFolder(std::filesystem::path folder)
        : locked_(std::move(folder)), folder_(locked_.path()), staging_(folder_ / "results.partial") {
        gsh::detail::remove_tree(staging_); // left by a run that was killed
    }
    OutputFolder(const OutputFolder&) = delete;
    OutputFolder& operator=(const OutputFolder&) = delete;
    ~OutputFolder() { gsh::detail::remove_tree(staging_); }

    /// The path to which the result `name` must be written. The name may contain a subfolder.
    [[nodiscard]] std::filesystem::path file(const std::string& name) {
        create_folder((staging_ / name).parent_path());
        names_.push_back(name);
        return staging_ / name;
    }

    /// Declares a subfolder that has only pictures of this program. commit() removes those of earlier results.
    void own(const std::string& subfolder) { owned_.push_back(subfolder); }

    void commit() {
        for (const std::string& name : names_) // before any file is moved
            create_folder((folder_ / name).parent_path());
        std::vector<FileMove> moves;
        for (const std::string& name : names_) moves.push_back({staging_ / name, folder_ / name});
        move_all(moves);
        for (const std::string& subfolder : owned_) remove_others(folder_ / subfolder);
        names_.clear();
    }

private:
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

    LockedFolder locked_;
    std::filesystem::path folder_, staging_;
    std::vector<std::string> names_, owned_;
};

} // namespace gsh::programs
