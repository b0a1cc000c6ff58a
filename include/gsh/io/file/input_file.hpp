// SPDX-License-Identifier: Apache-2.0
/// @file  The one door of readers: a file on the disk, or its bytes in memory.
#pragma once

#include <gsh/core/error.hpp>

#include <algorithm>
#include <cerrno>
#include <concepts>
#include <cstddef>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <type_traits>
#include <utility>

namespace gsh {

/// What a reader of a single file takes: a path, or the contents of a file that a program has in memory, such as a
/// member of a game's pack, a download or an upload. Readers of folders, and files that name others, need the disk.
///
/// ```cpp
/// load_avatar("avatar.gsh");
/// load_avatar(InputFile::in_memory("avatar.gsh", bytes));
/// ```
class InputFile {
public:
    /// A file on the disk, which is opened when it is read.
    template <class Path>
        requires std::convertible_to<Path, std::filesystem::path> &&
                 (!std::same_as<std::remove_cvref_t<Path>, InputFile>)
    InputFile(Path&& path) : path_(std::forward<Path>(path)) {} // NOLINT(google-explicit-constructor): a path is a file

    /// The contents of a file, which must outlive the reader. The name stands in messages; its ending tells the formats
    /// apart that have no signature, and is otherwise free.
    [[nodiscard]] static InputFile in_memory(std::filesystem::path name, std::string_view contents) {
        InputFile file(std::move(name));
        file.contents_ = contents;
        return file;
    }

    /// The path, or the name of the contents.
    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    /// The same as text, for messages.
    [[nodiscard]] std::string name() const { return path_.string(); }
    /// The ending of the name with its dot, or "".
    [[nodiscard]] std::string ending() const { return path_.extension().string(); }
    /// The contents in memory, if there are any.
    [[nodiscard]] const std::optional<std::string_view>& contents() const { return contents_; }
    [[nodiscard]] bool is_folder() const {
        std::error_code ignored;
        return !contents_ && std::filesystem::is_directory(path_, ignored);
    }

private:
    std::filesystem::path path_;
    std::optional<std::string_view> contents_;
};

/// Reads a file from its beginning, or from a place in it.
///
/// Errors  IoError, with the file's name and the system's message, for a file that cannot be opened.
class InputStream {
public:
    explicit InputStream(const InputFile& file);

    /// Reads up to `size` bytes; less at the end of the file, or where the disk fails.
    std::size_t read(void* data, std::size_t size);
    /// The next byte, or EOF.
    int next() {
        if (file_) return std::fgetc(file_.get());
        return position_ < contents_.size() ? static_cast<unsigned char>(contents_[position_++]) : EOF;
    }
    [[nodiscard]] std::size_t position() const {
        return file_ ? static_cast<std::size_t>(::ftello(file_.get())) : position_;
    }
    /// Goes to a byte; false if that is not possible.
    [[nodiscard]] bool seek(std::size_t position) {
        if (file_) return ::fseeko(file_.get(), static_cast<off_t>(position), SEEK_SET) == 0;
        position_ = position;
        return true;
    }
    /// Bytes of the file.
    /// Errors  IoError for a pipe or a device.
    [[nodiscard]] std::size_t size() const;
    /// The system's error if the last read ended before the end of the file; 0 otherwise.
    [[nodiscard]] int error() const { return file_ && std::ferror(file_.get()) ? errno : 0; }

private:
    struct Close {
        void operator()(std::FILE* stream) const { std::fclose(stream); }
    };
    std::filesystem::path path_;
    std::unique_ptr<std::FILE, Close> file_; // empty for contents in memory
    std::string_view contents_;
    std::size_t position_ = 0; // in the contents
};

/// The whole contents of a file.
///
/// Errors  IoError if it cannot be read, or is larger than `limit` bytes.
[[nodiscard]] inline std::string read_file(const InputFile& file, std::size_t limit = std::size_t(1) << 30);

// -------------------------------------------------------------------------------------------------------------

inline InputStream::InputStream(const InputFile& file) : path_(file.path()) {
    if (file.contents()) {
        contents_ = *file.contents();
        return;
    }
    if (file.is_folder()) throw IoError(file.name() + ": is a directory, expected a file");
    file_.reset(std::fopen(path_.c_str(), "rbe"));
    if (!file_) throw IoError(file.name() + ": cannot be opened: " + std::generic_category().message(errno));
}

inline std::size_t InputStream::read(void* data, std::size_t size) {
    if (file_) return std::fread(data, 1, size, file_.get());
    const std::size_t count = std::min(size, contents_.size() - std::min(position_, contents_.size()));
    if (count > 0) std::memcpy(data, contents_.data() + position_, count);
    position_ += count;
    return count;
}

inline std::size_t InputStream::size() const {
    if (!file_) return contents_.size();
    std::error_code error;
    const std::uintmax_t size = std::filesystem::file_size(path_, error);
    if (error) throw IoError(path_.string() + ": cannot be read: " + error.message());
    return static_cast<std::size_t>(size);
}

inline std::string read_file(const InputFile& file, std::size_t limit) {
    const auto check_limit = [&](std::size_t size) {
        if (size > limit)
            throw IoError(file.name() + ": is larger than " + std::to_string(limit) + " bytes, the most that is read");
    };
    if (file.contents()) {
        check_limit(file.contents()->size());
        return std::string(*file.contents());
    }
    InputStream stream(file);
    std::string content;
    char block[1 << 16];
    while (const std::size_t count = stream.read(block, sizeof block)) {
        content.append(block, count);
        check_limit(content.size());
    }
    if (const int error = stream.error())
        throw IoError(file.name() + ": cannot be read: " + std::generic_category().message(error));
    return content;
}

} // namespace gsh
