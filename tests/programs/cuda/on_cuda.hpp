// SPDX-License-Identifier: Apache-2.0
/// @file  Runs the programs on both backends and compares what they write.
#pragma once

#include "programs/process.hpp"
#include "programs/small_capture.hpp"
#include "support/skip.hpp"

#include <gsh/io/file/npy.hpp>
#include <gsh/io/image/image_file.hpp>

#include <doctest/doctest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <filesystem>
#include <initializer_list>
#include <string>
#include <vector>

namespace gsh::test {

using Words = std::vector<std::string>;

inline Words operator+(Words words, const Words& more) {
    words.insert(words.end(), more.begin(), more.end());
    return words;
}
inline const Words on_cuda{"--backend", "cuda"};

/// Settings that make tables small, and all parts learn from the first step on.
inline const Words small_settings{"--set", "hash.table_size=512", "--set", "ao.table_size=512", "--set",
                                  "light.points=2", "--set", "light.directions=4", "--set", "sh_start=0",
                                  "--set", "ao.start=0"};

/// The words of a reconstruction of the small capture, or another one with the same body. Unless `more` says
/// otherwise, it has 4 steps and 150 Gaussians.
inline Words reconstruction(const std::filesystem::path& out, const Words& more,
                            const std::filesystem::path& capture = {}) {
    const SmallCapture& s = studio();
    Words words{"gsh-reconstruct", "--capture", (capture.empty() ? s.path : capture).string(), "--body",
                s.body_file.string(), "--out", out.string(), "--threads", "2"};
    const auto has = [&](const char* option) { return std::find(more.begin(), more.end(), option) != more.end(); };
    if (!has("--steps") && !has("--seconds")) words = words + Words{"--steps", "4"};
    if (!has("--gaussians")) words = words + Words{"--gaussians", "150"};
    return words + small_settings + more;
}

/// The small capture with a background for each camera, of rows that become brighter.
inline Capture before_plates() {
    Capture filmed = studio().capture;
    for (std::size_t c = 0; c < filmed.cameras.size(); ++c) {
        PixelImage& plate = filmed.backgrounds.emplace_back(4, 64, 64);
        for (std::size_t i = 0; i < plate.data.size(); ++i)
            plate.data[i] = static_cast<std::uint8_t>(i % 4 == 3 ? 255 : 40 + 60 * c + i / 256);
    }
    return filmed;
}

/// PSNR of a picture of bytes, over the columns before `width` (0: all).
inline double decibels(const PixelImage& found, const PixelImage& expected, int width = 0) {
    REQUIRE(found.width == expected.width);
    REQUIRE(found.height == expected.height);
    if (width == 0) width = expected.width;
    double sum = 0;
    for (int y = 0; y < expected.height; ++y)
        for (int x = 0; x < width; ++x)
            for (int c = 0; c < 3; ++c) {
                const double d = (found.pixel(y, x)[c] - expected.pixel(y, x)[c]) / 255.0;
                sum += d * d;
            }
    return -10 * std::log10(sum / (3.0 * width * expected.height) + 1e-20);
}
/// PSNR of a picture of floats.
inline double decibels_of_npy(const std::filesystem::path& found, const std::filesystem::path& expected) {
    const NpyArray<float> a = read_npy<float>(found), b = read_npy<float>(expected);
    REQUIRE(a.shape == b.shape);
    double sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i) {
        const double d = static_cast<double>(a[i]) - static_cast<double>(b[i]);
        sum += d * d;
    }
    return -10 * std::log10(sum / static_cast<double>(a.size()) + 1e-20);
}

/// A result of --backend cuda says so.
inline void check_says_cuda(const nlohmann::json& json, const char* precision = "fp32") {
    CHECK(json.at("backend") == "cuda");
    CHECK(json.at("device").get<std::string>().size() > 3);
    CHECK(json.at("precision") == precision);
}

/// The results of a reconstruction on cuda are those of one on threads, within the roundings of a few steps: figures,
/// and renders of test views.
inline void check_near(const std::filesystem::path& cuda, const std::filesystem::path& threads) {
    const nlohmann::json found = json_of(cuda / "metrics.json"), expected = json_of(threads / "metrics.json");
    check_says_cuda(found);
    CHECK(expected.at("backend") == "threads");
    CHECK(!expected.contains("device"));
    CHECK(found.at("steps") == expected.at("steps"));
    CHECK(found.at("gaussians") == expected.at("gaussians"));
    CHECK(found.at("settings") == expected.at("settings"));
    CHECK(found.at("protocol") == expected.at("protocol"));
    CHECK(found.at("psnr").get<double>() == doctest::Approx(expected.at("psnr").get<double>()).epsilon(2e-3));
    CHECK(found.at("ssim").get<double>() == doctest::Approx(expected.at("ssim").get<double>()).epsilon(2e-3));
    REQUIRE(!expected.at("images").empty());
    REQUIRE(found.at("images").size() == expected.at("images").size());
    for (const auto& image : expected.at("images")) {
        const std::string file = "test/" + image.at("name").get<std::string>() + ".png";
        const PixelImage a = read_image(cuda / file), b = read_image(threads / file);
        CAPTURE(file);
        CHECK(decibels(a, b, b.width / 3) >= 60);
    }
    CHECK(files_below(cuda) == files_below(threads));
}

/// Runs a reconstruction on both backends, in the folders cuda and threads of `folder`, and compares the results.
inline void check_reconstruction(const std::filesystem::path& folder, const Words& more,
                                 const std::filesystem::path& capture = {}) {
    const auto cuda = folder / "cuda", threads = folder / "threads";
    check_done(run(reconstruction(cuda, more + on_cuda, capture)));
    check_done(run(reconstruction(threads, more, capture)));
    check_near(cuda, threads);
}

/// An environment variable, which describes the emulated GPU of the programs to come (support/emulated_machine.cpp).
class Described {
public:
    Described(const char* name, const std::string& value) : name_(name) { setenv(name, value.c_str(), 1); }
    Described(const Described&) = delete;
    ~Described() { unsetenv(name_); }

private:
    const char* name_;
};

} // namespace gsh::test
