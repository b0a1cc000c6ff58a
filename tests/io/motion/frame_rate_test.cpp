// SPDX-License-Identifier: Apache-2.0
/// @file  Times of frames: of the file, of the caller, or 30 a second with a warning, in all layouts of motions.
#include "io/small_body.hpp"
#include "io/temporary.hpp"
#include "support/contains.hpp"

#include <doctest/doctest.h>

#include <gsh/core/error.hpp>
#include <gsh/io/file/npz_writer.hpp>
#include <gsh/io/motion/any_motion.hpp>
#include <gsh/io/motion/frame_rate.hpp>

#include <cstdint>
#include <limits>
#include <map>
#include <string>
#include <vector>

using namespace gsh;

namespace {

struct Times {
    std::vector<double> seconds;
    std::vector<std::string> warnings;

    [[nodiscard]] std::string only_warning() const { return warnings.size() == 1 ? warnings[0] : ""; }
};
Times times_of(std::size_t frames, const StatedTime& stated, const FrameRates& rates = {}) {
    Times times;
    times.seconds = frame_times(frames, stated, rates, "a.npz", &times.warnings);
    return times;
}

constexpr std::size_t frames = 3;

/// A motion of still poses without times, in the layouts of archives.
struct Array {
    Shape shape;
    std::vector<double> data;
};
using StoredArrays = std::map<std::string, Array>;
StoredArrays split_arrays() {
    const auto rows = [](std::size_t width) { return Array{{frames, width}, std::vector<double>(frames * width)}; };
    StoredArrays arrays{{"global_orient", rows(3)}, {"body_pose", rows(63)}, {"transl", rows(3)}};
    for (const char* key : {"jaw_pose", "leye_pose", "reye_pose"}) arrays[key] = rows(3);
    for (const char* key : {"left_hand_pose", "right_hand_pose"}) arrays[key] = rows(45);
    arrays["betas"] = {{3}, {0, 0, 0}};
    return arrays;
}
StoredArrays amass_arrays() {
    return {{"poses", {{frames, 165}, std::vector<double>(frames * 165)}},
            {"trans", {{frames, 3}, std::vector<double>(frames * 3)}},
            {"betas", {{3}, {0, 0, 0}}}};
}

} // namespace

TEST_CASE("a rate is the caller's, else the file's, else the capture's, else 30 with a warning") {
    const StatedTime nothing, rate{{}, 120, "a.npz: fps", {}}, stamps{{5, 5.5, 6.5}, 0, "a.npz: timestamps", {}};
    const Times assumed = times_of(3, nothing);
    CHECK(assumed.seconds == std::vector<double>{0, 1 / 30.0, 2 / 30.0});
    CHECK(assumed.only_warning().starts_with("a.npz: states no frame rate, 30"));
    CHECK(assumed.only_warning() == test::contains("--input-fps"));
    CHECK(times_of(1, nothing).warnings.empty()); // a single frame has no rate

    const Times of_capture = times_of(2, nothing, {0, 25});
    CHECK(of_capture.seconds[1] == doctest::Approx(0.04));
    CHECK(of_capture.warnings.empty());
    const Times of_file = times_of(2, rate, {0, 25});
    CHECK(of_file.seconds[1] == doctest::Approx(1 / 120.0));
    CHECK(of_file.warnings.empty());
    CHECK(times_of(3, stamps, {0, 25}).seconds == stamps.timestamps);

    const Times of_caller = times_of(2, rate, {50, 25});
    CHECK(of_caller.seconds[1] == doctest::Approx(0.02));
    CHECK(of_caller.only_warning() == test::contains("fps: 120 frames per second, but --input-fps states 50"));
    CHECK(times_of(2, rate, {120, 0}).warnings.empty());
    CHECK(times_of(3, stamps, {30, 0}).seconds[2] == doctest::Approx(2 / 30.0));
    CHECK(times_of(3, stamps, {30, 0}).warnings.size() == 1);

    const StatedTime numbered{{}, 0, "", {4, 5, 9}}; // of files 4.json, 5.json, 9.json
    CHECK(times_of(3, numbered, {10, 0}).seconds == std::vector<double>{0.4, 0.5, 0.9});
}

