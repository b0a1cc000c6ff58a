// SPDX-License-Identifier: Apache-2.0
/// @file  Learned arrays by their names, for tests that set, compare or differentiate them.
#pragma once

#include <gsh/core/span.hpp>
#include <gsh/pipeline/learned_array.hpp>

#include <doctest/doctest.h>

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

/// The numbers of the array of this name, a copy.
template <class Part>
auto learned_values(Part& part, std::string_view name) {
    const auto values = learned_array(part, name).values;
    return std::vector(values.begin(), values.end());
}

/// The numbers of all arrays, one array after the other, a copy.
template <class Part>
auto learned_values(Part& part) {
    std::vector<std::remove_cvref_t<decltype(part.learned().front().values[0])>> all;
    for (const auto& array : part.learned()) all.insert(all.end(), array.values.begin(), array.values.end());
    return all;
}

/// The gradients of all arrays, one array after the other, a copy.
template <class Part>
auto learned_gradients(Part& part) {
    std::vector<std::remove_cvref_t<decltype(part.learned().front().values[0])>> all;
    for (const auto& array : part.learned()) all.insert(all.end(), array.gradient.begin(), array.gradient.end());
    return all;
}

} // namespace gsh::test
