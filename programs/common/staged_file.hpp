// SPDX-License-Identifier: Apache-2.0
/// @file  A file at any place that appears together with others.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/io/file/exchange.hpp>
#include <gsh/io/file/folder_entries.hpp>
#include <gsh/io/file/folder_lock.hpp>
#include <gsh/io/file/full_path.hpp>

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <system_error>
#include <utility>

namespace gsh::programs {

/// A file that is written into the folder NAME.new/ beside its target, and is then moved by move_all. NAME.lock is
/// there meanwhile (FileLock). A link is kept; what it leads to is replaced. Devices and pipes are written directly.
/// Errors  IoError naming the path that cannot be created, or the process that writes it.
class StagedFile {
public:
    explicit StagedFile(const std::filesystem::path& path)
        : path_(path), target_(followed(path)), staging_(target_.string() + ".new") {
        std::error_code error;
        direct_ = std::filesystem::exists(target_, error) && !std::filesystem::is_regular_file(target_, error);
        if (direct_) return;
        lock_ = std::make_unique<FileLock>(target_.string() + ".lock", path.string());
        gsh::detail::remove_tree(staging_); // left by a run that was killed
    }
    StagedFile(const StagedFile&) = delete;
    StagedFile& operator=(const StagedFile&) = delete;
    ~StagedFile() {
        if (!direct_) gsh::detail::remove_tree(staging_);
    }

    /// The path to which the file must be written.
    [[nodiscard]] std::filesystem::path file() const {
        if (direct_) return path_;
        create_folder(staging_);
        return staging_ / path_.filename();
    }
    /// The move into place, if there is one.
    [[nodiscard]] std::optional<FileMove> move() const {
        if (direct_) return std::nullopt;
        return FileMove{staging_ / path_.filename(), target_};
    }
    /// A message that begins with file(), with the file's own path.
    [[nodiscard]] std::string named(const std::string& message) const {
        const std::string written = (staging_ / path_.filename()).string();
        return message.starts_with(written) ? path_.string() + message.substr(written.size()) : message;
    }

private:
    std::filesystem::path path_, target_, staging_;
    bool direct_ = false;
    std::unique_ptr<FileLock> lock_;
};

} // namespace gsh::programs
