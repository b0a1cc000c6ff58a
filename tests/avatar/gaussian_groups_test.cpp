// SPDX-License-Identifier: Apache-2.0
/// @file  Groups of Gaussians: their number and order, who is grouped with whom, and the same on any number of threads.
#include <gsh/avatar/gaussian_groups.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>

#include "support/gradient.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

using namespace gsh;

namespace {

/// A wavy sheet of flat Gaussians of different sizes and colours.
GaussianCloud<float> sheet(std::size_t count, std::uint64_t seed = 3) {
    GaussianCloud<float> cloud(count, 1);
    test::Rng rng(seed);
    for (std::size_t i = 0; i < count; ++i) {
        const double x = rng.uniform(0, 0.4), y = rng.uniform(0, 0.4);
        cloud.means[i] = vec3<float>(vec3<double>(x, y, 0.01 * std::sin(20 * x)));
        cloud.log_scales[i] = vec3<float>(vec3<double>(rng.uniform(-6, -5), rng.uniform(-6, -5), -8));
        cloud.opacity_logits[i] = static_cast<float>(rng.uniform(-2, 3));
        cloud.sh[4 * i] = sh_of_color(vec3<float>(rng.vec(0.2, 0.8)));
    }
    return cloud;
}

/// Four equal discs in a row at the given places, of the given greys.
GaussianCloud<float> row_of_four(const std::vector<double>& places, const std::vector<float>& greys) {
    GaussianCloud<float> cloud(4, 0);
    for (std::size_t i = 0; i < 4; ++i) {
        cloud.means[i] = vec3<float>(static_cast<float>(places[i]), 0, 0);
        cloud.log_scales[i] = {-5, -5, -8};
        cloud.sh[i] = sh_of_color(vec3<float>(greys[i]));
    }
    return cloud;
}

} // namespace

TEST_CASE("there are as many groups as requested, each with the mixture of its members") {
    cpu::Serial serial;
    const GaussianCloud<float> cloud = sheet(700);
    for (const std::size_t count : {std::size_t(699), std::size_t(350), std::size_t(13), std::size_t(1)}) {
        const GaussianGroups groups = gaussian_groups(serial, cloud, count);
        REQUIRE(groups.size() == count);
        REQUIRE(groups.group.size() == cloud.size());
        std::vector<double> masses(count);
        std::vector<vec3<double>> sums(count, vec3<double>(0));
        std::uint32_t first_ones = 0;
        for (std::size_t i = 0; i < cloud.size(); ++i) {
            const std::uint32_t g = groups.group[i];
            REQUIRE(g <= first_ones); // in the order of their first members
            first_ones += g == first_ones;
            masses[g] += groups.masses[i], sums[g] += vec3<double>(cloud.means[i]) * groups.masses[i];
        }
        CHECK(first_ones == count);
        for (std::size_t g = 0; g < count; ++g) {
            CHECK(groups.group[groups.leads[g]] == g);
            CHECK(groups.mixtures[g].mass == doctest::Approx(masses[g]));
            CHECK(length(groups.mixtures[g].mean - sums[g] * (1 / masses[g])) < 1e-9);
        }
        const auto [starts, members] = groups.members();
        REQUIRE(starts.size() == count + 1);
        for (std::size_t g = 0; g < count; ++g)
            for (std::size_t m = starts[g]; m < starts[g + 1]; ++m) {
                CHECK(groups.group[members[m]] == g);
                if (m > starts[g]) CHECK(members[m] > members[m - 1]);
            }
    }
}

TEST_CASE("a cloud with no more Gaussians has a group for each of them") {
    cpu::Serial serial;
    const GaussianCloud<float> cloud = sheet(20);
    for (const std::size_t count : {std::size_t(20), std::size_t(500)}) {
        const GaussianGroups groups = gaussian_groups(serial, cloud, count);
        REQUIRE(groups.size() == 20);
        for (std::uint32_t i = 0; i < 20; ++i) CHECK((groups.group[i] == i && groups.leads[i] == i));
    }
    CHECK(gaussian_groups(serial, GaussianCloud<float>(0, 1), 5).size() == 0);
}

