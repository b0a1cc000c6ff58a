// SPDX-License-Identifier: Apache-2.0
#include "support/gradient.hpp"
#include "support/skinned_scene.hpp"

#include <gsh/avatar/cpu/skinned_splats.hpp>
#include <gsh/avatar/skinned_splats.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>

#include <cmath>
#include <cstring>

namespace gsh {
namespace {

template <int N>
struct Degree {
    static constexpr int value = N;
};

constexpr std::size_t joint_count = test::SkinnedScene<double>::joint_count;
template <class T>
using Scene = test::SkinnedScene<T>;
using test::SplatArrays;

template <class T, int Degree = 2, class B = cpu::Serial>
using Skin = SkinnedSplats<B, Degree, T>;

TEST_CASE("the canonical direction is that of the true inverse, also for mirrored maps") {
    test::Rng rng(1);
    int mirrored = 0;
    for (int n = 0; n < 100; ++n) {
        mat3<double> L;
        for (double& x : test::scalars(L)) x = rng.uniform(-1, 1);
        const auto offset = rng.vec();
        const auto expected = normalize(inverse(L) * offset);
        CHECK(length(CanonicalDirection<double>(L, offset).dir - expected) < 1e-10);
        mirrored += determinant(L) < 0;
    }
    CHECK(mirrored > 10);
}

TEST_CASE("its adjoint is exact, and bounded next to a singular map") {
    test::Rng rng(2);
    for (int n = 0; n < 20; ++n) {
        mat3<double> L;
        for (double& x : test::scalars(L)) x = rng.uniform(-1, 1);
        if (n % 2) L[2] = L[0] * 0.3 + L[1] * 0.4 + L[2] * 0.01; // determinant about 1e-3
        auto offset = rng.vec(1, 2);
        const auto dL_ddir = rng.vec();
        mat3<double> dL_dL(0.0);
        vec3<double> dL_doffset(0);
        CanonicalDirection<double>(L, offset).backward(L, offset, dL_ddir, dL_dL, dL_doffset);
        const auto loss = [&] { return dot(CanonicalDirection<double>(L, offset).dir, dL_ddir); };
        test::check_gradient(loss, test::scalars(L), test::scalars(dL_dL), {.tolerance = 1e-5});
        test::check_gradient(loss, test::scalars(offset), test::scalars(dL_doffset), {.tolerance = 1e-5});
    }
}

TEST_CASE_TEMPLATE("singular maps and a camera at the Gaussian give finite numbers", T, float, double) {
    // Two bones half a turn apart with equal weights collapse a plane onto an axis. The second map is zero.
    const mat3<T> collapsed(vec3<T>(1, 0, 0), vec3<T>(0, 0, 0), vec3<T>(0, 0, 0)), zero(T(0)), identity(T(1));
    const mat3<T> flat(vec3<T>(1, 0, 0), vec3<T>(0, 1, 0), vec3<T>(0, 0, 0));
    for (const mat3<T>& L : {collapsed, zero, identity, flat})
        for (const vec3<T>& offset : {vec3<T>(T(0)), vec3<T>(1, 2, 3), vec3<T>(T(1e-20))}) {
            const CanonicalDirection<T> direction(L, offset);
            mat3<T> dL_dL(T(0));
            vec3<T> dL_doffset(T(0));
            direction.backward(L, offset, vec3<T>(1, -1, 1), dL_dL, dL_doffset);
            CHECK(std::abs(length(direction.dir) - T(1)) < T(1e-6));
            for (int c = 0; c < 3; ++c)
                for (int r = 0; r < 3; ++r) CHECK(std::isfinite(dL_dL[c][r]));
            for (int k = 0; k < 3; ++k) CHECK(std::isfinite(dL_doffset[k]));
        }
}

TEST_CASE_TEMPLATE("SkinnedSplats::backward is the gradient of forward with respect to every input", D, Degree<0>,
                   Degree<1>, Degree<2>, Degree<3>, Degree<4>) {
    constexpr int degree = D::value;
    constexpr std::size_t basis = (degree + 1) * (degree + 1), count = 7;
    for (const std::size_t stride : {basis, basis + 2}) {
        Scene<double> scene(count, basis, stride, 5), gradient = scene;
        gradient.clear();
        cpu::Serial backend;
        const Skin<double, degree> skin(backend);
        typename Skin<double, degree>::Cache cache;
        SplatArrays<double> splats(count);
        const SplatArrays<double> dL_dsplats(count, 6);
        const auto loss = [&] {
            skin.forward(scene.input(), scene.bones, scene.center[0], splats.view(), cache);
            return inner(splats, dL_dsplats);
        };
        const auto backward = [&] {
            skin.backward(scene.input(), scene.bones, scene.center[0], dL_dsplats.view(), cache, gradient.view(),
                          gradient.bones, gradient.center);
        };
        backward();
        test::check_attribute_gradients(loss, scene, gradient);
        test::check_gradient(loss, test::scalars(scene.bones), test::scalars(gradient.bones));
        test::check_gradient(loss, test::scalars(scene.center), test::scalars(gradient.center),
                             {.may_vanish = degree == 0}); // colours do not depend on the direction

        const Scene<double> once = gradient;
        backward();
        for (std::size_t i = 0; i < count; ++i) {
            CHECK(gradient.means[i] == once.means[i] * 2.0);
            CHECK(gradient.log_scales[i] == once.log_scales[i] * 2.0);
            CHECK(gradient.quats[i].x == once.quats[i].x * 2.0);
            CHECK(gradient.logits[i] == once.logits[i] * 2.0);
            CHECK(gradient.ao[i] == once.ao[i] * 2.0);
        }
        for (std::size_t k = 0; k < gradient.sh.size(); ++k) CHECK(length(gradient.sh[k] - once.sh[k] * 2.0) < 1e-12);
        for (std::size_t j = 0; j < joint_count; ++j)
            CHECK(length(gradient.bones[j].translation - once.bones[j].translation * 2.0) < 1e-12);
        CHECK(gradient.center[0] == once.center[0] * 2.0);
    }
}

TEST_CASE("colours clamped below only keep their gradient above one") {
    Scene<double> scene(4, 9, 9, 7), gradient = scene;
    gradient.clear();
    cpu::Serial backend;
    const Skin<double> skin(backend, {.clamping = ColorClamp::below});
    Skin<double>::Cache cache;
    SplatArrays<double> splats(4);
    const SplatArrays<double> dL_dsplats(4, 8);
    const auto loss = [&] {
        skin.forward(scene.input(), scene.bones, scene.center[0], splats.view(), cache);
        return inner(splats, dL_dsplats);
    };
    skin.backward(scene.input(), scene.bones, scene.center[0], dL_dsplats.view(), cache, gradient.view(),
                  gradient.bones, gradient.center);
    test::check_gradient(loss, test::scalars(scene.sh), test::scalars(gradient.sh));
    CHECK(splats.colors[2].y > 1);
    CHECK(gradient.sh[2 * 9].y != 0);
}

TEST_CASE("ambient occlusion receives the loss times the colour before it, in full shadow and above white too") {
    constexpr std::size_t count = 33; // two registers and a remainder
    Scene<double> scene(count, 9, 9, 17), gradient = scene, lit = scene;
    for (std::size_t i = 0; i < count; ++i) scene.ao[i] = i % 4 ? scene.ao[i] : 0.0;
    std::fill(lit.ao.begin(), lit.ao.end(), 1.0);
    gradient.clear();
    cpu::Serial backend;
    const Skin<double> skin(backend);
    Skin<double>::Cache cache;
    SplatArrays<double> splats(count), unoccluded(count);
    const SplatArrays<double> dL_dsplats(count, 18);
    skin.forward(scene.input(), scene.bones, scene.center[0], splats.view(), cache);
    skin.forward(lit.input(), scene.bones, scene.center[0], unoccluded.view(), cache);
    skin.backward(scene.input(), scene.bones, scene.center[0], dL_dsplats.view(), cache, gradient.view(),
                  gradient.bones, gradient.center);
    for (std::size_t i = 0; i < count; ++i) {
        CHECK(length(splats.colors[i] - unoccluded.colors[i] * scene.ao[i]) < 1e-15);
        CHECK(gradient.ao[i] == doctest::Approx(dot(dL_dsplats.colors[i], unoccluded.colors[i])));
        if (scene.ao[i] == 0) CHECK(gradient.sh[9 * i] == vec3<double>(0)); // black, so the colour has no effect
        if (i % 3 == 2) CHECK(unoccluded.colors[i].y == 1);                 // clamped, but ao still has a gradient
    }
}

TEST_CASE("attributes that nobody asks for are left alone, the others do not change") {
    const std::size_t count = 9;
    Scene<double> scene(count, 9, 9, 9), all = scene, some = scene;
    all.clear(), some.clear();
    cpu::Serial backend;
    const Skin<double> skin(backend);
    Skin<double>::Cache cache;
    const SplatArrays<double> dL_dsplats(count, 10);
    skin.backward(scene.input(), scene.bones, scene.center[0], dL_dsplats.view(), cache, all.view(), all.bones,
                  all.center);
    skin.backward(scene.input(), scene.bones, scene.center[0], dL_dsplats.view(), cache,
                  SkinnedView<double>{.means = some.means});
    CHECK(some.means == all.means);
    CHECK(some.sh[0] == vec3<double>(0));
    // A Gaussian without influence on the loss adds nothing.
    SplatArrays<double> half = dL_dsplats;
    half.means[4] = half.colors[4] = vec3<double>(0), half.covariances[4] = {}, half.opacities[4] = 0;
    auto seen = scene;
    seen.clear();
    skin.backward(scene.input(), scene.bones, scene.center[0], half.view(), cache, seen.view(), seen.bones,
                  seen.center);
    CHECK(seen.means[4] == vec3<double>(0));
    CHECK(seen.ao[4] == 0);
    CHECK(seen.means[3] == all.means[3]);
    // Without ao the factor is 1.
    auto lit = scene, unlit = scene;
    std::fill(lit.ao.begin(), lit.ao.end(), 1.0);
    unlit.ao.clear();
    SplatArrays<double> a(count), b(count);
    skin.forward(lit.input(), scene.bones, scene.center[0], a.view(), cache);
    skin.forward(unlit.input(), scene.bones, scene.center[0], b.view(), cache);
    CHECK(a.colors == b.colors);
}

TEST_CASE("Threads equals Serial bit for bit; any size from none to beyond a chunk") {
    for (const std::size_t count : {0, 1, 2047, 2049, 7001}) {
        const Scene<float> scene(count, 9, 9, 13);
        const SplatArrays<float> dL_dsplats(count, 14);
        const auto run = [&](auto&& backend) {
            using B = std::remove_reference_t<decltype(backend)>;
            SplatArrays<float> splats(count);
            Scene<float> gradient = scene;
            gradient.clear();
            const Skin<float, 2, B> skin(backend);
            typename Skin<float, 2, B>::Cache cache;
            skin.forward(scene.input(), scene.bones, scene.center[0], splats.view(), cache);
            skin.backward(scene.input(), scene.bones, scene.center[0], dL_dsplats.view(), cache, gradient.view(),
                          gradient.bones, gradient.center);
            return std::pair(splats, gradient);
        };
        const auto equal = [](const auto& a, const auto& b) {
            return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(a[0])) == 0);
        };
        const auto [splats, gradient] = run(cpu::Serial());
        for (std::size_t threads : {1, 2, 3, 7}) {
            const auto [other_splats, other] = run(cpu::Threads(threads));
            CHECK(equal(splats.means, other_splats.means));
            CHECK(equal(splats.covariances, other_splats.covariances));
            CHECK(equal(splats.opacities, other_splats.opacities));
            CHECK(equal(splats.colors, other_splats.colors));
            CHECK(equal(gradient.means, other.means));
            CHECK(equal(gradient.quats, other.quats));
            CHECK(equal(gradient.log_scales, other.log_scales));
            CHECK(equal(gradient.logits, other.logits));
            CHECK(equal(gradient.sh, other.sh));
            CHECK(equal(gradient.ao, other.ao));
            CHECK(equal(gradient.bones, other.bones));
            CHECK(equal(gradient.center, other.center));
        }
    }
}

