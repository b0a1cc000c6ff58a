// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/activation.hpp>

#include "support/gradient.hpp"

using namespace gsh;

TEST_CASE("sigmoid, logit and exp have their gradients, and add them") {
    for (double x : {-8.0, -1.3, 0.0, 0.4, 6.0}) {
        INFO("x " << x);
        const double dL_dy = 1.7;
        double dL_dx = 0;
        sigmoid_backward(sigmoid(x), dL_dy, dL_dx);
        test::check_gradient([&] { return dL_dy * sigmoid(x); }, test::scalars(x), test::scalars(dL_dx));
        const double once = dL_dx;
        sigmoid_backward(sigmoid(x), dL_dy, dL_dx);
        CHECK(dL_dx == 2 * once);

        dL_dx = 0;
        exp_backward(exp(x), dL_dy, dL_dx);
        test::check_gradient([&] { return dL_dy * exp(x); }, test::scalars(x), test::scalars(dL_dx));
    }
    for (double p : {0.01, 0.2, 0.5, 0.97}) {
        INFO("p " << p);
        double dL_dp = 0;
        logit_backward(p, 0.8, dL_dp);
        test::check_gradient([&] { return 0.8 * logit(p); }, test::scalars(p), test::scalars(dL_dp),
                             {.step = 1e-7, .tolerance = 1e-5});
        CHECK(sigmoid(logit(p)) == doctest::Approx(p).epsilon(1e-14));
    }
}

TEST_CASE("sigmoid saturates without a NaN") {
    CHECK(sigmoid(-1000.0) == 0);
    CHECK(sigmoid(1000.0) == 1);
    CHECK(sigmoid(-200.0f) == 0);
    CHECK(sigmoid(200.0f) == 1);
    CHECK(sigmoid(0.0) == 0.5);
}
