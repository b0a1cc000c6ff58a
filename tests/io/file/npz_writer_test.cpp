// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/file/npz_writer.hpp>

#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/npz.hpp>

#include "io/temporary.hpp"

#include <cstdint>
#include <filesystem>
#include <numeric>
#include <string>
#include <vector>

using namespace gsh;

TEST_CASE("what NpzWriter writes, NpzReader reads") {
    const test::Temporary folder;
    const auto path = folder / "a.npz";
    std::vector<double> numbers(1000);
    std::iota(numbers.begin(), numbers.end(), -3.25);
    const std::vector<float> singles{1.5f, -2.5f, 3.5f, 4.5f, 5.5f, 6.5f};
    {
        NpzWriter file(path);
        file.add("numbers", numbers, {10, 100});
        file.add("singles", singles);
        file.add("ids", std::vector<std::int64_t>{-1, 4294967295});
        file.add("bytes", std::vector<std::uint8_t>{0, 255});
        file.add("count", 7);
        file.add("nothing", std::vector<float>{}, {0, 3});
        file.add_text("kind", "gsh Zoë 人 \xF0\x9F\x99\x82");
        file.add_text("silence", "");
        file.add_texts("names", {"pelvis", "left_hip", ""});
        CHECK(!std::filesystem::exists(path));
        file.commit();
    }
    const NpzReader file(path);
    CHECK(file.keys().size() == 9);
    CHECK(file.has("ids"));
    CHECK(!file.has("id"));
    CHECK(file.has_array("ids"));
    CHECK(!file.has_array("kin"));
    const auto read = file.read<double>("numbers", {-1, 100});
    CHECK(read.shape == Shape{10, 100});
    CHECK(read.data == numbers);
    CHECK(file.read<double>("singles", {6}).data[1] == -2.5);
    CHECK(file.read<std::int64_t>("ids", {2}).data == std::vector<std::int64_t>{-1, 4294967295});
    CHECK(file.read<int>("bytes").data == std::vector<int>{0, 255});
    CHECK(file.read_number<int>("count") == 7);
    CHECK(file.read_number<double>("count", Numbers::any) == 7.0);
    CHECK(file.read<float>("nothing", {-1, 3}).size() == 0);
    CHECK(file.read_texts("kind") == std::vector<std::string>{"gsh Zoë 人 \xF0\x9F\x99\x82"});
    CHECK(file.read_texts("silence") == std::vector<std::string>{""});
    CHECK(file.read_texts("names") == std::vector<std::string>{"pelvis", "left_hip", ""});
    CHECK(file.header("numbers").dtype == "<f8");
}

TEST_CASE("the same arrays give the same bytes") {
    const test::Temporary folder;
    for (const char* name : {"a.npz", "b.npz"}) {
        NpzWriter file(folder / name);
        file.add("x", std::vector<float>{1, 2, 3});
        file.commit();
    }
    CHECK(read_file(folder / "a.npz") == read_file(folder / "b.npz"));
}

TEST_CASE("a writer's own mistakes") {
    const test::Temporary folder;
    NpzWriter file(folder / "a.npz");
    CHECK_THROWS_AS(file.add("x", std::vector<float>(3), {2, 2}), ShapeError);
    file.add("x", std::vector<float>(3));
    test::check_throws<ValueError>([&] { file.add("x", 1); }, {"x", "twice"});
}
