// SPDX-License-Identifier: Apache-2.0
/// @file  Reads motions of AMASS and of programs with the same layout: whole poses, or split as in its SMPL-X release.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/npz.hpp>
#include <gsh/io/motion/frame_rate.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/io/motion/motion_table.hpp>

#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// Reads trans [T, 3] with poses [T, 3 J] (SMPL+H 156, SMPL-X 165, SMPL 72, body 66), or with root_orient [T, 3],
/// pose_body [T, 63] and optionally pose_jaw [T, 3], pose_eye [T, 6], pose_hand [T, 90]. poses takes precedence. betas,
/// expression(s) and what stated_time reads are optional. All other members (gender, dmpls, markers and
/// their pickled names) are ignored.
///
/// Frame   z is up in AMASS; with options.world = upright the body stands along +y. Hand poses include the mean hand
///         unless the file's flat_hand (or flat_hand_mean) is 0.
/// Errors  those of load_motion.
[[nodiscard]] inline Motion load_amass_motion(const InputFile& input, const BodyModel& model,
                                              const MotionFileOptions& options = {},
                                              std::vector<std::string>* warnings = nullptr);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Copies members of a file to a table with one row per frame, under other names.
class TableOfNpz {
public:
    TableOfNpz(const NpzReader& file, MotionTable& table) : file_(file), table_(table) {}

    /// Copies a member [T, width]; a width of 0 accepts any. Returns false if the member is missing.
    bool take(std::string_view member, std::string_view key, std::size_t width = 0) {
        if (!file_.has_array(member)) return false;
        put(key, member, rows(member, width), 0, 0);
        return true;
    }
    /// Copies numbers [from, from + count) of each row of a member.
    bool take_part(std::string_view member, std::string_view key, std::size_t width, std::size_t from,
                   std::size_t count) {
        if (!file_.has_array(member)) return false;
        put(key, member, rows(member, width), from, count);
        return true;
    }
    [[nodiscard]] std::size_t frames() const { return frames_; }

private:
    const NpzReader& file_;
    MotionTable& table_;
    std::size_t frames_ = 0;

    NpyArray<double> rows(std::string_view member, std::size_t width) {
        NpyArray<double> array = file_.read<double>(member);
        const std::size_t count = array.shape.empty() ? 0 : array.dim(0), found = count ? array.size() / count : 0;
        if (count == 0 || (frames_ && count != frames_) || (width && found != width))
            throw ShapeError(file_.name_of(member) + " has shape " + shape_text(array.shape) + ", expected (" +
                             (frames_ ? std::to_string(frames_) : "*") + ", " + (width ? std::to_string(width) : "*") +
                             ")");
        frames_ = count;
        array.shape = {count, found};
        return array;
    }
    void put(std::string_view key, std::string_view member, NpyArray<double> array, std::size_t from,
             std::size_t count) {
        if (count > 0) {
            NpyArray<double> part{{array.dim(0), count}, {}};
            for (std::size_t t = 0; t < array.dim(0); ++t)
                for (std::size_t k = 0; k < count; ++k) part.data.push_back(array[t * array.dim(1) + from + k]);
            array = std::move(part);
        }
        table_.add(std::string(key), std::string(member), std::move(array));
    }
};

/// Sets zero betas, the body's mean shape, for a file without betas.
inline void add_mean_shape(MotionTable& table, std::vector<std::string>* warnings) {
    table.add("betas", "betas", std::vector<double>{0.0}, {1});
    if (warnings) warnings->push_back(table.path().string() + ": betas are missing, the body's mean shape is taken");
}

} // namespace detail

inline Motion load_amass_motion(const InputFile& input, const BodyModel& model, const MotionFileOptions& options,
                                std::vector<std::string>* warnings) {
    const NpzReader file(input);
    MotionTable table(input.path());
    detail::TableOfNpz members(file, table);
    if (!members.take("poses", "poses")) {
        if (!members.take("root_orient", "global_orient", 3))
            throw IoError(input.name() +
                          ": poses is missing, and so is root_orient; expected a motion as AMASS writes it");
        if (!members.take("pose_body", "body_pose")) throw IoError(file.name_of("pose_body") + " is missing");
        members.take("pose_jaw", "jaw_pose", 3);
        members.take_part("pose_eye", "leye_pose", 6, 0, 3);
        members.take_part("pose_eye", "reye_pose", 6, 3, 3);
        members.take_part("pose_hand", "left_hand_pose", 90, 0, 45);
        members.take_part("pose_hand", "right_hand_pose", 90, 45, 45);
    }
    if (!members.take("trans", "transl", 3) && !members.take("transl", "transl", 3))
        throw IoError(file.name_of("trans") + " is missing");
    if (!members.take("expression", "expression")) members.take("expressions", "expression");
    if (file.has_array("betas"))
        table.add("betas", "betas", file.read<double>("betas"));
    else
        detail::add_mean_shape(table, warnings);
    copy_stated_time(file, table);
    double flat_hand = 1;
    for (const char* key : {"flat_hand_mean", "flat_hand"})
        if (file.has_array(key)) flat_hand = file.read_number<int>(key);
    table.add("flat_hand", "flat_hand", std::vector<double>{flat_hand}, {});
    return detail::MotionReader<MotionTable>(std::move(table), model, options, warnings).read();
}

} // namespace gsh
