// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/splat/gltf_splats.hpp>

#include "io/damage.hpp"
#include "io/glb_json.hpp"
#include "io/splat_clouds.hpp"
#include "io/temporary.hpp"

#include <gsh/io/file/input_file.hpp>

#include <functional>
#include <initializer_list>
#include <numbers>
#include <string>
#include <string_view>

using namespace gsh;
using GltfJson = nlohmann::ordered_json;

namespace {

constexpr test::SplatTolerance glb_tolerance{
    .mean = 0, .log_scale = 2e-6, .rotation = 2e-6, .opacity = 2e-6, .dc = 0, .rest = 0};

/// The JSON of a GLB file, edited, and the file written anew.
void edit_glb(const std::filesystem::path& path, const std::function<void(GltfJson&)>& edit) {
    GltfJson json = test::json_of_glb(path);
    edit(json);
    test::replace_json_of_glb(path, json);
}

} // namespace

TEST_CASE("clouds of degrees 0 to 3 come back from .glb") {
    const test::Temporary folder;
    for (int degree = 0; degree <= 3; ++degree) {
        const auto cloud = test::splat_cloud(50, degree);
        write_gltf_splats(folder / "a.glb", cloud, PixelFilter{0.1, true});
        const StillSplats splats = read_gltf_splats(folder / "a.glb");
        test::check_near(splats.cloud, cloud, glb_tolerance);
        CHECK(splats.notes.up == UpAxis::y);
        REQUIRE(splats.notes.filter.has_value());
        CHECK(splats.notes.filter->dilation == 0.1);
        CHECK(splats.notes.filter->compensate_opacity);
    }
    write_gltf_splats(folder / "a.glb", test::splat_cloud(1, 0));
    CHECK(!read_gltf_splats(folder / "a.glb").notes.filter.has_value());
    CHECK_THROWS_AS(write_gltf_splats(folder / "a.glb", test::splat_cloud(2, 4)), ValueError);
    CHECK_THROWS_AS(write_gltf_splats(folder / "a.glb", test::splat_cloud(0, 1)), ValueError);
}

TEST_CASE("opacities come back however near they are to 0 and 1") {
    const test::Temporary folder;
    auto cloud = test::splat_cloud(4, 0);
    cloud.opacity_logits = {-18, 15, -200, 200};
    write_gltf_splats(folder / "a.glb", cloud);
    const auto found = read_gltf_splats(folder / "a.glb").cloud.opacity_logits;
    CHECK(found[0] == doctest::Approx(-18).epsilon(1e-5));
    CHECK(found[1] == doctest::Approx(15).epsilon(0.02)); // a float holds 1 - 3e-7 roughly
    CHECK(found[2] == -certain_logit);
    CHECK(found[3] == certain_logit);
}

TEST_CASE("the document is what the extension asks for") {
    const test::Temporary folder;
    write_gltf_splats(folder / "a.glb", test::splat_cloud(7, 1));
    const std::string bytes = read_file(folder / "a.glb");
    CHECK(bytes.starts_with("glTF"));
    CHECK(bytes.size() % 4 == 0);
    const GltfJson json = test::json_of_glb(folder / "a.glb");
    const auto& primitive = json["meshes"][0]["primitives"][0];
    CHECK(primitive["mode"] == 0);
    CHECK(primitive["extensions"]["KHR_gaussian_splatting"]["kernel"] == "ellipse");
    CHECK(json["extensionsUsed"][0] == "KHR_gaussian_splatting");
    CHECK(json["asset"]["generator"] == file_author());
    const auto& position = json["accessors"][primitive["attributes"]["POSITION"].get<std::size_t>()];
    CHECK(position["min"].size() == 3);
    CHECK(position["max"].size() == 3);
    CHECK(primitive["attributes"].size() == 4 + 4 + 1);
    for (const auto& view : json["bufferViews"]) CHECK(view["byteOffset"].get<int>() % 4 == 0);
}

