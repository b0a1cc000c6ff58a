// SPDX-License-Identifier: Apache-2.0
/// @file  Motions written as GLB come back as they were, and the file is plain glTF.

#include "io/glb_json.hpp"
#include "io/gltf_files.hpp"
#include "io/temporary.hpp"
#include "support/skeleton_body.hpp"

#include <doctest/doctest.h>

#include <gsh/body/retarget.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/motion/gltf_export.hpp>
#include <gsh/io/motion/gltf_motion.hpp>
#include <gsh/synthetic/actor_motion.hpp>

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

using namespace gsh;

namespace {

Motion motion_of_body() {
    Motion motion = actor_motion(ActorMotion::stride, 6);
    motion.expression_count = 0, motion.expression.clear();
    motion.betas = {0.5};
    return motion;
}

} // namespace

TEST_CASE("a body's motion comes back within 1e-4 rad, whatever the axes of its joints") {
    const test::Temporary folder;
    const Motion motion = motion_of_body();
    for (const bool turned : {false, true}) {
        RigMotion rig = rig_of_motion(test::skeleton_body(), motion);
        test::Rng rng(4);
        for (std::size_t j = 0; turned && j < 55; ++j) {
            const mat3<double> axes = rotation_from_axis_angle(rng.vec(-2, 2));
            rig.rest_rotations[j] = rig.rest_rotations[j] * axes;
            for (std::size_t t = 0; t < 6; ++t) rig.rotations[t * 55 + j] = rig.rotations[t * 55 + j] * axes;
        }
        save_gltf_motion(folder / "a.glb", rig, "stride");
        CHECK(folder.file_count() == 1);
        const Motion back =
            retarget(load_gltf_motion(folder / "a.glb"), test::skeleton_body(), {}, {motion.betas, "a", nullptr});
        REQUIRE(back.frame_count() == 6);
        double angle = 0, place = 0;
        for (std::size_t i = 0; i < motion.pose.size(); ++i)
            angle =
                std::max(angle, length(axis_angle_from_rotation(transpose(rotation_from_axis_angle(motion.pose[i])) *
                                                                rotation_from_axis_angle(back.pose[i]))));
        for (std::size_t t = 0; t < 6; ++t) {
            place = std::max(place, length(motion.transl[t] - back.transl[t]));
            CHECK(back.timestamps[t] == doctest::Approx(motion.timestamps[t]));
        }
        CHECK(angle < 1e-5);
        CHECK(place < 1e-6);
    }
}

TEST_CASE("nothing is guessed about a GLB that gsh wrote") {
    const test::Temporary folder;
    // On the belly in every frame, a metre from the origin: z seems to be up. And as small as a doll.
    Motion lying = motion_of_body();
    for (std::size_t t = 0; t < 6; ++t) {
        for (std::size_t j = 0; j < 55; ++j) lying.pose[55 * t + j] = {j == 0 ? 1.5707963267948966 : 0, 0, 0};
        lying.transl[t] = {0, 0, 1};
    }
    for (const double size : {1.0, 0.1}) {
        RigMotion rig = rig_of_motion(test::skeleton_body(), lying);
        move_rig(rig, mat3<double>(1), size);
        save_gltf_motion(folder / "a.glb", rig);
        std::vector<std::string> warnings;
        const RigMotion back = load_gltf_motion(folder / "a.glb", {}, &warnings);
        CHECK(warnings.empty());
        CHECK(length(back.joint(5, 0) - rig.joint(5, 0)) < 1e-6);
        CHECK(length(back.joint(5, 7) - rig.joint(5, 7)) < 1e-5);
        std::string other = read_file(folder / "a.glb"); // as another program would write the same
        other.replace(other.find("\"gsh "), 5, "\"she ");
        write_file(folder / "b.glb", other);
        (void)load_gltf_motion(folder / "b.glb", {}, &warnings);
        CHECK(!warnings.empty());
    }
}

