// SPDX-License-Identifier: Apache-2.0
#include <gsh/gaussian/cloud_edits.hpp>

#include "support/gradient.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

using namespace gsh;

namespace {

GaussianCloud<double> cloud_to_edit(std::size_t count, int degree, std::uint64_t seed = 1) {
    test::Rng rng(seed);
    GaussianCloud<double> cloud(count, degree);
    cloud.means = rng.vecs(count);
    cloud.log_scales = rng.vecs(count, -4, -2);
    for (auto& q : cloud.quats) q = rng.quat();
    cloud.opacity_logits = rng.numbers(count, -3, 3);
    cloud.sh = rng.vecs(cloud.sh.size());
    return cloud;
}

} // namespace

TEST_CASE("reordering moves all attributes of a Gaussian together") {
    const auto cloud = cloud_to_edit(5, 1);
    const std::vector<std::uint32_t> order{4, 0, 4};
    const auto moved = reordered<double>(cloud, order);
    REQUIRE(moved.size() == 3);
    for (std::size_t i = 0; i < 3; ++i) {
        CHECK(moved.means[i] == cloud.means[order[i]]);
        CHECK(moved.quats[i].y == cloud.quats[order[i]].y);
        CHECK(moved.log_scales[i] == cloud.log_scales[order[i]]);
        CHECK(moved.opacity_logits[i] == cloud.opacity_logits[order[i]]);
        for (std::size_t k = 0; k < 4; ++k) CHECK(moved.sh[4 * i + k] == cloud.sh[4 * order[i] + k]);
    }
    CHECK(reordered<double>(cloud, Span<const std::uint32_t>()).size() == 0);
    const std::vector<std::uint32_t> beyond{5};
    CHECK_THROWS_AS((void)reordered<double>(cloud, beyond), ValueError);
}

TEST_CASE("the most important Gaussians are the large opaque ones, kept in order") {
    auto cloud = cloud_to_edit(200, 0);
    const auto order = importance_order(cloud);
    for (std::size_t i = 1; i < order.size(); ++i)
        CHECK(importance(cloud, order[i - 1]) >= importance(cloud, order[i]));
    const auto kept = largest_gaussians(cloud, 20);
    REQUIRE(kept.size() == 20);
    CHECK(std::is_sorted(kept.begin(), kept.end()));
    double least = 1e9, most_of_others = 0;
    for (std::uint32_t i = 0; i < 200; ++i) {
        const bool in = std::binary_search(kept.begin(), kept.end(), i);
        (in ? least : most_of_others) =
            in ? std::min(least, importance(cloud, i)) : std::max(most_of_others, importance(cloud, i));
    }
    CHECK(least >= most_of_others);
    CHECK(largest_gaussians(cloud, 1000).size() == 200);
}

TEST_CASE("Morton order is a permutation whose neighbours are near") {
    const auto cloud = cloud_to_edit(3000, 0);
    const auto order = morton_order(cloud);
    std::vector<std::uint32_t> sorted = order;
    std::sort(sorted.begin(), sorted.end());
    for (std::uint32_t i = 0; i < 3000; ++i) CHECK(sorted[i] == i);
    const auto way = [&](const auto& index) {
        double sum = 0;
        for (std::size_t i = 1; i < 3000; ++i) sum += length(cloud.means[index(i)] - cloud.means[index(i - 1)]);
        return sum;
    };
    CHECK(way([&](std::size_t i) { return order[i]; }) < 0.2 * way([](std::size_t i) { return i; }));
    auto point = cloud_to_edit(3, 0); // no extent
    point.means.assign(3, vec3<double>(1));
    CHECK(morton_order(point) == std::vector<std::uint32_t>{0, 1, 2});
    CHECK(morton_order(cloud_to_edit(0, 0)).empty());
}

TEST_CASE("a few outliers do not make the order of the others coarse, and come last") {
    const auto cloud = cloud_to_edit(3000, 0);
    auto wide = cloud;
    wide.means[5] = {5e7, 0, 0}, wide.means[700] = {0, -8e6, 1e6}, wide.means[2999] = {0, 0, 7e8};
    auto order = morton_order(wide);
    REQUIRE(order.size() == 3000);
    std::vector<std::uint32_t> last(order.end() - 3, order.end());
    std::sort(last.begin(), last.end());
    CHECK(last == std::vector<std::uint32_t>{5, 700, 2999});
    const auto way = [&](const std::vector<std::uint32_t>& indices) {
        double sum = 0;
        for (std::size_t i = 1; i < 2997; ++i) sum += length(wide.means[indices[i]] - wide.means[indices[i - 1]]);
        return sum;
    };
    std::vector<std::uint32_t> without = morton_order(cloud);
    std::erase_if(without, [](std::uint32_t i) { return i == 5 || i == 700 || i == 2999; });
    CHECK(way(order) < 1.05 * way(without));
}

TEST_CASE("fewer bands are the first ones") {
    const auto cloud = cloud_to_edit(4, 3), cut = with_bands_up_to(cloud, 1);
    CHECK(cut.sh_degree == 1);
    REQUIRE(cut.sh.size() == 16);
    for (std::size_t i = 0; i < 4; ++i)
        for (std::size_t k = 0; k < 4; ++k) CHECK(cut.sh[4 * i + k] == cloud.sh[16 * i + k]);
    CHECK(with_bands_up_to(cloud, 4).sh == cloud.sh);
}
