// SPDX-License-Identifier: Apache-2.0
/// @file  Reads motions from a folder of .npz files, one per frame and person, as SMPLer-X and OSX write them.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/io/file/folder_list.hpp>
#include <gsh/io/file/npz.hpp>
#include <gsh/io/motion/frame_rate.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/io/motion/motion_table.hpp>

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <iterator>
#include <set>
#include <string>
#include <string_view>
#include <system_error>
#include <tuple>
#include <utility>
#include <vector>

namespace gsh {

/// A file of one frame: NUMBER.npz, or NUMBER_PERSON.npz, with any word before the number ("frame_00012_0.npz").
struct NpzFrame {
    long number = 0, person = 0;
    std::filesystem::path path;
};

/// The files of a folder that are named so, by number and person; hidden files are left out.
[[nodiscard]] inline std::vector<NpzFrame> npz_frames(const std::filesystem::path& folder);

/// Reads the files of one person, options.person, in the order of their numbers; it is not needed if there is only one.
/// Each holds one frame: global_orient [3], body_pose [21, 3] or [23, 3], transl (or trans) [3], and optionally
/// jaw_pose, leye_pose, reye_pose [3], left_hand_pose, right_hand_pose, expression, betas; all with further axes of
/// length 1. All files must have the arrays of the first one. Shapes are averaged over the frames.
///
/// Frame   that of the estimator, usually the camera's: x right, y down, z forward.
/// Units   timestamps are NUMBER / fps (30 without options.fps, with a warning). Hands are relative to the mean hand
///         unless flat_hand or options specify otherwise.
/// Errors  IoError, ShapeError, ValueError naming file and key; also for files that hold several frames each.
[[nodiscard]] inline Motion load_npz_frames(const std::filesystem::path& folder, const BodyModel& model,
                                            const MotionFileOptions& options = {},
                                            std::vector<std::string>* warnings = nullptr);

// -------------------------------------------------------------------------------------------------------------

inline std::vector<NpzFrame> npz_frames(const std::filesystem::path& folder) {
    std::vector<NpzFrame> frames;
    std::error_code ignored;
    if (!std::filesystem::is_directory(folder, ignored)) return frames;
    for (const std::filesystem::path& path : list_folder(folder)) {
        const std::string stem = path.stem().string();
        if (path.extension() != ".npz") continue;
        constexpr const char* digits = "0123456789";
        const std::size_t first = stem.find_first_of(digits);
        if (first == std::string::npos) continue;
        const std::size_t end = std::min(stem.find_first_not_of(digits, first), stem.size());
        const std::string number = stem.substr(first, end - first), rest = stem.substr(end);
        const std::string person = rest.empty() ? "0" : rest.substr(1);
        const bool named = rest.empty() ||
                           (rest[0] == '_' && !person.empty() && person.find_first_not_of(digits) == std::string::npos);
        if (!named || number.size() > 9 || person.size() > 9) continue;
        frames.push_back({std::stol(number), std::stol(person), path});
    }
    std::sort(frames.begin(), frames.end(), [](const NpzFrame& a, const NpzFrame& b) {
        return std::tuple(a.number, a.person, a.path) < std::tuple(b.number, b.person, b.path);
    });
    return frames;
}

namespace detail {

/// The files of one person.
inline std::vector<NpzFrame> npz_frames_of(const std::filesystem::path& folder, int person) {
    std::vector<NpzFrame> all = npz_frames(folder), chosen;
    std::set<long> people;
    for (const NpzFrame& frame : all) people.insert(frame.person);
    for (NpzFrame& frame : all)
        if (people.size() == 1 || frame.person == person) chosen.push_back(std::move(frame));
    if (chosen.empty())
        throw IoError(folder.string() + ": " +
                      (people.empty() ? "holds no files NUMBER.npz, expected one per frame"
                                      : "person " + std::to_string(person) + " is missing, there are " +
                                            listing(people.size(), 8, [&](std::size_t i) {
                                                return std::to_string(*std::next(people.begin(), std::ptrdiff_t(i)));
                                            })));
    for (std::size_t i = 1; i < chosen.size(); ++i)
        if (chosen[i].number == chosen[i - 1].number)
            throw IoError(chosen[i].path.string() + ": its number is that of " +
                          chosen[i - 1].path.filename().string() + ", expected each frame once");
    return chosen;
}

/// The rows of an array, collected from all files.
struct NpzColumn {
    const char* key;
    std::size_t width; ///< 0: that of the first file
    std::vector<double> numbers = {};
};

} // namespace detail

inline Motion load_npz_frames(const std::filesystem::path& folder, const BodyModel& model,
                              const MotionFileOptions& options, std::vector<std::string>* warnings) {
    const std::vector<NpzFrame> frames = detail::npz_frames_of(folder, options.person);
    std::vector<detail::NpzColumn> columns;
    std::vector<double> numbers, betas;
    MotionTable table(folder);
    for (const NpzFrame& frame : frames) {
        const NpzReader file(frame.path);
        if (numbers.empty()) {
            for (const auto& [key, width] : {std::pair<const char*, std::size_t>{"global_orient", 3},
                                             {"body_pose", 0},
                                             {"jaw_pose", 3},
                                             {"leye_pose", 3},
                                             {"reye_pose", 3},
                                             {"left_hand_pose", 0},
                                             {"right_hand_pose", 0},
                                             {"expression", 0},
                                             {file.has_array("transl") ? "transl" : "trans", 3},
                                             {"betas", 0}})
                if (file.has_array(key)) columns.push_back({key, width});
            for (const char* needed : {"global_orient", "body_pose"})
                if (!file.has_array(needed))
                    throw IoError(file.name_of(needed) + " is missing; expected one frame of a motion in each file");
            for (const char* key : {"flat_hand", "flat_hand_mean"})
                if (file.has_array(key))
                    table.add("flat_hand", key, std::vector<double>{double(file.read_number<int>(key))}, {});
        }
        for (detail::NpzColumn& column : columns) {
            const NpyArray<double> array = file.read<double>(column.key);
            if (numbers.empty() && column.width == 0) column.width = array.size();
            if (array.size() != column.width)
                throw ShapeError(file.name_of(column.key) + " has shape " + detail::shape_text(array.shape) +
                                 ", expected " + std::to_string(column.width) +
                                 " numbers: one frame in each file of the folder" +
                                 (numbers.empty() ? "; to read a file with all frames, give its name" : ""));
            column.numbers.insert(column.numbers.end(), array.data.begin(), array.data.end());
        }
        numbers.push_back(static_cast<double>(frame.number));
    }
    for (detail::NpzColumn& column : columns) {
        if (column.key == std::string_view("betas")) {
            betas.assign(column.width, 0.0);
            for (std::size_t i = 0; i < column.numbers.size(); ++i)
                betas[i % column.width] += column.numbers[i] / static_cast<double>(frames.size());
        } else {
            table.add(column.key, column.key, std::move(column.numbers), {frames.size(), column.width});
        }
    }
    if (betas.empty()) {
        betas.push_back(0);
        if (warnings) warnings->push_back(folder.string() + ": betas are missing, the body's mean shape is taken");
    }
    table.add("betas", "betas", betas, {betas.size()});
    table.add(detail::frame_numbers_key, "the numbers of its files", std::move(numbers), {frames.size()});
    return detail::MotionReader<MotionTable>(std::move(table), model, options, warnings).read();
}

} // namespace gsh
