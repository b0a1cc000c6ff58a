// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/file/gltf_file.hpp>
#include <gsh/io/file/gltf_nodes.hpp>
#include <gsh/io/file/gltf_numbers.hpp>
#include <gsh/io/model/gltf_mesh.hpp>

#include "io/glb_json.hpp"
#include "io/temporary.hpp"
#include "support/tube_avatar.hpp"

#include <doctest/doctest.h>

#include <cstddef>
#include <string>
#include <vector>

using namespace gsh;

namespace {

Motion mesh_motion(const AvatarData& avatar) {
    test::Rng rng(4);
    Motion motion = rest_motion(avatar.rig);
    motion.pose = rng.vecs(8, -0.5, 0.5);
    motion.transl = {{0.1, 0.2, 0.3}, {0, 0.5, 0}};
    motion.timestamps = {0, 0.5};
    motion.expression_count = 2;
    motion.expression = {0.5, 1, -1, 2};
    motion.betas = {0.6, 0.2};
    return motion;
}

} // namespace

TEST_CASE("bones, skin, expressions and shape of the file pose the mesh as gsh poses the body") {
    const test::Temporary folder;
    const AvatarData avatar = test::tube_avatar(2);
    const Motion motion = mesh_motion(avatar);
    const std::vector<std::size_t> frames{0, 1};
    write_gltf_mesh(folder / "a.glb", avatar, motion, frames, motion.timestamps);
    const detail::GltfFile file(folder / "a.glb", detail::GltfParts::meshes);
    const detail::GltfNodes nodes(file);
    detail::GltfNumbers numbers(file);
    const auto& attributes = file.model().meshes.at(0).primitives.at(0).attributes;
    const auto positions = numbers.read(attributes.at("POSITION"), 3, "positions"),
               joints = numbers.read(attributes.at("JOINTS_0"), 4, "joints"),
               weights = numbers.read(attributes.at("WEIGHTS_0"), 4, "weights"),
               inverse = numbers.read(file.model().skins.at(0).inverseBindMatrices, 16, "inverse");
    const std::size_t V = positions.size() / 3, J = avatar.rig.joint_count();
    REQUIRE(V == avatar.rig.body.vertex_count());
    const auto json = test::json_of_glb(folder / "a.glb");
    const auto& targets = json["meshes"][0]["primitives"][0]["targets"];
    REQUIRE(targets.size() == 2);
    const auto& first = json["accessors"][targets[0]["POSITION"].get<std::size_t>()];
    CHECK(first.contains("sparse"));
    CHECK(first["sparse"]["count"] == 20);
    for (const char* part : {"indices", "values"}) CHECK(first["sparse"][part]["byteOffset"] == 0); // for VTK
    const auto moved = numbers.read(targets[0]["POSITION"].get<int>(), 3, "first");
    const auto second = numbers.read(targets[1]["POSITION"].get<int>(), 3, "second");
    CHECK(json["extensionsUsed"][0] == "KHR_materials_unlit");
    const auto channels = nodes.channels(file.model().animations.at(0), numbers, "motion");

    const ColoredMesh mesh = colored_mesh(avatar, motion.betas);
    for (std::size_t v = 0; v < V; ++v)
        CHECK(mesh.expressions[0][v] == vec3<float>(vec3<double>(moved[3 * v], moved[3 * v + 1], moved[3 * v + 2])));
    const auto plain = shaped_vertices(avatar.rig.body, motion.betas);
    for (std::size_t f = 0; f < 2; ++f) {
        const auto maps = nodes.world_maps(channels, motion.timestamps[f]);
        // The body, displaced like the mesh, by gsh's own skinning.
        BodyModel displaced = avatar.rig.body;
        for (std::size_t v = 0; v < V; ++v) displaced.v_template[v] += mesh.vertices[v] - plain[v];
        const auto expected = pose_body(displaced, motion.pose_at(f), motion.transl[f], motion.betas,
                                        motion.expression_at(f), mesh.rest_joints)
                                  .vertices;
        double largest = 0;
        for (std::size_t v = 0; v < V; ++v) {
            vec3<double> rest(positions[3 * v], positions[3 * v + 1], positions[3 * v + 2]), posed(0);
            rest += vec3<double>(mesh.expressions[0][v]) * motion.expression_at(f)[0];
            rest += vec3<double>(second[3 * v], second[3 * v + 1], second[3 * v + 2]) * motion.expression_at(f)[1];
            for (std::size_t k = 0; k < 4; ++k) {
                const auto j = static_cast<std::size_t>(joints[4 * v + k]);
                REQUIRE(j < J);
                const vec3<double> bound =
                    rest + vec3<double>(inverse[16 * j + 12], inverse[16 * j + 13], inverse[16 * j + 14]);
                posed += (*maps[j])(bound) * double(weights[4 * v + k]);
            }
            largest = std::max(largest, length(posed - expected[v]));
        }
        CHECK(largest < 1e-5);
    }
    // Without frames it rests.
    write_gltf_mesh(folder / "b.glb", avatar, rest_motion(avatar.rig), {}, {});
    CHECK(!test::json_of_glb(folder / "b.glb").contains("animations"));
    CHECK_THROWS_AS(write_gltf_mesh(folder / "c.glb", avatar, motion, frames, {}), ShapeError);
    for (const auto& times : std::vector<std::vector<double>>{{1, 0}, {1e9, 1e9 + 1}})
        CHECK_THROWS_AS(write_gltf_mesh(folder / "c.glb", avatar, motion, frames, times), ValueError);
    CHECK(folder.file_count() == 2);
}

TEST_CASE("an expression that moves nothing has bytes, too") {
    GlbWriter file;
    (void)detail::add_displacements(file, std::vector<vec3<float>>(10, vec3<float>(0)));
    const auto& accessor = file.json["accessors"][0];
    CHECK(accessor["count"] == 10);
    CHECK(accessor["sparse"]["count"] == 1);
    CHECK(file.json["bufferViews"][1]["byteLength"] == 12);
}
