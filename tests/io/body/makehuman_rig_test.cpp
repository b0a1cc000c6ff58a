// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/body/makehuman_rig.hpp>

#include "io/temporary.hpp"

#include <string>
#include <vector>

using namespace gsh;

namespace {

MakeHumanMesh small_mesh() {
    MakeHumanMesh mesh;
    mesh.vertices.resize(10);
    mesh.groups["joint-a"] = {{{7, 3, 5, 4}, {0, 0, 0, 0}}};
    mesh.groups["body"].resize(101);
    return mesh;
}

const std::string vertex_end = R"({"strategy": "VERTEX", "vertex_index": 9})";

std::string bone_json(const std::string& head, const std::string& parent = R"("")") {
    return R"({"head": )" + head + R"(, "tail": )" + vertex_end + R"(, "parent": )" + parent + "}";
}

} // namespace

TEST_CASE("a rig's bones end at means of vertices: of a cube, a list, or a single one") {
    const MakeHumanMesh mesh = small_mesh();
    const std::string bones = R"({"a": )" + bone_json(R"({"strategy": "CUBE", "cube_name": "joint-a"})") +
                              R"(, "b": )" + bone_json(R"({"strategy": "MEAN", "vertex_indices": [2, 8]})", R"("a")") +
                              R"(, "c": )" + bone_json(vertex_end, "null") + "}";
    for (const std::string& text : {bones, R"({"bones": )" + bones + R"(, "version": 110})"}) {
        const MakeHumanRig rig = parse_makehuman_rig(text, "rig.json", mesh);
        REQUIRE(rig.size() == 3);
        CHECK(rig.at("a").head == std::vector<int>{3, 4, 5, 7});
        CHECK(rig.at("b").head == std::vector<int>{2, 8});
        CHECK(rig.at("b").tail == std::vector<int>{9});
        CHECK(rig.at("b").parent == "a");
        CHECK(rig.at("c").parent.empty());
    }
}

TEST_CASE("damaged rigs are refused with file and bone") {
    const MakeHumanMesh mesh = small_mesh();
    const auto check_refused = [&](const std::string& text, std::initializer_list<std::string_view> words) {
        INFO(text);
        test::check_throws<Error>([&] { (void)parse_makehuman_rig(text, "rig.json", mesh); }, words);
    };
    const auto with_head = [](const std::string& head) { return R"({"a": )" + bone_json(head) + "}"; };
    check_refused("{", {"rig.json", "JSON"});
    check_refused("[]", {"rig.json", "array", "object"});
    check_refused(R"({"a": 1})", {"rig.json: bone 'a'", "number"});
    check_refused(R"({"a": {"tail": )" + vertex_end + "}}", {"bone 'a'", "head is missing"});
    check_refused(with_head(R"({"strategy": "NOSE"})"), {"bone 'a': head", "NOSE", "CUBE, VERTEX or MEAN"});
    check_refused(with_head(R"({"vertex_index": 1})"), {"bone 'a': head", "strategy is missing"});
    check_refused(with_head(R"({"strategy": "CUBE", "cube_name": "joint-b"})"), {"no group 'joint-b'"});
    check_refused(with_head(R"({"strategy": "CUBE", "cube_name": "body"})"), {"'body'", "101 faces", "small cube"});
    check_refused(with_head(R"({"strategy": "VERTEX", "vertex_index": 10})"), {"vertex 10", "below 10"});
    check_refused(with_head(R"({"strategy": "MEAN", "vertex_indices": [1, -1]})"), {"vertex -1"});
    check_refused(with_head(R"({"strategy": "MEAN", "vertex_indices": []})"), {"vertex_indices holds 0 vertices"});
    check_refused(R"({"a": )" + bone_json(vertex_end, R"("b")") + "}", {"bone 'a'", "'b'", "no bone"});
    check_refused(R"({"a": )" + bone_json(vertex_end, R"("b")") + R"(, "b": )" + bone_json(vertex_end, R"("a")") + "}",
                  {"cycle"});
    std::string many = "{";
    for (int k = 0; k < 1001; ++k) many += (k ? ", \"" : "\"") + std::to_string(k) + R"(": {})";
    check_refused(many + "}", {"rig.json", "at most 1000 bones"});
}

TEST_CASE("weights are read per bone, and damaged ones refused") {
    const MakeHumanRig rig = {{"a", {"", {0}, {1}}}, {"b", {"a", {0}, {1}}}};
    const auto read = [&](const std::string& text) { return parse_makehuman_weights(text, "weights.json", rig, 5); };
    const MakeHumanWeights weights = read(R"({"license": "CC0", "weights": {"a": [[0, 1], [4, 0.25]], "b": []}})");
    CHECK(weights.at("a") == std::vector<std::pair<int, double>>{{0, 1.0}, {4, 0.25}});
    CHECK(weights.at("b").empty());
    const auto check_refused = [&](const std::string& text, std::initializer_list<std::string_view> words) {
        INFO(text);
        test::check_throws<Error>([&] { (void)read(text); }, words);
    };
    check_refused("{}", {"weights.json", "weights is missing"});
    check_refused(R"({"weights": []})", {"weights.json", "no object"});
    check_refused(R"({"weights": {"c": []}})", {"weights of 'c'", "no such bone"});
    check_refused(R"({"weights": {"a": 1}})", {"weights of 'a'", "no list"});
    for (const char* row : {"1", "[1]", "[1, 0.5, 2]", "[0.5, 1]", "[\"1\", 1]", "[1, null]"})
        check_refused(std::string(R"({"weights": {"a": [[0, 1], )") + row + "]}}", {"row 1", "[VERTEX, WEIGHT]"});
    check_refused(R"({"weights": {"a": [[5, 1]]}})", {"vertex 5", "below 5"});
    check_refused(R"({"weights": {"a": [[-1, 1]]}})", {"vertex -1"});
    check_refused(R"({"weights": {"a": [[1, 1.5]]}})", {"vertex 1", "1.5", "0 to 1"});
    check_refused(R"({"weights": {"a": [[1, -0.5]]}})", {"-0.5"});
}
