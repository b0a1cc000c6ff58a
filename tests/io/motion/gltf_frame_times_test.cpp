// SPDX-License-Identifier: Apache-2.0
/// @file  Frames of glTF animations: curves between sparse keys are kept, keys stay frames.

#include "io/gltf_files.hpp"
#include "io/temporary.hpp"
#include "support/sample_rig.hpp"

#include <doctest/doctest.h>

#include <gsh/io/motion/gltf_motion.hpp>

#include <array>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

using namespace gsh;

namespace {

/// Left elbow's turn about z: 1.2 rad, once a second.
double angle_at(double t) {
    return 1.2 * std::sin(6.283185307179586 * t);
}
double speed_at(double t) {
    return 1.2 * 6.283185307179586 * std::cos(6.283185307179586 * t);
}

/// The cubic of glTF 2.0, appendix C, for one number.
double hermite(double a, double out, double in, double b, double u, double span) {
    return (2 * u * u * u - 3 * u * u + 1) * a + span * (u * u * u - 2 * u * u + u) * out +
           (3 * u * u - 2 * u * u * u) * b + span * (u * u * u - u * u) * in;
}

struct Clip {
    std::vector<double> keys;
    std::string kind; ///< LINEAR, STEP or CUBICSPLINE

    /// The turn that the file describes; `quats` halves it, so that their lengths are not 1.
    [[nodiscard]] double expected(double t) const {
        std::size_t k = 0;
        while (k + 1 < keys.size() && keys[k + 1] <= t) ++k;
        const double a = keys[k];
        if (k + 1 == keys.size() || kind == "STEP") return angle_at(a);
        const double b = keys[k + 1], u = (t - a) / (b - a);
        if (kind == "LINEAR") return angle_at(a) + u * (angle_at(b) - angle_at(a)); // less than half a turn apart
        const auto z = [](double at) { return std::sin(angle_at(at) / 2); };
        const auto w = [](double at) { return std::cos(angle_at(at) / 2); };
        const auto dz = [&](double at) { return w(at) * speed_at(at) / 2; };
        const auto dw = [&](double at) { return -z(at) * speed_at(at) / 2; };
        return 2 * std::atan2(hermite(z(a), dz(a), dz(b), z(b), u, b - a), hermite(w(a), dw(a), dw(b), w(b), u, b - a));
    }

    [[nodiscard]] RigMotion read(std::vector<std::string>* warnings = nullptr) const {
        const test::Temporary folder;
        auto files = test::gltf_of(test::sample_rig({.frames = 1}));
        std::size_t node = 0;
        while (files.json["nodes"][node]["name"] != "mixamorig:LeftForeArm") ++node;
        std::vector<double> values;
        for (const double t : keys) {
            const double z = std::sin(angle_at(t) / 2), w = std::cos(angle_at(t) / 2), half = speed_at(t) / 2;
            if (kind == "CUBICSPLINE") values.insert(values.end(), {0, 0, w * half, -z * half});
            const double size = kind == "LINEAR" ? 0.5 : 1; // readers must not rely on unit length
            values.insert(values.end(), {0, 0, z * size, w * size});
            if (kind == "CUBICSPLINE") values.insert(values.end(), {0, 0, w * half, -z * half});
        }
        const int input = files.add(keys, "SCALAR", 1), output = files.add(values, "VEC4", 4);
        files.json["animations"] = test::Json::array(
            {{{"samplers", test::Json::array({{{"input", input}, {"output", output}, {"interpolation", kind}}})},
              {"channels",
               test::Json::array({{{"sampler", 0}, {"target", {{"node", node}, {"path", "rotation"}}}}})}}});
        write_file(folder / "a.glb", files.glb());
        return load_gltf_motion(folder / "a.glb", {}, warnings);
    }
};

/// The largest difference, in degrees, between the file's curve and frames that are joined by turns about fixed axes.
double largest_error(const Clip& clip, const RigMotion& rig) {
    std::size_t joint = 0;
    while (rig.names[joint] != "mixamorig:LeftForeArm") ++joint;
    const auto turn = [&](std::size_t t) { // about z
        const mat3<double>& R = rig.rotation(t, static_cast<int>(joint));
        return std::atan2(R[0].y, R[0].x);
    };
    double largest = 0;
    for (int i = 0; i <= 1000; ++i) {
        const double time = clip.keys.front() + (rig.timestamps.back() - clip.keys.front()) * i / 1000.0;
        std::size_t b = 1;
        while (b + 1 < rig.frame_count() && rig.timestamps[b] < time) ++b;
        const double u = (time - rig.timestamps[b - 1]) / (rig.timestamps[b] - rig.timestamps[b - 1]);
        largest = std::max(largest, std::abs(turn(b - 1) + u * (turn(b) - turn(b - 1)) - clip.expected(time)));
    }
    return largest * 57.295779513;
}

std::vector<double> even_keys(double rate, double seconds = 1) {
    std::vector<double> keys;
    for (int k = 0; k <= std::lround(rate * seconds); ++k) keys.push_back(k / rate);
    return keys;
}

/// Rates at which keys are frames: the time of each is that of a frame.
void check_keys_are_frames(const Clip& clip, const RigMotion& rig) {
    for (const double key : clip.keys) {
        double nearest = 1e9;
        for (const double time : rig.timestamps) nearest = std::min(nearest, std::abs(time - key));
        CHECK(nearest < 1e-5);
    }
}

} // namespace

