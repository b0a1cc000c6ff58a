// SPDX-License-Identifier: Apache-2.0
/// @file  Central differences: the judge of every adjoint.
#pragma once

#include <doctest/doctest.h>

#include <gsh/core/span.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/sym.hpp>
#include <gsh/math/vec.hpp>

#include <cmath>
#include <cstddef>
#include <vector>

namespace gsh::test {

/// Random numbers with the shapes tests ask for.
class Rng : public gsh::Rng {
public:
    using gsh::Rng::Rng;

    vec3<double> vec(double low = -1, double high = 1) {
        const double x = uniform(low, high), y = uniform(low, high), z = uniform(low, high);
        return {x, y, z};
    }
    gsh::quat<double> quat() {
        const double w = normal(), x = normal(), y = normal(), z = normal();
        return {w, x, y, z};
    }
    std::vector<vec3<double>> vecs(std::size_t count, double low = -1, double high = 1) {
        std::vector<vec3<double>> values(count);
        for (auto& value : values) value = vec(low, high);
        return values;
    }
    std::vector<double> numbers(std::size_t count, double low = -1, double high = 1) {
        std::vector<double> values(count);
        for (auto& value : values) value = uniform(low, high);
        return values;
    }
};

/// The doubles that an object or an array of objects is made of.
template <class T>
Span<double> scalars(std::vector<T>& values) {
    return {reinterpret_cast<double*>(values.data()), values.size() * sizeof(T) / sizeof(double)};
}
template <class T>
    requires std::is_trivially_copyable_v<T>
Span<double> scalars(T& value) {
    return {reinterpret_cast<double*>(&value), sizeof(T) / sizeof(double)};
}

struct GradientCheck {
    double step = 6e-6;       ///< about the cube root of the machine epsilon
    double tolerance = 1e-6;  ///< relative to max(1, |gradient|)
    std::size_t stride = 1;   ///< check every stride-th number
};

/// Checks dL_dx against (loss(x + h) - loss(x - h)) / 2h for each number of x, which is left as it was.
template <class Loss>
void check_gradient(const Loss& loss, Span<double> x, Span<const double> dL_dx, GradientCheck options = {}) {
    REQUIRE(x.size() == dL_dx.size());
    for (std::size_t i = 0; i < x.size(); i += options.stride) {
        const double kept = x[i];
        x[i] = kept + options.step;
        const double above = loss();
        x[i] = kept - options.step;
        const double below = loss();
        x[i] = kept;
        const double expected = (above - below) / (2 * options.step);
        INFO("element " << i << ": adjoint " << dL_dx[i] << ", central difference " << expected);
        CHECK(std::abs(dL_dx[i] - expected) <= options.tolerance * std::max(1.0, std::abs(expected)));
    }
}

} // namespace gsh::test
