// SPDX-License-Identifier: Apache-2.0
#include "support/bodies.hpp"
#include "support/closed_mesh.hpp"

#include <gsh/body/coarse_mesh.hpp>

#include <doctest/doctest.h>

#include <limits>

namespace gsh {
namespace {

TEST_CASE("a coarse mesh picks vertices with the spacing asked for, and stays closed and oriented") {
    const BodyModel body = test::tube(4, 60, 40);
    const double before = test::volume(body.v_template, body.faces);
    for (const double spacing : {0.05, 0.1}) {
        CAPTURE(spacing);
        const CoarseMesh mesh = coarse_mesh(body.v_template, body.faces, spacing);
        REQUIRE(!mesh.faces.empty());
        std::vector<vec3<double>> picked;
        for (const std::uint32_t v : mesh.picked) picked.push_back(body.v_template[v]);
        CHECK(picked.size() < body.vertex_count() / 2);
        for (const auto& p : body.v_template) { // paths along edges are longer than straight lines
            double nearest = std::numeric_limits<double>::infinity();
            for (const auto& q : picked) nearest = std::min(nearest, length(p - q));
            CHECK(nearest <= spacing);
        }
        for (const auto& face : mesh.faces)
            for (const int v : face) CHECK((v >= 0 && static_cast<std::size_t>(v) < picked.size()));
        CHECK(test::open_edges(mesh.faces) == 0);
        const double after = test::volume(picked, mesh.faces);
        CHECK(after > 0.85 * before);
        CHECK(after < 1.02 * before);
    }
}

TEST_CASE("a spacing below all edges keeps the mesh; vertices without faces are left out") {
    BodyModel body = test::tube();
    const std::size_t V = body.vertex_count();
    body.v_template.push_back({1, 1, 1});
    const CoarseMesh mesh = coarse_mesh(body.v_template, body.faces, 1e-6);
    CHECK(mesh.picked.size() == V);
    CHECK(mesh.faces == body.faces);
    CHECK(coarse_mesh({}, {}, 1).picked.empty());
}

TEST_CASE("coarse_mesh refuses a spacing that is not positive and indices out of range") {
    const std::vector<vec3<double>> vertices(3);
    const std::vector<std::array<int, 3>> good{{0, 1, 2}}, high{{0, 1, 3}}, low{{0, -1, 2}};
    CHECK_THROWS_AS((void)coarse_mesh(vertices, good, 0), ValueError);
    CHECK_THROWS_AS((void)coarse_mesh(vertices, good, std::numeric_limits<double>::quiet_NaN()), ValueError);
    CHECK_THROWS_AS((void)coarse_mesh(vertices, high, 1), ValueError);
    CHECK_THROWS_AS((void)coarse_mesh(vertices, low, 1), ValueError);
}

} // namespace
} // namespace gsh
