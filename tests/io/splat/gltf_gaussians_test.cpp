// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/splat/gltf_gaussians.hpp>

#include "io/gltf_files.hpp"
#include "io/splat_clouds.hpp"
#include "io/splat_document.hpp"
#include "io/temporary.hpp"
#include "support/contains.hpp"

#include <gsh/io/file/input_file.hpp>
#include <gsh/io/splat/any_splats.hpp>
#include <gsh/io/splat/gltf_splats.hpp>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

using namespace gsh;

namespace {

constexpr test::SplatTolerance near{
    .mean = 1e-5, .log_scale = 1e-5, .rotation = 1e-4, .opacity = 1e-5, .dc = 1e-5, .rest = 1e-5};

StillSplats written(test::SplatDocument& document, const test::Temporary& folder) {
    document.file.write(folder / "a.glb");
    return read_gltf_splats(folder / "a.glb");
}

} // namespace

TEST_CASE("indices choose the Gaussians that are drawn, in their order") {
    const test::Temporary folder;
    const auto cloud = test::splat_cloud(40, 1);
    const std::vector<std::uint32_t> drawn{7, 3, 39, 3};
    test::SplatDocument wide(cloud), narrow(cloud), beyond(cloud);
    wide.primitive()["indices"] = wide.file.add(drawn, {.target = 34963});
    test::check_near(written(wide, folder).cloud, reordered(cloud, Span<const std::uint32_t>(drawn)), near);
    narrow.primitive()["indices"] = narrow.file.add(std::vector<std::uint8_t>{7, 3, 39, 3}, {});
    test::check_near(written(narrow, folder).cloud, reordered(cloud, Span<const std::uint32_t>(drawn)), near);
    beyond.primitive()["indices"] = beyond.file.add(std::vector<std::uint16_t>{7, 40}, {});
    test::check_throws<IoError>([&] { (void)written(beyond, folder); },
                                {"a.glb", "mesh 0: indices: accessor", "holds 40, expected indices below 40"});
}

TEST_CASE("sparse accessors and accessors without bytes") {
    const test::Temporary folder;
    auto cloud = test::splat_cloud(40, 1);
    test::SplatDocument document(cloud);
    const std::vector<std::uint16_t> places{3, 17};
    const std::vector<float> values{9, 9, 9, 8, 7, 6};
    // Positions: two are replaced. Scales are kept. A band: zeros but for one element.
    document.accessor("POSITION")["sparse"] = {
        {"count", 2},
        {"indices", {{"bufferView", document.file.add_view(places.data(), 4)}, {"componentType", 5123}}},
        {"values", {{"bufferView", document.file.add_view(values.data(), 24)}}}};
    cloud.means[3] = {9, 9, 9}, cloud.means[17] = {8, 7, 6};
    test::SplatDocument::Json& band = document.accessor("SH_DEGREE_1_COEF_1");
    band.erase("bufferView");
    band["sparse"] = {
        {"count", 1},
        {"indices",
         {{"bufferView", document.file.add_view(places.data(), 4)}, {"byteOffset", 2}, {"componentType", 5123}}},
        {"values", {{"bufferView", document.file.add_view(values.data(), 24)}, {"byteOffset", 12}}}};
    document.accessor("SH_DEGREE_1_COEF_2").erase("bufferView");
    for (std::size_t i = 0; i < 40; ++i)
        cloud.sh[4 * i + 2] = i == 17 ? vec3<float>(8, 7, 6) : vec3<float>(0), cloud.sh[4 * i + 3] = vec3<float>(0);
    test::check_near(written(document, folder).cloud, cloud, near);
}

TEST_CASE("integers that stand for fractions: quantised positions, rotations, scales and opacities") {
    const test::Temporary folder;
    auto cloud = test::splat_cloud(4, 0);
    test::SplatDocument document(cloud);
    document.file.json["extensionsRequired"] = {"KHR_mesh_quantization"};
    document.set("POSITION", std::vector<std::int16_t>{0, 1, 2, -3, 4, 5, 6, 7, 8, 9, 10, -11}, {.width = 3});
    document.set("ROTATION",
                 std::vector<std::int16_t>{0, 0, 0, 32767, 0, 0, 32767, 0, 0, 32767, 0, 0, 23170, 0, 0, 23170},
                 {.width = 4, .normalized = true});
    document.set("SCALE", std::vector<std::uint8_t>{255, 51, 51, 51, 51, 51, 51, 51, 51, 51, 51, 51},
                 {.width = 3, .normalized = true});
    document.set("OPACITY", std::vector<std::uint16_t>{65535, 13107, 32768, 0}, {.normalized = true});
    document.file.json["nodes"][0]["scale"] = {0.5, 0.5, 0.5}; // as quantised files undo their unit
    cloud.means = {{0, 0.5, 1}, {-1.5, 2, 2.5}, {3, 3.5, 4}, {4.5, 5, -5.5}};
    const float h = std::sqrt(0.5f), fifth = std::log(0.1f);
    cloud.quats = {{1, 0, 0, 0}, {0, 0, 0, 1}, {0, 0, 1, 0}, {h, h, 0, 0}};
    cloud.log_scales = {{std::log(0.5f), fifth, fifth}, vec3<float>(fifth), vec3<float>(fifth), vec3<float>(fifth)};
    cloud.opacity_logits = {20, logit(0.2f), logit(32768 / 65535.0f), -20};
    const StillSplats splats = written(document, folder);
    test::check_near(splats.cloud, cloud, near);
    CHECK(splats.warnings.empty());
}

