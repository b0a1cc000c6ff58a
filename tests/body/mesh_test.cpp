// SPDX-License-Identifier: Apache-2.0
#include "support/bodies.hpp"

#include <gsh/body/mesh.hpp>

namespace gsh {
namespace {

TEST_CASE("normals of a tube point outward") {
    const BodyModel model = test::tube();
    const auto normals = vertex_normals(model.v_template, model.faces);
    for (std::size_t v = 0; v < normals.size(); ++v) {
        CHECK(length(normals[v]) == doctest::Approx(1));
        const vec3<double> axis(0, 0.8, 0);
        CHECK(dot(normals[v], model.v_template[v] - axis) > 0);
    }
    const std::vector<vec3<double>> lonely(1, vec3<double>(1));
    CHECK(vertex_normals(lonely, {})[0] == vec3<double>(0));
}

TEST_CASE("the three corner regions of any triangle share out its area") {
    test::Rng rng(1);
    for (int n = 0; n < 200; ++n) {
        const auto a = rng.vec(), b = rng.vec();
        const auto c = n % 2 ? rng.vec() : (a + b) * 0.5 + rng.vec() * 0.05; // every other one is obtuse
        const double sum =
            CornerRegion(a, b, c).fraction() + CornerRegion(b, c, a).fraction() + CornerRegion(c, a, b).fraction();
        CHECK(sum == doctest::Approx(1));
    }
}

TEST_CASE("known fractions: equilateral, right, and one corner far away") {
    const vec3<double> a(0, 0, 0), b(1, 0, 0);
    CHECK(CornerRegion(a, b, {0.5, std::sqrt(0.75), 0}).fraction() == doctest::Approx(1.0 / 3));
    CHECK(CornerRegion(a, b, {0, 1, 0}).fraction() == doctest::Approx(0.5));
    CHECK(CornerRegion(b, {0, 1, 0}, a).fraction() == doctest::Approx(0.25));
    CHECK(CornerRegion(a, a, {0, 1, 0}).fraction() >= 0); // degenerate: two corners coincide
}

TEST_CASE("points of a corner region are nearest to the corner, and area-uniform") {
    test::Rng rng(2);
    const vec3<double> a(0, 0, 0), b(1, 0, 0);
    for (const vec3<double>& c : {vec3<double>(0.4, 0.8, 0), vec3<double>(0.5, 0.1, 0), vec3<double>(-0.7, 0.3, 0)}) {
        const CornerRegion region(a, b, c);
        const auto position = [&](vec3<double> w) { return a * w.x + b * w.y + c * w.z; };
        vec3<double> mean(0), centroid(0);
        double whole = 0;
        for (std::size_t k = 2; k < region.count; ++k) {
            const auto p = position(region.points[0]), q = position(region.points[k - 1]),
                       r = position(region.points[k]);
            const double area = length(cross(q - p, r - p));
            centroid += (p + q + r) * (area / 3), whole += area;
        }
        constexpr int count = 200;
        for (int i = 0; i < count; ++i)
            for (int j = 0; j < count; ++j) {
                const auto w = region.at((i + 0.5) / count, (j + 0.5) / count);
                const auto x = position(w);
                if (length(x - a) > length(x - b) + 1e-12 || length(x - a) > length(x - c) + 1e-12)
                    FAIL_CHECK("not nearest");
                mean += x * (1.0 / (count * count));
            }
        CHECK(length(mean - centroid * (1 / whole)) < 1e-3);
    }
}

} // namespace
} // namespace gsh
