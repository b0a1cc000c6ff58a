// SPDX-License-Identifier: Apache-2.0
/// @file  JSON: what is read, and the bounds in depth, memory and time.

#include "io/temporary.hpp"

#include <doctest/doctest.h>

#include <gsh/io/file/json_file.hpp>

#include <chrono>
#include <string>

using namespace gsh;
using detail::Json;
using detail::parse_json;
using test::check_throws;

namespace {

template <class Value = Json>
void refused(const std::string& text, std::initializer_list<std::string_view> words,
             const detail::JsonLimits& limits = {}) {
    CAPTURE(text.substr(0, 80));
    check_throws<IoError>([&] { (void)parse_json<Value>(text, "a.json", limits); }, {"a.json"});
    check_throws<IoError>([&] { (void)parse_json<Value>(text, "a.json", limits); }, words);
}

std::string nested(std::size_t depth, char open, char close) {
    return std::string(depth, open) + std::string(depth, close);
}

} // namespace

TEST_CASE_TEMPLATE("values of every kind are those of nlohmann's own parser", Value, Json, nlohmann::json) {
    for (const char* text :
         {"null", "true", "-3", "18446744073709551615", "0.1", "\"a\\u00e9\\n\"", "[]", "{}", "[1, [2, {}], \"x\"]",
          R"({"z": 1, "a": {"b": [1, 2.5, -7e3, null, false]}, "": []})", " [ { } , { \"k\" : [ [ ] ] } ] "}) {
        CAPTURE(text);
        const auto value = parse_json<Value>(text, "a.json");
        CHECK(value == Value::parse(text));
        CHECK(value.dump() == Value::parse(text).dump());
    }
}

TEST_CASE("members keep the file's order") {
    CHECK(parse_json(R"({"z": 1, "a": 2, "m": 3})", "a.json").dump() == R"({"z":1,"a":2,"m":3})");
}

