// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/cpu/sum.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/gaussian/cpu/static_gaussian.hpp>
#include <gsh/gaussian/static_gaussian.hpp>

#include "support/gradient.hpp"

#include <cstring>
#include <utility>

using namespace gsh;

namespace {

template <class T>
GaussianCloud<T> random_cloud(std::size_t count, int degree) {
    test::Rng rng(5);
    GaussianCloud<T> cloud(count, degree);
    for (auto& mean : cloud.means) mean = vec3<T>(rng.vec());
    for (auto& q : cloud.quats) {
        const quat<double> r = rng.quat();
        q = {T(r.w), T(r.x), T(r.y), T(r.z)};
    }
    for (auto& s : cloud.log_scales) s = vec3<T>(rng.vec(-2, 0));
    for (auto& o : cloud.opacity_logits) o = T(rng.uniform(-2, 2));
    for (auto& c : cloud.sh) c = vec3<T>(rng.vec(-0.05, 0.05)); // colours stay inside the clamp
    return cloud;
}

template <class T>
Splats<cpu::Serial, T> random_gradient(std::size_t count) {
    test::Rng rng(6);
    Splats<cpu::Serial, T> dL_dsplats;
    dL_dsplats.resize(count);
    for (auto& v : dL_dsplats.means) v = vec3<T>(rng.vec());
    for (auto& v : dL_dsplats.covariances) {
        const vec3<double> a = rng.vec(), b = rng.vec();
        v = {T(a.x), T(a.y), T(a.z), T(b.x), T(b.y), T(b.z)};
    }
    for (auto& v : dL_dsplats.opacities) v = T(rng.uniform(-1, 1));
    for (auto& v : dL_dsplats.colors) v = vec3<T>(rng.vec());
    return dL_dsplats;
}

template <class T>
bool same_bits(Span<const T> a, Span<const T> b) {
    return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

constexpr auto same_cloud = [](const auto& a, const auto& b) {
    using C = std::remove_cvref_t<decltype(a)>;
    using V3 = typename decltype(C::means)::value_type;
    using Q = typename decltype(C::quats)::value_type;
    using T = typename decltype(C::opacity_logits)::value_type;
    return same_bits<V3>(a.means, b.means) && same_bits<Q>(a.quats, b.quats) &&
           same_bits<V3>(a.log_scales, b.log_scales) && same_bits<T>(a.opacity_logits, b.opacity_logits) &&
           same_bits<V3>(a.sh, b.sh);
};

template <class T>
GaussianCloud<T> zero_cloud(std::size_t count, int degree) {
    GaussianCloud<T> cloud(count, degree);
    for (auto& q : cloud.quats) q.w = T(0);
    return cloud;
}

} // namespace

TEST_CASE("StaticSplats::backward is the gradient of forward, and adds") {
    constexpr int degree = 3;
    constexpr std::size_t count = 3;
    auto cloud = random_cloud<double>(count, degree);
    vec3<double> center(0.3, -0.2, -4);
    auto weight = random_gradient<double>(count);
    cpu::Serial backend;
    const StaticSplats<cpu::Serial, degree, double> to_splats(backend);
    StaticSplats<cpu::Serial, degree, double>::Cache cache;
    Splats<cpu::Serial, double> splats;
    splats.resize(count);
    const auto loss = [&] {
        to_splats.forward(cloud.view(), center, splats.view(), cache);
        double sum = 0;
        for (std::size_t i = 0; i < count; ++i) {
            const sym3<double>&s = splats.covariances[i], &w = weight.covariances[i];
            sum += dot(splats.means[i], weight.means[i]) + dot(splats.colors[i], weight.colors[i]) +
                   splats.opacities[i] * weight.opacities[i] + s.xx * w.xx + s.xy * w.xy + s.xz * w.xz + s.yy * w.yy +
                   s.yz * w.yz + s.zz * w.zz;
        }
        return sum;
    };
    auto gradient = zero_cloud<double>(count, degree);
    std::vector<vec3<double>> dL_dcenter(1, vec3<double>(0.0));
    to_splats.backward(cloud.view(), center, weight.view(), cache, gradient.view(), dL_dcenter);
    test::check_gradient(loss, test::scalars(cloud.means), test::scalars(gradient.means));
    test::check_gradient(loss, test::scalars(cloud.quats), test::scalars(gradient.quats));
    test::check_gradient(loss, test::scalars(cloud.log_scales), test::scalars(gradient.log_scales));
    test::check_gradient(loss, test::scalars(cloud.opacity_logits), test::scalars(gradient.opacity_logits));
    test::check_gradient(loss, test::scalars(cloud.sh), test::scalars(gradient.sh));
    test::check_gradient(loss, test::scalars(center), test::scalars(dL_dcenter));

    auto twice = gradient;
    const vec3<double> center_once = dL_dcenter[0];
    to_splats.backward(cloud.view(), center, weight.view(), cache, twice.view(), dL_dcenter);
    for (std::size_t i = 0; i < count; ++i) {
        CHECK(length(twice.means[i] - gradient.means[i] * 2.0) < 1e-13);
        CHECK(length(twice.log_scales[i] - gradient.log_scales[i] * 2.0) < 1e-13);
        CHECK(twice.quats[i].x == doctest::Approx(2 * gradient.quats[i].x).epsilon(1e-13));
        CHECK(twice.opacity_logits[i] == 2 * gradient.opacity_logits[i]);
        CHECK(twice.sh[i] == gradient.sh[i] * 2.0);
    }
    CHECK(length(dL_dcenter[0] - center_once * 2.0) < 1e-13);
}

TEST_CASE("by factors: F Fᵀ is the covariance, and backward is the gradient") {
    constexpr int degree = 1;
    constexpr std::size_t count = 3;
    auto cloud = random_cloud<double>(count, degree);
    const vec3<double> center(0.3, -0.2, -4);
    cpu::Serial backend;
    const StaticSplats<cpu::Serial, degree, double> to_splats(backend);
    StaticSplats<cpu::Serial, degree, double>::Cache cache;
    Splats<cpu::Serial, double> plain, splats, weight = random_gradient<double>(count);
    plain.resize(count), splats.resize(count, true);
    weight.resize(count, true);
    test::Rng rng(8);
    for (auto& F : weight.factors)
        for (int c = 0; c < 3; ++c) F[c] = rng.vec();
    to_splats.forward(cloud.view(), center, plain.view(), cache);
    const auto loss = [&] {
        to_splats.forward(cloud.view(), center, splats.view(), cache);
        double sum = 0;
        for (std::size_t i = 0; i < count; ++i) {
            sum += dot(splats.means[i], weight.means[i]) + dot(splats.colors[i], weight.colors[i]) +
                   splats.opacities[i] * weight.opacities[i];
            for (int c = 0; c < 3; ++c) sum += dot(splats.factors[i][c], weight.factors[i][c]);
        }
        return sum;
    };
    (void)loss();
    for (std::size_t i = 0; i < count; ++i) {
        const sym3<double> found = gram(splats.factors[i]), &expected = plain.covariances[i];
        CHECK(found.xx == doctest::Approx(expected.xx).epsilon(1e-14));
        CHECK(found.xz == doctest::Approx(expected.xz).epsilon(1e-12));
        CHECK(splats.colors[i] == plain.colors[i]);
    }
    auto gradient = zero_cloud<double>(count, degree);
    to_splats.backward(cloud.view(), center, weight.view(), cache, gradient.view());
    test::check_gradient(loss, test::scalars(cloud.means), test::scalars(gradient.means));
    test::check_gradient(loss, test::scalars(cloud.quats), test::scalars(gradient.quats));
    test::check_gradient(loss, test::scalars(cloud.log_scales), test::scalars(gradient.log_scales));
    CHECK(is_zero(std::as_const(weight).view(), 0) == false);
    fill_zero(backend, weight.view());
    CHECK(is_zero(std::as_const(weight).view(), 0));
}

TEST_CASE("Threads equals Serial bit for bit at any thread count and size") {
    const vec3<float> center(0.1f, 0.2f, -3);
    for (const std::size_t count : {0, 1, 513, 5001}) {
        const auto cloud = random_cloud<float>(count, 2);
        const auto dL_dsplats = random_gradient<float>(count);
        const auto run = [&](auto& backend, auto& splats, auto& gradient, auto& dL_dcenter) {
            using B = std::remove_reference_t<decltype(backend)>;
            const StaticSplats<B, 2> to_splats(backend);
            typename StaticSplats<B, 2>::Cache cache;
            splats.resize(count);
            to_splats.forward(cloud.view(), center, splats.view(), cache);
            to_splats.backward(cloud.view(), center, dL_dsplats.view(), cache, gradient.view(), dL_dcenter);
        };
        cpu::Serial serial;
        Splats<cpu::Serial, float> expected;
        auto expected_gradient = zero_cloud<float>(count, 2);
        std::vector<vec3<float>> expected_center(1, vec3<float>(0.0f));
        run(serial, expected, expected_gradient, expected_center);
        for (const std::size_t threads : {1, 2, 3, 7}) {
            cpu::Threads backend(threads);
            Splats<cpu::Threads, float> splats;
            auto gradient = zero_cloud<float>(count, 2);
            std::vector<vec3<float>> dL_dcenter(1, vec3<float>(0.0f));
            run(backend, splats, gradient, dL_dcenter);
            CHECK(same_cloud(gradient, expected_gradient));
            CHECK(same_bits<vec3<float>>(dL_dcenter, expected_center));
            CHECK(same_bits<sym3<float>>(splats.covariances, expected.covariances));
            CHECK(same_bits<vec3<float>>(splats.colors, expected.colors));
            CHECK(same_bits<float>(splats.opacities, expected.opacities));
        }
    }
}

TEST_CASE("blocks of lanes give each Gaussian its own result, also where some have no gradient") {
    for (const std::size_t count : {1, 7, 37}) {
        CAPTURE(count);
        const auto cloud = random_cloud<double>(count, 3);
        auto dL_dsplats = random_gradient<double>(count);
        for (std::size_t i = 0; i < count; i += 3) { // nothing sees every third one
            dL_dsplats.means[i] = dL_dsplats.colors[i] = vec3<double>(0.0);
            dL_dsplats.covariances[i] = {};
            dL_dsplats.opacities[i] = 0;
        }
        const vec3<double> center(0.3, -0.2, -4);
        cpu::Serial backend;
        const StaticSplats<cpu::Serial, 3, double> to_splats(backend);
        StaticSplats<cpu::Serial, 3, double>::Cache cache;
        Splats<cpu::Serial, double> splats, expected;
        splats.resize(count), expected.resize(count);
        auto gradient = zero_cloud<double>(count, 3), expected_gradient = gradient;
        std::vector<vec3<double>> dL_dcenter(1, vec3<double>(0.0)), dL_dcenters(count, vec3<double>(9));
        to_splats.forward(cloud.view(), center, splats.view(), cache);
        to_splats.backward(cloud.view(), center, dL_dsplats.view(), cache, gradient.view(), dL_dcenter);

        const detail::StaticInput<3, double> input{cloud.view(), center};
        const auto clamping = to_splats.params().clamping;
        const detail::StaticSplatForward<3, double> forward{input, clamping, expected.view()};
        const detail::StaticSplatBackward<3, double> backward{input, clamping, dL_dsplats.view(),
                                                              expected_gradient.view(), dL_dcenters};
        vec3<double> sum(0.0);
        for (std::size_t i = 0; i < count; ++i) {
            forward(i), backward(i);
            sum += dL_dcenters[i];
            CHECK(length(splats.colors[i] - expected.colors[i]) < 1e-12);
            CHECK(splats.opacities[i] == doctest::Approx(expected.opacities[i]).epsilon(1e-12));
            CHECK(splats.covariances[i].xy == doctest::Approx(expected.covariances[i].xy).epsilon(1e-12));
            CHECK(length(gradient.means[i] - expected_gradient.means[i]) < 1e-12);
            CHECK(length(gradient.log_scales[i] - expected_gradient.log_scales[i]) < 1e-12);
            CHECK(gradient.quats[i].z == doctest::Approx(expected_gradient.quats[i].z).epsilon(1e-11));
            CHECK(gradient.opacity_logits[i] == doctest::Approx(expected_gradient.opacity_logits[i]).epsilon(1e-12));
            for (std::size_t k = 0; k < 16; ++k)
                CHECK(length(gradient.sh[16 * i + k] - expected_gradient.sh[16 * i + k]) < 1e-12);
            if (i % 3 == 0) CHECK(gradient.means[i] == vec3<double>(0.0));
        }
        CHECK(length(dL_dcenter[0] - sum) < 1e-12);
    }
}

TEST_CASE("empty gradients are left alone, the others do not change for it") {
    const auto cloud = random_cloud<double>(4, 1);
    const auto dL_dsplats = random_gradient<double>(4);
    cpu::Serial backend;
    const StaticSplats<cpu::Serial, 1, double> to_splats(backend);
    StaticSplats<cpu::Serial, 1, double>::Cache cache;
    auto all = zero_cloud<double>(4, 1), some = all;
    some.quats.clear(), some.sh.clear();
    const vec3<double> center(0, 0, -3);
    to_splats.backward(cloud.view(), center, dL_dsplats.view(), cache, all.view());
    to_splats.backward(cloud.view(), center, dL_dsplats.view(), cache, some.view());
    CHECK(some.means == all.means);
    CHECK(some.log_scales == all.log_scales);
    CHECK(some.sh.empty());
}

TEST_CASE("a Gaussian at the camera's centre makes no NaN") {
    auto cloud = random_cloud<double>(1, 2);
    const vec3<double> center = cloud.means[0];
    cpu::Serial backend;
    const StaticSplats<cpu::Serial, 2, double> to_splats(backend);
    StaticSplats<cpu::Serial, 2, double>::Cache cache;
    Splats<cpu::Serial, double> splats;
    splats.resize(1);
    to_splats.forward(cloud.view(), center, splats.view(), cache);
    CHECK(std::isfinite(splats.colors[0].x));
    auto gradient = zero_cloud<double>(1, 2);
    to_splats.backward(cloud.view(), center, random_gradient<double>(1).view(), cache, gradient.view());
    CHECK(std::isfinite(gradient.means[0].x));
}

TEST_CASE("sizes and degrees are checked") {
    cpu::Serial backend;
    const StaticSplats<cpu::Serial, 1, double> to_splats(backend);
    StaticSplats<cpu::Serial, 1, double>::Cache cache;
    auto cloud = random_cloud<double>(2, 1);
    Splats<cpu::Serial, double> splats;
    splats.resize(2);
    const vec3<double> center(0.0);
    const StaticSplats<cpu::Serial, 2, double> of_degree_2(backend);
    CHECK_THROWS_WITH_AS(of_degree_2.forward(cloud.view(), center, splats.view(), cache),
                         "StaticSplats::forward: sh_degree is 1, expected 2; choose the template's degree with "
                         "with_sh_degree",
                         ShapeError);
    for (const int which : {0, 1, 2, 3}) {
        Splats<cpu::Serial, double> wrong;
        wrong.resize(2);
        if (which == 0) wrong.means.resize(1);
        if (which == 1) wrong.covariances.resize(1);
        if (which == 2) wrong.opacities.resize(1);
        if (which == 3) wrong.colors.resize(1);
        CHECK_THROWS_AS(to_splats.forward(cloud.view(), center, wrong.view(), cache), ShapeError);
        auto gradient = zero_cloud<double>(2, 1);
        CHECK_THROWS_AS(to_splats.backward(cloud.view(), center, wrong.view(), cache, gradient.view()), ShapeError);
    }
    auto gradient = zero_cloud<double>(2, 1), other = zero_cloud<double>(3, 1), higher = zero_cloud<double>(2, 2);
    std::vector<vec3<double>> two(2);
    const auto backward = [&](auto& out, Span<vec3<double>> dL_dcenter) {
        to_splats.backward(cloud.view(), center, splats.view(), cache, out.view(), dL_dcenter);
    };
    CHECK_THROWS_AS(backward(other, {}), ShapeError);
    CHECK_THROWS_AS(backward(higher, {}), ShapeError);
    CHECK_THROWS_AS(backward(gradient, two), ShapeError);
    cloud.quats.pop_back();
    CHECK_THROWS_AS(to_splats.forward(cloud.view(), center, splats.view(), cache), ShapeError);
}
