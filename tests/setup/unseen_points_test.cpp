// SPDX-License-Identifier: Apache-2.0
#include <gsh/cpu.hpp>
#include <gsh/setup/unseen_points.hpp>

#include "support/guarded.hpp"
#include "support/small_training.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

using namespace gsh;
using test::SmallScene;
using test::SmallTraining;

namespace {

const PixelFilter filter = TrainParams{}.filter;
const UnseenParams small{.pixels = 48};

} // namespace

TEST_CASE("Gaussians that face the cameras are shown, those behind are not; a second photograph adds its own") {
    const SmallScene scene; // both cameras stand in front, at z > 0
    SmallTraining<cpu::Serial> training(
        scene, cpu::Serial(), 3,
        {.appearance = {.sh_rate = test::small_sh_rate}, .model = {.initial_opacity = 0.95, .quat_rate = 0}});
    training.steps(1);
    const std::vector<Photo>& photos = scene.photos;
    const auto all = photographs_showing(training.backend, training.people, {&training.samples}, photos, filter, small);
    REQUIRE(all.size() == training.model.size());
    double front = 0, fronts = 0, back = 0, backs = 0, turned_away = 0, turned_to = 0;
    for (std::size_t i = 0; i < all.size(); ++i) {
        CHECK(all[i].front >= 0);
        CHECK(all[i].all >= all[i].front);
        const double facing = training.samples.normals[i].z;
        if (facing > 0.8) front += all[i].all, ++fronts, turned_away += all[i].all != all[i].front;
        if (facing < -0.8) back += all[i].all, ++backs, turned_to += all[i].front > 0;
    }
    REQUIRE((fronts > 5 && backs > 5));
    MESSAGE("shown by " << front / fronts << " of 4 photographs in front, by " << back / backs << " behind");
    CHECK(front / fronts > 0.4); // neighbours overlap, and each hides parts of the others
    CHECK(back / backs < 0.05 * front / fronts);
    CHECK(turned_away == 0); // joints turn by up to 0.7 radians
    CHECK(turned_to == 0);

    const auto some =
        photographs_showing(training.backend, training.people, {&training.samples}, {photos[0]}, filter, small);
    double sum_all = 0, sum_some = 0;
    for (std::size_t i = 0; i < all.size(); ++i) sum_all += all[i].all, sum_some += some[i].all;
    CHECK(sum_some < 0.4 * sum_all);

    // One of two equal photographs stands for both.
    const std::vector<Photo> twice{photos[0], photos[0]};
    UnseenParams one_of_two = small;
    one_of_two.most_photographs = 1;
    const auto of_both =
        photographs_showing(training.backend, training.people, {&training.samples}, twice, filter, small);
    const auto of_one =
        photographs_showing(training.backend, training.people, {&training.samples}, twice, filter, one_of_two);
    for (std::size_t i = 0; i < all.size(); ++i) {
        CHECK(of_one[i].all == doctest::Approx(of_both[i].all));
        CHECK(of_one[i].front == doctest::Approx(2 * some[i].front));
    }
    const auto refused = [&](const std::vector<const SurfaceSamples*>& samples, const std::vector<Photo>& of) {
        (void)photographs_showing(training.backend, training.people, samples, of, filter);
    };
    CHECK_THROWS_AS(refused({&training.samples}, {}), ValueError);
    CHECK_THROWS_AS(refused({}, photos), ShapeError);
    SurfaceSamples fewer = training.samples;
    fewer.positions.pop_back();
    CHECK_THROWS_AS(refused({&fewer}, photos), ShapeError);
}