TEST_CASE("extensions inside that are not known are notes") {
    const test::Temporary folder;
    const auto cloud = test::splat_cloud(20, 1);
    test::SplatDocument document(cloud);
    document.extension()["extensions"] = {{"VENDOR_note", {{"trainer", "x"}}}};
    document.file.json["extensionsUsed"].push_back("VENDOR_note");
    document.file.json["extensionsRequired"] = {"KHR_gaussian_splatting", "KHR_materials_unlit", "VENDOR_texture_x",
                                                "KHR_xmp_json_ld"};
    const StillSplats splats = written(document, folder);
    test::check_near(splats.cloud, cloud, near);
    CHECK(splats.warnings.empty());
    document.file.json["extensionsRequired"].push_back("VENDOR_note");
    test::check_throws<IoError>([&] { (void)written(document, folder); },
                                {"a.glb", "requires the glTF extension 'VENDOR_note', which is not read"});
    test::SplatDocument kernel(cloud);
    kernel.extension()["kernel"] = "box", kernel.extension()["projection"] = "fisheye";
    const StillSplats other = written(kernel, folder);
    test::check_near(other.cloud, cloud, near);
    REQUIRE(other.warnings.size() == 2);
    CHECK(other.warnings[0] == test::contains("a.glb: mesh 0: kernel is 'box', which is not known"));
    CHECK(other.warnings[1] == test::contains("projection is 'fisheye'"));
}

TEST_CASE("negative scales are the logarithms of an earlier draft, in all primitives of the file") {
    const test::Temporary folder;
    auto cloud = test::splat_cloud(20, 0);
    cloud.log_scales[4] = {1.5f, -2, 0};
    test::SplatDocument document(cloud);
    document.set("SCALE", test::numbers_of({cloud.log_scales.begin(), cloud.log_scales.end()}), {.width = 3});
    test::SplatDocument::Json second = document.primitive(); // all of its scales are positive
    document.file.json["meshes"][0]["primitives"].push_back(second);
    document.file.json["meshes"][0]["primitives"][1]["attributes"]["KHR_gaussian_splatting:SCALE"] =
        document.file.add(std::vector<float>(60, 0.25f), {.width = 3});
    const StillSplats splats = written(document, folder);
    REQUIRE(splats.cloud.size() == 40);
    for (std::size_t i = 0; i < 20; ++i) {
        CHECK(splats.cloud.log_scales[i] == cloud.log_scales[i]);
        CHECK(splats.cloud.log_scales[20 + i] == vec3<float>(0.25f));
    }
    REQUIRE(splats.warnings.size() == 1);
    CHECK(splats.warnings[0] == test::contains("has negative scales, so all of its scales are read as logarithms"));
}

TEST_CASE("colours in linear light are converted, and the warning says so") {
    const test::Temporary folder;
    auto cloud = test::splat_cloud(3, 0);
    constexpr float Y = 0.28209479f;
    cloud.sh = {vec3<float>((0.5f - 0.5f) / Y), vec3<float>((0.214041f - 0.5f) / Y, 0, (1 - 0.5f) / Y),
                vec3<float>(-9)}; // 0.5; 0.214041, which is 0.5 of sRGB; below 0
    test::SplatDocument document(cloud);
    document.extension()["colorSpace"] = "lin_rec709_display";
    const StillSplats splats = written(document, folder);
    const auto color = [&](std::size_t i, int c) { return splats.cloud.sh[i][c] * Y + 0.5f; };
    CHECK(color(0, 0) == doctest::Approx(0.735357).epsilon(1e-5));
    CHECK(color(1, 0) == doctest::Approx(0.5).epsilon(1e-5));
    CHECK(color(1, 1) == doctest::Approx(0.735357).epsilon(1e-5));
    CHECK(color(1, 2) == doctest::Approx(1).epsilon(1e-5));
    CHECK(std::abs(color(2, 0)) < 1e-5);
    REQUIRE(splats.warnings.size() == 1);
    CHECK(splats.warnings[0] == test::contains("a.glb: colours are in linear light (lin_rec709_display)"));
}

