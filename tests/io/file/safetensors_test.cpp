// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/file/safetensors.hpp>

#include "io/safetensors_files.hpp"
#include "io/temporary.hpp"

#include <gsh/io/file/input_file.hpp>

#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

using namespace gsh;
using test::check_throws;
using test::safetensors_bytes;

namespace {

const std::vector<float> six{1.5f, -2, 0.25f, 0, 1024, -0.0009765625f}; // exact in every type

std::string tensor(const std::string& name, const std::string& dtype, const std::string& shape,
                   const std::string& offsets) {
    return "\"" + name + "\": {\"dtype\": \"" + dtype + "\", \"shape\": " + shape + ", \"data_offsets\": " + offsets +
           "}";
}

/// {inner}; appended, because GCC 12 sees overlaps where a literal comes first.
std::string object(const std::string& inner) {
    return std::string(1, '{').append(inner).append(1, '}');
}

/// The error message for a file with this header and this many bytes of numbers.
void check_refused(const std::string& header, std::size_t data, std::initializer_list<std::string_view> words) {
    const test::Temporary folder;
    write_file(folder / "a.safetensors", safetensors_bytes(header, std::string(data, '\0')), Sync::none);
    check_throws<IoError>([&] { SafetensorsReader file(folder / "a.safetensors"); }, words);
}

} // namespace

TEST_CASE("tensors of every real type") {
    const test::Temporary folder;
    test::SafetensorsFile writer;
    for (const char* dtype : {"F32", "F64", "F16", "BF16"}) writer.add(std::string("a.") + dtype, "2, 3", six, dtype);
    writer.add("number", "", std::vector<float>{7});
    writer.add("nothing", "0, 3", std::vector<float>{});
    writer.write(folder / "a.safetensors");

    const SafetensorsReader file(folder / "a.safetensors");
    CHECK(file.keys() == std::vector<std::string>{"a.BF16", "a.F16", "a.F32", "a.F64", "nothing", "number"});
    CHECK(file.has("number"));
    CHECK(!file.has("__metadata__"));
    for (const char* dtype : {"F32", "F64", "F16", "BF16"}) {
        const std::string name = std::string("a.") + dtype;
        CAPTURE(name);
        const auto array = file.read<float>(name, {-1, 3});
        CHECK(array.shape == Shape{2, 3});
        CHECK(array.data == six);
        CHECK(file.read<double>(name).data == std::vector<double>(six.begin(), six.end()));
        CHECK(file.header(name).dtype == dtype);
    }
    CHECK(file.read<float>("number", {}).data == std::vector<float>{7});
    CHECK(file.read<float>("nothing", {0, 3}).size() == 0);
    check_throws<ShapeError>([&] { (void)file.read<float>("a.F32", {3, 2}); },
                             {"a.safetensors: a.F32", "(2, 3)", "(3, 2)"});
    check_throws<IoError>([&] { (void)file.read<float>("b"); }, {"b is missing", "a.BF16, a.F16"});
}

TEST_CASE("an empty file of tensors is a file") {
    const test::Temporary folder;
    write_file(folder / "a.safetensors", safetensors_bytes("{}", ""));
    CHECK(SafetensorsReader(folder / "a.safetensors").keys().empty());
    check_throws<IoError>([&] { SafetensorsReader file(folder / "b"); }, {"b: cannot be opened"});
}

TEST_CASE("numbers that are none are refused, and named") {
    const test::Temporary folder;
    const float nan = std::numeric_limits<float>::quiet_NaN(), infinite = std::numeric_limits<float>::infinity();
    for (const char* dtype : {"F32", "F64", "BF16"}) {
        test::SafetensorsFile writer;
        writer.add("w", "2, 2", std::vector<float>{0, 1, nan, 3}, dtype);
        writer.add("v", "1", std::vector<float>{-infinite}, dtype);
        writer.write(folder / "a.safetensors");
        const SafetensorsReader file(folder / "a.safetensors");
        check_throws<ValueError>([&] { (void)file.read<float>("w"); }, {"a.safetensors: w[1, 0] is NaN"});
        check_throws<ValueError>([&] { (void)file.read<float>("v"); }, {"v[0] is infinite"});
    }
    const std::string halves("\x00\x7e\x00\x7c", 4), big("\0\0\0\0\0\0\xf0\x7e", 8);
    write_file(folder / "b.safetensors", safetensors_bytes(object(tensor("h", "F16", "[2]", "[0, 4]") + ", " +
                                                                  tensor("d", "F64", "[]", "[4, 12]")),
                                                           halves + big));
    const SafetensorsReader file(folder / "b.safetensors");
    check_throws<ValueError>([&] { (void)file.read<float>("h"); }, {"h[0] is NaN"});
    check_throws<ValueError>([&] { (void)file.read<float>("d"); }, {"d[]", "fits <f4"});
    CHECK(file.read<double>("d").data[0] > 1e300);
}

TEST_CASE("types that are no real numbers are refused when read, not before") {
    const test::Temporary folder;
    write_file(folder / "a.safetensors", safetensors_bytes(object(tensor("i", "I64", "[2]", "[0, 16]") + ", " +
                                                                  tensor("q", "F4", "[3]", "[16, 18]")),
                                                           std::string(18, '\1')));
    const SafetensorsReader file(folder / "a.safetensors");
    check_throws<IoError>([&] { (void)file.read<float>("i"); }, {": i has dtype I64", "F16, BF16, F32 or F64"});
    check_throws<IoError>([&] { (void)file.read<float>("q"); }, {": q has dtype F4"});
}

