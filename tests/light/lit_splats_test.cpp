// SPDX-License-Identifier: Apache-2.0
#include "support/gradient.hpp"
#include "support/lit_scene.hpp"

#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/light/cpu/lit_splats.hpp>
#include <gsh/light/lit_splats.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>
#include <vector>

namespace gsh {
namespace {

template <class T>
using LitScene = test::LitScene<T>;
using test::color_gradient;

/// Numbers of points and directions, and whether there is gloss.
struct LightKind {
    std::size_t points, directions;
    bool glossy;
};
constexpr LightKind light_kinds[] = {{4, 12, true}, {4, 12, false}, {3, 0, true},
                                     {0, 7, false}, {0, 3, true},   {5, 18, true}};

TEST_CASE("LitSplats::backward is the gradient of forward with respect to every input, and adds") {
    for (const LightKind& kind : light_kinds) {
        CAPTURE(kind.points);
        CAPTURE(kind.directions);
        CAPTURE(kind.glossy);
        LitScene<double> scene(19, kind.points, kind.directions, kind.glossy, 5), gradient = scene;
        gradient.clear();
        cpu::Serial backend;
        const auto lit = scene.splats(backend);
        LitSplats<cpu::Serial, double>::Cache cache;
        std::vector<vec3<double>> colors(scene.N);
        const auto dL_dcolors = color_gradient<double>(scene.N, 6);
        const auto loss = [&] {
            lit.forward(scene.input(), colors, cache);
            double sum = 0;
            for (std::size_t i = 0; i < scene.N; ++i) sum += dot(colors[i], dL_dcolors[i]);
            return sum;
        };
        loss();
        lit.backward(scene.input(), dL_dcolors, cache, gradient.view());
        const LitScene<double> once = gradient;
        lit.backward(scene.input(), dL_dcolors, cache, gradient.view());
        for (const auto& [twice, single] :
             {std::pair(&gradient.points, &once.points), std::pair(&gradient.vertices, &once.vertices),
              std::pair(&gradient.base, &once.base), std::pair(&gradient.normals, &once.normals),
              std::pair(&gradient.center, &once.center)})
            for (std::size_t i = 0; i < single->size(); ++i)
                CHECK(length((*twice)[i] - (*single)[i] * 2.0) <= 1e-12 * length((*single)[i]));
        for (std::size_t k = 0; k < once.log_intensities.size(); ++k)
            CHECK(gradient.log_intensities[k] == doctest::Approx(2 * once.log_intensities[k]).epsilon(1e-12));
        for (std::size_t k = 0; k < once.gloss.size(); ++k)
            CHECK(gradient.gloss[k] == doctest::Approx(2 * once.gloss[k]).epsilon(1e-12));

        gradient = once;
        const bool lobes = kind.glossy && kind.points > 0; // only points have gloss
        test::check_gradient(loss, test::scalars(scene.points), test::scalars(gradient.points));
        test::check_gradient(loss, test::scalars(scene.log_intensities), test::scalars(gradient.log_intensities));
        test::check_gradient(loss, test::scalars(scene.gloss), test::scalars(gradient.gloss), {.may_vanish = !lobes});
        test::check_gradient(loss, test::scalars(scene.vertices), test::scalars(gradient.vertices),
                             {.may_vanish = kind.points == 0});
        test::check_gradient(loss, test::scalars(scene.base), test::scalars(gradient.base));
        test::check_gradient(loss, test::scalars(scene.normals), test::scalars(gradient.normals));
        test::check_gradient(loss, test::scalars(scene.center), test::scalars(gradient.center),
                             {.may_vanish = !lobes});
    }
}

TEST_CASE("a lane of the element equals the plain formula") {
    const LitScene<double> scene(1, 2, 2, true, 8);
    const LitSplatsInput<double> in = scene.input();
    cpu::Serial backend;
    const auto lit = scene.splats(backend);
    LitSplats<cpu::Serial, double>::Cache cache;
    std::vector<vec3<double>> colors(1);
    lit.forward(in, colors, cache);
    double E = 0, S = 0; // at the Gaussian
    for (int c = 0; c < 3; ++c) {
        const auto v = static_cast<std::size_t>(scene.triangles[0][static_cast<std::size_t>(c)]);
        const vec3<double> n = normalize(scene.normals[v]), view = normalize(scene.center[0] - scene.vertices[v]);
        double of_vertex = 0, gloss_of_vertex = 0;
        for (std::size_t k = 0; k < 4; ++k) {
            const bool point = k < 2;
            const vec3<double> to = point ? scene.points[k] - scene.vertices[v] : scene.directions[k - 2];
            const double e = std::exp(scene.log_intensities[k]) * scene.visibility[4 * v + k] *
                             std::max(0.0, dot(n, normalize(to))) / dot(to, to);
            of_vertex += e;
            if (!point) continue;
            const vec3<double> h = normalize(view + normalize(to));
            const double F = (0.04 + 0.96 * std::pow(1 - dot(h, view), 5)) / 0.04;
            gloss_of_vertex += std::exp(scene.gloss[0]) * e * F * std::exp(-std::exp(scene.gloss[1]) * (1 - dot(n, h)));
        }
        CHECK(cache.shading[v].x == doctest::Approx(of_vertex).epsilon(1e-7));
        CHECK(cache.shading[v].y == doctest::Approx(gloss_of_vertex).epsilon(1e-7));
        E += scene.barycentric[0][c] * of_vertex, S += scene.barycentric[0][c] * gloss_of_vertex;
    }
    CHECK(E > 0);
    CHECK(S > 0);
    CHECK(lit.interpolate(cache)[0].x == doctest::Approx(E).epsilon(1e-7));
    CHECK(lit.interpolate(cache)[0].y == doctest::Approx(S).epsilon(1e-7));
    for (int c = 0; c < 3; ++c)
        CHECK(colors[0][c] == doctest::Approx(linear_to_srgb(srgb_to_linear(scene.base[0][c]) * E + S)).epsilon(1e-7));
}

TEST_CASE_TEMPLATE("where the irradiance is one and nothing shines, the colour is the base", T, float, double) {
    LitScene<T> scene(40, 0, 1, false, 9);
    scene.directions = {vec3<T>(0, 0, 1)}, scene.log_intensities = {T(0)};
    std::fill(scene.normals.begin(), scene.normals.end(), vec3<T>(0, 0, 1));
    std::fill(scene.visibility.begin(), scene.visibility.end(), T(1));
    for (std::size_t i = 0; i < scene.N; ++i) scene.base[i] *= T(i) / T(scene.N); // both ends of the curve
    cpu::Serial backend;
    const auto lit = scene.splats(backend);
    typename LitSplats<cpu::Serial, T>::Cache cache;
    std::vector<vec3<T>> colors(scene.N);
    const double tolerance = sizeof(T) == 4 ? 1e-6 : 4e-8; // the standard's two formulas meet within 3e-8
    lit.forward(scene.input(), colors, cache);
    for (std::size_t i = 0; i < scene.N; ++i)
        for (int c = 0; c < 3; ++c)
            CHECK(std::abs(static_cast<double>(colors[i][c] - scene.base[i][c])) < tolerance);
    // A point at one metre straight ahead is the same.
    LitScene<T> near = scene;
    near.directions.clear(), near.points = {vec3<T>(0, 0, 1)};
    std::fill(near.vertices.begin(), near.vertices.end(), vec3<T>(T(0)));
    lit.forward(near.input(), colors, cache);
    for (std::size_t i = 0; i < near.N; ++i)
        for (int c = 0; c < 3; ++c) CHECK(std::abs(static_cast<double>(colors[i][c] - near.base[i][c])) < tolerance);
    // In place, results are bit-identical.
    std::vector<vec3<T>> in_place = near.base;
    near.base.clear();
    auto in = near.input();
    in.base = in_place;
    lit.forward(in, in_place, cache);
    CHECK(in_place == colors);
}

TEST_CASE_TEMPLATE("no normal, a light or a camera at a vertex, and darkness give finite numbers", T, float,
                   double) {
    for (int fault = 0; fault < 5; ++fault) {
        CAPTURE(fault);
        LitScene<T> scene(21, 3, 4, true, 10), gradient = scene;
        gradient.clear();
        if (fault == 0) std::fill(scene.normals.begin(), scene.normals.end(), vec3<T>(T(0)));
        if (fault == 1) scene.points[1] = scene.vertices[4];
        if (fault == 2) scene.center[0] = scene.vertices[4];
        if (fault == 3) std::fill(scene.visibility.begin(), scene.visibility.end(), T(0));
        if (fault == 4) scene.points[1] = scene.vertices[4] * T(2) - scene.center[0]; // behind, straight: no half vector
        cpu::Serial backend;
        const auto lit = scene.splats(backend);
        typename LitSplats<cpu::Serial, T>::Cache cache;
        std::vector<vec3<T>> colors(scene.N);
        lit.forward(scene.input(), colors, cache);
        lit.backward(scene.input(), color_gradient<T>(scene.N, 11), cache, gradient.view());
        for (const auto* values : {&colors, &gradient.points, &gradient.vertices, &gradient.base, &gradient.normals,
                                   &gradient.center})
            for (const vec3<T>& value : *values)
                for (int c = 0; c < 3; ++c) CHECK(std::isfinite(value[c]));
        for (const auto* values : {&gradient.log_intensities, &gradient.gloss})
            for (const T value : *values) CHECK(std::isfinite(value));
        if (fault == 0)
            for (const auto& shading : cache.shading) CHECK(shading.x == T(0));
        if (fault == 0 || fault == 3)
            for (const vec3<T>& color : colors) CHECK(color == vec3<T>(T(0)));
    }
}

TEST_CASE("gradients that nobody asks for are left alone, and a colour without gradient adds nothing") {
    const LitScene<double> scene(33, 4, 12, true, 12);
    LitScene<double> all = scene, some = scene, seen = scene;
    all.clear(), some.clear(), seen.clear();
    cpu::Serial backend;
    const auto lit = scene.splats(backend);
    LitSplats<cpu::Serial, double>::Cache cache;
    std::vector<vec3<double>> colors(scene.N);
    auto dL_dcolors = color_gradient<double>(scene.N, 13);
    lit.forward(scene.input(), colors, cache);
    lit.backward(scene.input(), dL_dcolors, cache, all.view());
    lit.backward(scene.input(), dL_dcolors, cache, {.vertices = some.vertices});
    CHECK(some.vertices == all.vertices);
    CHECK(some.base[0] == vec3<double>(0));
    lit.backward(scene.input(), dL_dcolors, cache, {.light = {.gloss = some.gloss}, .normals = some.normals});
    CHECK(some.normals == all.normals);
    CHECK(some.gloss == all.gloss);
    CHECK(some.log_intensities[0] == 0);

    // Without Gaussian 5, normals lose its part and no other.
    const vec3<double> kept = dL_dcolors[5];
    dL_dcolors[5] = vec3<double>(0);
    lit.backward(scene.input(), dL_dcolors, cache, seen.view());
    CHECK(seen.base[5] == vec3<double>(0));
    std::fill(dL_dcolors.begin(), dL_dcolors.end(), vec3<double>(0));
    dL_dcolors[5] = kept;
    lit.backward(scene.input(), dL_dcolors, cache, seen.view());
    for (std::size_t v = 0; v < scene.V; ++v) CHECK(length(seen.normals[v] - all.normals[v]) < 1e-12);
    for (std::size_t k = 0; k < 16; ++k)
        CHECK(seen.log_intensities[k] == doctest::Approx(all.log_intensities[k]).epsilon(1e-12));
}

TEST_CASE("Threads equals Serial bit for bit; any size from none to beyond a chunk; float follows double") {
    for (const std::size_t count : {0, 1, 17, 2047, 2049, 5001}) {
        const LitScene<float> scene(count, 4, 12, true, 14);
        const auto dL_dcolors = [&] {
            auto values = color_gradient<float>(count, 15);
            for (std::size_t i = 0; i < count; i += 3) values[i] = vec3<float>(0); // unseen
            return values;
        }();
        const auto run = [&]<class T>(auto&& backend, const LitScene<T>& from) {
            using B = std::remove_reference_t<decltype(backend)>;
            std::vector<vec3<T>> colors(count), dL_d(dL_dcolors.begin(), dL_dcolors.end());
            LitScene<T> gradient = from;
            gradient.clear();
            const auto lit = from.splats(backend);
            typename LitSplats<B, T>::Cache cache;
            lit.forward(from.input(), colors, cache);
            lit.backward(from.input(), dL_d, cache, gradient.view());
            return std::pair(colors, gradient);
        };
        const auto equal = [](const auto& a, const auto& b) {
            return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(a[0])) == 0);
        };
        const auto [colors, gradient] = run(cpu::Serial(), scene);
        for (const std::size_t threads : {1, 2, 3, 7}) {
            const auto [other_colors, other] = run(cpu::Threads(threads), scene);
            CHECK(equal(colors, other_colors));
            CHECK(equal(gradient.vertices, other.vertices));
            CHECK(equal(gradient.base, other.base));
            CHECK(equal(gradient.normals, other.normals));
            CHECK(equal(gradient.points, other.points));
            CHECK(equal(gradient.log_intensities, other.log_intensities));
            CHECK(equal(gradient.gloss, other.gloss));
            CHECK(equal(gradient.center, other.center));
        }
        if (count != 2049) continue;
        LitScene<double> exact(count, 4, 12, true, 14);
        const auto copy = [](const auto& from, auto& to) { to.assign(from.begin(), from.end()); };
        copy(scene.points, exact.points), copy(scene.directions, exact.directions), copy(scene.vertices, exact.vertices);
        copy(scene.base, exact.base), copy(scene.normals, exact.normals), copy(scene.center, exact.center);
        copy(scene.log_intensities, exact.log_intensities), copy(scene.gloss, exact.gloss);
        copy(scene.visibility, exact.visibility);
        const auto [exact_colors, exact_gradient] = run(cpu::Serial(), exact);
        for (std::size_t i = 0; i < count; ++i) {
            CHECK(length(vec3<double>(colors[i]) - exact_colors[i]) < 1e-4);
            const auto near = [](const vec3<float>& found, const vec3<double>& expected) {
                return length(vec3<double>(found) - expected) < 1e-4 * (1 + length(expected));
            };
            CHECK(near(gradient.base[i], exact_gradient.base[i]));
        }
        for (std::size_t v = 0; v < scene.V; ++v)
            CHECK(length(vec3<double>(gradient.vertices[v]) - exact_gradient.vertices[v]) <
                  1e-4 * (1 + length(exact_gradient.vertices[v])));
        for (std::size_t k = 0; k < 4; ++k)
            CHECK(length(vec3<double>(gradient.points[k]) - exact_gradient.points[k]) < 1e-3);
    }
}

