// SPDX-License-Identifier: Apache-2.0
#include <gsh/body/vertex_samples.hpp>

#include "support/bodies.hpp"

#include <doctest/doctest.h>

#include <vector>

using namespace gsh;

TEST_CASE("each vertex holds one sample, with its weights, and no triangle is asked for") {
    BodyModel body = test::tube(4, 6, 5);
    body.faces.clear();
    const SurfaceSamples samples = sample_vertices(body, body.v_template);
    REQUIRE(samples.size() == body.vertex_count());
    std::vector<int> seen(samples.size(), 0);
    for (std::size_t i = 0; i < samples.size(); ++i) {
        const auto v = static_cast<std::size_t>(samples.sources[i]);
        ++seen[v];
        CHECK(samples.positions[i] == body.v_template[v]);
        CHECK(samples.triangles[i][2] == static_cast<int>(v));
        CHECK(samples.barycentric[i] == vec3<double>(1, 0, 0));
        CHECK(samples.scales[i] > 0.05);
        CHECK(samples.scales[i] < 0.3);
        CHECK(samples.normals[i] == vec3<double>(0));
    }
    CHECK(seen == std::vector<int>(samples.size(), 1));

    std::vector<vec3<double>> normals(body.vertex_count(), vec3<double>(0, 0, 2));
    CHECK(sample_vertices(body, body.v_template, normals).normals[3] == vec3<double>(0, 0, 1));
    normals.pop_back();
    CHECK_THROWS_AS((void)sample_vertices(body, body.v_template, normals), ShapeError);
    CHECK_THROWS_AS((void)sample_vertices(body, normals), ShapeError);
    CHECK(sample_vertices(BodyModel(), {}).size() == 0);
}