TEST_CASE_TEMPLATE("text that is no JSON names the line and what stands there", Value, Json, nlohmann::json) {
    refused<Value>("", {"line 1, at its end"});
    refused<Value>("{\"a\": 1,\n \"b\": nan}", {"is not JSON, or truncated, in line 2", "'"});
    refused<Value>("[1, 2", {"truncated"});
    refused<Value>("[1] 2", {"not JSON"});
    refused<Value>("[1e999]", {"beyond the range of double", "1e999"});
    refused<Value>("\"\xff\xfe\"", {"not JSON"});
    refused<Value>("\"" + std::string(100'000, 'x'), {"…"});
    try {
        (void)parse_json<Value>("[\"\x01\x80" + std::string(100'000, 'x'), "a.json");
        FAIL_CHECK("nothing was thrown");
    } catch (const IoError& error) {
        CHECK(std::string(error.what()).size() < 300);
    }
}

TEST_CASE_TEMPLATE("depth is bounded before anything recurses", Value, Json, nlohmann::json) {
    CHECK(parse_json<Value>(nested(64, '[', ']'), "a.json").dump() == nested(64, '[', ']'));
    refused<Value>(nested(65, '[', ']'), {"nested deeper than 64"});
    refused<Value>(std::string(1'000'000, '['), {"nested deeper than 64"});
    std::string objects;
    for (int i = 0; i < 100'000; ++i) objects += "{\"a\":";
    refused<Value>(objects, {"nested deeper than 64"});
    refused<Value>("[[[1]]]", {"nested deeper than 2"}, {.depth = 2});
}

TEST_CASE_TEMPLATE("the number of values is bounded", Value, Json, nlohmann::json) {
    refused<Value>("[1,2,3,4]", {"more than 4 values"}, {.values = 4});
    CHECK(parse_json<Value>("[1,2,3,4]", "a.json", {.values = 5}).size() == 4);
    refused<Value>("[[],[],{}]", {"more than 3 lists and objects"}, {.containers = 3});
    CHECK(parse_json<Value>("[[],[],{}]", "a.json", {.containers = 4}).size() == 3);
}

TEST_CASE_TEMPLATE("a member that stands there twice is refused", Value, Json, nlohmann::json) {
    refused<Value>(R"({"a": 1, "b": 2, "a": 3})", {"member 'a' twice"});
    refused<Value>(R"([{"x": {"a": [], "a": {}}}])", {"'a' twice"});
    refused<Value>("{\"a\\n\": 1, \"a\\n\": 2}", {"'a?' twice"});
    CHECK(parse_json<Value>(R"({"a": {"a": 1}, "A": 2})", "a.json").size() == 2);
}

TEST_CASE_TEMPLATE("objects of many members take no more time than their length asks for", Value, Json,
                   nlohmann::json) {
    std::string text = "{";
    for (int i = 0; i < 80'000; ++i) text += (i ? ",\"k" : "\"k") + std::to_string(i) + "\":0"; // 0.9 MB
    text += "}";
    const auto begin = std::chrono::steady_clock::now();
    CHECK(parse_json<Value>(text, "a.json").size() == 80'000);
    CHECK(std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count() < 2);
}

TEST_CASE("fields of an object name their place") {
    const Json json = parse_json(
        R"({"n": 1.5, "i": 3, "t": "x", "rows": [[1, 2], [3, 4]], "big": 3000000000, "no": null, "b": true})",
        "a.json");
    const detail::JsonObject object(json, "a.json: views[0]");
    CHECK(object.number("n") == 1.5);
    CHECK(object.integer("i") == 3);
    CHECK(object.text("t") == "x");
    CHECK(object.numbers("rows", 4) == std::vector<double>{1, 2, 3, 4});
    CHECK(object.boolean("b"));
    CHECK(!object.has("no"));
    check_throws<IoError>([&] { (void)object.at("no"); }, {"a.json: views[0]: no is missing"});
    check_throws<IoError>([&] { (void)object.number("t"); }, {"t is string, expected a number"});
    check_throws<IoError>([&] { (void)object.boolean("i"); }, {"i is number, expected true or false"});
    check_throws<ShapeError>([&] { (void)object.numbers("rows", 3); }, {"rows has 4 numbers, expected 3"});
    check_throws<ValueError>([&] { (void)object.integer("big"); }, {"beyond 32 bits"});
    check_throws<IoError>([&] { object.expect_only({"n", "i"}); }, {"unknown field 't', expected n, i"});
    check_throws<IoError>([&] { (void)detail::JsonObject(json["rows"], "a.json"); }, {"is array, expected an object"});
}

TEST_CASE("files are read through the same door") {
    const test::Temporary folder;
    write_file(folder / "a.json", "{\"a\": [1]}");
    CHECK(detail::read_json(folder / "a.json")["a"][0] == 1);
    write_file(folder / "b.json", std::string(200'000, '['));
    check_throws<IoError>([&] { (void)detail::read_json(folder / "b.json"); },
                          {(folder / "b.json").string(), "nested"});
    check_throws<IoError>([&] { (void)detail::read_json(folder / "c.json"); }, {(folder / "c.json").string()});
}

TEST_CASE("an owned value is whole until it is taken, and members keep their order while an object grows") {
    std::string text = "{";
    for (int i = 0; i < 100; ++i)
        text += (i ? ", \"" : "\"") + std::to_string(100 - i) + R"(": {"list": [)" + std::to_string(i) + ", [2]]}";
    detail::OwnedJson owned(parse_json(text + "}", "a.json"));
    CHECK(owned->size() == 100);
    CHECK((*owned)["58"]["list"][0] == 42);
    CHECK(owned->begin().key() == "100");
    const detail::Json taken = owned.take();
    CHECK(owned->is_null());
    CHECK(taken["1"]["list"].dump() == "[99,[2]]");
    const detail::OwnedJson<nlohmann::json> empty;
    CHECK((*empty).is_null());
}