TEST_CASE("sizes that do not fit are refused") {
    LitScene<double> scene(3, 2, 2, true, 16), gradient = scene;
    cpu::Serial backend;
    const auto lit = scene.splats(backend);
    LitSplats<cpu::Serial, double>::Cache cache;
    std::vector<vec3<double>> colors(3);
    const auto shorter = [](auto& span) { span = span.subspan(0, span.size() - 1); };
    const auto forward = [&](auto break_it) {
        auto input = scene.input();
        break_it(input);
        lit.forward(input, colors, cache);
    };
    CHECK_THROWS_AS(lit.backward(scene.input(), colors, cache, gradient.view()), ShapeError); // forward comes first
    CHECK_NOTHROW(forward([](auto&) {}));
    CHECK_THROWS_AS(forward([&](auto& in) { shorter(in.light.points); }), ShapeError);
    CHECK_THROWS_AS(forward([&](auto& in) { shorter(in.light.log_intensities); }), ShapeError);
    CHECK_THROWS_AS(forward([&](auto& in) { shorter(in.light.gloss); }), ShapeError);
    CHECK_THROWS_AS(forward([&](auto& in) { shorter(in.vertices); }), ShapeError);
    CHECK_THROWS_AS(forward([&](auto& in) { shorter(in.base); }), ShapeError);
    CHECK_THROWS_AS(forward([&](auto& in) { shorter(in.normals); }), ShapeError);
    CHECK_THROWS_AS(forward([&](auto& in) { shorter(in.visibility); }), ShapeError);
    CHECK_THROWS_AS(lit.forward(scene.input(), Span<vec3<double>>(colors).subspan(0, 2), cache), ShapeError);
    const auto backward = [&](auto break_it) {
        auto view = gradient.view();
        break_it(view);
        lit.backward(scene.input(), colors, cache, view);
    };
    CHECK_NOTHROW(backward([](auto&) {}));
    CHECK_THROWS_AS(backward([&](auto& out) { shorter(out.light.points); }), ShapeError);
    CHECK_THROWS_AS(backward([&](auto& out) { shorter(out.light.log_intensities); }), ShapeError);
    CHECK_THROWS_AS(backward([&](auto& out) { shorter(out.light.gloss); }), ShapeError);
    CHECK_THROWS_AS(backward([&](auto& out) { shorter(out.vertices); }), ShapeError);
    CHECK_THROWS_AS(backward([&](auto& out) { shorter(out.base); }), ShapeError);
    CHECK_THROWS_AS(backward([&](auto& out) { shorter(out.normals); }), ShapeError);
    std::vector<vec3<double>> centers(2);
    CHECK_THROWS_AS(backward([&](auto& out) { out.center = centers; }), ShapeError);
    CHECK_THROWS_AS(lit.backward(scene.input(), Span<const vec3<double>>(colors).subspan(0, 2), cache, gradient.view()),
                    ShapeError);
    CHECK_THROWS_AS((LitSplats<cpu::Serial>(backend, 2, scene.triangles, scene.barycentric)), ValueError);
}

} // namespace
} // namespace gsh
