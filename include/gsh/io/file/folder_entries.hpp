// SPDX-License-Identifier: Apache-2.0
/// @file  The names in a folder, and the removal of a folder, with errors in place of an end where memory runs out.
#pragma once

#include <dirent.h>
#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <climits>
#include <cstddef>
#include <cstring>
#include <filesystem>
#include <memory>
#include <string_view>

namespace gsh::detail {

struct CloseFolder {
    void operator()(DIR* folder) const { ::closedir(folder); }
};
using OpenFolder = std::unique_ptr<DIR, CloseFolder>;

/// The next entry but "." and "..", or null at the end and after an error, which errno tells then.
[[nodiscard]] inline const dirent* next_entry(DIR* folder) {
    while (true) {
        errno = 0;
        const dirent* const entry = ::readdir(folder);
        if (!entry || (std::strcmp(entry->d_name, ".") != 0 && std::strcmp(entry->d_name, "..") != 0)) return entry;
    }
}

/// Calls visit(name) for each entry of a folder, in the order of the disk. Returns 0, or the system's error.
///
/// std::filesystem::directory_iterator of libstdc++ allocates where it must not throw: without memory it ends the
/// program.
template <class Visit>
[[nodiscard]] int for_each_name(const std::filesystem::path& folder, const Visit& visit) {
    const OpenFolder open(::opendir(folder.c_str()));
    if (!open) return errno;
    while (const dirent* const entry = next_entry(open.get())) visit(std::string_view(entry->d_name));
    return errno;
}

/// Removes what an open folder holds, folders with all that is in them. Links are removed, not followed.
inline void remove_entries(DIR* folder) noexcept {
    while (const dirent* const entry = next_entry(folder)) {
        const int here = ::dirfd(folder);
        if (::unlinkat(here, entry->d_name, 0) == 0 || (errno != EISDIR && errno != EPERM)) continue;
        const int inner = ::openat(here, entry->d_name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
        if (inner < 0) continue;
        if (const OpenFolder open(::fdopendir(inner)); open)
            remove_entries(open.get());
        else
            ::close(inner);
        ::unlinkat(here, entry->d_name, AT_REMOVEDIR);
    }
}

/// The path of a folder, which a call takes apart and puts together without memory.
struct FolderPath {
    char text[PATH_MAX];
    std::size_t size = 0;

    /// Returns false if the name does not fit.
    [[nodiscard]] bool append(const char* name) noexcept {
        const std::size_t length = std::strlen(name);
        if (size + length + 2 > sizeof text) return false;
        if (size > 0) text[size++] = '/';
        std::memcpy(text + size, name, length + 1);
        size += length;
        return true;
    }
    void shorten(std::size_t to) noexcept {
        size = to;
        text[size] = '\0';
    }
};

/// The same where the system opens no second folder: one is open at a time. Returns whether the folder is gone.
inline bool remove_folder(FolderPath& folder) noexcept {
    const std::size_t size = folder.size;
    while (true) {
        const int here = ::open(folder.text, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
        OpenFolder open(here < 0 ? nullptr : ::fdopendir(here));
        if (!open) {
            if (here >= 0) ::close(here);
            return false;
        }
        bool has_folder = false;
        while (const dirent* const entry = next_entry(open.get()))
            if (::unlinkat(here, entry->d_name, 0) != 0 && (errno == EISDIR || errno == EPERM)) {
                has_folder = folder.append(entry->d_name);
                break;
            }
        open.reset();
        if (!has_folder) return ::rmdir(folder.text) == 0;
        const bool gone = remove_folder(folder);
        folder.shorten(size);
        if (!gone) return false;
    }
}

/// Removes a folder and all that is in it; a link or a file in its place is removed, too. Takes no memory but the
/// system's, so that destructors may call it. Where too many files are open, one more suffices. What cannot be removed
/// stays.
inline void remove_tree(const std::filesystem::path& folder) noexcept {
    if (::unlink(folder.c_str()) == 0) return;
    if (const OpenFolder open(::opendir(folder.c_str())); open) remove_entries(open.get());
    if (::rmdir(folder.c_str()) == 0 || errno == ENOENT) return;
    FolderPath path;
    if (path.append(folder.c_str())) (void)remove_folder(path);
}

} // namespace gsh::detail
