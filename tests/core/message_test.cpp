// SPDX-License-Identifier: Apache-2.0
/// @file  Foreign text in messages: what is printable stays, everything else is replaced.

#include <doctest/doctest.h>

#include <gsh/core/message.hpp>

#include <limits>
#include <string>
#include <vector>

using namespace gsh::detail;

TEST_CASE("text is at most 40 printable characters of UTF-8") {
    CHECK(shortened("a\nb\x01") == "a?b?");
    CHECK(shortened(std::string(50, 'x')) == std::string(40, 'x') + "…");
    CHECK(shortened(std::string(40, 'x')) == std::string(40, 'x'));
    CHECK(shortened("").empty());
    CHECK(shortened("カメラ1, bras_gauché") == "カメラ1, bras_gauché");
    std::string many;
    for (int i = 0; i < 41; ++i) many += "é";
    CHECK(shortened(many) == many.substr(0, 80) + "…");
}

TEST_CASE("bytes that are not UTF-8, and characters that turn a line, are question marks") {
    for (const char* bytes : {"\x80", "\xC0", "\xFF", "\x7F", "\x1B", "\xE2\x82" /* cut */})
        CHECK(shortened(std::string("a") + bytes).substr(0, 2) == "a?");
    CHECK(shortened("\xC1\x81") == "??");           // overlong
    CHECK(shortened("\xED\xA0\x80") == "???");      // half of a pair
    CHECK(shortened("\xF5\x80\x80\x80") == "????"); // beyond the last character
    CHECK(shortened("\u202Eabc") == "???abc");      // text that runs to the left
    CHECK(shortened("\u2028") == "???");
    CHECK(shortened("\uFEFF") == "???");
    CHECK(shortened("😀") == "😀");
    CHECK(shortened(std::string_view("a\0b", 3)) == "a?b");
}

TEST_CASE("lists of names are short") {
    CHECK(listed(std::vector<std::string>{}, "no arrays") == "no arrays");
    CHECK(listed(std::vector<std::string>{"a", "b\n"}, "none") == "a, b?");
    CHECK(listed(std::vector<std::string>(100, "name"), "none", 2) == "name, name and 98 more");
}

TEST_CASE("numbers have six digits") {
    CHECK(number_text(0.82) == "0.82");
    CHECK(number_text(1e18) == "1e+18");
    CHECK(number_text(3840) == "3840");
    CHECK(number_text(std::numeric_limits<double>::max()) == "1.79769e+308");
    CHECK(number_text(std::numeric_limits<double>::infinity()) == "inf");
}