TEST_CASE("instances: each places the node's Gaussians") {
    const test::Temporary folder;
    const auto cloud = test::splat_cloud(20, 2);
    test::SplatDocument document(cloud);
    const float h = std::sqrt(0.5f);
    document.file.json["extensionsRequired"] = {"EXT_mesh_gpu_instancing"};
    document.file.json["nodes"][0]["translation"] = {0, 0, 10};
    document.file.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = {
        {"TRANSLATION", document.file.add(std::vector<float>{0, 0, 0, 5, 0, 0}, {.width = 3})},
        {"ROTATION", document.file.add(std::vector<float>{0, 0, 0, 1, 0, 0, h, h}, {.width = 4})},
        {"SCALE", document.file.add(std::vector<float>{1, 1, 1, 2, 2, 2}, {.width = 3})},
        {"_ID", document.file.add(std::vector<float>{1, 2}, {})}};
    auto first = cloud, second = cloud;
    move_cloud(first, Affine<double>(mat3<double>(1.0), {0, 0, 10}));
    move_cloud(second, Affine<double>(mat3<double>({0, 2, 0}, {-2, 0, 0}, {0, 0, 2}), {5, 0, 10}));
    const GaussianCloud<float> both = written(document, folder).cloud;
    std::vector<std::uint32_t> ids(40);
    for (std::uint32_t i = 0; i < 40; ++i) ids[i] = i;
    test::check_near(reordered(both, Span<const std::uint32_t>(ids).subspan(0, 20)), first, near);
    test::check_near(reordered(both, Span<const std::uint32_t>(ids).subspan(20, 20)), second, near);
}

TEST_CASE("which nodes show Gaussians: mirrored, invisible, in a file without scenes") {
    const test::Temporary folder;
    const auto cloud = test::splat_cloud(20, 3);
    test::SplatDocument mirror(cloud);
    mirror.file.json["nodes"][0]["scale"] = {-1, 1, 1};
    auto expected = cloud;
    move_cloud(expected, Affine<double>(mat3<double>({-1, 0, 0}, {0, 1, 0}, {0, 0, 1}), {0, 0, 0}));
    const GaussianCloud<float> mirrored = written(mirror, folder).cloud;
    test::check_near(mirrored, expected, near);
    CHECK(mirrored.means[5].x == doctest::Approx(-cloud.means[5].x));

    test::SplatDocument hidden(cloud);
    hidden.file.json["nodes"] =
        test::SplatDocument::Json::parse(R"([{"children": [1, 3]}, {"children": [2]}, {"mesh": 0}, {"mesh": 0}])");
    hidden.file.json["nodes"][1]["extensions"]["KHR_node_visibility"]["visible"] = false;
    CHECK(written(hidden, folder).cloud.size() == 20);
    hidden.file.json["nodes"][1]["extensions"]["KHR_node_visibility"]["visible"] = true;
    CHECK(written(hidden, folder).cloud.size() == 40);

    test::SplatDocument plain(cloud);
    plain.file.json.erase("scenes"), plain.file.json.erase("scene");
    test::check_near(written(plain, folder).cloud, cloud, near);
}

TEST_CASE("glTF as text, with its bytes inside or beside") {
    const test::Temporary folder;
    const auto cloud = test::splat_cloud(20, 1);
    test::SplatDocument document(cloud);
    document.file.write(folder / "a.glb");
    const std::string glb = read_file(folder / "a.glb");
    std::uint32_t size = 0;
    std::memcpy(&size, glb.data() + 12, 4);
    auto json = test::SplatDocument::Json::parse(glb.substr(20, size));
    const std::string bytes = glb.substr(28 + size);
    write_file(folder / "beside.bin", bytes.substr(0, json["buffers"][0]["byteLength"].get<std::size_t>()));
    json["buffers"][0]["uri"] = "beside.bin";
    write_file(folder / "a.gltf", json.dump(1));
    CHECK(recognise_splats(folder / "a.gltf") == SplatFormat::glb);
    test::check_near(load_any_splats(folder / "a.gltf").cloud, cloud, near);
    json["buffers"][0]["uri"] = "data:application/octet-stream;base64," +
                                test::base64_of(bytes.substr(0, json["buffers"][0]["byteLength"].get<std::size_t>()));
    write_file(folder / "b.gltf", "\n " + json.dump());
    test::check_near(load_any_splats(folder / "b.gltf").cloud, cloud, near);
    write_file(folder / "c.gltf", "no JSON");
    test::check_throws<IoError>([&] { (void)load_any_splats(folder / "c.gltf"); }, {"c.gltf", "is not glTF"});
}
