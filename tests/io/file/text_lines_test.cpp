// SPDX-License-Identifier: Apache-2.0
/// @file  Text files by lines: blanks, line ends, numbers, and messages with the line.

#include "io/temporary.hpp"

#include <doctest/doctest.h>

#include <gsh/io/file/text_lines.hpp>

#include <string>
#include <vector>

using namespace gsh;

TEST_CASE("lines are trimmed, empty ones are skipped, numbers of lines count all") {
    using namespace gsh::detail;
    TextLines lines("\xef\xbb\xbf\n  one two\r\n\r\n\t3 4e1 -5.5 +6\n", "a.txt");
    CHECK(lines.count_rest() == 2);
    REQUIRE(lines.next());
    CHECK(lines.line() == "one two");
    CHECK(words_in(lines.line()) == std::vector<std::string_view>{"one", "two"});
    CHECK(lines.count_rest() == 1);
    REQUIRE(lines.next());
    CHECK(lines.numbers(lines.line(), 4) == std::vector<double>{3, 40, -5.5, 6});
    test::check_throws<IoError>([&] { (void)lines.numbers(lines.line(), 5, ", five of them"); },
                                {"a.txt:4: this line holds 4 numbers, expected 5, five of them"});
    test::check_throws<IoError>([&] { (void)lines.numbers("1 x2 3", 3); }, {"a.txt:4:", "'x2'", "finite"});
    test::check_throws<IoError>([&] { (void)lines.numbers("1 inf", 2); }, {"'inf'"});
    CHECK(!lines.next());
    CHECK(lines.count_rest() == 0);
    test::check_throws<IoError>([&] { lines.fail("is not good"); }, {"a.txt: ends too early", "is not good"});
}

TEST_CASE("words") {
    using namespace gsh::detail;
    CHECK(is_word("Root", "ROOT"));
    CHECK(!is_word("Root", "Roots"));
    CHECK(first_word("").empty());
    CHECK(trimmed(" \t ").empty());
    CHECK(words_in("").empty());
}
