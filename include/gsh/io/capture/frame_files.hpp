// SPDX-License-Identifier: Apache-2.0
/// @file  Which file of a camera's folder belongs to which frame.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/io/file/folder_list.hpp>

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace gsh::detail {

/// The files of some folders (images of several cameras, their masks), ordered by frame.
struct FrameFiles {
    std::vector<std::vector<std::filesystem::path>> rows; ///< [folders][frames]; empty where a frame has no file
    std::size_t frames = 0;
};

/// The number at the end of a file's name without extension (frame_0012.png: 12), or -1.
inline long number_at_end(const std::filesystem::path& path) {
    const std::string stem = path.stem().string();
    const std::size_t last = stem.find_last_not_of("0123456789");
    return number_of_digits(stem.substr(last == std::string::npos ? 0 : last + 1));
}

/// Throws IoError for numbers whose order is not that of the names (2, 10).
inline void check_order(const std::vector<std::filesystem::path>& files) {
    for (std::size_t i = 1; i < files.size(); ++i)
        if (number_of(files[i]) >= 0 && number_of(files[i]) < number_of(files[i - 1]))
            throw IoError(files[i].string() + ": comes after " + files[i - 1].filename().string() +
                          " in the order of the names; pad the numbers with zeros");
}

/// Whether the files are numbered without a gap, or not numbered.
inline bool has_no_gap(const std::vector<std::filesystem::path>& files) {
    for (std::size_t i = 1; i < files.size(); ++i)
        if (number_of(files[i]) > number_of(files[i - 1]) + 1) return false;
    return true;
}

/// Assigns files, in the order of their names, to frames. Where every folder has one file for each frame, their order
/// decides. Otherwise the numbers at the ends of their names do: the smallest number of all folders is the first frame,
/// the largest the last, and a frame may lack its file.
///
/// @param folders  of the lists, for messages.
/// @param frames   how many there are; 0: as many as the files tell.
/// @param reason   of that number: "one per pose of poses.npz".
/// Errors  ShapeError for an empty folder, and for files that are not as many as the frames where numbers do not tell
///         which are missing; IoError for names in another order than their numbers, and a number that occurs twice.
inline FrameFiles assign_frames(std::vector<std::vector<std::filesystem::path>> lists,
                                const std::vector<std::filesystem::path>& folders, std::size_t frames,
                                const std::string& reason) {
    FrameFiles result{{}, frames};
    bool whole = true;
    for (const auto& files : lists) {
        check_order(files);
        if (result.frames == 0) result.frames = files.size();
        whole = whole && files.size() == result.frames && has_no_gap(files);
    }
    if (whole) {
        result.rows = std::move(lists);
        return result;
    }
    long first = 0, last = -1;
    bool numbered = true, none = false;
    for (const auto& files : lists) {
        none = none || files.empty();
        for (const auto& path : files) {
            const long number = number_at_end(path);
            numbered = numbered && number >= 0;
            first = last < 0 ? number : std::min(first, number), last = std::max(last, number);
        }
    }
    const auto count = static_cast<std::size_t>(last - first + 1);
    if (frames == 0 && numbered && !none) {
        constexpr std::size_t most_missing = 10000; // a span that few files fill is a mistake, and may be of any length
        std::size_t files = 0;
        for (const auto& list : lists) files = std::max(files, list.size());
        if (count > files + most_missing)
            throw ShapeError(folders[0].string() + ": the numbers of its files and of those beside it go from " +
                             std::to_string(first) + " to " + std::to_string(last) + ", but there are only " +
                             std::to_string(files) + " files; number them by frame");
        result.frames = count;
    }
    if (none || !numbered || count != result.frames) {
        std::size_t k = 0; // the folder to name: the first that is not as it should be
        while (!(none ? lists[k].empty() : lists[k].size() != result.frames || !has_no_gap(lists[k]))) ++k;
        throw ShapeError(folders[k].string() + ": holds " + std::to_string(lists[k].size()) + " images" +
                         (lists[k].size() == result.frames ? " with a gap in their numbers" : "") + ", expected " +
                         std::to_string(result.frames) + ", " + reason +
                         (none        ? ""
                          : !numbered ? "; a frame may lack its image only where all names end in numbers"
                                      : "; a frame may lack its image only where the numbers of all files span " +
                                            std::to_string(result.frames) + " frames, but they go from " +
                                            std::to_string(first) + " to " + std::to_string(last)));
    }
    for (const auto& files : lists) {
        std::vector<std::filesystem::path>& row = result.rows.emplace_back(result.frames);
        for (const auto& path : files) {
            std::filesystem::path& place = row[static_cast<std::size_t>(number_at_end(path) - first)];
            if (!place.empty())
                throw IoError(path.string() + ": its number is that of " + place.filename().string() +
                              ", expected each frame once");
            place = path;
        }
    }
    return result;
}

} // namespace gsh::detail
