// SPDX-License-Identifier: Apache-2.0
#include <gsh/fit/absent_people.hpp>

#include <doctest/doctest.h>

#include <cstddef>
#include <vector>

using namespace gsh;

TEST_CASE("a person is out of view in long spans without a sight, and missed in short ones") {
    std::vector<double> times;
    std::vector<bool> seen(60, true);
    for (std::size_t t = 0; t < 60; ++t) times.push_back(0.1 * static_cast<double>(t));
    CHECK(absent_frames(seen, times).empty());
    for (const std::size_t t : {0, 1, 10, 11, 12, 13, 58, 59}) seen[t] = false; // 0.2, 0.5 and 0.2 seconds
    CHECK(absent_frames(seen, times).empty());
    for (std::size_t t = 20; t < 31; ++t) seen[t] = false; // 1.2 seconds from sight to sight
    for (const std::size_t t : {55, 56, 57}) seen[t] = false;
    std::vector<std::size_t> expected;
    for (std::size_t t = 20; t < 31; ++t) expected.push_back(t);
    for (std::size_t t = 55; t < 60; ++t) expected.push_back(t);
    CHECK(absent_frames(seen, times) == expected);
    CHECK(absent_frames(std::vector<bool>(60, false), times).size() == 60);
}

TEST_CASE("the place out of view is seen by no camera, also by one that looks down") {
    const auto camera = [](const vec3<double>& eye, const vec3<double>& target, const vec3<double>& up) {
        return look_at<double>(eye, target, up, 0.8, 100, 100);
    };
    std::vector<Camera<double>> cameras{camera({0, 1, 3}, {0, 1, 0}, {0, 1, 0})};
    CHECK(place_out_of_view(cameras) == vec3<double>(0, -100, 0));
    cameras.push_back(camera({0, 4, 0}, {0, 0, 0}, {0, 0, 1}));
    const vec3<double> place = place_out_of_view(cameras);
    CHECK(place == vec3<double>(0, 100, 0)); // behind it
    cameras.push_back(camera({0, 1, 0}, {0, 5, 0}, {0, 0, 1}));
    CHECK(place_out_of_view(cameras) == vec3<double>(0, 0, 100)); // behind the first
}
