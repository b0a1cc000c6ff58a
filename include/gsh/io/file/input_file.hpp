// SPDX-License-Identifier: Apache-2.0
/// @file  The one door of readers: a file on the disk, or its bytes in memory.
#pragma once

#include <gsh/core/error.hpp>

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
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
#include <thread>
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
    /// Whether it can be read only once, from its beginning to its end: a pipe (/dev/stdin after |), or a device.
    [[nodiscard]] bool is_pipe() const {
        std::error_code error;
        if (contents_) return false;
        const auto status = std::filesystem::status(path_, error);
        return std::filesystem::is_other(status);
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

    /// Reads up to `size` bytes; less at the end of the file.
    /// Errors  IoError, with the system's message, if the disk fails.
    std::size_t read(void* data, std::size_t size);
    /// The next byte, or EOF.
    int next() {
        unsigned char byte = 0;
        return read(&byte, 1) == 1 ? byte : EOF;
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
private:
    struct Close {
        void operator()(std::FILE* stream) const { std::fclose(stream); }
    };
    std::filesystem::path path_;
    std::unique_ptr<std::FILE, Close> file_; // empty for contents in memory
    std::string_view contents_;
    std::size_t position_ = 0; // in the contents
};

/// Throws IoError for a pipe. Readers that look at a file more than once call this first.
inline void check_no_pipe(const InputFile& file) {
    if (file.is_pipe())
        throw IoError(file.name() + ": is a pipe or a device, and this kind of file is not read in one go; store it in "
                                    "a file first");
}

/// The whole contents of a file, which may be a pipe.
///
/// Errors  IoError if it cannot be read, or is larger than `limit` bytes.
[[nodiscard]] inline std::string read_file(const InputFile& file, std::size_t limit = std::size_t(1) << 30);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Opens a file. A pipe is opened once somebody writes to it, because fopen would wait for that without end, as for a
/// named pipe among the images of a capture.
/// Errors  null, and errno; IoError for a pipe that nobody writes to within two seconds.
inline std::FILE* open_input(const std::filesystem::path& path) {
    std::error_code ignored;
    if (!std::filesystem::is_fifo(path, ignored)) return std::fopen(path.c_str(), "rbe");
    const int descriptor = ::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    if (descriptor < 0) return nullptr;
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(2);
    char first = 0;
    ssize_t count = 0; // 0: the end, or nobody writes yet; below 0: somebody does, but nothing has come
    while ((count = ::read(descriptor, &first, 1)) == 0 && std::chrono::steady_clock::now() < end)
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
    std::FILE* const file = count != 0 && ::fcntl(descriptor, F_SETFL, 0) == 0 ? ::fdopen(descriptor, "rb") : nullptr;
    if (!file) ::close(descriptor);
    if (count == 0) throw IoError(path.string() + ": is a pipe that nobody writes to");
    if (file && count > 0) std::ungetc(static_cast<unsigned char>(first), file);
    return file;
}

} // namespace detail

inline InputStream::InputStream(const InputFile& file) : path_(file.path()) {
    if (file.contents()) {
        contents_ = *file.contents();
        return;
    }
    if (file.is_folder()) throw IoError(file.name() + ": is a directory, expected a file");
    file_.reset(detail::open_input(path_));
    if (!file_) throw IoError(file.name() + ": cannot be opened: " + std::generic_category().message(errno));
}

inline std::size_t InputStream::read(void* data, std::size_t size) {
    std::size_t count = 0;
    if (!file_) {
        count = std::min(size, contents_.size() - std::min(position_, contents_.size()));
        if (count > 0) std::memcpy(data, contents_.data() + position_, count);
        position_ += count;
        return count;
    }
    while (true) {
        count += std::fread(static_cast<char*>(data) + count, 1, size - count, file_.get());
        if (count == size || !std::ferror(file_.get())) return count;
        const int error = errno;
        if (error != EINTR) // a signal's handler ran
            throw IoError(path_.string() + ": cannot be read: " + std::generic_category().message(error));
        std::clearerr(file_.get());
    }
}

inline std::size_t InputStream::size() const {
    if (!file_) return contents_.size();
    check_no_pipe(path_);
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
    return content;
}

} // namespace gsh
