// SPDX-License-Identifier: Apache-2.0
/// @file  Reads motions in BVH files, the text format of motion capture: a tree of joints, then a line per frame.
#pragma once

#include <gsh/body/joint_map.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/body/rig_pose.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/text_lines.hpp>
#include <gsh/io/motion/frame_rate.hpp>
#include <gsh/io/motion/unit_guess.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <array>
#include <cstddef>
#include <filesystem>
#include <numbers>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// Reads the one skeleton of a file and its motion. The rest pose is that of zero angles. A joint with position
/// channels takes its position in the parent's frame from them, in place of its OFFSET. An End Site becomes a joint
/// NAME_end. Of joints with the same name, the second is NAME#2.
///
/// Frame   y up. Where the body stands along z in the rest pose and in the frames, the world is turned.
/// Units   the file does not state its unit; it is guessed from the length of the legs. A frame time of 0 is none: 30
///         frames a second, with a warning.
/// Errors  IoError, ValueError naming file and line: a channel that is not known, numbers that do not fit the channels,
///         a count of frames that is not that of the lines, NaN, more than 256 levels. What was guessed is added to
///         `warnings`.
[[nodiscard]] inline RigMotion load_bvh(const std::filesystem::path& path, const JointMap& map = {},
                                        std::vector<std::string>* warnings = nullptr, const FrameRates& rates = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

class BvhReader {
public:
    explicit BvhReader(const std::filesystem::path& path) : text_(read_file(path)), lines_(text_, path.string()) {}

    RigMotion read(const FrameRates& rates, std::vector<std::string>* warnings) {
        read_hierarchy();
        read_motion();
        if (!(rates.input > 0) && step_ * detail::slowest_frame_rate >= 1)
            throw IoError(lines_.name() + ": 'Frame Time:' states " + number_text(step_) +
                          " s, expected the seconds from one frame to the next; correct it, or state the rate "
                          "(--input-fps)");
        StatedTime stated;
        if (step_ != 0) stated.rate = 1 / step_, stated.name = lines_.name() + ": 1 / 'Frame Time:'";
        rig_.timestamps = frame_times(frame_count_, stated, rates, lines_.name(), warnings);
        if (!(rates.input > 0) && step_ != 0) // without the rounding of 1 / step
            for (std::size_t t = 0; t < frame_count_; ++t) rig_.timestamps[t] = static_cast<double>(t) * step_;
        return std::move(rig_);
    }

private:
    struct Joint {
        vec3<double> offset{0.0};
        std::vector<int> channels; ///< 0 to 2: position x, y, z; 3 to 5: rotation about x, y, z
    };
    std::string text_;
    TextLines lines_;
    RigMotion rig_;
    std::vector<Joint> joints_;
    std::set<std::string> seen_;
    std::size_t channel_count_ = 0, frame_count_ = 0;
    double step_ = 0; // seconds from frame to frame; 0 where the file states no time

    void add_joint(const std::string& name, int parent) {
        if (name.empty()) lines_.fail("is a joint without a name");
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
        if (!lines_.next() || !is_word(first_word(lines_.line()), "HIERARCHY"))
            lines_.fail("is not the beginning of a BVH file, expected HIERARCHY");
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
                    lines_.fail("is a second ROOT, expected one skeleton in a file; '" + rig_.names[0] +
                                "' is the first");
                if (!root && current < 0) lines_.fail("is '" + shortened(line) + "' outside of a joint's braces");
                if (joints_.size() == most)
                    lines_.fail("is joint " + std::to_string(most + 1) + ", more than are read");
                if (open.size() == deepest) lines_.fail("is nested deeper than " + std::to_string(deepest) + " levels");
                add_joint(end ? unused_name(rig_.names[static_cast<std::size_t>(current)] + "_end")
                              : name_of(line, word),
                          current);
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

    [[nodiscard]] std::string unused_name(std::string name) const {
        while (seen_.contains(name)) name += "_end";
        return name;
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
                if (other == found) lines_.fail("has the channel '" + std::string(words[w]) + "' twice");
            joint.channels.push_back(found);
        }
        if (words.size() < 2 || words[1] != std::to_string(joint.channels.size()))
            lines_.fail("has " + std::to_string(joint.channels.size()) + " channels, but states " +
                        (words.size() < 2 ? "no number" : "'" + shortened(words[1]) + "'"));
        channel_count_ += joint.channels.size();
    }

    void read_motion() {
        if (!lines_.next() || !is_word(first_word(lines_.line()), "Frames:")) lines_.fail("is not 'Frames: NUMBER'");
        const double stated = lines_.numbers(lines_.line().substr(7), 1)[0];
        if (!(stated >= 1)) lines_.fail("states " + number_text(stated) + " frames, expected at least one");
        if (!lines_.next() || !is_word(first_word(lines_.line()), "Frame") ||
            !is_word(first_word(trimmed(lines_.line().substr(5))), "Time:"))
            lines_.fail("is not 'Frame Time: SECONDS'");
        step_ = lines_.numbers(trimmed(lines_.line().substr(5)).substr(5), 1)[0];
        if (step_ < 0) lines_.fail("states a frame time of " + number_text(step_) + " s, expected more than 0");
        if (channel_count_ == 0) lines_.fail("is a motion of joints without any channels");

        if (const std::size_t found = lines_.count_rest(); static_cast<double>(found) != stated)
            throw IoError(lines_.name() + ": 'Frames:' states " + number_text(stated) + " frames, but " +
                          std::to_string(found) + " lines follow, expected one for each frame");
        const auto frames = static_cast<std::size_t>(stated);
        const std::size_t J = joints_.size();
        check_rig_size(lines_.name(), J, frames);
        rest_pose();
        rig_.joints.reserve(frames * J);
        rig_.rotations.reserve(frames * J);
        while (lines_.next()) {
            add_frame(lines_.numbers(lines_.line(), channel_count_, ", one for each channel"));
            ++frame_count_;
        }
    }

    void rest_pose() {
        rig_.rest_rotations.assign(joints_.size(), mat3<double>(1.0));
        for (std::size_t j = 0; j < joints_.size(); ++j)
            rig_.rest_joints.push_back(
                joints_[j].offset +
                (rig_.parents[j] < 0 ? vec3<double>(0) : rig_.rest_joints[static_cast<std::size_t>(rig_.parents[j])]));
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

inline RigMotion load_bvh(const std::filesystem::path& path, const JointMap& map, std::vector<std::string>* warnings,
                          const FrameRates& rates) {
    RigMotion rig = detail::BvhReader(path).read(rates, warnings);
    const MatchedJoints matched = map.match(rig, path.string());
    const LengthUnit unit = guess_length_unit(rig, matched);
    const bool z_up = has_z_up(rig, matched);
    const auto warn = [&](const std::string& text) {
        if (warnings) warnings->push_back(path.string() + ": " + text);
    };
    if (unit.leg > 0) warn(detail::unit_warning(unit));
    if (z_up) warn("the body stands along z, so the world is turned to y up");
    move_rig(rig,
             z_up ? mat3<double>(vec3<double>(1, 0, 0), vec3<double>(0, 0, -1), vec3<double>(0, 1, 0))
                  : mat3<double>(1.0),
             unit.metres);
    validate(rig, path.string());
    return rig;
}

} // namespace gsh
