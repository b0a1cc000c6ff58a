// SPDX-License-Identifier: Apache-2.0
#include <doctest/doctest.h>

#include <gsh/synthetic/remesh.hpp>

#include "support/closed_mesh.hpp"

using namespace gsh;

TEST_CASE("remesh coarsens a sphere to the wished lengths and leaves it closed and on the surface") {
    const auto sphere = [](const vec3<double>& p) { return length(p) - 1; };
    const auto lines = graded_lines(-1.2, 1.2, [](double) { return 0.035; });
    const auto wished = [](const vec3<double>& p) { return p.x > 0 ? 0.07 : 0.15; };
    const TriangleMesh fine = surface_nets({lines, lines, lines}, sphere);
    const TriangleMesh mesh = remesh(fine, sphere, wished);

    CHECK(mesh.vertices.size() < fine.vertices.size() / 3);
    CHECK(test::open_edges(mesh.faces) == 0);
    CHECK(test::euler_characteristic(mesh.vertices.size(), mesh.faces) == 2);
    CHECK(test::volume(mesh.vertices, mesh.faces) == doctest::Approx(4.18879).epsilon(0.02));
    for (const auto& v : mesh.vertices) CHECK(length(v) == doctest::Approx(1).epsilon(1e-3));
    std::size_t short_or_long = 0, skewed = 0;
    for (const auto& f : mesh.faces) {
        const auto at = [&](std::size_t k) { return mesh.vertices[static_cast<std::size_t>(f[k % 3])]; };
        double longest = 0;
        for (std::size_t k = 0; k < 3; ++k) {
            const double edge = length(at(k) - at(k + 1)), aim = wished((at(k) + at(k + 1)) * 0.5);
            short_or_long += edge < 0.5 * aim || edge > 1.8 * aim;
            longest = std::max(longest, edge);
        }
        // It is 0.87 for an equilateral triangle.
        skewed += length(cross(at(1) - at(0), at(2) - at(0))) < 0.25 * longest * longest;
    }
    CHECK(static_cast<double>(short_or_long) < 0.03 * 3 * static_cast<double>(mesh.faces.size()));
    CHECK(skewed == 0);
}

TEST_CASE("remesh gives the same mesh again, and nothing for nothing") {
    const auto ball = [](const vec3<double>& p) { return length(p) - 0.5; };
    const auto lines = graded_lines(-0.7, 0.7, [](double) { return 0.06; });
    const TriangleMesh fine = surface_nets({lines, lines, lines}, ball);
    const auto wished = [](const vec3<double>&) { return 0.12; };
    const TriangleMesh a = remesh(fine, ball, wished), b = remesh(fine, ball, wished);
    CHECK(a.vertices == b.vertices);
    CHECK(a.faces == b.faces);
    CHECK(remesh({}, ball, wished).vertices.empty());
}
