// SPDX-License-Identifier: Apache-2.0
#include "support/gradient.hpp"

#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/body/blend_shapes.hpp>
#include <gsh/body/cpu/blend_shapes.hpp>

#include <cstring>

namespace gsh {
namespace {

using Shapes = BlendShapes<cpu::Serial, double>;

double inner(const std::vector<vec3<double>>& a, const std::vector<vec3<double>>& b) {
    double sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i) sum += dot(a[i], b[i]);
    return sum;
}

TEST_CASE("offsets are the directions times the coefficients, block after block") {
    test::Rng rng(1);
    for (std::size_t V : {1, 2, 511, 512, 513, 1100}) {
        const auto first = rng.vecs(V * 3), second = rng.vecs(V * 2);
        cpu::Serial backend;
        const Shapes shapes(backend, V, {first, {}, second});
        CHECK(shapes.coefficient_count() == 5);
        CHECK(shapes.vertex_count() == V);
        const std::vector<double> c{0.5, 0, -2, 3, 1};
        std::vector<vec3<double>> offsets(V, vec3<double>(1));
        shapes.forward(c, offsets);
        for (std::size_t v = 0; v < V; ++v) {
            const auto expected = vec3<double>(1) + first[v * 3] * c[0] + first[v * 3 + 2] * c[2] +
                                  second[v * 2] * c[3] + second[v * 2 + 1] * c[4];
            CHECK(length(offsets[v] - expected) < 1e-14);
        }
    }
}

TEST_CASE("BlendShapes::backward is the gradient of forward, and adds") {
    test::Rng rng(2);
    constexpr std::size_t V = 1031, C = 7;
    const auto directions = rng.vecs(V * C), dL_doffsets = rng.vecs(V);
    cpu::Serial backend;
    const Shapes shapes(backend, V, {directions});
    auto c = rng.numbers(C);
    std::vector<double> dL_dc(C, 0);
    Shapes::Workspace workspace;
    const auto loss = [&] {
        std::vector<vec3<double>> offsets(V, vec3<double>(0));
        shapes.forward(c, offsets);
        return inner(offsets, dL_doffsets);
    };
    shapes.backward(dL_doffsets, dL_dc, workspace);
    test::check_gradient(loss, test::scalars(c), test::scalars(dL_dc));
    const auto once = dL_dc;
    shapes.backward(dL_doffsets, dL_dc, workspace);
    for (std::size_t k = 0; k < C; ++k) CHECK(dL_dc[k] == 2 * once[k]);
}

TEST_CASE("Threads equals Serial bit for bit") {
    test::Rng rng(3);
    constexpr std::size_t V = 5003, C = 21;
    const auto directions = rng.vecs(V * C);
    std::vector<vec3<float>> dL_doffsets(V);
    for (auto& g : dL_doffsets) g = vec3<float>(rng.vec());
    std::vector<float> c(C);
    for (float& x : c) x = static_cast<float>(rng.uniform(-1, 1));
    const auto run = [&](auto&& backend) {
        using B = std::remove_reference_t<decltype(backend)>;
        const BlendShapes<B, float> shapes(backend, V, {directions});
        std::vector<vec3<float>> offsets(V, vec3<float>(0));
        std::vector<float> dL_dc(C, 0);
        typename BlendShapes<B, float>::Workspace workspace;
        shapes.forward(c, offsets);
        shapes.backward(dL_doffsets, dL_dc, workspace);
        for (const auto& v : offsets)
            for (int k = 0; k < 3; ++k) dL_dc.push_back(v[k]);
        return dL_dc;
    };
    const auto expected = run(cpu::Serial());
    for (std::size_t threads : {1, 2, 3, 7}) {
        const auto found = run(cpu::Threads(threads));
        CHECK(std::memcmp(found.data(), expected.data(), expected.size() * sizeof(float)) == 0);
    }
}

TEST_CASE("sizes are checked; nothing times nothing is nothing") {
    cpu::Serial backend;
    std::vector<vec3<double>> seven(7, vec3<double>(1)), four(4, vec3<double>(1)), two(2, vec3<double>(1));
    std::vector<double> c(2, 0), three(3, 0);
    Shapes::Workspace workspace;
    CHECK_THROWS_AS((Shapes(backend, 2, {seven})), ShapeError);
    const Shapes shapes(backend, 2, {four});
    CHECK_THROWS_AS(shapes.forward(three, two), ShapeError);
    CHECK_THROWS_AS(shapes.forward(c, four), ShapeError);
    CHECK_THROWS_AS(shapes.backward(four, c, workspace), ShapeError);
    CHECK_THROWS_AS(shapes.backward(two, three, workspace), ShapeError);

    const Shapes none(backend, 0, {}), still(backend, 2, {});
    none.forward({}, {});
    still.forward({}, two);
    still.backward(two, {}, workspace);
    CHECK(two[0] == vec3<double>(1));
}

} // namespace
} // namespace gsh
