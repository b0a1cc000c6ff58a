// SPDX-License-Identifier: Apache-2.0
#include <gsh/field/frequency.hpp>

#include "support/gradient.hpp"

#include <numbers>

using namespace gsh;

TEST_CASE("FrequencyEncoding gives pairs of doubling frequency, then t") {
    double features[9];
    FrequencyEncoding<4>::forward(0.3, features);
    for (int i = 0; i < 4; ++i) {
        CHECK(features[2 * i] == doctest::Approx(std::sin(std::pow(2, i) * std::numbers::pi * 0.3)));
        CHECK(features[2 * i + 1] == doctest::Approx(std::cos(std::pow(2, i) * std::numbers::pi * 0.3)));
    }
    CHECK(features[8] == 0.3);
    static_assert(FrequencyEncoding<4>::output_count == 9);
    static_assert(FrequencyEncoding<0>::output_count == 1);
    FrequencyEncoding<0>::forward(0.7, features);
    CHECK(features[0] == 0.7);
}

TEST_CASE("FrequencyEncoding::backward is the gradient of forward and adds") {
    using Encoding = FrequencyEncoding<4>;
    test::Rng rng(1);
    double t = 0.37, dL_dt = 0;
    const auto dL_dfeatures = rng.numbers(Encoding::output_count);
    const auto loss = [&] {
        double features[Encoding::output_count], sum = 0;
        Encoding::forward(t, features);
        for (int i = 0; i < Encoding::output_count; ++i) sum += features[i] * dL_dfeatures[i];
        return sum;
    };
    Encoding::backward(t, dL_dfeatures.data(), dL_dt);
    test::check_gradient(loss, {&t, 1}, {&dL_dt, 1});
    const double once = dL_dt;
    dL_dt = 0;
    Encoding::backward(t, dL_dfeatures.data(), dL_dt);
    Encoding::backward(t, dL_dfeatures.data(), dL_dt);
    CHECK(dL_dt == doctest::Approx(2 * once));
}
