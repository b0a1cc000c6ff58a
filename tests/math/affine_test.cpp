// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/affine.hpp>

#include "support/linear.hpp"

using namespace gsh;

TEST_CASE("a product applies its right factor first") {
    test::Rng rng(1);
    const Affine<double> a = test::random_affine(rng), b = test::random_affine(rng);
    const vec3<double> p = rng.vec();
    CHECK(length((a * b)(p) - a(b(p))) < 1e-14);
    CHECK(Affine<double>{}(p) == p);
    CHECK(Affine<double>::zero()(p) == vec3<double>(0.0));
}

TEST_CASE("product_backward is the gradient of the product, and adds") {
    test::Rng rng(2);
    Affine<double> a = test::random_affine(rng), b = test::random_affine(rng);
    const Affine<double> weight = test::random_affine(rng);
    Affine<double> dL_da = Affine<double>::zero(), dL_db = Affine<double>::zero();
    product_backward(a, b, weight, dL_da, dL_db);
    const auto loss = [&] { return test::inner(a * b, weight); };
    test::check_gradient(loss, test::scalars(a), test::scalars(dL_da));
    test::check_gradient(loss, test::scalars(b), test::scalars(dL_db));

    Affine<double> twice_a = dL_da, twice_b = dL_db;
    product_backward(a, b, weight, twice_a, twice_b);
    dL_da.add_scaled(dL_da, 1), dL_db.add_scaled(dL_db, 1);
    for (std::size_t i = 0; i < 12; ++i) {
        CHECK(test::scalars(twice_a)[i] == doctest::Approx(test::scalars(dL_da)[i]).epsilon(1e-14));
        CHECK(test::scalars(twice_b)[i] == doctest::Approx(test::scalars(dL_db)[i]).epsilon(1e-14));
    }
}

TEST_CASE("apply_backward is the gradient of the map's value") {
    test::Rng rng(3);
    Affine<double> map = test::random_affine(rng), dL_dmap = Affine<double>::zero();
    vec3<double> p = rng.vec(), dL_dp(0.0);
    const vec3<double> weight = rng.vec();
    apply_backward(map, p, weight, dL_dmap, dL_dp);
    const auto loss = [&] { return dot(map(p), weight); };
    test::check_gradient(loss, test::scalars(map), test::scalars(dL_dmap));
    test::check_gradient(loss, test::scalars(p), test::scalars(dL_dp));
}
