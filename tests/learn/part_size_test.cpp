// SPDX-License-Identifier: Apache-2.0
/// @file  Sizes of parts add up. memory_test.cpp compares those of an avatar with its arrays.
#include <gsh/learn/part_size.hpp>

#include <doctest/doctest.h>

using namespace gsh;

TEST_CASE("a learned number counts four times, for its gradient and two moments, and another number once") {
    CHECK(PartSize{}.fixed() == 0);
    CHECK(PartSize{}.per_point() == 0);
    const PartSize size{.learned = {{"weights", 10, 0}, {"points", 0, 3}, {"both", 100, 5}}, .other_per_point = 7};
    CHECK(size.fixed() == 4 * 110);
    CHECK(size.per_point() == 4 * 8 + 7);
    CHECK(size.learned[0].at(1000) == 10);
    CHECK(size.learned[1].at(0) == 0);
    CHECK(size.learned[1].at(1000) == 3000);
    CHECK(size.learned[2].at(1) == 105);
}

TEST_CASE("parts are appended in their order, and their numbers add") {
    PartSize all;
    append(all, {});
    CHECK(all.learned.empty());
    append(all, {.learned = {{"a", 1, 0}, {"b", 2, 3}}, .other_per_point = 5});
    append(all, {.learned = {{"c", 4, 1}}, .other_per_point = 6});
    append(all, {.learned = {}, .other_per_point = 2});
    REQUIRE(all.learned.size() == 3);
    CHECK(all.learned[0].name == "a");
    CHECK(all.learned[1].name == "b");
    CHECK(all.learned[2].name == "c");
    CHECK(all.fixed() == 4 * 7);
    CHECK(all.per_point() == 4 * 4 + 13);
}
