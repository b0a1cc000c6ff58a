// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/sym.hpp>

#include "support/gradient.hpp"

using namespace gsh;

namespace {
sym3<double> random_sym(test::Rng& rng) {
    const vec3<double> a = rng.vec(), b = rng.vec();
    return {a.x, a.y, a.z, b.x, b.y, b.z};
}
double inner(const sym3<double>& a, const sym3<double>& b) {
    return a.xx * b.xx + a.xy * b.xy + a.xz * b.xz + a.yy * b.yy + a.yz * b.yz + a.zz * b.zz;
}
void check_equal(const mat3<double>& a, const mat3<double>& b) {
    for (int c = 0; c < 3; ++c)
        for (int r = 0; r < 3; ++r) CHECK(a[c][r] == doctest::Approx(b[c][r]).epsilon(1e-13));
}
} // namespace

TEST_CASE("packed products are the full products") {
    test::Rng rng(1);
    const mat3<double> m(rng.vec(), rng.vec(), rng.vec());
    const sym3<double> s = random_sym(rng);
    check_equal(full_matrix(gram(m)), m * transpose(m));
    check_equal(full_matrix(congruence(m, s)), m * full_matrix(s) * transpose(m));
    const sym2<double> two{3, 0.5, 2};
    CHECK(determinant(two) == 5.75);
}

TEST_CASE("full_gradient pairs with a symmetric change as the packed gradient does") {
    test::Rng rng(2);
    const sym3<double> g = random_sym(rng), ds = random_sym(rng);
    const mat3<double> G = full_gradient(g), dS = full_matrix(ds);
    CHECK(dot(G[0], dS[0]) + dot(G[1], dS[1]) + dot(G[2], dS[2]) == doctest::Approx(inner(g, ds)));
}

TEST_CASE("gram_backward and congruence_backward are gradients, and add") {
    test::Rng rng(3);
    mat3<double> m(rng.vec(), rng.vec(), rng.vec()), dL_dm(0.0);
    sym3<double> s = random_sym(rng), dL_ds{};
    const sym3<double> weight = random_sym(rng);
    gram_backward(m, weight, dL_dm);
    test::check_gradient([&] { return inner(gram(m), weight); }, test::scalars(m), test::scalars(dL_dm));

    const mat3<double> first = dL_dm; // congruence adds to this
    congruence_backward(m, s, weight, dL_dm, dL_ds);
    dL_dm -= first;
    const auto loss = [&] { return inner(congruence(m, s), weight); };
    test::check_gradient(loss, test::scalars(m), test::scalars(dL_dm));
    test::check_gradient(loss, test::scalars(s), test::scalars(dL_ds));

    const sym3<double> once = dL_ds;
    congruence_backward(m, s, weight, dL_dm, dL_ds);
    CHECK(dL_ds.xy == 2 * once.xy);
    CHECK(dL_ds.zz == 2 * once.zz);
}
