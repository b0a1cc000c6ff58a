// SPDX-License-Identifier: Apache-2.0
#include "support/bodies.hpp"

#include <gsh/avatar/rig.hpp>
#include <gsh/body/thinned_samples.hpp>
#include <gsh/core/error.hpp>

#include <cmath>
#include <cstddef>
#include <numeric>
#include <vector>

using namespace gsh;

TEST_CASE("every third row of a table, the last one though it ends it") {
    std::vector<int> rows(2 * 7);
    std::iota(rows.begin(), rows.end(), 0);
    CHECK(thinned_rows(rows, 2, 3) == std::vector<int>{0, 1, 6, 7, 12, 13});
    CHECK(thinned_rows(rows, 2, 1) == rows);
    CHECK(thinned_rows(rows, 2, 100) == std::vector<int>{0, 1});
    CHECK(thinned_rows(std::vector<int>(), 0, 2).empty()); // a table without columns
    CHECK(thinned_count(7, 3) == 3);
    CHECK(thinned_count(6, 3) == 2);
    CHECK_THROWS_WITH_AS((void)thinned_rows(rows, 2, 0), doctest::Contains("stride is 0"), ValueError);
}

TEST_CASE("thinned samples are nested, cover the same area, and are the points of the thinned rig") {
    const BodyModel body = test::tube();
    const SurfaceSamples all = sample_surface(body, body.v_template, std::vector<double>(body.vertex_count(), 5), 3);
    const RigData rig = make_rig(body, {}, all);
    const SurfaceSamples half = thinned(all, 2), quarter = thinned(all, 4);
    REQUIRE(quarter.size() == thinned_count(all.size(), 4));
    for (std::size_t i = 0; i < quarter.size(); ++i) {
        CHECK(quarter.positions[i] == all.positions[4 * i]);
        CHECK(quarter.positions[i] == half.positions[2 * i]);
        CHECK(quarter.normals[i] == all.normals[4 * i]);
        CHECK(quarter.sources[i] == all.sources[4 * i]);
        CHECK(quarter.scales[i] == doctest::Approx(2 * all.scales[4 * i]));
    }
    const auto area = [](const SurfaceSamples& samples) { // of discs of one standard deviation
        return std::accumulate(samples.scales.begin(), samples.scales.end(), 0.0,
                               [](double sum, double scale) { return sum + scale * scale; });
    };
    CHECK(area(quarter) == doctest::Approx(area(all)).epsilon(0.05));

    const RigData part = thinned(rig, 4), made = make_rig(body, {}, quarter);
    CHECK(part.triangles == made.triangles);
    CHECK(part.barycentric == made.barycentric);
    CHECK(part.skin.joints == made.skin.joints);
    CHECK(part.skin.weights == made.skin.weights);
    CHECK(part.joints == made.joints);
    CHECK(part.point_count() == quarter.size());
}

TEST_CASE("thinned samples have the density of all: more where there are more") {
    const BodyModel body = test::tube();
    std::vector<double> K(body.vertex_count(), 4);
    for (std::size_t v = 0; v < K.size() / 2; ++v) K[v] = 16;
    const SurfaceSamples all = sample_surface(body, body.v_template, K, 5), part = thinned(all, 4);
    const auto dense = [&](const SurfaceSamples& samples) {
        double count = 0;
        for (const int source : samples.sources) count += K[static_cast<std::size_t>(source)] == 16;
        return count / static_cast<double>(samples.size());
    };
    CHECK(dense(all) == doctest::Approx(0.8).epsilon(0.05));
    CHECK(dense(part) == doctest::Approx(dense(all)).epsilon(0.05));
}