TEST_CASE("groups are the same on any number of threads") {
    cpu::Serial serial;
    const GaussianCloud<float> cloud = sheet(5000);
    const GaussianGroups expected = gaussian_groups(serial, cloud, 1700);
    for (const std::size_t threads : {1, 2, 3, 7}) {
        cpu::Threads backend(threads);
        const GaussianGroups found = gaussian_groups(backend, cloud, 1700);
        CHECK(found.group == expected.group);
        CHECK(found.leads == expected.leads);
        for (std::size_t g = 0; g < found.size(); ++g)
            CHECK(found.mixtures[g].coverage == expected.mixtures[g].coverage);
    }
}

TEST_CASE("near ones merge before far ones, alike ones before others, and what a caller keeps apart last") {
    cpu::Serial serial;
    using Groups = std::vector<std::uint32_t>;
    CHECK(gaussian_groups(serial, row_of_four({0, 0.010, 0.012, 0.022}, {0.5f, 0.5f, 0.5f, 0.5f}), 3).group ==
          Groups{0, 1, 1, 2});
    CHECK(gaussian_groups(serial, row_of_four({0, 0.010, 0.012, 0.022}, {0.2f, 0.2f, 0.9f, 0.9f}), 2).group ==
          Groups{0, 0, 1, 1});
    const auto middle_apart = [](std::uint32_t a, std::uint32_t b) { return (a < 2) == (b < 2) ? 0.0 : 1.0; };
    CHECK(gaussian_groups(serial, row_of_four({0, 0.010, 0.012, 0.022}, {0.5f, 0.5f, 0.5f, 0.5f}), 2, {}, middle_apart)
              .group == Groups{0, 0, 1, 1});
    // Beside a disc is nearer than above it.
    GaussianCloud<float> cloud = row_of_four({0, 0.004, 0.3, 0.6}, {0.5f, 0.5f, 0.5f, 0.5f});
    cloud.means[2] = {0, 0, 0.002f};
    CHECK(gaussian_groups(serial, cloud, 3).group == Groups{0, 0, 1, 2});
}

TEST_CASE("Gaussians in one place and groups far from each other merge, too") {
    cpu::Serial serial;
    GaussianCloud<float> cloud = sheet(60);
    for (std::size_t i = 0; i < 30; ++i) cloud.means[i] = cloud.means[0];
    for (std::size_t i = 30; i < 60; ++i) cloud.means[i].x += 100.0f;
    CHECK(gaussian_groups(serial, cloud, 2, {.neighbours = 1}).size() == 2);
    CHECK(gaussian_groups(serial, cloud, 1, {.neighbours = 3}).size() == 1);
}

TEST_CASE("wrong arguments are refused") {
    cpu::Serial serial;
    GaussianCloud<float> cloud = sheet(5);
    CHECK_THROWS_WITH_AS((void)gaussian_groups(serial, cloud, 0), "gaussian_groups: count is 0, expected at least 1",
                         ValueError);
    CHECK_THROWS_AS((void)gaussian_groups(serial, cloud, 2, {.neighbours = 0}), ValueError);
    CHECK_THROWS_AS((void)gaussian_groups(serial, cloud, 2, {.share = 0}), ValueError);
    CHECK_THROWS_AS((void)gaussian_groups(serial, cloud, 2, {.length = 0}), ValueError);
    CHECK_THROWS_AS((void)gaussian_groups(serial, cloud, 2, {.thickness = -1}), ValueError);
    const auto refused = [&](const auto& change) {
        GaussianCloud<float> wrong = cloud;
        change(wrong);
        CHECK_THROWS_WITH_AS((void)gaussian_groups(serial, wrong, 2),
                             "gaussian_groups: Gaussian 3 has a number that is not finite, or no direction",
                             ValueError);
    };
    constexpr float none = std::numeric_limits<float>::quiet_NaN();
    refused([](GaussianCloud<float>& wrong) { wrong.means[3].y = none; });
    refused([](GaussianCloud<float>& wrong) { wrong.log_scales[3].x = none; });
    refused([](GaussianCloud<float>& wrong) { wrong.opacity_logits[3] = none; });
    refused([](GaussianCloud<float>& wrong) { wrong.sh[4 * 3].x = none; });
    refused([](GaussianCloud<float>& wrong) { wrong.quats[3] = {0, 0, 0, 0}; });
    cloud.opacity_logits.pop_back();
    CHECK_THROWS_AS((void)gaussian_groups(serial, cloud, 2), ShapeError);
}
