// SPDX-License-Identifier: Apache-2.0
/// @file  Atomic folders: a folder of files appears completely or not at all.
#pragma once

#include <gsh/core/error.hpp>

#include <filesystem>
#include <functional>
#include <string>
#include <system_error>
#include <utility>

namespace gsh {

/// Collects files in a folder beside the target (`NAME.partial`). On commit it takes the place of `NAME`. Without a
/// commit it is removed, and a folder that was there stays as it is.
///
/// Errors  IoError naming the path. A folder that is in the way is replaced only if all of its entries are files that
///         `may_replace` accepts, so that nobody loses other files.
class AtomicFolder {
public:
    AtomicFolder(std::filesystem::path folder, const std::function<bool(const std::string& name)>& may_replace)
        : folder_(without_slash(std::move(folder))), staging_(folder_.string() + ".partial") {
        std::error_code error;
        if (std::filesystem::exists(folder_, error)) {
            if (!std::filesystem::is_directory(folder_)) throw IoError(folder_.string() + ": a file is in the way");
            for (const auto& entry : std::filesystem::directory_iterator(folder_, error))
                if (!entry.is_regular_file() || !may_replace(entry.path().filename().string()))
                    throw IoError(folder_.string() + ": holds " + entry.path().filename().string() +
                                  ", which this program did not write; name another folder");
        }
        std::filesystem::remove_all(staging_, error); // left by a run that was killed
        std::filesystem::create_directories(staging_, error);
        if (error) throw IoError(staging_.string() + ": cannot be created: " + error.message());
    }
    AtomicFolder(const AtomicFolder&) = delete;
    AtomicFolder& operator=(const AtomicFolder&) = delete;
    ~AtomicFolder() {
        std::error_code ignored;
        if (!committed_) std::filesystem::remove_all(staging_, ignored);
    }

    /// The path to which the file `name` must be written.
    [[nodiscard]] std::filesystem::path file(const std::string& name) const { return staging_ / name; }
    [[nodiscard]] const std::filesystem::path& path() const { return folder_; }

    void commit() {
        const std::filesystem::path old = folder_.string() + ".old";
        std::error_code error, ignored;
        std::filesystem::remove_all(old, ignored);
        const bool replaces = std::filesystem::exists(folder_, ignored);
        if (replaces) std::filesystem::rename(folder_, old, error);
        if (!error) std::filesystem::rename(staging_, folder_, error);
        if (error) {
            if (replaces) std::filesystem::rename(old, folder_, ignored);
            throw IoError(folder_.string() + ": cannot be written: " + error.message());
        }
        committed_ = true;
        std::filesystem::remove_all(old, ignored);
    }

private:
    static std::filesystem::path without_slash(std::filesystem::path path) {
        return path.has_filename() ? path : path.parent_path();
    }

    std::filesystem::path folder_, staging_;
    bool committed_ = false;
};

} // namespace gsh