TEST_CASE("the file is plain glTF: chunks, nodes, a skin, bounds of the times") {
    const test::Temporary folder;
    save_gltf_motion(folder / "a.glb", rig_of_motion(test::skeleton_body(), motion_of_body()), "stride");
    const std::string bytes = read_file(folder / "a.glb");
    const auto number = [&](std::size_t at) {
        std::uint32_t value = 0;
        std::memcpy(&value, bytes.data() + at, 4);
        return value;
    };
    CHECK(bytes.substr(0, 4) == "glTF");
    CHECK(number(8) == bytes.size());
    CHECK(number(12) % 4 == 0);
    const auto json = nlohmann::json::parse(bytes.substr(20, number(12)));
    CHECK(json["asset"]["generator"] == file_author());
    CHECK(json["nodes"].size() == 55);
    CHECK(json["nodes"][0]["name"] == "pelvis");
    CHECK(json["skins"][0]["joints"].size() == 55);
    CHECK(json["animations"][0]["name"] == "stride");
    CHECK(json["animations"][0]["channels"].size() == 56);
    const auto& times = json["accessors"][json["animations"][0]["samplers"][0]["input"].get<std::size_t>()];
    CHECK(times["min"][0] == 0.0);
    CHECK(times["max"][0].get<double>() == doctest::Approx(0.5));
    CHECK(!json["buffers"][0].contains("uri"));
    const std::size_t bin = 20 + number(12);
    CHECK(number(bin + 4) == 0x004E4942);
    CHECK(json["buffers"][0]["byteLength"].get<std::size_t>() <= number(bin));
}

TEST_CASE("times that do not ascend are refused; nothing is written") {
    const test::Temporary folder;
    RigMotion rig = rig_of_motion(test::skeleton_body(), motion_of_body());
    rig.timestamps[3] = rig.timestamps[2];
    test::check_throws<ValueError>([&] { save_gltf_motion(folder / "a.glb", rig); }, {"a.glb", "frames 2 and 3"});
    CHECK(folder.file_count() == 0);
}

TEST_CASE("times that are one float, names in another encoding, several roots") {
    const test::Temporary folder;
    RigMotion rig = rig_of_motion(test::skeleton_body(), motion_of_body());
    for (double& time : rig.timestamps) time += 1e9; // where floats are 64 s apart
    test::check_throws<ValueError>([&] { save_gltf_motion(folder / "a.glb", rig); }, {"a.glb", "frames 0 and 1"});
    rig = rig_of_motion(test::skeleton_body(), motion_of_body());
    rig.names[3] = "R\xFC"
                   "cken"; // Latin-1
    save_gltf_motion(folder / "a.glb", rig);
    CHECK(load_gltf_motion(folder / "a.glb").names[3] == "R\xEF\xBF\xBD"
                                                         "cken");
    CHECK(test::json_of_glb(folder / "a.glb")["skins"][0]["skeleton"] == 0);
    rig.parents[1] = -1;
    save_gltf_motion(folder / "a.glb", rig);
    CHECK(!test::json_of_glb(folder / "a.glb")["skins"][0].contains("skeleton"));
}

TEST_CASE("an accessor has at least one whole element") {
    GlbWriter file;
    const std::vector<float> numbers{1, 2, 3, 4};
    const int view = file.add_view(numbers.data(), 16);
    CHECK(file.add_accessor(view, 4, Span<const float>(numbers).subspan(1, 3), {.width = 3, .bounds = true}) == 0);
    CHECK_THROWS_AS((void)file.add_accessor(view, 0, Span<const float>(), {.bounds = true}), ValueError);
    CHECK_THROWS_AS((void)file.add_accessor(view, 0, Span<const float>(numbers), {.width = 3}), ValueError);
    CHECK_THROWS_AS((void)file.add_times({}, "a"), ValueError);
    const std::vector<double> endless{0, 1e300};
    test::check_throws<ValueError>([&] { (void)file.add_times(endless, "a"); }, {"a: times[1]", "finite"});
}
