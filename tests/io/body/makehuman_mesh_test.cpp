// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/body/makehuman_mesh.hpp>

#include "io/temporary.hpp"

#include <gsh/io/body/makehuman_surface.hpp>

#include <array>
#include <string>
#include <vector>

using namespace gsh;

namespace {

const std::string quad_lines = "v 0 0 0\nv 10 0 0\nv 10 20 0\nv 0 20 0\nvt 0 0\nvt 0.5 0\nvt 0.5 1\nvt 0 1\n";

void check_mesh_refused(const std::string& text, std::initializer_list<std::string_view> words) {
    INFO(text);
    test::check_throws<IoError>([&] { (void)parse_makehuman_mesh(text, "base.obj"); }, words);
}

} // namespace

TEST_CASE("the base mesh is read in metres, with its groups") {
    const MakeHumanMesh mesh = parse_makehuman_mesh(
        "# comment\n" + quad_lines +
            "s 1\ng body\nf 1/1 2/2 3/3 4/4\ng joint-head\nf 4/1/7 3/2 2/3 1/4\ng body\nf 1/4 2/4 3/4 1/4\n",
        "base.obj");
    REQUIRE(mesh.vertices.size() == 4);
    CHECK(mesh.vertices[2] == vec3<double>(1, 2, 0));
    CHECK(mesh.vt[2] == vec2<double>(0.5, 1));
    REQUIRE(mesh.groups.size() == 2);
    CHECK(mesh.groups.at("body").size() == 2);
    CHECK(mesh.groups.at("joint-head")[0].corners == std::array<int, 4>{3, 2, 1, 0});
    CHECK(mesh.groups.at("joint-head")[0].texture == std::array<int, 4>{0, 1, 2, 3});
    CHECK(mesh.vertices_of("body") == std::vector<int>{0, 1, 2, 3});
    CHECK(mesh.vertices_of("none").empty());
}

TEST_CASE("damaged base meshes are refused with file and line") {
    check_mesh_refused("v 1 2\n", {"base.obj:1", "2 numbers", "expected 3"});
    check_mesh_refused("v 1 2 x\n", {"base.obj:1", "'x'"});
    check_mesh_refused("v 1 2 nan\n", {"base.obj:1", "finite"});
    check_mesh_refused("v 1 2 1e9\n", {"base.obj:1", "beyond 100 m"});
    check_mesh_refused("vt 1\n", {"base.obj:1", "1 numbers", "expected 2"});
    check_mesh_refused(quad_lines + "f 1/1 2/2 3/3 4/4\n", {"base.obj:9", "before the first group"});
    check_mesh_refused(quad_lines + "g body\nf 1/1 2/2 3/3\n", {"base.obj:10", "3 corners", "expected 4"});
    check_mesh_refused(quad_lines + "g body\nf 1/1 2/2 3/3 5/4\n", {"base.obj:10", "vertex 5", "1 to 4"});
    check_mesh_refused(quad_lines + "g body\nf 0/1 2/2 3/3 4/4\n", {"base.obj:10", "vertex 0", "1 to 4"});
    check_mesh_refused(quad_lines + "g body\nf 1/1 2/9 3/3 4/4\n", {"base.obj:10", "texture coordinate 9", "1 to 4"});
    check_mesh_refused(quad_lines + "g body\nf 1 2 3 4\n", {"base.obj:10", "VERTEX/TEXTURE"});
    check_mesh_refused(quad_lines + "g body\nf -1/1 2/2 3/3 4/4\n", {"base.obj:10", "'-1/1'"});
    check_mesh_refused(quad_lines, {"base.obj", "no groups"});
    std::string many;
    for (int k = 0; k < 100001; ++k) many += "v 0 0 0\n";
    check_mesh_refused(many, {"base.obj:100001", "at most 100000"});
}

TEST_CASE("the surface keeps six groups, in the order of the base mesh, as triangles with texture") {
    MakeHumanMesh mesh;
    mesh.vertices.resize(26), mesh.vt.resize(26);
    const auto quad = [](int first) {
        return MakeHumanMesh::Quad{{first, first + 1, first + 2, first + 3}, {first + 3, first + 2, first + 1, first}};
    };
    mesh.groups["helper-skirt"] = {quad(0)}; // left out
    mesh.groups["helper-tongue"] = {quad(2)};
    mesh.groups["body"] = {quad(6)};
    mesh.groups["helper-l-eye"] = {quad(10)};
    mesh.groups["helper-r-eye"] = {quad(14)};
    mesh.groups["helper-lower-teeth"] = {quad(18)};
    test::check_throws<ValueError>([&] { (void)makehuman_surface(mesh, "base.obj"); },
                                   {"base.obj", "helper-upper-teeth"});
    mesh.groups["helper-upper-teeth"] = {quad(22)};
    const MakeHumanSurface surface = makehuman_surface(mesh, "base.obj");
    REQUIRE(surface.vertices.size() == 24);
    CHECK(surface.vertices.front() == 2);
    CHECK(surface.vertices.back() == 25);
    CHECK(surface.vt.size() == 24);
    REQUIRE(surface.faces.size() == 12);
    CHECK(surface.faces[0] == std::array<int, 3>{4, 5, 6}); // the body's
    CHECK(surface.faces[1] == std::array<int, 3>{4, 6, 7});
    CHECK(surface.ft[1] == std::array<int, 3>{7, 5, 4});
    for (std::size_t v = 0; v < 24; ++v) CHECK(makehuman_part_names[surface.parts[v]] != "");
    CHECK(surface.parts[0] == 1);
    CHECK(surface.parts[4] == 0);
    CHECK(surface.parts[8] == 2);
    CHECK(surface.parts[23] == 5);
}

TEST_CASE("each vertex has a mirror image, or the mesh is refused") {
    const std::vector<vec3<double>> vertices = {{0, 1, 2}, {-0.5, 0, 1}, {0.5, 0, 1}, {-0.0, 3, 3}};
    CHECK(mirrored_vertices(vertices, "base.obj") == std::vector<int>{0, 2, 1, 3});
    test::check_throws<ValueError>([&] { (void)mirrored_vertices({{0.5, 0, 0}, {-0.4, 0, 0}}, "base.obj"); },
                                   {"base.obj", "vertex 0", "mirror image"});
}
