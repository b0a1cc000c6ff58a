// SPDX-License-Identifier: Apache-2.0
/// @file  Locks by which one process at a time writes a folder; the system releases them when the process ends.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/io/file/disk_sync.hpp>

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh {

/// Holds a file locked (flock), which names this process while it does; the destructor removes the file.
///
/// A process that is killed leaves the file, but not the lock, so it never blocks the next one. On NFS, Linux locks the
/// file at the server, for all machines that mount it. On a file system without locks, nothing is locked.
///
/// Errors  IoError, beginning with `what`, if another process holds the lock, which is named, or if the file cannot be
///         created.
class FileLock {
public:
    FileLock(std::filesystem::path path, const std::string& what);
    ~FileLock() { release(); }
    FileLock(const FileLock&) = delete;
    FileLock& operator=(const FileLock&) = delete;

    void release() noexcept {
        if (descriptor_ < 0) return;
        ::unlink(path_.c_str()); // while the lock is held, so that no other process has it
        ::close(std::exchange(descriptor_, -1));
    }

private:
    std::filesystem::path path_;
    int descriptor_ = -1;
};

/// Creates a folder and those above it, where they are missing.
///
/// Errors  IoError, naming the folder, if it cannot be created.
inline void create_folder(const std::filesystem::path& folder);

/// Creates a folder and those above it that are missing. The destructor removes the ones that were missing, if they are
/// empty; an error in the constructor does so, too.
///
/// Errors  IoError, naming the folder, if it cannot be created.
class CreatedFolders {
public:
    explicit CreatedFolders(const std::filesystem::path& folder);
    CreatedFolders(const CreatedFolders&) = delete;
    CreatedFolders& operator=(const CreatedFolders&) = delete;
    ~CreatedFolders() { remove(); }

private:
    std::vector<std::filesystem::path> missing_; // from the innermost

    void remove() noexcept {
        for (const auto& folder : missing_) ::rmdir(folder.c_str()); // only if empty
    }
};

/// A folder that this process alone writes to. It is created if it does not exist. The destructor removes the folders
/// that were created here, if they are empty.
///
/// Errors  IoError, naming the folder: it cannot be created, or another process writes to it.
class LockedFolder {
public:
    explicit LockedFolder(std::filesystem::path folder)
        : path_(std::move(folder)), created_(path_), lock_(path_ / ".gsh-lock", path_.string()) {}
    LockedFolder(const LockedFolder&) = delete;
    LockedFolder& operator=(const LockedFolder&) = delete;
    [[nodiscard]] const std::filesystem::path& path() const { return path_; }

private:
    std::filesystem::path path_;
    CreatedFolders created_;
    FileLock lock_; // its file is removed before the folders are
};

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Whether a path still leads to an open file: another process may have removed or replaced it.
[[nodiscard]] inline bool leads_to(const std::filesystem::path& path, int descriptor) {
    struct stat opened{}, found{};
    return ::fstat(descriptor, &opened) == 0 && ::stat(path.c_str(), &found) == 0 && opened.st_dev == found.st_dev &&
           opened.st_ino == found.st_ino;
}

/// Opens a file, creates it if needed, and locks it. Returns false if another process holds the lock; the descriptor
/// is then open, too. On a file system without locks the file is not locked.
/// Errors  -1 as descriptor, and errno.
[[nodiscard]] inline bool open_locked(const std::filesystem::path& path, int& descriptor) {
    while (true) {
        descriptor = open_again([&] { return ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666); });
        if (descriptor < 0) return true;
        int failed = 0;
        do failed = ::flock(descriptor, LOCK_EX | LOCK_NB);
        while (failed != 0 && errno == EINTR);
        if (failed != 0 && errno == EWOULDBLOCK) return false;
        if (failed != 0 || leads_to(path, descriptor)) return true;
        ::close(descriptor); // of the file that the process before has just removed
    }
}

} // namespace detail

inline FileLock::FileLock(std::filesystem::path path, const std::string& what) : path_(std::move(path)) {
    char host[65] = {};
    if (::gethostname(host, sizeof host - 1) != 0) host[0] = '\0';
    // Before the lock is taken, because no destructor releases it if this is out of memory.
    const std::string name =
        "process " + std::to_string(::getpid()) + (host[0] ? std::string(" on ") + host : "") + "\n";
    const bool free = detail::open_locked(path_, descriptor_);
    if (descriptor_ < 0) {
        const int error = errno;
        throw IoError(what + ": " + path_.filename().string() +
                      " cannot be created there: " + std::generic_category().message(error));
    }
    char text[200] = {};
    if (!free) {
        const auto size = ::pread(descriptor_, text, sizeof text - 1, 0);
        ::close(std::exchange(descriptor_, -1));
        const std::string_view holder(text, size > 0 ? static_cast<std::size_t>(size) : 0);
        const std::string who = detail::shortened(holder.substr(0, holder.find('\n')));
        throw IoError(what + ": " + (who.empty() ? "another process" : who) +
                      " is writing there; wait until it has ended, or name another place");
    }
    if (!detail::empty_file(descriptor_) || ::pwrite(descriptor_, name.data(), name.size(), 0) < 0)
        return; // on a full disk; the lock holds without a name
}

inline void create_folder(const std::filesystem::path& folder) {
    std::error_code error, ignored;
    std::filesystem::create_directories(folder, error);
    if (error || !std::filesystem::is_directory(folder, ignored))
        throw IoError(folder.string() + ": cannot be created: " + (error ? error.message() : "a file is in the way"));
}

inline CreatedFolders::CreatedFolders(const std::filesystem::path& folder) {
    std::error_code error;
    for (auto place = folder; !place.empty() && !std::filesystem::exists(place, error); place = place.parent_path())
        missing_.push_back(place);
    try {
        create_folder(folder);
    } catch (...) {
        remove();
        throw;
    }
}

} // namespace gsh
