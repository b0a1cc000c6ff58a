// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/body/makehuman_target.hpp>

#include "io/temporary.hpp"

#include <string>

using namespace gsh;

TEST_CASE("a target moves vertices by decimetres, as metres") {
    const auto offsets = parse_makehuman_target("# CC0\n0 0 -.001 2\n\n41 1e1 0.5 -3\r\n", "a.target", 42);
    REQUIRE(offsets.size() == 2);
    CHECK(offsets[0].vertex == 0);
    CHECK(length(offsets[0].offset - vec3<double>(0, -0.0001, 0.2)) < 1e-15);
    CHECK(offsets[1].vertex == 41);
    CHECK(offsets[1].offset.x == 1);
    CHECK(parse_makehuman_target("", "a.target", 42).empty()); // MakeHuman has such files
}

TEST_CASE("damaged targets are refused with file and line") {
    const auto check_refused = [](const std::string& text, std::initializer_list<std::string_view> words) {
        INFO(text);
        test::check_throws<IoError>([&] { (void)parse_makehuman_target(text, "a.target", 42); }, words);
    };
    check_refused("1 0 0 0\n1 2 3\n", {"a.target:2", "3 numbers", "expected 4"});
    check_refused("1 2 3 x\n", {"a.target:1", "'x'"});
    check_refused("42 0 0 0\n", {"a.target:1", "42", "below 42"});
    check_refused("-1 0 0 0\n", {"a.target:1", "-1"});
    check_refused("1.5 0 0 0\n", {"a.target:1", "1.5"});
    check_refused("1e300 0 0 0\n", {"a.target:1", "1e+300"});
    check_refused("1 0 inf 0\n", {"a.target:1", "finite"});
    check_refused("1 0 -1e4 0\n", {"a.target:1", "more than 100 m"});
}
