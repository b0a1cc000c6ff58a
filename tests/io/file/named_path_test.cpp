// SPDX-License-Identifier: Apache-2.0
/// @file  Names of files that stand in a file stay in their folder.

#include "io/temporary.hpp"

#include <doctest/doctest.h>

#include <gsh/io/file/named_path.hpp>

#include <string>

using namespace gsh;
using namespace gsh::detail;

TEST_CASE("names that lead out of a folder") {
    for (const char* name :
         {"a.png", "cam/a.png", "a..b/..c.png", ".hidden", "./a.png", "cam//a.png", "...", "ünï/ö.png"})
        CHECK_MESSAGE(stays_inside(name), name);
    for (const char* name :
         {"", "..", "../a.png", "../../x", "cam/../../a.png", "cam/..", "/etc/passwd", "//a", "a/../b"})
        CHECK_MESSAGE(!stays_inside(name), name);
    CHECK(!stays_inside(std::string_view("a\0b", 3)));
    for (const char* name : {"cam01", "front left", "..."}) CHECK_MESSAGE(is_plain_name(name), name);
    for (const char* name : {"", ".", "..", "a/b", "/a", "a\nb"}) CHECK_MESSAGE(!is_plain_name(name), name);
    CHECK(is_plain_name(std::string(255, 'a')));
    CHECK(!is_plain_name(std::string(256, 'a')));
}

TEST_CASE("the message names the place and the folder") {
    CHECK(named_path("folder", "a/b.png", "list.json: views[0]") == "folder/a/b.png");
    test::check_throws<ValueError>([] { (void)named_path("folder", "../b.png", "list.json: views[0]"); },
                                   {"list.json: views[0]: ", "'../b.png' leads out", "folder"});
    test::check_throws<ValueError>([] { (void)named_path("folder", "b\x1b[31m.png", "list.json: views[0]"); },
                                   {"list.json: views[0]: ", "'b?[31m.png'", "cannot be shown"});
}
