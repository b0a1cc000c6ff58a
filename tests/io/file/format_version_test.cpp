// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/file/format_version.hpp>
#include <gsh/io/file/json_file.hpp>

#include "io/temporary.hpp"

#include <string>

using namespace gsh;

namespace {
std::string refusal(const std::string& format, const char* kind = "avatar", int newest = 11, int oldest = 9) {
    try {
        detail::check_format("a.gsh", format, kind, newest, oldest);
    } catch (const IoError& error) {
        return error.what();
    }
    return {};
}
} // namespace

TEST_CASE("a format is its kind, in a version that is read") {
    for (const char* good : {"avatar 9", "avatar 10", "avatar 11"}) CHECK(refusal(good).empty());
    CHECK(refusal("motion 1", "motion", 1, 1).empty());
    CHECK(refusal("anything 1", "", 1, 1).empty());

    const std::string later = "take the later version of gsh that wrote it", older = "make the file again, or take the "
                                                                                    "older version of gsh that wrote it";
    const std::string reads = "', but this program reads 'avatar 9' to 'avatar 11'; ";
    CHECK(refusal("avatar 12") == "a.gsh: holds 'avatar 12" + reads + later);
    CHECK(refusal("avatar 100") == "a.gsh: holds 'avatar 100" + reads + later);
    CHECK(refusal("avatar 99999999999999999999").ends_with(later));
    CHECK(refusal("avatar 8") == "a.gsh: holds 'avatar 8" + reads + older);
    CHECK(refusal("motion 2", "motion", 1, 1) ==
          "a.gsh: holds 'motion 2', but this program reads 'motion 1'; " + later);
    CHECK(refusal("anything 2", "", 1, 1) ==
          "a.gsh: holds 'anything 2', but this program reads 'anything 1'; " + later);
    CHECK(refusal("body 9") == "a.gsh: holds 'body 9', expected 'avatar 9' to 'avatar 11'; give the file of that kind");
    for (const char* damaged : {"avatar", "avatar ", "avatar x", "avatar 9 ", "avatar -9", "avatar 09", "avatar 9.5"})
        CHECK(refusal(damaged).ends_with(reads + "the file is damaged"));
    CHECK(refusal("avatar " + std::string(9999, '1')).size() < 200);
    CHECK(refusal(std::string(9999, 'a') + " 2", "", 1, 1).size() < 250);
}

TEST_CASE("an object of JSON may state its format, which is left out") {
    const test::Temporary folder;
    const auto path = folder / "a.json";
    write_file(path, R"({"gsh_format": "regions 1", "high": [1]})");
    CHECK(detail::read_json(path, "regions").dump() == R"({"high":[1]})");
    CHECK(detail::read_json(path).dump() == R"({"high":[1]})");
    test::check_throws<IoError>([&] { (void)detail::read_json(path, "cameras"); },
                                {path.string() + ": holds 'regions 1', expected 'cameras 1'"});
    write_file(path, R"({"gsh_format": "regions 2"})");
    test::check_throws<IoError>([&] { (void)detail::read_json(path); }, {path.string() + ": holds 'regions 2'"});
    write_file(path, R"({"gsh_format": 2})");
    test::check_throws<IoError>([&] { (void)detail::read_json(path, "regions"); },
                                {path.string() + ": gsh_format is number, expected text"});
    write_file(path, R"([{"gsh_format": "regions 2"}])"); // of an element, which its reader knows
    CHECK(detail::read_json(path, "regions").size() == 1);
}
