// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/file/settings_file.hpp>

#include "io/temporary.hpp"

#include <string>
#include <utility>
#include <vector>

using namespace gsh;
using test::check_throws;

namespace {

using Settings = std::vector<std::pair<std::string, std::string>>;

Settings parsed(const std::string& text) {
    const test::Temporary folder;
    write_file(folder / "settings.json", text);
    return read_settings(folder / "settings.json");
}

} // namespace

TEST_CASE("settings come in the file's order, as text") {
    CHECK(parsed(R"({"z": 0.5, "a": true, "m": "text", "count": 64, "tiny": 1e-3, "off": false, "minus": -2})") ==
          Settings{{"z", "0.5"},
                   {"a", "true"},
                   {"m", "text"},
                   {"count", "64"},
                   {"tiny", "0.001"},
                   {"off", "false"},
                   {"minus", "-2"}});
    CHECK(parsed("{}").empty());
    CHECK(parsed(R"({"empty": "", "quoted": "say \"no\""})") == Settings{{"empty", ""}, {"quoted", "say \"no\""}});
    const auto digits = parsed(R"({"sum": 0.30000000000000004})"); // all digits of a double are kept
    CHECK(std::stod(digits[0].second) == 0.1 + 0.2);
}

TEST_CASE("what is no flat object is refused by name") {
    for (const char* text : {"[1, 2]", "3", "\"text\"", "null"})
        check_throws<IoError>([&] { (void)parsed(text); }, {"settings.json", "one JSON object"});
    for (const char* value : {"[1]", "{\"b\": 1}", "null"})
        check_throws<IoError>([&] { (void)parsed(std::string("{\"fine\": 1, \"a\": ") + value + "}"); },
                              {"settings.json", "a must be a number, true, false, or text in quotes"});
    for (const char* text : {"", "{", R"({"a": 1,})", R"({"a": nan})", R"({"a" 1})"})
        check_throws<IoError>([&] { (void)parsed(text); }, {"settings.json"});
    check_throws<IoError>([] { (void)read_settings("/nowhere/settings.json"); }, {"/nowhere/settings.json"});
}
