// SPDX-License-Identifier: Apache-2.0
#include <doctest/doctest.h>

#include <gsh/core/rng.hpp>
#include <gsh/synthetic/signed_distance.hpp>
#include <gsh/synthetic/surface_nets.hpp>

#include "support/closed_mesh.hpp"

using namespace gsh;

namespace {
GridLines cube_of_lines(double half, const auto& spacing) {
    const auto lines = graded_lines(-half, half, spacing);
    return {lines, lines, lines};
}
double torus(const vec3<double>& p) {
    return length(vec3<double>(std::hypot(p.x, p.z) - 0.6, p.y, 0)) - 0.25;
}
} // namespace

TEST_CASE("graded_lines rise from low past high, spaced as asked") {
    const auto lines = graded_lines(-1, 1, [](double x) { return x < 0 ? 0.1 : 0.02; });
    CHECK(lines.front() == -1);
    CHECK(lines.back() >= 1);
    for (std::size_t i = 1; i < lines.size(); ++i)
        CHECK(lines[i] - lines[i - 1] == doctest::Approx(lines[i] < 0.05 ? 0.1 : 0.02).epsilon(0.9));
    CHECK(lines.size() > 55);
}

TEST_CASE("a sphere becomes a closed mesh of its volume, facing outward") {
    const auto mesh = surface_nets(cube_of_lines(1.3, [](double x) { return x < 0 ? 0.05 : 0.03; }),
                                   [](const vec3<double>& p) { return length(p) - 1; });
    CHECK(test::open_edges(mesh.faces) == 0);
    CHECK(test::euler_characteristic(mesh.vertices.size(), mesh.faces) == 2);
    CHECK(test::volume(mesh.vertices, mesh.faces) == doctest::Approx(4.18879).epsilon(0.01));
    for (const auto& v : mesh.vertices) CHECK(length(v) == doctest::Approx(1).epsilon(0.002));
}

TEST_CASE("a torus keeps its hole") {
    const auto mesh = surface_nets(cube_of_lines(1.1, [](double) { return 0.05; }), torus);
    CHECK(test::open_edges(mesh.faces) == 0);
    CHECK(test::euler_characteristic(mesh.vertices.size(), mesh.faces) == 0);
}

TEST_CASE("two sheets in one cell stay apart") {
    // Two balls whose gap lies on a cell's diagonal.
    const auto balls = [](const vec3<double>& p) {
        return std::min(length(p - vec3<double>(0.33)) - 0.545, length(p + vec3<double>(0.33)) - 0.545);
    };
    const auto mesh = surface_nets(cube_of_lines(1.2, [](double) { return 0.07; }), balls);
    CHECK(test::open_edges(mesh.faces) == 0);
    CHECK(test::pieces(mesh.vertices.size(), mesh.faces, [](std::size_t) { return true; }) == 2);
}

TEST_CASE("a cell's sheets are as many as its corners allow") {
    const detail::CellSheets sheets;
    CHECK(sheets.count(0) == 0);
    CHECK(sheets.count(255) == 0);
    CHECK(sheets.count(1) == 1);
    CHECK(sheets.count(0b10000001) == 2); // opposite corners
    CHECK(sheets.count(0b01101001) == 4); // every other corner
    for (unsigned mask = 0; mask < 256; ++mask)
        for (int e = 0; e < 12; ++e) {
            const auto [a, b] = detail::CellSheets::corners(e);
            CHECK((sheets.sheet(mask, e) >= 0) == (((mask >> a) & 1u) != ((mask >> b) & 1u)));
        }
}

TEST_CASE("a surface that reaches the border is refused; no surface gives no mesh") {
    const auto lines = cube_of_lines(0.9, [](double) { return 0.1; });
    CHECK_THROWS_AS((void)surface_nets(lines, [](const vec3<double>& p) { return length(p) - 1; }), ValueError);
    CHECK(surface_nets(lines, [](const vec3<double>&) { return 5.0; }).faces.empty());
}