TEST_CASE("sizes that do not fit are refused") {
    Scene<double> scene(3, 9, 9, 15), gradient = scene;
    SplatArrays<double> splats(3);
    cpu::Serial backend;
    const Skin<double> skin(backend);
    Skin<double>::Cache cache;
    const auto forward = [&](auto break_it) {
        auto input = scene.input();
        auto out = splats.view();
        break_it(input, out);
        skin.forward(input, scene.bones, scene.center[0], out, cache);
    };
    const auto shorter = [](auto& span) { span = span.subspan(0, span.size() - 1); };
    CHECK_NOTHROW(forward([](auto&, auto&) {}));
    CHECK_THROWS_AS(forward([&](auto& in, auto&) { shorter(in.means); }), ShapeError);
    CHECK_THROWS_AS(forward([&](auto& in, auto&) { shorter(in.quats); }), ShapeError);
    CHECK_THROWS_AS(forward([&](auto& in, auto&) { shorter(in.log_scales); }), ShapeError);
    CHECK_THROWS_AS(forward([&](auto& in, auto&) { shorter(in.opacity_logits); }), ShapeError);
    CHECK_THROWS_AS(forward([&](auto& in, auto&) { shorter(in.sh); }), ShapeError);
    CHECK_THROWS_AS(forward([&](auto& in, auto&) { shorter(in.ao); }), ShapeError);
    CHECK_THROWS_AS(forward([&](auto& in, auto&) { shorter(in.weights.weights); }), ShapeError);
    CHECK_THROWS_AS(forward([&](auto& in, auto&) { shorter(in.weights.joints); }), ShapeError);
    CHECK_THROWS_AS(forward([&](auto& in, auto&) { in.sh_stride = 8; }), ValueError);
    CHECK_THROWS_AS(forward([&](auto&, auto& out) { shorter(out.means); }), ShapeError);
    CHECK_THROWS_AS(forward([&](auto&, auto& out) { shorter(out.covariances); }), ShapeError);
    CHECK_THROWS_AS(forward([&](auto&, auto& out) { shorter(out.opacities); }), ShapeError);
    CHECK_THROWS_AS(forward([&](auto&, auto& out) { shorter(out.colors); }), ShapeError);

    std::vector<vec3<double>> centers(2);
    const auto backward = [&](SkinnedView<double> view, Span<Affine<double>> bones, Span<vec3<double>> center) {
        skin.backward(scene.input(), scene.bones, scene.center[0], splats.view(), cache, view, bones, center);
    };
    CHECK_NOTHROW(backward(gradient.view(), gradient.bones, gradient.center));
    CHECK_THROWS_AS(backward(gradient.view(), Span<Affine<double>>(gradient.bones).subspan(0, 2), gradient.center),
                    ShapeError);
    CHECK_THROWS_AS(backward(gradient.view(), gradient.bones, centers), ShapeError);
    auto short_view = gradient.view();
    shorter(short_view.quats);
    CHECK_THROWS_AS(backward(short_view, gradient.bones, gradient.center), ShapeError);
}

} // namespace
} // namespace gsh
