// SPDX-License-Identifier: Apache-2.0
/// @file  A deferred value is the one in the backend's memory if there is one, and else the one that is known.
#include <gsh/core/deferred.hpp>
#include <gsh/math/vec.hpp>

#include <doctest/doctest.h>

#include <type_traits>
#include <vector>

using namespace gsh;

// A kernel holds it, and arguments convert to it.
static_assert(std::is_trivially_copyable_v<Deferred<float>> && std::is_trivially_copyable_v<Deferred<vec3<double>>>);
static_assert(std::is_convertible_v<float, Deferred<float>>);
static_assert(std::is_convertible_v<vec3<double>, Deferred<vec3<double>>>);
static_assert(!std::is_constructible_v<Deferred<vec3<double>>, double, double>); // a vector has three numbers

namespace {

vec3<double> value_of(const Deferred<vec3<double>>& value) {
    return value();
}

} // namespace

TEST_CASE("a plain value, or the numbers that it is made of, is a deferred one that is known") {
    CHECK(value_of(vec3<double>(1, 2, 3)) == vec3<double>(1, 2, 3));
    CHECK(value_of({4, 5, 6}) == vec3<double>(4, 5, 6));
    CHECK(value_of({}) == vec3<double>(0, 0, 0));
    CHECK(Deferred<int>()() == 0);
    CHECK(Deferred<vec3<double>>(vec3<double>(1)).computed.empty());
}

TEST_CASE("what is computed replaces what is known, as it is when the value is read") {
    std::vector<vec3<double>> memory{{7, 8, 9}};
    const Deferred<vec3<double>> value(vec3<double>(1, 2, 3), memory), none(vec3<double>(1, 2, 3), {});
    CHECK(value() == vec3<double>(7, 8, 9));
    CHECK(value.known == vec3<double>(1, 2, 3)); // the host's guess stays
    memory[0] = vec3<double>(0, 1, 0);
    CHECK(value() == vec3<double>(0, 1, 0));
    const auto copy = value; // refers to the same memory
    CHECK(&copy() == memory.data());
    CHECK(none() == vec3<double>(1, 2, 3));
}