TEST_CASE(
    "times that do not ascend, other units and rates that are none are refused, unless the caller states the rate") {
    const auto refuse = [](const StatedTime& stated, std::initializer_list<std::string_view> words) {
        test::check_throws<ValueError>([&] { (void)times_of(3, stated); }, words);
        CHECK(times_of(3, stated, {60, 0}).seconds[2] == doctest::Approx(2 / 60.0));
    };
    const auto stamps = [](std::vector<double> seconds) {
        return StatedTime{std::move(seconds), 0, "a.npz: timestamps", {}};
    };
    refuse(stamps({0, 2, 1}), {"a.npz: timestamps: go back at frame 2, from 2 to 1", "--input-fps"});
    refuse(stamps({0, 1, 1}), {"stand still at frame 2"});
    refuse(stamps({0, 33.3, 66.7}), {"are 33.4 apart", "expected seconds", "milliseconds"});
    refuse(stamps({0, std::numeric_limits<double>::quiet_NaN(), 1}), {"[1] is", "finite"});
    for (const double rate : {0.0, -30.0, std::numeric_limits<double>::quiet_NaN()})
        refuse({{}, rate, "a.npz: fps", {}}, {"a.npz: fps: is", "expected frames per second above 0"});
    refuse({{}, 1 / 30.0, "a.npz: fps", {}}, {"0.0333333", "seconds of a frame"});
    refuse({{}, 1e6, "a.npz: fps", {}}, {"1e+06", "at most 100000"});
    // 0, 1, 2, …: numbers of frames, probably
    std::vector<double> numbers;
    for (int n = 0; n < 12; ++n) numbers.push_back(n);
    CHECK(times_of(12, stamps(numbers)).only_warning() == test::contains("numbers of frames"));
    numbers[3] = 3.25;
    CHECK(times_of(12, stamps(numbers)).warnings.empty());
}

TEST_CASE("every key for the rate is read, in gsh's layout, AMASS', PeopleSnapshot's and SMPLify-X'") {
    const test::Temporary folder;
    const BodyModel body = test::small_body(55, 3, 2);
    StoredArrays fits = split_arrays(), snapshot = {{"thetas", {{frames, 72}, std::vector<double>(frames * 72)}},
                                              {"transl", {{frames, 3}, std::vector<double>(frames * 3)}},
                                              {"betas", {{3}, {0, 0, 0}}}};
    fits["camera_translation"] = {{frames, 3}, std::vector<double>(frames * 3)};
    for (const StoredArrays& layout : {split_arrays(), amass_arrays(), fits, snapshot}) {
        const auto load = [&](const std::string& key, double value, std::vector<std::string>& warnings,
                              double input = 0) {
            StoredArrays arrays = layout;
            if (!key.empty()) arrays[key] = {{}, {value}};
            NpzWriter file(folder / "a.npz");
            for (const auto& [name, array] : arrays) file.add(name, array.data, array.shape);
            file.add("flat_hand", std::uint8_t(1));
            file.commit();
            MotionFileOptions options;
            options.input_fps = input;
            return load_any_motion(folder / "a.npz", body, options, &warnings).timestamps[2];
        };
        const auto rate_warnings = [](const std::vector<std::string>& warnings) {
            std::size_t count = 0;
            for (const auto& warning : warnings) count += warning.find("frames per second") != std::string::npos;
            return count;
        };
        for (const std::string key : frame_rate_keys) {
            CAPTURE(key);
            std::vector<std::string> warnings;
            CHECK(load(key, 50, warnings) == doctest::Approx(2 / 50.0));
            CHECK(rate_warnings(warnings) == 0);
        }
        std::vector<std::string> warnings;
        CHECK(load("mocap_time_length", 0.1, warnings) == doctest::Approx(2 / 30.0)); // 3 frames in 0.1 s
        CHECK(rate_warnings(warnings) == 0);
        CHECK(load("", 0, warnings) == doctest::Approx(2 / 30.0));
        CHECK(rate_warnings(warnings) == 1);
        warnings.clear();
        CHECK(load("", 0, warnings, 12.5) == doctest::Approx(2 / 12.5));
        CHECK(rate_warnings(warnings) == 0);
        CHECK(load("framerate", 120, warnings, 12.5) == doctest::Approx(2 / 12.5));
        CHECK(rate_warnings(warnings) == 1);
    }
}
