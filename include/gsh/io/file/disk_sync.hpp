// SPDX-License-Identifier: Apache-2.0
/// @file  Waits until files, and the names in folders, are on the disk.
#pragma once

#include <gsh/core/error.hpp>

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <string>
#include <system_error>

namespace gsh {

/// Waits until a file's contents, or a folder's names, are on the disk. A file that is renamed before its contents are
/// there can be empty after a power failure; a rename is there only once its folder is.
///
/// A file system that cannot do this, and a folder that may be written but not read, are left as they are.
/// Errors  IoError with the path and the system's message.
inline void sync_to_disk(const std::filesystem::path& path);

/// The folder that holds a file's name.
[[nodiscard]] inline std::filesystem::path folder_of(const std::filesystem::path& file) {
    return file.has_parent_path() ? file.parent_path() : std::filesystem::path(".");
}

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Calls open() again while a signal interrupts it.
template <class Open>
[[nodiscard]] int open_again(const Open& open) {
    int descriptor = -1;
    do descriptor = open();
    while (descriptor < 0 && errno == EINTR);
    return descriptor;
}

/// Takes all bytes out of an open file. Returns false, and errno, if that fails.
[[nodiscard]] inline bool empty_file(int descriptor) {
    int failed = 0;
    do failed = ::ftruncate(descriptor, 0);
    while (failed != 0 && errno == EINTR);
    return failed == 0;
}

/// 0, or the system's error.
[[nodiscard]] inline int sync_descriptor(int descriptor) {
    int failed = 0;
    do failed = ::fsync(descriptor);
    while (failed != 0 && errno == EINTR);
    return failed == 0 || errno == EINVAL || errno == ENOTSUP || errno == EROFS ? 0 : errno;
}

} // namespace detail

inline void sync_to_disk(const std::filesystem::path& path) {
    const int descriptor = detail::open_again([&] { return ::open(path.c_str(), O_RDONLY | O_CLOEXEC); });
    int error = descriptor >= 0 ? detail::sync_descriptor(descriptor) : errno == EACCES ? 0 : errno;
    if (descriptor >= 0) ::close(descriptor);
    if (error)
        throw IoError(path.string() + ": cannot be synced to the disk: " + std::generic_category().message(error));
}

} // namespace gsh