TEST_CASE("truncated files") {
    const test::Temporary folder;
    const auto path = folder / "a.safetensors";
    test::SafetensorsFile writer;
    writer.add("w", "2, 3", six);
    writer.write(path);
    const std::string whole = read_file(path);
    for (std::size_t size = 0; size < whole.size(); ++size) {
        CAPTURE(size);
        write_file(path, whole.substr(0, size), Sync::none);
        CHECK_THROWS_AS(SafetensorsReader{path}, IoError);
    }
    write_file(path, whole);
    const SafetensorsReader file(path);
    test::truncate_file(path, 4); // while the file is open
    check_throws<IoError>([&] { (void)file.read<float>("w"); }, {"w is truncated"});
    std::filesystem::remove(path);
    check_throws<IoError>([&] { (void)file.read<float>("w"); }, {"cannot be opened"});
}

TEST_CASE("every damaged byte of a header is survived") {
    const test::Temporary folder;
    const auto path = folder / "a.safetensors";
    test::SafetensorsFile writer;
    writer.add("w", "2, 3", six);
    writer.write(path);
    const std::string whole = read_file(path);
    for (std::size_t place = 0; place < whole.size() - six.size() * 4; ++place)
        for (const char damage : {'\0', '"', '9', '}', '\xff'}) {
            std::string bytes = whole;
            bytes[place] = damage;
            write_file(path, bytes, Sync::none);
            try {
                const SafetensorsReader file(path);
                for (const auto& name : file.keys()) (void)file.read<float>(name);
            } catch (const Error&) { // reading may also succeed
            }
        }
}

TEST_CASE("headers made to exhaust memory, or to lie") {
    const test::Temporary folder;
    write_file(folder / "a", std::string(8, '\xff') + "{}");
    check_throws<IoError>([&] { SafetensorsReader file(folder / "a"); }, {"header claims", "the file has 10"});
    write_file(folder / "b", safetensors_bytes(object(std::string(2000, ' ')), ""));
    check_throws<IoError>([&] { SafetensorsReader file(folder / "b", {.header_bytes = 1000}); },
                          {"2002 bytes", "limit of 1000"});

    check_refused(std::string(1 << 20, '['), 0, {"nested deeper than 3"});
    check_refused(std::string("{\"a\":").append(1 << 20, '['), 0, {"nested deeper than 3"});
    check_refused("{\"a\": {\"shape\": [[[1]]]}}", 0, {"nested deeper than 3"});
    check_refused(std::string("{\"").append(1 << 16, 'x'), 0, {"not a safetensors file"});
    check_refused("[1, 2]", 0, {"no JSON object"});
    check_refused("PK\x03\x04....", 0, {"not a safetensors file"});
    check_refused("{\"a\": 3}", 0, {": a is no JSON object"});

    const auto one = [](const std::string& dtype, const std::string& shape, const std::string& offsets) {
        return object(tensor("a", dtype, shape, offsets));
    };
    check_refused(one("F32", "[3]", "[0, 8]"), 8, {": a is damaged", "(3,)", "8 bytes"});
    check_refused(one("F32", "[4294967296, 4294967296, 4]", "[0, 0]"), 0, {": a is damaged"});
    check_refused(one("F32", "[2]", "[0, 8]"), 7, {": a is truncated", "byte 8", "holds 7"});
    check_refused(one("F32", "[2]", "[8, 0]"), 8, {"data_offsets are (8, 0)"});
    check_refused(one("F32", "[2]", "[0]"), 8, {"data_offsets are (0,)"});
    check_refused(one("F32", "[2]", "[18446744073709551608, 18446744073709551615]"), 8, {": a is damaged"});
    check_refused(one("F4", "[2]", "[18446744073709551614, 18446744073709551615]"), 8, {": a is truncated"});
    check_refused(one("F32", "[-2]", "[0, 8]"), 8, {"shape holds -2"});
    check_refused(one("F32", "[2.0]", "[0, 8]"), 8, {"shape holds 2.0"});
    check_refused(one("F32", "2", "[0, 8]"), 8, {"no list 'shape'"});
    check_refused("{\"a\": {\"dtype\": 3, \"shape\": [2], \"data_offsets\": [0, 8]}}", 8, {"no text 'dtype'"});
    check_refused("{\"a\": {}}", 8, {"no text 'dtype'"});
    check_refused(object(tensor("a", "F32", "[2]", "[0, 8]") + ", " + tensor("a", "F32", "[2]", "[0, 8]")), 8,
                  {"member 'a' twice"});
    check_refused(object(tensor("a", "F32", "[2]", "[0, 8]") + ", " + tensor("b", "F32", "[2]", "[4, 12]")), 12,
                  {"overlaps"});
    check_refused(object(tensor("a", "F32", "[2]", "[0, 8]") + ", " + tensor("b", "F32", "[1]", "[0, 4]")), 12,
                  {"overlaps"});

    write_file(folder / "c", safetensors_bytes(one("F16", "[4]", "[0, 8]"), std::string(8, '\0')));
    const SafetensorsReader small(folder / "c", {.tensor_bytes = 15});
    check_throws<IoError>([&] { (void)small.read<float>("a"); }, {"limit of 15"});
    CHECK(SafetensorsReader(folder / "c", {.tensor_bytes = 16}).read<float>("a").size() == 4);
}