TEST_CASE("splines with sparse keys keep their curve between frames") {
    for (const double rate : {5.0, 7.0, 8.0, 10.0, 12.0, 15.0, 20.0}) {
        const Clip clip{even_keys(rate), "CUBICSPLINE"};
        const RigMotion rig = clip.read();
        CHECK(largest_error(clip, rig) < 0.26);
        check_keys_are_frames(clip, rig);
        CHECK(rig.frame_count() <= 121);
    }
    // Dense keys of a curve that hardly bends between them stay the frames.
    const Clip dense{even_keys(60), "CUBICSPLINE"};
    CHECK(dense.read().frame_count() == 61);
    CHECK(largest_error(dense, dense.read()) < 0.26);
    const Clip thirty{even_keys(30), "CUBICSPLINE"}; // bends by 0.37 degrees between frames
    CHECK(thirty.read().frame_count() == 61);
    const Clip uneven{{0, 0.13, 0.31, 0.42, 0.71, 1}, "CUBICSPLINE"};
    CHECK(largest_error(uneven, uneven.read()) < 0.26);
}

TEST_CASE("straight lines between keys: 10 keys a second or more are the frames, sparser ones are among them") {
    struct Case {
        double keys, frames;
    };
    for (const auto& [keys, frames] :
         {Case{1, 30}, {7, 35}, {8, 24}, {10, 10}, {12, 12}, {15, 15}, {25, 25}, {90, 90}}) {
        const Clip clip{even_keys(keys), "LINEAR"};
        std::vector<std::string> warnings;
        const RigMotion rig = clip.read(&warnings);
        CHECK(rig.frame_count() == static_cast<std::size_t>(frames) + 1);
        CHECK(largest_error(clip, rig) < 0.01);
        check_keys_are_frames(clip, rig);
        CHECK(warnings.empty());
    }
    // Keys that a program has thinned out, on frames of 1/25 s
    const Clip thinned{{0, 0.04, 0.2, 0.32, 0.36, 0.72, 1}, "LINEAR"};
    CHECK(thinned.read().frame_count() == 26);
    CHECK(largest_error(thinned, thinned.read()) < 0.01);
    // Keys at any time: corners are met as well as 120 frames a second can.
    const Clip any{{0, 0.123, 0.377, 0.5051, 0.7119, 1}, "LINEAR"};
    CHECK(any.read().frame_count() == 121);
    CHECK(largest_error(any, any.read()) < 1.2); // degrees, of a corner where the speed changes by 9 rad/s
}

TEST_CASE("steps begin at the frame of their key") {
    for (const double rate : {6.0, 12.0}) {
        const Clip clip{even_keys(rate), "STEP"};
        const RigMotion rig = clip.read();
        CHECK(rig.frame_count() == (rate == 6 ? 31u : 13u));
        std::size_t joint = 0;
        while (rig.names[joint] != "mixamorig:LeftForeArm") ++joint;
        for (std::size_t t = 0; t < rig.frame_count(); ++t) {
            const mat3<double>& R = rig.rotation(t, static_cast<int>(joint));
            CHECK(std::abs(std::atan2(R[0].y, R[0].x) - clip.expected(rig.timestamps[t] + 1e-6)) < 1e-5);
        }
    }
}

TEST_CASE("channels with keys of their own: all of them are frames") {
    const test::Temporary folder;
    auto files = test::gltf_of(test::sample_rig({.frames = 4}), {.step = 0.1}); // 0.5 to 0.8 s
    auto& animation = files.json["animations"][0];
    const int input = files.add({0.5, 0.6333333333, 0.8}, "SCALAR", 1);
    animation["samplers"][1]["input"] = input; // the hips' place
    animation["samplers"][1]["output"] = files.add({0, 1, 0, 0, 2, 0, 0, 1, 0}, "VEC3", 3);
    write_file(folder / "a.glb", files.glb());
    const RigMotion rig = load_gltf_motion(folder / "a.glb");
    REQUIRE(rig.frame_count() == 10); // 30 a second
    CHECK(rig.timestamps[4] == doctest::Approx(0.6333333));
    CHECK(rig.joint(4, 0).y == doctest::Approx(2));
    CHECK(rig.joint(2, 0).y == doctest::Approx(1.5));
}
