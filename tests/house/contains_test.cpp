// SPDX-License-Identifier: Apache-2.0
#include "support/contains.hpp"

#include <doctest/doctest.h>

#include <string>

using namespace gsh;

TEST_CASE("a text equals contains(part) if the part is in it, and a failed check would print both") {
    const std::string text = "frame 3 is missing";
    CHECK(text == test::contains("3 is"));
    CHECK(text == test::contains(text));
    CHECK(text == test::contains(""));
    CHECK(text != test::contains("frame 4"));
    CHECK("" != test::contains("a"));
    CHECK(doctest::toString(test::contains("3 is")) == "a text with \"3 is\"");
    CHECK(doctest::toString(text) == "frame 3 is missing");
}
