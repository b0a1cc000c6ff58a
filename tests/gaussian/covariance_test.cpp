// SPDX-License-Identifier: Apache-2.0
#include <gsh/gaussian/covariance.hpp>
#include <gsh/math/rotation.hpp>

#include "support/gradient.hpp"

using namespace gsh;

namespace {
double inner(const sym3<double>& a, const sym3<double>& b) {
    return a.xx * b.xx + a.xy * b.xy + a.xz * b.xz + a.yy * b.yy + a.yz * b.yz + a.zz * b.zz;
}
} // namespace

TEST_CASE("covariance_backward is the gradient of covariance, and adds") {
    test::Rng rng(1);
    for (int trial = 0; trial < 5; ++trial) {
        quat<double> q = rng.quat(), dL_dq{0, 0, 0, 0};
        vec3<double> log_scale = rng.vec(-1, 0.5), dL_dlog_scale(0.0);
        const vec3<double> a = rng.vec(), b = rng.vec();
        const sym3<double> weight{a.x, a.y, a.z, b.x, b.y, b.z};
        const auto loss = [&] { return inner(covariance(q, log_scale), weight); };
        covariance_backward(q, log_scale, weight, dL_dq, dL_dlog_scale);
        test::check_gradient(loss, test::scalars(q), test::scalars(dL_dq));
        test::check_gradient(loss, test::scalars(log_scale), test::scalars(dL_dlog_scale));

        const quat<double> once = dL_dq;
        const vec3<double> once_scale = dL_dlog_scale;
        covariance_backward(q, log_scale, weight, dL_dq, dL_dlog_scale);
        CHECK(dL_dq.w == doctest::Approx(2 * once.w).epsilon(1e-14));
        CHECK(dL_dq.z == doctest::Approx(2 * once.z).epsilon(1e-14));
        CHECK(length(dL_dlog_scale - once_scale * 2.0) < 1e-13);
    }
}

TEST_CASE("covariance_factor_backward is the gradient of covariance_factor, and adds") {
    test::Rng rng(5);
    quat<double> q = rng.quat(), dL_dq{0, 0, 0, 0};
    vec3<double> log_scale = rng.vec(-1, 0.5), dL_dlog_scale(0.0);
    const mat3<double> weight(rng.vec(), rng.vec(), rng.vec());
    const auto loss = [&] {
        const mat3<double> F = covariance_factor(q, log_scale);
        return dot(F[0], weight[0]) + dot(F[1], weight[1]) + dot(F[2], weight[2]);
    };
    covariance_factor_backward(q, log_scale, weight, dL_dq, dL_dlog_scale);
    test::check_gradient(loss, test::scalars(q), test::scalars(dL_dq));
    test::check_gradient(loss, test::scalars(log_scale), test::scalars(dL_dlog_scale));
    const double once = dL_dq.y;
    covariance_factor_backward(q, log_scale, weight, dL_dq, dL_dlog_scale);
    CHECK(dL_dq.y == 2 * once);
}

TEST_CASE("scaled_rotation is covariance_factor of the logarithms, and its adjoint adds") {
    test::Rng rng(6);
    quat<double> q = rng.quat(), dL_dq{0, 0, 0, 0};
    vec3<double> scale = rng.vec(0.1, 2), dL_dscale(0.0);
    const mat3<double> weight(rng.vec(), rng.vec(), rng.vec());
    const auto loss = [&] {
        const mat3<double> F = scaled_rotation(q, scale);
        return dot(F[0], weight[0]) + dot(F[1], weight[1]) + dot(F[2], weight[2]);
    };
    const mat3<double> F = covariance_factor(q, vec3<double>(log(scale.x), log(scale.y), log(scale.z)));
    for (int k = 0; k < 3; ++k) CHECK(length(scaled_rotation(q, scale)[k] - F[k]) < 1e-14);
    scaled_rotation_backward(q, scale, weight, dL_dq, dL_dscale);
    test::check_gradient(loss, test::scalars(q), test::scalars(dL_dq));
    test::check_gradient(loss, test::scalars(scale), test::scalars(dL_dscale));
    const double once = dL_dq.y, once_scale = dL_dscale.y;
    scaled_rotation_backward(q, scale, weight, dL_dq, dL_dscale);
    CHECK(dL_dq.y == 2 * once);
    CHECK(dL_dscale.y == 2 * once_scale);
}

TEST_CASE("the eigenvalues of a covariance are its squared scales") {
    test::Rng rng(2);
    const vec3<double> log_scale(-1, 0.2, 0.7);
    const quat<double> q = rng.quat();
    const mat3<double> S = full_matrix(covariance(q, log_scale)), R = rotation_from_quat(q);
    for (int k = 0; k < 3; ++k) CHECK(length(S * R[k] - R[k] * std::exp(2 * log_scale[k])) < 1e-14);

    const sym3<double> upright = covariance(quat<double>{}, log_scale);
    CHECK(upright.xx == doctest::Approx(std::exp(-2.0)));
    CHECK(upright.yy == doctest::Approx(std::exp(0.4)));
    CHECK(upright.zz == doctest::Approx(std::exp(1.4)));
    CHECK(upright.xy == 0);
}

TEST_CASE("an isotropic Gaussian does not feel its rotation") {
    test::Rng rng(3);
    const quat<double> q = rng.quat();
    quat<double> dL_dq{0, 0, 0, 0};
    vec3<double> dL_dlog_scale(0.0);
    covariance_backward(q, vec3<double>(-0.5), sym3<double>{1, 2, 3, 4, 5, 6}, dL_dq, dL_dlog_scale);
    CHECK(dot(dL_dq, dL_dq) < 1e-28);
}

TEST_CASE("a linear map of space acts on the factor") {
    test::Rng rng(4);
    const quat<double> q = rng.quat();
    const vec3<double> s = rng.vec();
    const mat3<double> M(rng.vec(), rng.vec(), rng.vec());
    const sym3<double> mapped = gram(M * covariance_factor(q, s)), expected = congruence(M, covariance(q, s));
    CHECK(mapped.xx == doctest::Approx(expected.xx).epsilon(1e-13));
    CHECK(mapped.yz == doctest::Approx(expected.yz).epsilon(1e-13));
}
