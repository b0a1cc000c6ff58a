// SPDX-License-Identifier: Apache-2.0
/// @file  Lists the files of a folder in the order of their names, without those that operating systems add.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/io/file/folder_entries.hpp>
#include <gsh/io/file/named_path.hpp>
#include <gsh/io/file/text_lines.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

namespace gsh {

/// Whether a file or folder is one that a system or a program keeps beside the user's own: every name that begins with
/// a dot (hidden files, and the "._NAME" that macOS writes to disks of other systems), Thumbs.db and desktop.ini of
/// Windows, "Icon\r" of macOS, __MACOSX of zip archives, @eaDir of Synology.
[[nodiscard]] inline bool is_system_file(const std::filesystem::path& path);

/// The entries of a folder, files and folders, in the order of their names, without system files.
///
/// Errors  IoError for a folder that cannot be listed, where `expected` ("a folder of images") ends the message, and
///         for a name that messages cannot show.
[[nodiscard]] inline std::vector<std::filesystem::path> list_folder(const std::filesystem::path& folder,
                                                                    std::string_view expected = {});

/// The same of all files below a folder, in the order of their paths. Links to folders are not followed.
[[nodiscard]] inline std::vector<std::filesystem::path> list_files_below(const std::filesystem::path& folder,
                                                                         std::string_view expected = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Digits as a number, or -1 if it is none or has more than nine digits after its zeros.
[[nodiscard]] inline long number_of_digits(std::string_view digits) {
    if (digits.empty() || digits.find_first_not_of("0123456789") != std::string_view::npos) return -1;
    digits.remove_prefix(std::min(digits.find_first_not_of('0'), digits.size() - 1));
    return digits.size() <= 9 ? std::stol(std::string(digits)) : -1;
}

inline void list_into(const std::filesystem::path& folder, std::string_view expected, bool below,
                      std::vector<std::filesystem::path>& found) {
    std::error_code ignored;
    const int error = for_each_name(folder, [&](std::string_view name) {
        const std::filesystem::path path = folder / name;
        if (is_system_file(path)) return;
        if (!is_printable_name(name))
            throw IoError(folder.string() + ": holds '" + shortened(name) +
                          "', whose name has characters that cannot be shown; rename it");
        if (!below)
            found.push_back(path);
        else if (std::filesystem::is_directory(path, ignored) && !std::filesystem::is_symlink(path, ignored))
            list_into(path, expected, below, found);
        else if (!std::filesystem::is_directory(path, ignored))
            found.push_back(path);
    });
    if (error)
        throw IoError(folder.string() + ": cannot be listed: " + std::generic_category().message(error) +
                      (expected.empty() ? "" : "; expected " + std::string(expected)));
}

} // namespace detail

inline bool is_system_file(const std::filesystem::path& path) {
    constexpr std::array<std::string_view, 6> others{"Thumbs.db", "desktop.ini", "ehthumbs.db",
                                                     "Icon\r",    "__MACOSX",    "@eaDir"};
    const std::string name = path.filename().string();
    return name.starts_with('.') || std::any_of(others.begin(), others.end(),
                                                [&](std::string_view other) { return detail::is_word(name, other); });
}

inline std::vector<std::filesystem::path> list_folder(const std::filesystem::path& folder, std::string_view expected) {
    std::vector<std::filesystem::path> found;
    detail::list_into(folder, expected, false, found);
    std::sort(found.begin(), found.end());
    return found;
}

inline std::vector<std::filesystem::path> list_files_below(const std::filesystem::path& folder,
                                                           std::string_view expected) {
    std::vector<std::filesystem::path> found;
    detail::list_into(folder, expected, true, found);
    std::sort(found.begin(), found.end());
    return found;
}

namespace detail {

/// A file with a number as its name.
struct NumberedFile {
    long number = 0;
    std::filesystem::path path;
};

/// The number that is a file's name without extension, with any number of leading zeros, or -1.
inline long number_of(const std::filesystem::path& path) {
    return number_of_digits(path.stem().string());
}

/// Files NUMBER.EXTENSION of a folder in the order of their numbers; other files are ignored.
///
/// Errors  IoError for a folder that cannot be listed, or a number that occurs twice (1.json, 01.json).
inline std::vector<NumberedFile> list_numbered(const std::filesystem::path& folder, std::string_view extension) {
    std::vector<NumberedFile> files;
    for (const auto& path : list_folder(folder))
        if (const long number = number_of(path); number >= 0 && path.extension() == extension)
            files.push_back({number, path});
    std::stable_sort(files.begin(), files.end(),
                     [](const NumberedFile& a, const NumberedFile& b) { return a.number < b.number; });
    for (std::size_t i = 1; i < files.size(); ++i)
        if (files[i].number == files[i - 1].number)
            throw IoError(files[i].path.string() + ": its number is that of " + files[i - 1].path.filename().string() +
                          ", expected each frame once");
    return files;
}

} // namespace detail
} // namespace gsh
