// SPDX-License-Identifier: Apache-2.0
/// @file  When the frames of a motion are: what its file states, what the caller states, or 30 a second with a warning.
#pragma once

#include <gsh/body/resampled_motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/file/npy.hpp>
#include <gsh/io/file/text_lines.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// Frames a second of a motion whose file states none. Video and most estimators have this rate.
inline constexpr double assumed_frame_rate = 30;

/// The names under which programs store frames a second: AMASS (two spellings), SOMA and BEAT, others.
inline constexpr std::array frame_rate_keys = {"mocap_framerate", "mocap_frame_rate", "frame_rate", "framerate", "fps"};

/// Frames a second that a caller states; 0: none.
struct FrameRates {
    double input = 0;     ///< of the input, whatever its file states: --input-fps
    double otherwise = 0; ///< of an input that states none, such as that of a capture's cameras
};

/// What a motion's file states about time.
struct StatedTime {
    std::vector<double> timestamps = {}; ///< seconds, one per frame; empty: none
    double rate = 0;                     ///< frames a second; unused if there are timestamps
    std::string name = {};               ///< what states them, for messages: "walk.npz: fps"; empty: nothing does
    std::vector<double> numbers = {};    ///< of the frames, for files NUMBER.json; empty: 0, 1, 2, …
};

/// The times of T frames in seconds: by rates.input, else the file's timestamps, else the file's rate, else
/// rates.otherwise, else 30 a second with a warning. `where` is the file.
///
/// Errors  ValueError naming the key: timestamps that do not ascend, or are 5 s apart and more (milliseconds?); a rate
///         that is not from 0.2 to 100,000 frames a second. With rates.input, the file's times are not needed and not
///         checked; where they differ, that is added to `warnings`.
[[nodiscard]] inline std::vector<double> frame_times(std::size_t frames, const StatedTime& stated,
                                                     const FrameRates& rates, const std::string& where,
                                                     std::vector<std::string>* warnings);

/// What an NpzReader or a MotionTable of T frames states: timestamps [T], a rate, or AMASS' mocap_time_length.
template <class Source>
[[nodiscard]] StatedTime stated_time(const Source& file, std::size_t frames);

/// Copies the members that stated_time reads to a table, under their names.
template <class File, class Table>
void copy_stated_time(const File& file, Table& table);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// The key of a table with the numbers of files NUMBER.json; the blank keeps it apart from members of archives.
inline constexpr const char* frame_numbers_key = "frame numbers";
inline constexpr const char* mocap_length_key = "mocap_time_length";

inline constexpr double slowest_frame_rate = 0.2, fastest_frame_rate = 1e5;

inline void check_timestamps(const std::vector<double>& timestamps, const std::string& name) {
    check_finite<double>(name, "seconds", timestamps);
    for (std::size_t t = 1; t < timestamps.size(); ++t)
        check_value(timestamps[t] > timestamps[t - 1], name,
                    std::string(timestamps[t] < timestamps[t - 1] ? "go back" : "stand still") + " at frame " +
                        std::to_string(t) + ", from " + number_text(timestamps[t - 1]) + " to " +
                        number_text(timestamps[t]) + "; expected seconds that ascend, or a rate (--input-fps)");
    const double interval = typical_interval(timestamps);
    check_value(interval * slowest_frame_rate < 1, name,
                "are " + number_text(interval) +
                    " apart, expected seconds; convert milliseconds, or state the rate (--input-fps)");
}

inline void check_frame_rate(double rate, const std::string& name) {
    check_value(rate >= slowest_frame_rate && rate <= fastest_frame_rate, name,
                "is " + number_text(rate) + ", expected frames per second above 0" +
                    (rate > fastest_frame_rate               ? " and at most " + number_text(fastest_frame_rate)
                     : rate > 0 && rate < slowest_frame_rate ? "; it looks like the seconds of a frame"
                                                             : ""));
}

} // namespace detail

inline std::vector<double> frame_times(std::size_t frames, const StatedTime& stated, const FrameRates& rates,
                                       const std::string& where, std::vector<std::string>* warnings) {
    const auto warn = [&](const std::string& text) {
        if (warnings && frames > 1) warnings->push_back(text); // a single frame has no rate
    };
    double rate = rates.input;
    if (rate > 0) {
        const double interval = typical_interval(stated.timestamps);
        const double found = stated.timestamps.empty() ? stated.rate : 1 / interval; // inf for times that stand still
        if (!stated.name.empty() && !(std::abs(found - rate) <= 0.005 * rate))
            warn(stated.name + ": " + detail::number_text(found) + " frames per second, but --input-fps states " +
                 detail::number_text(rate) + ", which are taken");
    } else if (!stated.timestamps.empty()) {
        detail::check_timestamps(stated.timestamps, stated.name);
        const std::size_t last = stated.timestamps.size() - 1;
        const auto whole = [&](double time) { return time == std::floor(time); };
        if (last >= 9 && stated.timestamps[last] - stated.timestamps[0] == static_cast<double>(last) &&
            std::all_of(stated.timestamps.begin(), stated.timestamps.end(), whole))
            warn(stated.name + " are 0, 1, 2, …, which is one frame per second; if they are numbers of frames, state "
                               "the rate (--input-fps)");
        return stated.timestamps;
    } else if (!stated.name.empty()) {
        detail::check_frame_rate(stated.rate, stated.name);
        rate = stated.rate;
    } else if (rates.otherwise > 0) {
        rate = rates.otherwise;
    } else {
        rate = assumed_frame_rate;
        warn(where + ": states no frame rate, " + detail::number_text(rate) +
             " frames per second are taken; state another by --input-fps, or by fps in a capture's cameras.json");
    }
    std::vector<double> times;
    for (std::size_t t = 0; t < frames; ++t)
        times.push_back((stated.numbers.empty() ? static_cast<double>(t) : stated.numbers[t]) / rate);
    return times;
}

template <class Source>
StatedTime stated_time(const Source& file, std::size_t frames) {
    StatedTime stated;
    if (file.has_array(detail::frame_numbers_key))
        stated.numbers = file.template read<double>(detail::frame_numbers_key).data;
    if (file.has_array("timestamps")) {
        stated.name = file.name_of("timestamps");
        stated.timestamps =
            file.template read<double>("timestamps", {static_cast<std::int64_t>(frames)}, Numbers::any).data;
        return stated;
    }
    for (const char* key : frame_rate_keys)
        if (file.has_array(key)) {
            stated.name = file.name_of(key);
            stated.rate = file.template read_number<double>(key, Numbers::any);
            return stated;
        }
    if (file.has_array(detail::mocap_length_key)) {
        stated.name = file.name_of(detail::mocap_length_key);
        const double seconds = file.template read_number<double>(detail::mocap_length_key, Numbers::any);
        check_value(seconds > 0, stated.name, "is " + detail::number_text(seconds) + " s, expected more than 0");
        stated.rate = static_cast<double>(frames) / seconds;
    }
    return stated;
}

template <class File, class Table>
void copy_stated_time(const File& file, Table& table) {
    const auto copy = [&](const char* key) {
        if (file.has_array(key)) table.add(key, key, file.template read<double>(key, Numbers::any));
    };
    for (const char* key : frame_rate_keys) copy(key);
    for (const char* key : {"timestamps", detail::mocap_length_key}) copy(key);
}

} // namespace gsh