TEST_CASE("COLOR_0 is the colour without its bands in linear light, and the opacity") {
    const test::Temporary folder;
    auto cloud = test::splat_cloud(3, 1);
    constexpr float Y = 0.28209479f;
    cloud.sh[0] = vec3<float>(0), cloud.sh[4] = {(0.3451f - 0.5f) / Y, 3, -3}; // sRGB: 0.5; 0.3451, above 1, below 0
    cloud.opacity_logits[0] = logit(0.25f);
    write_gltf_splats(folder / "a.glb", cloud);
    const detail::GltfFile file(folder / "a.glb", detail::GltfParts::meshes);
    const int accessor = file.model().meshes.at(0).primitives.at(0).attributes.at("COLOR_0");
    const auto found = detail::GltfNumbers(file).read(accessor, 4, "COLOR_0");
    CHECK(found[0] == doctest::Approx(0.214041).epsilon(1e-4));
    CHECK(found[3] == doctest::Approx(0.25).epsilon(1e-4));
    CHECK(found[4] == doctest::Approx(0.0976).epsilon(1e-3));
    CHECK(found[5] == 1);
    CHECK(found[6] == 0);
}

TEST_CASE("a node moves its Gaussians, and an animation moves the node") {
    const test::Temporary folder;
    const auto cloud = test::splat_cloud(30, 2);
    write_gltf_splats(folder / "a.glb", cloud);
    const double half = std::sqrt(0.5);
    const Affine<double> expected(mat3<double>({0, 2, 0}, {-2, 0, 0}, {0, 0, 2}),
                                  {1, 2, 3}); // a quarter about z, twice
    edit_glb(folder / "a.glb", [&](GltfJson& json) {
        json["nodes"] =
            GltfJson::parse(R"([{"children": [1], "translation": [1, 2, 3]}, {"children": [2], "scale": [2, 2, 2]},
                                        {"mesh": 0}])");
        json["nodes"][2]["rotation"] = {0, 0, half, half};
    });
    auto moved = cloud;
    move_cloud(moved, expected);
    test::check_near(read_gltf_splats(folder / "a.glb").cloud, moved,
                     {.mean = 1e-5, .log_scale = 1e-5, .rotation = 1e-4, .opacity = 1e-5, .dc = 1e-5, .rest = 1e-5});

    // The animation turns about z by half a turn in two seconds; at one second it is at a quarter.
    GlbWriter writer;
    begin_gltf_splats(writer, {});
    const GltfSplatArrays arrays(writer, cloud);
    writer.json["scenes"] = GltfJson::parse(R"([{"nodes": [0]}])");
    writer.json["nodes"] = GltfJson::parse(R"([{"mesh": 0}])");
    writer.json["meshes"] = GltfJson::array();
    writer.json["meshes"].push_back({{"primitives", GltfJson::array({arrays.primitive(0, 30)})}});
    const std::vector<float> times{0, 2}, turns{0, 0, 0, 1, 0, 0, 1, 0}, places{0, 0, 0, 2, 4, 6};
    const int input = writer.add(times, {.bounds = true}), rotation = writer.add(turns, {.width = 4}),
              translation = writer.add(places, {.width = 3});
    writer.animate(0, "rotation", input, rotation);
    writer.animate(0, "translation", input, translation);
    writer.write(folder / "b.glb");
    moved = cloud;
    move_cloud(moved, Affine<double>(mat3<double>({0, 1, 0}, {-1, 0, 0}, {0, 0, 1}), {1, 2, 3}));
    const test::SplatTolerance near{
        .mean = 1e-5, .log_scale = 1e-5, .rotation = 1e-4, .opacity = 1e-5, .dc = 1e-5, .rest = 1e-5};
    test::check_near(read_gltf_splats(folder / "b.glb", 1).cloud, moved, near);
    test::check_near(read_gltf_splats(folder / "b.glb").cloud, cloud, glb_tolerance);
    test::check_near(read_gltf_splats(folder / "b.glb", -3).cloud, cloud, near);
    moved = cloud;
    move_cloud(moved, Affine<double>(mat3<double>({-1, 0, 0}, {0, -1, 0}, {0, 0, 1}), {2, 4, 6}));
    test::check_near(read_gltf_splats(folder / "b.glb", 9).cloud, moved, near);

    const auto refuse = [&](const std::function<void(GltfJson&)>& edit, std::initializer_list<std::string_view> words) {
        std::filesystem::copy_file(folder / "b.glb", folder / "c.glb",
                                   std::filesystem::copy_options::overwrite_existing);
        edit_glb(folder / "c.glb", edit);
        test::check_throws<IoError>([&] { (void)read_gltf_splats(folder / "c.glb", 1); }, words);
    };
    refuse([](GltfJson& j) { j["animations"][0]["channels"][0]["sampler"] = 2; }, {"c.glb", "sampler is 2"});
    refuse([](GltfJson& j) { j["animations"][0]["channels"][0]["target"]["node"] = 1; }, {"node is 1"});
    refuse([](GltfJson& j) { j["animations"][0]["samplers"][0]["interpolation"] = "SPHERE"; }, {"SPHERE"});
    refuse([](GltfJson& j) { j["animations"][0]["samplers"][0]["interpolation"] = "CUBICSPLINE"; },
           {"2 times, but 8 numbers of output, expected 24"});
    refuse(
        [](GltfJson& j) { j["animations"][0]["samplers"][0]["output"] = j["animations"][0]["samplers"][1]["output"]; },
        {"does not have 4 numbers"});
    refuse([](GltfJson& j) { j["animations"][0].erase("channels"); }, {"no channels"});
    refuse([](GltfJson& j) { j["nodes"][0]["matrix"] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}; }, {"matrix"});
}

