// SPDX-License-Identifier: Apache-2.0
#include <gsh/cpu.hpp>
#include <gsh/train/unseen_points.hpp>

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

const PixelFilter filter = TrainConfig{}.filter;

} // namespace

TEST_CASE("Gaussians that face the cameras are shown, those behind are not; a second photograph adds its own") {
    const SmallScene scene; // both cameras stand in front, at z > 0
    SmallTraining<cpu::Serial> training(scene, cpu::Serial(), 3,
                                        {.initial_opacity = 0.95, .rates = test::small_rates});
    training.steps(1);
    const std::vector<Photo>& photos = scene.photos;
    const auto all = photographs_showing(training.backend, training.people, photos, filter, 48);
    REQUIRE(all.size() == training.model.size());
    double front = 0, fronts = 0, back = 0, backs = 0;
    for (std::size_t i = 0; i < all.size(); ++i) {
        CHECK(all[i] >= 0);
        const double facing = training.samples.normals[i].z;
        if (facing > 0.8) front += all[i], ++fronts;
        if (facing < -0.8) back += all[i], ++backs;
    }
    REQUIRE((fronts > 5 && backs > 5));
    MESSAGE("shown by " << front / fronts << " of 4 photographs in front, by " << back / backs << " behind");
    CHECK(front / fronts > 0.4); // neighbours overlap, and each hides parts of the others
    CHECK(back / backs < 0.05 * front / fronts);

    const auto some = photographs_showing(training.backend, training.people, {photos[0]}, filter, 48);
    double sum_all = 0, sum_some = 0;
    for (std::size_t i = 0; i < all.size(); ++i) sum_all += all[i], sum_some += some[i];
    CHECK(sum_some < 0.4 * sum_all);
    CHECK_THROWS_AS((void)photographs_showing(training.backend, training.people, {}, filter), ValueError);
}

TEST_CASE("the numbers are equal on every backend") {
    const SmallScene scene;
    const auto showing = [&](auto make) {
        using B = decltype(make());
        SmallTraining<B> training(scene, make, 3, {.rates = test::small_rates});
        training.steps(2);
        return photographs_showing(training.backend, training.people, scene.photos, filter, 48);
    };
    const auto serial = showing([] { return cpu::Serial(); });
    CHECK(showing([] { return cpu::Threads(2); }) == serial);
    CHECK(showing([] { return test::Guarded(); }) == serial);
}

TEST_CASE("what no photograph saw gets colours and opacity from what was seen; the rest stays") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> training(scene, cpu::Serial(), 3,
                                        {.initial_opacity = 0.95, .rates = test::small_rates});
    training.steps(10);
    const std::vector<std::size_t> frames{0, 1};
    const auto showing = photographs_showing(training.backend, training.people, scene.photos, filter, 48);
    const GaussianCloud<float> before = mean_gaussians(training.people, frames);
    const PointFill<float> fill =
        fill_of_unseen(training.people, training.samples, Span<const double>(showing), frames);
    const std::size_t basis = before.sh.size() / before.size();
    REQUIRE(fill.points.size() > 20);
    CHECK(fill.points.size() < before.size() * 2 / 3); // all behind, and some in front that others hide
    vec3<float> low(1e9f), high(-1e9f);
    for (std::size_t i = 0; i < before.size(); ++i)
        if (showing[i] >= UnseenParams{}.least_photographs)
            for (int c = 0; c < 3; ++c) {
                low[c] = std::min(low[c], before.sh[i * basis][c]);
                high[c] = std::max(high[c], before.sh[i * basis][c]);
            }
    for (std::size_t k = 0; k < fill.points.size(); ++k) {
        const std::size_t i = fill.points[k];
        CHECK(showing[i] < UnseenParams{}.least_photographs);
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

    const std::vector<double> seen(before.size(), 1.0), short_one(3, 1.0);
    CHECK(fill_of_unseen(training.people, training.samples, Span<const double>(seen), frames).points.empty());
    CHECK_THROWS_AS(
        (void)fill_of_unseen(training.people, training.samples, Span<const double>(short_one), frames), ShapeError);
}
