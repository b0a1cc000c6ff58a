// SPDX-License-Identifier: Apache-2.0
/// @file  Atomic file writing: a file appears completely or not at all.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/io/file/disk_sync.hpp>
#include <gsh/io/file/exchange.hpp>
#include <gsh/io/file/folder_lock.hpp>
#include <gsh/io/file/full_path.hpp>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <initializer_list>
#include <memory>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh {

/// Whether a commit waits for the disk.
enum class Sync {
    disk, ///< yes: the file survives a power failure right after the commit
    none, ///< no: faster, for many files that can be regenerated
};

/// Writes to a file beside the target (`NAME.partial`). On commit it syncs that file to the disk and renames it to
/// `NAME`. A reader sees the old file or the new one. A crash, a full disk or an exception leaves the old file
/// unchanged.
///
/// If `path` is a symbolic link, the link is kept and its target is replaced; a device or a pipe is written directly.
/// Of two writers of a path at one time, the second is refused: NAME.partial is locked (flock) while it is written.
/// What a killed process left is written over.
///
/// Errors  IoError with the file and the system's message. A limit on file sizes (ulimit -f) counts as a full disk in
///         programs that ignore SIGXFSZ.
class AtomicFile {
public:
    explicit AtomicFile(std::filesystem::path path);
    ~AtomicFile() { abandon(); }
    AtomicFile(const AtomicFile&) = delete;
    AtomicFile& operator=(const AtomicFile&) = delete;

    void write(const void* data, std::size_t size);
    void write(std::string_view text) { write(text.data(), text.size()); }
    /// Makes the file appear. Without a commit, the destructor removes what was written.
    ///
    /// With a path `keep`, the file that is replaced is there afterwards; if it cannot be kept, it is replaced all the
    /// same.
    void commit(Sync sync = Sync::disk, const std::filesystem::path& keep = {});
    /// Makes several files appear, all or none (move_all).
    static void commit_all(std::initializer_list<AtomicFile*> files);

    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    /// Bytes written so far.
    [[nodiscard]] std::size_t size() const { return size_; }

private:
    std::filesystem::path path_;      // as given by the caller, for messages
    std::filesystem::path target_;    // with links resolved
    std::filesystem::path temporary_; // empty when writing directly
    std::vector<char> pending_;       // buffer for small writes
    std::size_t size_ = 0;
    int descriptor_ = -1;

    static constexpr std::size_t pending_limit = 1 << 16;

    void flush();
    void finish(Sync sync);
    void write_through(const char* data, std::size_t size);
    void abandon() noexcept;
    void keep_replaced(const std::filesystem::path& keep) const noexcept;
    [[noreturn]] void fail(std::string_view deed, int error);
};

/// Writes `text` as the whole contents of a file.
inline void write_file(const std::filesystem::path& path, std::string_view text, Sync sync = Sync::disk) {
    AtomicFile file(path);
    file.write(text);
    file.commit(sync);
}

// -------------------------------------------------------------------------------------------------------------

inline AtomicFile::AtomicFile(std::filesystem::path path) : path_(std::move(path)), target_(followed(path_)) {
    std::error_code error;
    const auto status = std::filesystem::status(target_, error);
    if (std::filesystem::is_directory(status)) fail("cannot be written", EISDIR);
    const bool direct = std::filesystem::exists(status) && !std::filesystem::is_regular_file(status);
    if (!direct) temporary_ = target_.string() + ".partial";
    bool free = true;
    if (direct)
        descriptor_ = detail::open_again([&] { return ::open(target_.c_str(), O_WRONLY | O_CLOEXEC); });
    else
        free = detail::open_locked(temporary_, descriptor_);
    if (descriptor_ >= 0 && free && (direct || detail::empty_file(descriptor_))) return;
    const int code = errno;
    if (descriptor_ < 0 || !free) temporary_.clear(); // not a file that this object may remove
    if (!free) {
        abandon();
        throw IoError(path_.string() + ": another process is writing this file; name another one, or wait");
    }
    fail("cannot be created", code);
}

inline void AtomicFile::write(const void* data, std::size_t size) {
    const char* bytes = static_cast<const char*>(data);
    if (pending_.size() + size > pending_limit) flush();
    if (size > pending_limit)
        write_through(bytes, size);
    else
        pending_.insert(pending_.end(), bytes, bytes + size);
    size_ += size;
}

/// Writes all that is to be written, and waits for the disk.
inline void AtomicFile::finish(Sync sync) {
    flush();
    if (sync == Sync::disk && !temporary_.empty())
        if (const int error = detail::sync_descriptor(descriptor_)) fail("cannot be synced to the disk", error);
    // Some file systems report errors of writing on closing. The file stays open, and locked, until it is in place.
    // An interrupted close has closed the copy.
    if (const int copy = ::dup(descriptor_); copy < 0 || (::close(copy) != 0 && errno != EINTR))
        fail("cannot be closed", errno);
}

inline void AtomicFile::commit(Sync sync, const std::filesystem::path& keep) {
    finish(sync);
    const std::filesystem::path folder = folder_of(target_); // before the rename, after which nothing may fail
    if (!keep.empty() && !temporary_.empty()) keep_replaced(keep);
    const bool renamed = temporary_.empty() || std::rename(temporary_.c_str(), target_.c_str()) == 0;
    if (!renamed) fail("cannot be renamed into place", errno);
    const bool direct = temporary_.empty();
    temporary_.clear();
    ::close(std::exchange(descriptor_, -1));
    if (direct || sync == Sync::none) return;
    sync_to_disk(folder); // which stores the rename
}

inline void AtomicFile::commit_all(std::initializer_list<AtomicFile*> files) {
    std::vector<FileMove> moves;
    for (AtomicFile* const file : files) {
        file->finish(Sync::disk);
        if (!file->temporary_.empty()) moves.push_back({file->temporary_, file->target_});
    }
    move_all(moves);
    for (AtomicFile* const file : files) file->abandon(); // removes what was replaced
}

inline void AtomicFile::flush() {
    write_through(pending_.data(), pending_.size());
    pending_.clear();
}

inline void AtomicFile::write_through(const char* data, std::size_t size) {
    while (size > 0) {
        const ssize_t written = ::write(descriptor_, data, std::min(size, std::size_t(1) << 30));
        if (written < 0 && errno == EINTR) continue;
        if (written <= 0) fail("cannot be written", written < 0 ? errno : ENOSPC);
        data += written;
        size -= static_cast<std::size_t>(written);
    }
}

inline void AtomicFile::abandon() noexcept {
    if (!temporary_.empty()) ::unlink(temporary_.c_str()); // while it is locked
    temporary_.clear();
    if (descriptor_ >= 0) ::close(std::exchange(descriptor_, -1));
}

inline void AtomicFile::keep_replaced(const std::filesystem::path& keep) const noexcept {
    struct stat found{};
    if (::stat(target_.c_str(), &found) != 0) return;
    ::unlink(keep.c_str());
    if (::link(target_.c_str(), keep.c_str()) != 0) // as on file systems without hard links
        (void)!std::rename(target_.c_str(), keep.c_str());
}

inline void AtomicFile::fail(std::string_view deed, int error) {
    abandon();
    throw IoError(
        path_.string() + ": " + std::string(deed) + ": " + std::generic_category().message(error) +
        (error == ENOSPC || error == EFBIG || error == EDQUOT ? "; nothing was changed, free some space" : ""));
}

} // namespace gsh
