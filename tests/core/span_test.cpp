// SPDX-License-Identifier: Apache-2.0
#include <gsh/core/span.hpp>

#include <doctest/doctest.h>

#include <array>
#include <span>
#include <vector>

using namespace gsh;

static_assert(std::is_trivially_copyable_v<Span<float>>);
static_assert(std::is_convertible_v<std::vector<int>&, Span<int>>);
static_assert(std::is_convertible_v<const std::vector<int>&, Span<const int>>);
static_assert(!std::is_convertible_v<const std::vector<int>&, Span<int>>); // const cannot be removed
static_assert(std::is_convertible_v<Span<int>, Span<const int>>);
static_assert(!std::is_convertible_v<Span<const int>, Span<int>>);
static_assert(!std::is_convertible_v<std::vector<int>&, Span<float>>);

TEST_CASE("a span views vectors, arrays and std::span") {
    std::vector<int> values{1, 2, 3, 4};
    const Span<int> span = values;
    CHECK(span.size() == 4);
    span[2] = 7;
    CHECK(values[2] == 7);

    std::array<int, 2> two{5, 6};
    const Span<const int> from_array = two, from_std = std::span<int>(two), from_span = span;
    CHECK(from_array[1] == 6);
    CHECK(from_std.data() == two.data());
    CHECK(from_span.data() == values.data());

    int sum = 0;
    for (const int value : span.subspan(1, 2)) sum += value;
    CHECK(sum == 2 + 7);
}

TEST_CASE("an empty span holds nothing") {
    const Span<double> none;
    CHECK(none.empty());
    CHECK(none.begin() == none.end());
    std::vector<double> nothing;
    CHECK(Span<double>(nothing).empty());
}