TEST_CASE("the numbers are equal on every backend") {
    const SmallScene scene;
    const auto showing = [&](auto make) {
        using B = decltype(make());
        SmallTraining<B> training(scene, make, 3, test::quick_avatar());
        training.steps(2);
        return photographs_showing(training.backend, training.people, {&training.samples}, scene.photos, filter, small);
    };
    const auto serial = showing([] { return cpu::Serial(); });
    const auto equal = [&](const std::vector<Showing>& other) {
        return std::equal(serial.begin(), serial.end(), other.begin(), other.end(),
                          [](const Showing& a, const Showing& b) { return a.all == b.all && a.front == b.front; });
    };
    CHECK(equal(showing([] { return cpu::Threads(2); })));
    CHECK(equal(showing([] { return test::Guarded(); })));
}

TEST_CASE("unseen is what hardly any photograph shows, and what is shown from behind as long as it makes up little") {
    const std::vector<Showing> showing{{0.09, 0.09}, {0.11, 0.11}, {0.5, 0.09}, {0.3, 0}, {0.2, 0}, {98, 40}};
    const auto with = [&](double most) {
        return unseen_points(Span<const Showing>(showing), {.most_behind = most});
    };
    CHECK(with(0) == std::vector<std::uint8_t>{1, 0, 0, 0, 0, 0});
    CHECK(with(0.004) == std::vector<std::uint8_t>{1, 0, 0, 0, 1, 0}); // 0.29 of 99.2
    CHECK(with(0.009) == std::vector<std::uint8_t>{1, 0, 0, 1, 1, 0}); // 0.59
    CHECK(with(0.02) == std::vector<std::uint8_t>{1, 0, 1, 1, 1, 0});  // 1.09
    CHECK(unseen_points(Span<const Showing>()).empty());
}

TEST_CASE("what no photograph saw gets colours and opacity from what was seen; the rest stays") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> training(
        scene, cpu::Serial(), 3,
        {.appearance = {.sh_rate = test::small_sh_rate}, .model = {.initial_opacity = 0.95, .quat_rate = 0}});
    training.steps(10);
    const std::vector<std::size_t> frames{0, 1};
    const auto showing =
        photographs_showing(training.backend, training.people, {&training.samples}, scene.photos, filter, small);
    const GaussianCloud<float> before = mean_gaussians(training.people, frames);
    const PointFill<float> fill =
        fill_of_unseen(training.people, training.samples, Span<const Showing>(showing), frames);
    const std::size_t basis = before.sh.size() / before.size();
    REQUIRE(fill.points.size() > 20);
    CHECK(fill.points.size() < before.size() * 2 / 3); // all behind, and some in front that others hide
    const std::vector<std::uint8_t> unseen = unseen_points(Span<const Showing>(showing));
    vec3<float> low(1e9f), high(-1e9f);
    for (std::size_t i = 0; i < before.size(); ++i)
        if (!unseen[i])
            for (int c = 0; c < 3; ++c) {
                low[c] = std::min(low[c], before.sh[i * basis][c]);
                high[c] = std::max(high[c], before.sh[i * basis][c]);
            }
    for (std::size_t k = 0; k < fill.points.size(); ++k) {
        const std::size_t i = fill.points[k];
        CHECK(unseen[i]);
        CHECK(fill.opacity_logits[k] >= before.opacity_logits[i]);
        for (int c = 0; c < 3; ++c) {
            CHECK(fill.colors[k][c] >= low[c] - 1e-4f);
            CHECK(fill.colors[k][c] <= high[c] + 1e-4f);
        }
    }
    training.model.fill(fill);
    const GaussianCloud<float> after = mean_gaussians(training.people, frames);
    std::size_t changed = 0;
    for (std::size_t i = 0; i < after.size(); ++i) changed += after.sh[i * basis] != before.sh[i * basis];
    CHECK(changed > 0);
    CHECK(changed <= fill.points.size());

    const std::vector<Showing> seen(before.size(), {1, 1}), short_one(3, {1, 1});
    CHECK(fill_of_unseen(training.people, training.samples, Span<const Showing>(seen), frames).points.empty());
    CHECK_THROWS_AS(
        (void)fill_of_unseen(training.people, training.samples, Span<const Showing>(short_one), frames), ShapeError);
}
