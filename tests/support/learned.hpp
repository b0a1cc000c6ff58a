// SPDX-License-Identifier: Apache-2.0
/// @file  Learned arrays by their names, and their gradients against central differences.
#pragma once

#include <gsh/backend/serial.hpp>
#include <gsh/core/span.hpp>
#include <gsh/learn/learned_array.hpp>

#include "support/gradient.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string_view>
#include <type_traits>
#include <vector>

namespace gsh::test {

/// Whether a model, a scene or one of their parts announces an array of this name.
template <class Part>
bool learns(Part& part, std::string_view name) {
    for (const auto& array : part.learned())
        if (array.name == name) return true;
    return false;
}

/// The array of this name; the test fails if there is none.
template <class Part>
auto learned_array(Part& part, std::string_view name) {
    for (const auto& array : part.learned())
        if (array.name == name) return array;
    FAIL("there is no learned array ", name);
    return typename decltype(part.learned())::value_type();
}

/// The numbers of the array of this name, a copy in host memory.
template <class B, class Part>
auto learned_values(B& backend, Part& part, std::string_view name) {
    const auto values = learned_array(part, name).values;
    std::vector<std::remove_cvref_t<decltype(values[0])>> host(values.size());
    backend.download(Span<const std::remove_cvref_t<decltype(values[0])>>(values), Span(host.data(), host.size()));
    return host;
}

/// The numbers of all arrays, one array after the other, a copy in host memory.
template <class B, class Part>
auto learned_values(B& backend, Part& part) {
    std::vector<std::remove_cvref_t<decltype(part.learned().front().values[0])>> all;
    for (const auto& array : part.learned()) {
        const auto values = learned_values(backend, part, array.name);
        all.insert(all.end(), values.begin(), values.end());
    }
    return all;
}

/// The same for a backend in host memory.
template <class Part>
auto learned_values(Part& part, std::string_view name) {
    cpu::Serial host;
    return learned_values(host, part, name);
}
template <class Part>
auto learned_values(Part& part) {
    cpu::Serial host;
    return learned_values(host, part);
}

/// Makes one number of the array of this name NaN.
template <class B, class Part>
void spoil(B& backend, Part& part, std::string_view name, std::size_t number) {
    const auto values = learned_array(part, name).values.subspan(number, 1);
    backend.fill(values, std::numeric_limits<std::remove_cvref_t<decltype(values[0])>>::quiet_NaN());
}

/// The gradients of all arrays, one array after the other, a copy.
template <class Part>
auto learned_gradients(Part& part) {
    std::vector<std::remove_cvref_t<decltype(part.learned().front().values[0])>> all;
    for (const auto& array : part.learned()) all.insert(all.end(), array.gradient.begin(), array.gradient.end());
    return all;
}

/// Sets all gradients to zero.
template <class B, class Part>
void zero_gradients(B& backend, Part& part) {
    for (const auto& array : part.learned()) backend.fill(array.gradient, 0);
}

/// Sets every learned number to a value that is not near zero, so that the outputs of fields are noticeable.
template <class Part>
void randomize(Part& part, std::uint64_t seed = 8) {
    Rng rng(seed);
    for (const auto& array : part.learned())
        for (auto& value : array.values) value = rng.uniform(-0.5, 0.5);
}

/// Checks the gradients in a part's learned arrays against central differences of loss(), about `samples` numbers of
/// each array. Of a table, only rows are checked that a point reads, because the others have no gradient.
template <class Part, class Loss>
void check_learned_gradients(Part& part, const Loss& loss, const GradientCheck& check = {}, std::size_t samples = 30) {
    for (const LearnedArray<double>& array : part.learned()) {
        CAPTURE(array.name);
        REQUIRE(!array.values.empty());
        const Span<const double> gradient = array.gradient;
        double largest = 0;
        for (const double value : gradient) largest = std::max(largest, std::abs(value));
        CHECK(largest > 1e-3); // otherwise the check below compares zeros
        GradientCheck options = check;
        options.elements = spread_elements(array.values.size(), array.is_table() ? &array.touched_rows : nullptr,
                                           array.row_size, samples);
        check_gradient(loss, array.values, gradient, options);
    }
}

/// Checks that `twice` is two times `once`, relative to its largest number.
inline void check_doubled(const std::vector<double>& once, const std::vector<double>& twice) {
    REQUIRE(once.size() == twice.size());
    double largest = 0, difference = 0;
    for (std::size_t i = 0; i < once.size(); ++i) {
        largest = std::max(largest, std::abs(once[i]));
        difference = std::max(difference, std::abs(twice[i] - 2 * once[i]));
    }
    CHECK(largest > 0);
    CHECK(difference <= 1e-12 * largest);
}

} // namespace gsh::test
