// SPDX-License-Identifier: Apache-2.0
/// @file  Reads motions in BVH files, the text format of motion capture: a tree of joints, then a line per frame.
#pragma once

#include <gsh/body/joint_map.hpp>
#include <gsh/body/joint_names.hpp>
#include <gsh/body/rest_pose.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/body/rig_up.hpp>
#include <gsh/body/turned_limbs.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/file/claimed_size.hpp>
#include <gsh/io/file/foreign_file.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/text_lines.hpp>
#include <gsh/io/motion/bvh_export.hpp>
#include <gsh/io/motion/frame_rate.hpp>
#include <gsh/io/motion/unit_guess.hpp>
#include <gsh/io/motion/up_warning.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <map>
#include <numbers>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// Reads the one skeleton of a file and its motion. The rest pose is that of zero angles. A joint with position
/// channels takes its position in the parent's frame from them, in place of its OFFSET; limbs are then turned to where
/// the joints are (body/turned_limbs.hpp). Where such a joint has an OFFSET of zero, it rests at the mean of its
/// positions. An End Site becomes a joint NAME_end. Of joints with the same name, the second is NAME#2.
///
/// Frames  one for each line after 'Frame Time:', also where 'Frames:' states fewer (Rokoko states one fewer), with a
///         warning.
///
/// Frame   y up. Where another axis is up (body/rig_up.hpp), the world is turned.
/// Units   the file does not state its unit; it is guessed from the length of the legs, except in files of save_bvh,
///         which are in centimetres and y up. A frame time of 0 is none: 30 frames a second, with a warning.
/// Errors  IoError, ValueError naming file and line: a channel that is not known, numbers that do not fit the channels,
///         fewer lines than 'Frames:' states, NaN, more than 256 levels. What was guessed is added to
///         `warnings`.
[[nodiscard]] inline RigMotion load_bvh(const InputFile& input, const JointMap& map = {},
                                        std::vector<std::string>* warnings = nullptr, const FrameRates& rates = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

class BvhReader {
public:
    BvhReader(const InputFile& input, std::vector<std::string>* warnings)
        : text_(read_file(input)), lines_(text_, input.name()), warnings_(warnings) {}

    /// Whether gsh wrote the file.
    [[nodiscard]] bool is_own() const { return is_saved_bvh(text_); }

    RigMotion read(const FrameRates& rates) {
        read_hierarchy();
        read_motion();
        if (!(rates.input > 0) && step_ * detail::slowest_frame_rate >= 1)
            throw IoError(lines_.name() + ": 'Frame Time:' states " + number_text(step_) +
                          " s, expected the seconds from one frame to the next; correct it, or state the rate "
                          "(--input-fps)");
        if (!(rates.input > 0) && step_ > 1)
            warn("'Frame Time:' states " + number_text(step_) +
                 " s from frame to frame; is it in milliseconds, or the number of frames a second?");
        StatedTime stated;
        if (step_ != 0) stated.rate = 1 / step_, stated.name = lines_.name() + ": 1 / 'Frame Time:'";
        rig_.timestamps = frame_times(frame_count_, stated, rates, lines_.name(), warnings_);
        if (!(rates.input > 0) && step_ != 0) // without the rounding of 1 / step
            for (std::size_t t = 0; t < frame_count_; ++t) rig_.timestamps[t] = static_cast<double>(t) * step_;
        return std::move(rig_);
    }

private:
    struct Joint {
        vec3<double> offset{0.0}, positions{0.0}; ///< positions: the sum over the frames
        std::vector<int> channels;                ///< 0 to 2: position x, y, z; 3 to 5: rotation about x, y, z

        [[nodiscard]] bool moves() const {
            return std::count_if(channels.begin(), channels.end(), [](int channel) { return channel < 3; }) == 3;
        }
    };
    std::string text_;
    TextLines lines_;
    std::vector<std::string>* warnings_;
    RigMotion rig_;
    std::vector<Joint> joints_;
    std::map<std::string, int> seen_;
    std::size_t channel_count_ = 0, frame_count_ = 0;
    double step_ = 0; // seconds from frame to frame; 0 where the file states no time

    [[noreturn]] void refuse_beginning() const {
        const std::string foreign = not_the_kind(lines_.name(), "a BVH file", "bvh", "");
        if (!foreign.empty()) throw IoError(lines_.name() + ": " + foreign);
        lines_.fail("is not the beginning of a BVH file, expected HIERARCHY");
    }

    void add_joint(const std::string& name, int parent) {
        if (name.empty()) lines_.fail("is a joint without a name");
        if (name.size() > longest_joint_name)
            lines_.fail("is a joint with a name of " + std::to_string(name.size()) + " bytes, expected at most " +
                        std::to_string(longest_joint_name));
        rig_.names.push_back(unique_joint_name(name, seen_));
        rig_.parents.push_back(parent);
        joints_.emplace_back();
    }

    /// The rest of a line after its first word, without an opening brace; names may contain blanks.
    static std::string name_of(std::string_view line, std::string_view first) {
        line.remove_prefix(first.size());
        line = trimmed(line);
        if (line.ends_with("{")) line = trimmed(line.substr(0, line.size() - 1));
        return std::string(line);
    }

    void read_hierarchy() {
        constexpr std::size_t deepest = 256, most = 4096;
        if (!lines_.next() || !is_word(first_word(lines_.line()), "HIERARCHY")) refuse_beginning();
        std::vector<int> open; // joints whose braces are open
        int coming = -2;       // a joint whose opening brace was not read yet
        while (lines_.next()) {
            const std::string_view line = lines_.line(), word = first_word(line);
            const int current = open.empty() ? -1 : open.back();
            const bool root = is_word(word, "ROOT"), end = is_word(word, "End");
            if (is_word(word, "MOTION")) {
                if (!open.empty() || coming >= 0)
                    lines_.fail("is reached while a brace of the hierarchy is open, expected '}'");
                if (joints_.empty()) lines_.fail("is reached before a ROOT");
                return;
            }
            if (coming >= 0 && word != "{") lines_.fail("is '" + shortened(line) + "', expected '{'");
            if (root || end || is_word(word, "JOINT")) {
                if (root && current >= 0) lines_.fail("is a ROOT inside of another joint");
                if (root && !joints_.empty())
                    lines_.fail("is a second ROOT, expected one skeleton in a file; '" + shortened(rig_.names[0]) +
                                "' is the first");
                if (!root && current < 0) lines_.fail("is '" + shortened(line) + "' outside of a joint's braces");
                if (joints_.size() == most)
                    lines_.fail("is joint " + std::to_string(most + 1) + ", more than are read");
                if (open.size() == deepest) lines_.fail("is nested deeper than " + std::to_string(deepest) + " levels");
                add_joint(end ? rig_.names[static_cast<std::size_t>(current)] + "_end" : name_of(line, word), current);
                coming = static_cast<int>(joints_.size()) - 1;
                if (line.ends_with("{")) open.push_back(std::exchange(coming, -2));
            } else if (word == "{") {
                if (coming < 0) lines_.fail("is a '{' without a joint");
                open.push_back(std::exchange(coming, -2));
            } else if (word == "}") {
                if (current < 0) lines_.fail("is a '}' without a '{'");
                open.pop_back();
            } else if (is_word(word, "OFFSET")) {
                if (current < 0) lines_.fail("is an OFFSET outside of a joint");
                const auto numbers = lines_.numbers(line.substr(word.size()), 3);
                joints_[static_cast<std::size_t>(current)].offset = {numbers[0], numbers[1], numbers[2]};
            } else if (is_word(word, "CHANNELS")) {
                if (current < 0) lines_.fail("are CHANNELS outside of a joint");
                read_channels(line, joints_[static_cast<std::size_t>(current)]);
            } else {
                lines_.fail("is '" + shortened(line) +
                            "', expected JOINT, End Site, OFFSET, CHANNELS, braces or MOTION");
            }
        }
        lines_.fail_at_end("expected MOTION after the hierarchy");
    }

    void read_channels(std::string_view line, Joint& joint) {
        static constexpr std::array<std::string_view, 6> names = {"Xposition", "Yposition", "Zposition",
                                                                  "Xrotation", "Yrotation", "Zrotation"};
        const std::vector<std::string_view> words = words_in(line);
        if (!joint.channels.empty()) lines_.fail("are CHANNELS of a joint that has some already");
        for (std::size_t w = 2; w < words.size(); ++w) {
            int found = -1;
            for (int c = 0; c < 6; ++c)
                if (is_word(words[w], names[static_cast<std::size_t>(c)])) found = c;
            if (found < 0)
                lines_.fail("has the channel '" + shortened(words[w]) + "', expected Xposition to Zrotation");
            for (const int other : joint.channels)
                if (other == found) lines_.fail("has the channel '" + shortened(words[w]) + "' twice");
            joint.channels.push_back(found);
        }
        if (words.size() < 2 || words[1] != std::to_string(joint.channels.size()))
            lines_.fail("has " + std::to_string(joint.channels.size()) + " channels, but states " +
                        (words.size() < 2 ? "no number" : "'" + shortened(words[1]) + "'"));
        channel_count_ += joint.channels.size();
    }

    void read_motion() {
        if (!lines_.next() || !is_word(first_word(lines_.line()).substr(0, 7), "Frames:"))
            lines_.fail("is not 'Frames: NUMBER'");
        const double stated = lines_.numbers(lines_.line().substr(7), 1)[0];
        if (!(stated >= 0) || stated != std::floor(stated))
            lines_.fail("states " + number_text(stated) + " frames, expected a whole number");
        step_ = read_frame_time();
        if (channel_count_ == 0) lines_.fail("is a motion of joints without any channels");

        const std::size_t found = lines_.count_rest();
        if (static_cast<double>(found) < stated)
            throw IoError(lines_.name() + ": 'Frames:' states " + number_text(stated) + " frames, but " +
                          std::to_string(found) + " lines follow, expected one for each frame; is the file truncated?");
        if (found == 0) throw IoError(lines_.name() + ": holds no frames: no line follows 'Frame Time:'");
        if (static_cast<double>(found) > stated)
            warn("'Frames:' states " + number_text(stated) + " frames, but " + std::to_string(found) +
                 " lines follow; all of them are read");
        const std::size_t J = joints_.size();
        check_rig_size(lines_.name(), J, found);
        check_claimed_poses(lines_.name(), J, found, text_.size());
        rig_.joints.reserve(found * J);
        rig_.rotations.reserve(found * J);
        while (lines_.next()) {
            add_frame(lines_.numbers(lines_.line(), channel_count_, ", one for each channel"));
            ++frame_count_;
        }
        rest_pose();
    }

    /// Seconds from frame to frame; 0 where the file states none.
    double read_frame_time() {
        std::string_view line;
        if (lines_.next()) line = lines_.line();
        const std::size_t colon = std::min(line.find(':'), line.size());
        const std::vector<std::string_view> words = words_in(line.substr(0, colon));
        if (colon == line.size() || words.size() != 2 || !is_word(words[0], "Frame") || !is_word(words[1], "Time"))
            lines_.fail("is not 'Frame Time: SECONDS'");
        const double step = lines_.numbers(line.substr(colon + 1), 1)[0];
        if (step < 0) lines_.fail("states a frame time of " + number_text(step) + " s, expected more than 0");
        return step;
    }

    void warn(const std::string& text) {
        if (warnings_) warnings_->push_back(lines_.name() + ": " + text);
    }

    void rest_pose() {
        rig_.rest_rotations.assign(joints_.size(), mat3<double>(1.0));
        for (std::size_t j = 0; j < joints_.size(); ++j) {
            const Joint& joint = joints_[j];
            const auto parent = static_cast<std::size_t>(std::max(rig_.parents[j], 0));
            const bool by_positions = rig_.parents[j] >= 0 && joint.moves() && joint.offset == vec3<double>(0);
            rig_.rest_joints.push_back(
                (by_positions ? joint.positions * (1.0 / static_cast<double>(frame_count_)) : joint.offset) +
                (rig_.parents[j] < 0 ? vec3<double>(0) : rig_.rest_joints[parent]));
        }
    }

    void add_frame(const std::vector<double>& numbers) {
        const std::size_t first = rig_.joints.size();
        std::size_t n = 0;
        for (std::size_t j = 0; j < joints_.size(); ++j) {
            vec3<double> place = joints_[j].offset;
            mat3<double> local(1.0);
            for (const int channel : joints_[j].channels) {
                const double number = numbers[n++];
                if (channel < 3)
                    place[channel] = number;
                else
                    local = local * axis_rotation(channel - 3, number * (std::numbers::pi / 180));
            }
            joints_[j].positions += place;
            if (rig_.parents[j] >= 0) {
                const std::size_t p = first + static_cast<std::size_t>(rig_.parents[j]);
                place = rig_.joints[p] + rig_.rotations[p] * place;
                local = rig_.rotations[p] * local;
            }
            rig_.joints.push_back(place);
            rig_.rotations.push_back(local);
        }
    }
};

} // namespace detail

inline RigMotion load_bvh(const InputFile& input, const JointMap& map, std::vector<std::string>* warnings,
                          const FrameRates& rates) {
    detail::BvhReader reader(input, warnings);
    RigMotion rig = reader.read(rates);
    const MatchedJoints matched = map.match(rig, input.name());
    LengthUnit unit = guess_length_unit(rig, matched);
    RigUp up = find_up(rig, matched);
    const auto warn = [&](const std::string& text) {
        if (warnings) warnings->push_back(input.name() + ": " + text);
    };
    if (reader.is_own() && unit.metres != 1) { // with legs of 0.3 to 3, another program wrote it, in metres
        unit.metres = 0.01;
        up = {}; // also where a person lies, or stands on the hands, so that another axis seems to point up
    } else if (unit.leg > 0) {
        warn(detail::unit_warning(unit));
    }
    if (const std::string text = detail::up_warning(up); !text.empty()) warn(text);
    move_rig(rig, turn_to_y(up.axis), unit.metres);
    validate(rig, input.name());
    turn_limbs_to_joints(rig, matched);
    return rig;
}

} // namespace gsh
