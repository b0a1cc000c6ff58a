// SPDX-License-Identifier: Apache-2.0
/// @file  Central differences, with which all adjoints are compared.
#pragma once

#include <doctest/doctest.h>

#include <gsh/core/span.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/sym.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

namespace gsh::test {

/// Random numbers in the shapes that tests need.
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
    double tolerance = 1e-6;  ///< relative to the gradient: the element or the group, whichever is larger
    std::size_t stride = 1;   ///< check every stride-th number
    bool may_vanish = false;  ///< accept zeros, which otherwise fail, because comparing zeros checks nothing
    std::vector<std::size_t> elements = {}; ///< if not empty, check these numbers and ignore the stride
};

/// Checks dL_dx against (loss(x + h) - loss(x - h)) / 2h for each number of x. Afterwards x is unchanged.
///
/// The permitted error of an element is the tolerance times its own size or the root mean square of the checked
/// elements, whichever is larger. Small gradients are therefore checked as strictly as large ones. The rounding of the
/// two losses is permitted in addition, a few units in their last place.
template <class Loss>
void check_gradient(const Loss& loss, Span<double> x, Span<const double> dL_dx, GradientCheck options = {}) {
    REQUIRE(x.size() == dL_dx.size());
    std::vector<std::size_t> elements = std::move(options.elements);
    if (elements.empty())
        for (std::size_t i = 0; i < x.size(); i += options.stride) elements.push_back(i);
    if (elements.empty()) return;
    std::vector<double> differences;
    double largest_loss = 0, sum_of_squares = 0;
    for (const std::size_t i : elements) {
        REQUIRE(i < x.size());
        const double kept = x[i];
        x[i] = kept + options.step;
        const double above = loss();
        x[i] = kept - options.step;
        const double below = loss();
        x[i] = kept;
        differences.push_back((above - below) / (2 * options.step));
        largest_loss = std::max({largest_loss, std::abs(above), std::abs(below)});
        sum_of_squares += differences.back() * differences.back();
    }
    const double size = std::sqrt(sum_of_squares / static_cast<double>(elements.size()));
    const double rounding = 4 * std::numeric_limits<double>::epsilon() * largest_loss / options.step;
    INFO("root mean square of the checked elements " << size << ", rounding of the differences " << rounding);
    CHECK((size > rounding || options.may_vanish));
    for (std::size_t k = 0; k < elements.size(); ++k) {
        const double found = dL_dx[elements[k]], expected = differences[k];
        INFO("element " << elements[k] << ": adjoint " << found << ", central difference " << expected);
        CHECK(std::abs(found - expected) <= options.tolerance * std::max(size, std::abs(expected)) + rounding);
    }
}

/// About `count` elements of a learned array, evenly spread. Of a table with rows of `width` numbers only those rows
/// are taken that are read, because the others have no gradient. `rows` is null for an array that is not a table.
template <class Rows>
std::vector<std::size_t> spread_elements(std::size_t size, const Rows* rows, std::size_t width, std::size_t count) {
    const std::size_t candidates = rows ? rows->size() * width : size;
    std::vector<std::size_t> elements;
    for (std::size_t i = 0; i < candidates; i += (candidates / count) | 1) // odd, so that all columns occur
        elements.push_back(rows ? (*rows)[i / width] * width + i % width : i);
    return elements;
}

} // namespace gsh::test