TEST_CASE("damaged .glb files are refused") {
    const test::Temporary folder;
    const auto path = folder / "a.glb";
    write_gltf_splats(path, test::splat_cloud(40, 1));
    const std::string good = read_file(path);
    const auto expect = [&](const std::function<void(GltfJson&)>& edit, std::initializer_list<std::string_view> words) {
        write_file(path, good);
        edit_glb(path, edit);
        test::check_throws<Error>([&] { (void)read_gltf_splats(path); }, {path.string()});
        test::check_throws<Error>([&] { (void)read_gltf_splats(path); }, words);
    };
    expect([](GltfJson& j) { j["nodes"][0]["children"] = {0}; }, {"cycle"});
    expect([](GltfJson& j) { j["nodes"][0]["mesh"] = 1; }, {"node 0: mesh is 1"});
    expect([](GltfJson& j) { j["nodes"][0]["rotation"] = {0, 0, 0, 0}; }, {"rotation is 0"});
    expect([](GltfJson& j) { j["nodes"][0]["scale"] = "large"; }, {"scale of a node is not a list of numbers"});
    expect([](GltfJson& j) { j["scene"] = 5; }, {"scene is 5"});
    expect([](GltfJson& j) { j["scenes"][0]["nodes"] = {3}; }, {"a node of scene 0 is 3"});
    expect([](GltfJson& j) { j["meshes"] = 7; }, {"meshes is number"});
    expect([](GltfJson& j) { j["meshes"][0]["primitives"] = {1}; }, {"primitives is number"});
    expect([](GltfJson& j) { j["meshes"][0].erase("primitives"); }, {"no primitives"});
    expect([](GltfJson& j) { j["meshes"][0]["primitives"][0].erase("attributes"); }, {"attributes"});
    expect([](GltfJson& j) { j["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = "0"; }, {"attributes"});
    const auto extension = [](GltfJson& j) -> GltfJson& {
        return j["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"];
    };
    expect(
        [&](GltfJson& j) {
            extension(j)["extensions"] = {{"KHR_spz", {{"bufferView", 0}}}};
            j["meshes"][0]["primitives"][0]["attributes"].erase("KHR_gaussian_splatting:SCALE");
        },
        {"mesh 0 has no KHR_gaussian_splatting:SCALE; what is in the extension KHR_spz is not read"});
    expect([&](GltfJson& j) { extension(j)["colorSpace"] = "BT.2020"; },
           {"mesh 0: colorSpace is 'BT.2020', expected 'srgb_rec709_display' or 'lin_rec709_display'"});
    expect([](GltfJson& j) { j["meshes"][0]["primitives"][0]["mode"] = 4; }, {"mesh 0: mode is 4, expected 0"});
    expect([](GltfJson& j) { j["meshes"][0]["primitives"][0].erase("mode"); }, {"mesh 0: mode is 4, expected 0"});
    expect([](GltfJson& j) { j["meshes"][0]["primitives"][0]["mode"] = "points"; }, {"mode of a primitive is string"});
    expect([](GltfJson& j) { j["meshes"][0]["primitives"][0]["indices"] = -1; }, {"indices of a primitive"});
    expect([](GltfJson& j) { j["meshes"][0]["primitives"][0]["indices"] = 0; },
           {"indices: accessor 0 does not have 1"});
    expect([](GltfJson& j) { j["meshes"][0]["primitives"][0]["indices"] = 3; },
           {"indices: accessor 3 is not of unsigned"});
    expect([](GltfJson& j) { j["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"] = {{"x", 1}}; },
           {"node 0: EXT_mesh_gpu_instancing has no attributes"});
    expect([](GltfJson& j) { j["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]["ROTATION"] = 0; },
           {"EXT_mesh_gpu_instancing: ROTATION: accessor 0 does not have 4"});
    expect([&](GltfJson& j) { extension(j)["kernel"] = 3; }, {"kernel is not a text"});
    expect([](GltfJson& j) { j["nodes"][0]["scale"] = {1, 1, 0}; }, {"node 0 flattens"});
    expect([](GltfJson& j) { j["nodes"][0]["scale"] = {0, 0, 0}; }, {"no Gaussians"});
    expect([](GltfJson& j) { j["nodes"][0]["scale"] = {1e60, 1e60, 1e60}; }, {"node 0: the mean of Gaussian 0"});
    expect([](GltfJson& j) { j["nodes"][0]["scale"] = {1e200, 1e200, 1e200}; }, {"node 0"});
    expect([](GltfJson& j) { j["nodes"][0]["translation"] = {1e200, 0, 0}; }, {"node 0: the mean of Gaussian 0"});
    expect([](GltfJson& j) { j["nodes"] = 7; }, {"nodes is number"});
    expect([](GltfJson& j) { j["nodes"][0].erase("mesh"); }, {"no Gaussians"});
    expect([](GltfJson& j) { j["meshes"][0]["primitives"][0].erase("extensions"); }, {"no Gaussians"});
    expect([](GltfJson& j) { j["meshes"][0]["primitives"][0]["attributes"].erase("KHR_gaussian_splatting:SCALE"); },
           {"no KHR_gaussian_splatting:SCALE"});
    expect([](GltfJson& j) { j["accessors"][0]["count"] = 41; }, {"accessor 0", "41 elements"});
    expect([](GltfJson& j) { j["accessors"][0]["count"] = 4000000000u; }, {"elements"});
    expect([](GltfJson& j) { j["accessors"][0]["count"] = -1; }, {"count"});
    expect([](GltfJson& j) { j["accessors"][0]["componentType"] = 5124; }, {"neither of floats"});
    const auto sparse = [](GltfJson& j, const char* text) { j["accessors"][0]["sparse"] = GltfJson::parse(text); };
    expect([&](GltfJson& j) { sparse(j, "7"); }, {"sparse of an accessor is number"});
    expect(
        [&](GltfJson& j) {
            sparse(
                j,
                R"({"count": 41, "indices": {"bufferView": 0, "componentType": 5125}, "values": {"bufferView": 0}})");
        },
        {"accessor 0: sparse.count is 41, expected 1 to 40"});
    expect(
        [&](GltfJson& j) {
            sparse(j,
                   R"({"count": 1, "indices": {"bufferView": 0, "componentType": 5126}, "values": {"bufferView": 0}})");
        },
        {"accessor 0: sparse.indices is not of unsigned integers"});
    expect(
        [&](GltfJson& j) {
            sparse(j,
                   R"({"count": 1, "indices": {"bufferView": 0, "componentType": 5125}, "values": {"bufferView": 0}})");
        },
        {"accessor 0: sparse.indices has", "expected ascending indices below 40"});
    expect([](GltfJson& j) { j["accessors"][0].erase("bufferView"), j["accessors"][0]["count"] = 40000000; },
           {"accessor 0 brings the numbers without bytes to more than 4194304"});
    expect([](GltfJson& j) { j["extensionsRequired"] = "KHR_x"; }, {"extensionsRequired is string, expected an array"});
    expect([](GltfJson& j) { j["extensionsRequired"] = {1}; }, {"an element of extensionsRequired is number"});
    for (const char* name : {"VENDOR_x", "EXT_meshopt_compression", "KHR_draco_mesh_compression", "CESIUM_RTC",
                             "KHR_gaussian_splatting_compression_spz_2"})
        expect([&](GltfJson& j) { j["extensionsRequired"] = {"KHR_gaussian_splatting", name}; },
               {std::string("requires the glTF extension '") + name + "', which is not read"});
    expect([](GltfJson& j) { j["accessors"][0]["byteOffset"] = 4; }, {"beyond its buffer"});
    expect([](GltfJson& j) { j["accessors"][1]["type"] = "VEC3"; }, {"accessor 1 does not have 4 numbers"});
    expect([](GltfJson& j) { j["accessors"][2]["bufferView"] = 99; }, {"bufferView is 99"});
    expect([](GltfJson& j) { j["bufferViews"][0]["byteLength"] = 1000000000; }, {"accessor 0", "beyond its buffer"});
    expect([](GltfJson& j) { j["bufferViews"][0]["byteStride"] = 3; }, {"byteStride"});
    expect([](GltfJson& j) { j["buffers"][0]["uri"] = "other.bin"; }, {"other.bin", "cannot be read"});
    // Views hold positions, rotations, scales, opacities. Attributes of another meaning have values that do not fit.
    expect([](GltfJson& j) { j["bufferViews"][3]["byteOffset"] = 0; }, {"mesh 0: Gaussian", "within 0 to 1"});
    for (const std::size_t size : {std::size_t(0), std::size_t(19), std::size_t(200), good.size() - 4}) {
        write_file(path, good.substr(0, size));
        test::check_throws<IoError>([&] { (void)read_gltf_splats(path); }, {path.string()});
    }
    std::string bytes = good;
    bytes[4] = 1;
    write_file(path, bytes);
    test::check_throws<IoError>([&] { (void)read_gltf_splats(path); }, {"version 1"});
    bytes = good;
    bytes[30] = '\x01';
    write_file(path, bytes);
    test::check_throws<IoError>([&] { (void)read_gltf_splats(path); }, {"not glTF"});
}

TEST_CASE("nodes that share a mesh: its Gaussians are decoded once, and together they are bounded") {
    const test::Temporary folder;
    const auto path = folder / "a.glb";
    const auto cloud = test::splat_cloud(50, 3);
    write_gltf_splats(path, cloud);
    const auto share = [&](std::size_t nodes) {
        edit_glb(path, [&](GltfJson& json) {
            GltfJson children = GltfJson::array();
            json["nodes"] = GltfJson::array({GltfJson::object()});
            for (std::size_t n = 1; n <= nodes; ++n) {
                children.push_back(n);
                json["nodes"].push_back({{"mesh", 0}, {"translation", {n, 0, 0}}});
            }
            json["nodes"][0]["children"] = children;
        });
    };
    share(3);
    const auto shown = read_gltf_splats(path).cloud;
    REQUIRE(shown.size() == 150);
    CHECK(shown.means[149] == cloud.means[49] + vec3<float>(3, 0, 0));
    CHECK(shown.sh.back() == cloud.sh.back());
    // 2^27 numbers in all, of which a Gaussian of degree 3 has 59.
    write_gltf_splats(path, test::splat_cloud(1000, 3));
    share(2300);
    test::check_throws<IoError>([&] { (void)read_gltf_splats(path); },
                                {path.string(), "2300000 Gaussians", "at most 2274876 in a file of its size"});
}

TEST_CASE("a file of Gaussians that is cut or changed anywhere is read or refused, never anything else") {
    const test::Temporary folder;
    write_gltf_splats(folder / "good.glb", test::splat_cloud(3, 1), PixelFilter{0.1, true});
    CHECK(test::read_damaged(read_file(folder / "good.glb"), folder / "fuzz.glb", 97, 2000,
                             [](const auto& path) { (void)read_gltf_splats(path, 0.5); }) > 1000);
}
