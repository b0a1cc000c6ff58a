// SPDX-License-Identifier: Apache-2.0
#include "support/gradient.hpp"

#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/body/surface_interpolation.hpp>

#include <cstring>

namespace gsh {
namespace {

constexpr std::size_t V = 700, N = 2001;

struct Attachment {
    std::vector<std::array<int, 3>> triangles;
    std::vector<vec3<double>> barycentric;

    explicit Attachment(std::uint64_t seed) {
        test::Rng rng(seed);
        const auto vertex = [&] { return static_cast<int>(rng.below(V - 1)); }; // the last vertex stays unused
        for (std::size_t i = 0; i < N; ++i) {
            const int a = vertex(), b = vertex(), c = vertex();
            triangles.push_back({a, b, c});
            vec3<double> w = rng.vec(0, 1);
            barycentric.push_back(w * (1 / (w.x + w.y + w.z)));
        }
    }
};

TEST_CASE("a linear function of position is reproduced at the points") {
    const Attachment a(1);
    test::Rng rng(2);
    const auto values = rng.vecs(V);
    cpu::Serial backend;
    const SurfaceInterpolation<cpu::Serial, double> surface(backend, V, a.triangles, a.barycentric);
    std::vector<vec3<double>> points(N, vec3<double>(5));
    surface.forward(values, points);
    for (std::size_t i = 0; i < N; ++i) {
        vec3<double> expected(5);
        for (std::size_t c = 0; c < 3; ++c)
            expected += values[static_cast<std::size_t>(a.triangles[i][c])] * a.barycentric[i][static_cast<int>(c)];
        CHECK(length(points[i] - expected) < 1e-14);
    }
}

TEST_CASE("SurfaceInterpolation::backward is the gradient of forward, and adds") {
    const Attachment a(3);
    test::Rng rng(4);
    auto values = rng.vecs(V);
    const auto dL_dpoints = rng.vecs(N);
    cpu::Serial backend;
    const SurfaceInterpolation<cpu::Serial, double> surface(backend, V, a.triangles, a.barycentric);
    std::vector<vec3<double>> dL_dvalues(V, vec3<double>(0));
    surface.backward(dL_dpoints, dL_dvalues);
    const auto loss = [&] {
        std::vector<vec3<double>> points(N, vec3<double>(0));
        surface.forward(values, points);
        double sum = 0;
        for (std::size_t i = 0; i < N; ++i) sum += dot(points[i], dL_dpoints[i]);
        return sum;
    };
    test::check_gradient(loss, test::scalars(values), test::scalars(dL_dvalues), {.stride = 41});
    CHECK(dL_dvalues[V - 1] == vec3<double>(0));
    const auto once = dL_dvalues;
    surface.backward(dL_dpoints, dL_dvalues);
    for (std::size_t v = 0; v < V; ++v) CHECK(dL_dvalues[v] == once[v] * 2.0);
}

TEST_CASE("Threads equals Serial bit for bit") {
    const Attachment a(5);
    test::Rng rng(6);
    const auto values = rng.vecs(V), dL_dpoints = rng.vecs(N);
    const auto run = [&](auto&& backend) {
        using B = std::remove_reference_t<decltype(backend)>;
        const SurfaceInterpolation<B, double> surface(backend, V, a.triangles, a.barycentric);
        std::vector<vec3<double>> out(V + N, vec3<double>(0));
        surface.backward(dL_dpoints, Span<vec3<double>>(out).subspan(0, V));
        surface.forward(values, Span<vec3<double>>(out).subspan(V, N));
        return out;
    };
    const auto expected = run(cpu::Serial());
    for (std::size_t threads : {1, 2, 3, 7}) {
        const auto found = run(cpu::Threads(threads));
        CHECK(std::memcmp(found.data(), expected.data(), expected.size() * sizeof(expected[0])) == 0);
    }
}

TEST_CASE("bad attachments and sizes are refused; no points are fine") {
    cpu::Serial backend;
    using Surface = SurfaceInterpolation<cpu::Serial, double>;
    const std::vector<std::array<int, 3>> good{{0, 1, 2}}, high{{0, 1, 3}}, low{{0, -1, 2}};
    const std::vector<vec3<double>> one(1, vec3<double>(1.0 / 3)), three(3, vec3<double>(0));
    CHECK_THROWS_AS(Surface(backend, 3, good, three), ShapeError);
    CHECK_THROWS_AS(Surface(backend, 3, high, one), ValueError);
    CHECK_THROWS_AS(Surface(backend, 3, low, one), ValueError);
    const Surface surface(backend, 3, good, one);
    std::vector<vec3<double>> out1(1), out3(3);
    CHECK_THROWS_AS(surface.forward(one, out1), ShapeError);
    CHECK_THROWS_AS(surface.forward(three, out3), ShapeError);
    CHECK_THROWS_AS(surface.backward(three, out3), ShapeError);
    CHECK_THROWS_AS(surface.backward(one, out1), ShapeError);
    Surface none(backend, 3, {}, {});
    none.forward(three, {});
    none.backward({}, out3);
}

} // namespace
} // namespace gsh
