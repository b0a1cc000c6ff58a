// SPDX-License-Identifier: Apache-2.0
#include "support/bodies.hpp"

#include <gsh/body/surface_samples.hpp>

#include <cstring>
#include <limits>

namespace gsh {
namespace {

TEST_CASE("counts: exact totals, exact expectations") {
    test::Rng rng(1);
    const auto expected = rng.numbers(50, 0, 3);
    double sum = 0;
    for (double e : expected) sum += e;
    std::vector<double> mean(50, 0);
    constexpr int starts = 1000;
    for (int s = 0; s < starts; ++s) {
        const double start = (s + 0.5) / starts;
        const auto counts = detail::diffuse_counts(expected, 0, start);
        std::size_t total = 0;
        for (std::size_t v = 0; v < 50; ++v) {
            CHECK(std::abs(static_cast<double>(counts[v]) - expected[v]) < 1);
            mean[v] += static_cast<double>(counts[v]) / starts;
            total += counts[v];
        }
        CHECK(std::abs(static_cast<double>(total) - sum) < 1);
        std::size_t exact = 0;
        for (const auto count : detail::diffuse_counts(expected, 777, start)) exact += count;
        CHECK(exact == 777);
    }
    for (std::size_t v = 0; v < 50; ++v) CHECK(mean[v] == doctest::Approx(expected[v]).epsilon(2e-3));
    std::size_t edge = 0;
    for (const auto count : detail::diffuse_counts(expected, 123457, std::nextafter(1.0, 0.0))) edge += count;
    CHECK(edge == 123457);
}

TEST_CASE("samples lie on the surface, nearest to their source, with unit weights") {
    const BodyModel model = test::tube();
    const std::vector<double> K(model.vertex_count(), 15);
    for (const auto kind : {SampleWeights::barycentric, SampleWeights::copied}) {
        const auto samples = sample_surface(model, model.v_template, K, 3, {.weights = kind});
        CHECK(samples.size() == 15 * model.vertex_count());
        CHECK(samples.weights.size() == samples.size());
        std::vector<std::size_t> per_vertex(model.vertex_count(), 0);
        for (std::size_t i = 0; i < samples.size(); ++i) {
            vec3<double> on_mesh(0);
            double nearest = 1e9;
            for (std::size_t t = 0; t < 3; ++t) {
                const auto& corner = model.v_template[static_cast<std::size_t>(samples.triangles[i][t])];
                on_mesh += corner * samples.barycentric[i][static_cast<int>(t)];
                nearest = std::min(nearest, length(corner - samples.positions[i]));
            }
            const auto source = static_cast<std::size_t>(samples.sources[i]);
            CHECK(length(on_mesh - samples.positions[i]) < 1e-14);
            CHECK(length(model.v_template[source] - samples.positions[i]) <= nearest + 1e-12);
            CHECK(length(samples.normals[i]) == doctest::Approx(1));
            CHECK(samples.scales[i] > 0);
            ++per_vertex[source];
            double sum = 0;
            for (std::size_t k = 0; k < samples.weights.influences; ++k) {
                const double w = samples.weights.weights[i * samples.weights.influences + k];
                const auto joint = samples.weights.joints[i * samples.weights.influences + k];
                sum += w;
                double expected = 0;
                if (kind == SampleWeights::copied) expected = model.weights[source * 4 + joint];
                else
                    for (std::size_t t = 0; t < 3; ++t)
                        expected += model.weights[static_cast<std::size_t>(samples.triangles[i][t]) * 4 + joint] *
                                    samples.barycentric[i][static_cast<int>(t)];
                if (w > 0) CHECK(w == doctest::Approx(expected));
            }
            CHECK(std::abs(sum - 1) < 1e-14);
        }
        for (const auto count : per_vertex) CHECK(count == 15);
    }
}

TEST_CASE("density is area-uniform within a vertex's part") {
    // A flat hexagonal fan: the part of the middle vertex is a hexagon about it, so samples average to the middle.
    BodyModel model;
    model.v_template.push_back(vec3<double>(0));
    for (int k = 0; k < 6; ++k) {
        const double angle = std::numbers::pi / 3 * k;
        model.v_template.push_back({std::cos(angle), std::sin(angle), 0});
        model.faces.push_back({0, 1 + k, 1 + (k + 1) % 6});
    }
    model.parents = {-1};
    model.weights.assign(7, 1);
    std::vector<double> K(7, 0);
    K[0] = 20000;
    const auto samples = sample_surface(model, model.v_template, K, 5);
    REQUIRE(samples.size() == 20000);
    vec3<double> mean(0);
    double second = 0;
    for (const auto& p : samples.positions) mean += p / 20000.0, second += dot(p, p) / 20000.0;
    CHECK(length(mean) < 5e-3);
    CHECK(second == doctest::Approx(5.0 / 36).epsilon(0.01)); // a regular hexagon of side s: 5 s²/12, here s² = 1/3
    // The middle is 1 m from its neighbours, so the scale is that of K Gaussians in a square metre.
    CHECK(samples.scales[0] == doctest::Approx(std::sqrt(1.0 / 20000)));
}

TEST_CASE("a requested total is hit exactly and scales with it; K may differ between vertices") {
    const BodyModel model = test::tube();
    std::vector<double> K(model.vertex_count(), 15);
    for (std::size_t v = 0; v < K.size() / 2; ++v) K[v] = 20.25;
    for (std::size_t total : {1, 100, 4321, 20000}) {
        const auto samples = sample_surface(model, model.v_template, K, 7, {.total = total});
        CHECK(samples.size() == total);
    }
    const auto samples = sample_surface(model, model.v_template, K, 7, {.total = 20000});
    double low = 0, high = 0;
    for (const int source : samples.sources) (static_cast<std::size_t>(source) < K.size() / 2 ? high : low) += 1;
    CHECK(high / low ==
          doctest::Approx(20.25 / 15 * static_cast<double>(K.size() / 2) / static_cast<double>(K.size() - K.size() / 2))
              .epsilon(1e-3));
}

TEST_CASE("one seed, one result; neighbours in memory are neighbours in space") {
    const BodyModel model = test::tube();
    const std::vector<double> K(model.vertex_count(), 14.3);
    const auto once = sample_surface(model, model.v_template, K, 11),
               again = sample_surface(model, model.v_template, K, 11),
               other = sample_surface(model, model.v_template, K, 12);
    CHECK(once.positions == again.positions);
    CHECK(once.weights.weights == again.weights.weights);
    CHECK(once.positions != other.positions);
    double step = 0;
    for (std::size_t i = 1; i < once.size(); ++i) step += length(once.positions[i] - once.positions[i - 1]);
    CHECK(step / static_cast<double>(once.size()) < 0.06); // the tube is 1.6 m long
}

TEST_CASE("jitter stays within its share of the vertex distance") {
    const BodyModel model = test::tube();
    const std::vector<double> K(model.vertex_count(), 5);
    const auto still = sample_surface(model, model.v_template, K, 13),
               moved = sample_surface(model, model.v_template, K, 13, {.jitter = 0.1});
    REQUIRE(still.size() == moved.size());
    double largest = 0;
    for (std::size_t i = 0; i < still.size(); ++i) {
        const double share = length(still.positions[i] - moved.positions[i]) / (still.scales[i] * std::sqrt(5.0));
        largest = std::max(largest, share);
        CHECK(moved.barycentric[i] == still.barycentric[i]);
    }
    CHECK(largest > 0.05);
    CHECK(largest <= 0.1 * std::sqrt(3.0) + 1e-12);
}

TEST_CASE("influences can be bounded") {
    const BodyModel model = test::tube(8);
    const std::vector<double> K(model.vertex_count(), 2);
    const auto samples = sample_surface(model, model.v_template, K, 17, {.max_influences = 2});
    CHECK(samples.weights.influences == 2);
}

TEST_CASE("what cannot be sampled is refused, a vertex without surface is passed over") {
    BodyModel model = test::tube();
    std::vector<double> K(model.vertex_count(), 1);
    const auto& vertices = model.v_template;
    CHECK_THROWS_AS((void)sample_surface(model, std::vector<vec3<double>>(3), K, 1), ShapeError);
    CHECK_THROWS_AS((void)sample_surface(model, vertices, std::vector<double>(3, 1), 1), ShapeError);
    auto bad = K;
    bad[4] = -1;
    CHECK_THROWS_AS((void)sample_surface(model, vertices, bad, 1), ValueError);
    bad[4] = std::numeric_limits<double>::quiet_NaN();
    CHECK_THROWS_AS((void)sample_surface(model, vertices, bad, 1), ValueError);
    CHECK_THROWS_AS((void)sample_surface(model, vertices, std::vector<double>(K.size(), 0), 1, {.total = 10}),
                    ValueError);
    CHECK(sample_surface(model, vertices, std::vector<double>(K.size(), 0), 1).size() == 0);
    CHECK_THROWS_AS((void)sample_surface(model, vertices, K, 1, {.jitter = -1}), ValueError);
    auto broken = vertices;
    broken[2].y = std::numeric_limits<double>::infinity();
    CHECK_THROWS_AS((void)sample_surface(model, broken, K, 1), ValueError);
    BodyModel faceless = model, short_weights = model, bad_face = model;
    faceless.faces.clear();
    short_weights.weights.pop_back();
    bad_face.faces[3][1] = static_cast<int>(model.vertex_count());
    CHECK_THROWS_AS((void)sample_surface(faceless, vertices, K, 1), ValueError);
    CHECK_THROWS_AS((void)sample_surface(short_weights, vertices, K, 1), ShapeError);
    CHECK_THROWS_AS((void)sample_surface(bad_face, vertices, K, 1), ValueError);

    model.v_template.push_back(vec3<double>(9)); // belongs to no triangle
    for (int j = 0; j < 4; ++j) model.weights.push_back(0.25);
    K.push_back(100);
    const auto samples = sample_surface(model, model.v_template, K, 1, {.total = 500});
    CHECK(samples.size() == 500);
    for (const int source : samples.sources) CHECK(source + 1 < static_cast<int>(model.vertex_count()));
}

} // namespace
} // namespace gsh
