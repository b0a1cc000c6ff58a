// SPDX-License-Identifier: Apache-2.0
/// @file  Requests as gsh-view's page sends them, and what tests read from the answers.
#pragma once

#include "io/temporary.hpp"

#include "view/view_request.hpp"

#include <gsh/camera/pinhole.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/image/image_file.hpp>

#include <doctest/doctest.h>
#include <nlohmann/json.hpp>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

namespace gsh::test {

using programs::PersonSize;
using ViewJson = nlohmann::json;

/// A request for a picture of some people, as the page sends it.
inline ViewJson request_for(const std::vector<PersonSize>& people, int size = 64) {
    const auto camera = look_at<double>({0, 0.2, 3.5}, {0, 0, 0}, {0, 1, 0}, 0.55, size, size);
    ViewJson json{{"camera",
                   {{"size", {size, size}},
                    {"focal", {camera.fx, camera.fy}},
                    {"centre", {camera.cx, camera.cy}},
                    {"R", ViewJson::array()},
                    {"t", {camera.t.x, camera.t.y, camera.t.z}}}},
                  {"background", {0.1, 0.2, 0.3}},
                  {"show", "splats"},
                  {"shadows", true},
                  {"light_turn", 0},
                  {"format", "png"},
                  {"people", ViewJson::array()}};
    for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 3; ++column) json["camera"]["R"].push_back(camera.R[column][row]);
    for (const PersonSize& person : people)
        json["people"].push_back({{"pose", std::vector<double>(3 * person.joints, 0.05)},
                                  {"betas", std::vector<double>(person.betas, 0.2)},
                                  {"expression", std::vector<double>(person.expressions, 0.3)},
                                  {"transl", {0.1, 0, 0}}});
    return json;
}

/// The pixels of a picture that a server sent.
inline PixelImage decoded(const std::string& bytes) {
    const Temporary folder;
    write_file(folder / "picture", bytes, Sync::none);
    return read_image(folder / "picture");
}

/// Mean squared difference of the RGB of two pictures, of any number of channels.
inline double difference(const PixelImage& a, const PixelImage& b) {
    REQUIRE(a.width == b.width);
    REQUIRE(a.height == b.height);
    double sum = 0;
    for (int y = 0; y < a.height; ++y)
        for (int x = 0; x < a.width; ++x)
            for (int c = 0; c < 3; ++c) {
                const double d = (a.pixel(y, x)[c] - b.pixel(y, x)[c]) / 255.0;
                sum += d * d;
            }
    return sum / (3.0 * a.width * a.height);
}

/// The header of a package, and the place where its arrays begin.
inline std::pair<ViewJson, std::size_t> header_of(const std::string& package) {
    REQUIRE(package.starts_with("GSHVIEW1"));
    std::uint32_t length = 0;
    std::memcpy(&length, package.data() + 8, 4);
    return {ViewJson::parse(package.substr(12, length)), 12 + length};
}

} // namespace gsh::test
