// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/body/region_file.hpp>

#include "io/temporary.hpp"

#include <string>
#include <vector>

using namespace gsh;

namespace {

RegionLists lists_of(const std::string& text, std::size_t vertex_count = 6) {
    const test::Temporary folder;
    write_file(folder / "regions.json", text);
    return read_regions(folder / "regions.json", vertex_count);
}

} // namespace

TEST_CASE("lists and importance are read as they stand") {
    const RegionLists lists = lists_of(R"({"face_vertices": [5, 0], "left_hand_vertices": [],
                                     "importance": [0, 1, 0.25, 0.5, 1, 0]})");
    CHECK(*lists.face == std::vector<int>{5, 0});
    CHECK(lists.left_hand->empty()); // present and empty
    CHECK(!lists.right_hand);
    CHECK(!lists.high);
    CHECK(lists.importance == std::vector<double>{0, 1, 0.25, 0.5, 1, 0});
    CHECK(*lists_of(R"({"high": [2]})").high == std::vector<int>{2});
    CHECK(*lists_of(R"({"right_hand_vertices": [3, 4], "high": null})").right_hand == std::vector<int>{3, 4});
}

TEST_CASE("what cannot be meant is refused, with the file and the field") {
    using test::check_throws;
    const test::Temporary folder;
    check_throws<IoError>([&] { (void)read_regions(folder / "none.json", 6); }, {"none.json"});
    check_throws<IoError>([] { (void)lists_of("{\"high\": [1,"); }, {"regions.json", "JSON"});
    check_throws<IoError>([] { (void)lists_of("[1, 2]"); }, {"regions.json", "array", "object"});
    check_throws<IoError>([] { (void)lists_of("{}"); }, {"no region", "face_vertices"});
    check_throws<IoError>([] { (void)lists_of(R"({"high": [1], "face_vertex": [2]})"); },
                          {"face_vertex", "face_vertices"});
    check_throws<IoError>([] { (void)lists_of(R"({"high": 3})"); }, {"high", "list"});
    check_throws<IoError>([] { (void)lists_of(R"({"high": [1.5]})"); }, {"high", "integer"});
    check_throws<ValueError>([] { (void)lists_of(R"({"high": [1, 6]})"); }, {"high[1]", "6"});
    check_throws<ValueError>([] { (void)lists_of(R"({"face_vertices": [-1]})"); }, {"face_vertices[0]", "-1"});
    check_throws<ShapeError>([] { (void)lists_of(R"({"importance": [0, 1]})"); }, {"importance", "2", "6"});
    check_throws<ValueError>([] { (void)lists_of(R"({"importance": [0, 0, 0, 1.5, 0, 0]})"); },
                             {"importance[3]", "[0,"});
}
