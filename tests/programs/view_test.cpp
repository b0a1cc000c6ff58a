// SPDX-License-Identifier: Apache-2.0
/// gsh-view without a server: what its requests may say, its packages, pages and pictures.
#include "io/bvh_files.hpp"
#include "programs/view_answers.hpp"
#include "programs/view_scenes.hpp"

#include "common/base64.hpp"
#include "support/contains.hpp"
#include "view/ellipsoids.hpp"
#include "view/jpeg.hpp"
#include "view/motion_occlusion.hpp"
#include "view/package.hpp"
#include "view/shown_names.hpp"
#include "view/view_package.hpp"
#include "view/view_page.hpp"
#include "view/view_painter.hpp"
#include "view/view_request.hpp"
#include "view/view_scene.hpp"

#include <gsh/avatar/avatar.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/cpu.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/loss/metrics.hpp>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <initializer_list>
#include <limits>
#include <numbers>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

using namespace gsh;
using namespace gsh::programs;
using test::ViewJson, test::request_for, test::decoded, test::difference, test::header_of;

TEST_CASE("gsh-view: a request is read as it was sent") {
    const std::vector<PersonSize> people{{2, 1, 3}, {1, 0, 0}};
    ViewJson json = request_for(people);
    json["show"] = "ellipsoids", json["shadows"] = false, json["light_turn"] = 0.5;
    json["people"][0]["pose"] = {1, 2, 3, 4, 5, 6};
    const ViewRequest request = parse_view_request(json.dump(), people);
    CHECK(request.camera.width == 64);
    CHECK(request.camera.fx == doctest::Approx(json["camera"]["focal"][0].get<double>()));
    CHECK(request.camera.R[1][0] == doctest::Approx(json["camera"]["R"][1].get<double>()));
    CHECK(request.show == ViewRequest::Show::ellipsoids);
    CHECK(!request.shadows);
    CHECK(request.light_turn == 0.5);
    CHECK(request.lossless);
    CHECK(request.background.z == doctest::Approx(0.3));
    REQUIRE(request.people.size() == 2);
    CHECK(request.people[0].pose[1].z == 6);
    CHECK(request.people[0].expression == std::vector<double>(3, 0.3));
    CHECK(request.people[1].transl[0].x == 0.1);
}

TEST_CASE("gsh-view: a request that is not as it must be is refused by the name of the field") {
    const std::vector<PersonSize> people{{2, 1, 3}};
    const auto refused = [&](const std::string& text, std::initializer_list<std::string_view> words) {
        test::check_throws<ValueError>([&] { (void)parse_view_request(text, people); }, words);
    };
    const auto changed = [&](const char* place, ViewJson value) {
        ViewJson json = request_for(people);
        json[ViewJson::json_pointer(place)] = std::move(value);
        return json.dump();
    };
    const std::string whole = request_for(people).dump();
    refused("", {"request", "JSON"});
    refused(whole.substr(0, whole.size() / 2), {"request", "JSON"});
    refused("[" + whole + "]", {"request", "expected an object"});
    refused(std::string(100'000, '['), {"request", "nested"});
    refused(changed("/more", 1), {"unknown member 'more'"});
    refused(changed("/camera/more", 1), {"camera", "unknown member 'more'"});
    refused(changed("/camera/size/0", 0), {"camera.size[0]", "16 to 4096"});
    refused(changed("/camera/size/0", 64.5), {"camera.size[0]", "whole pixels"});
    refused(changed("/camera/size/1", 100'000), {"camera.size[1]", "16 to 4096"});
    refused(changed("/camera/focal/0", -1), {"camera", "focal"});
    refused(changed("/camera/R/0", 3), {"camera", "rotation"});
    refused(changed("/camera/t", {1, 2}), {"camera.t", "has 2 elements, expected 3"});
    refused(changed("/background/0", 2), {"background", "0 to 1"});
    refused(changed("/show", "nothing"), {"show", "'nothing'", "'ellipsoids'"});
    refused(changed("/shadows", 1), {"shadows", "true or false"});
    refused(changed("/format", "tiff"), {"format", "'tiff'", "'png'"});
    refused(changed("/people", ViewJson::array()), {"people", "has 0 elements, expected 1"});
    refused(changed("/people/0/pose/3", nullptr), {"people[0].pose[3]", "null", "number"});
    refused(changed("/people/0/pose/3", 1e7), {"people[0].pose[3]", "1000000"});
    refused(changed("/people/0/betas", {1, 2}), {"people[0].betas", "has 2 elements, expected 1"});
    ViewJson without = request_for(people);
    without["people"][0].erase("transl");
    refused(without.dump(), {"people[0].transl", "missing"});
    // numbers that are not finite are no JSON
    for (const char* number : {"NaN", "Infinity", "-Infinity", "1e999", "nan"}) {
        std::string text = changed("/light_turn", 77777);
        text.replace(text.find("77777"), 5, number);
        refused(text, {"request", number == std::string("1e999") ? "beyond the range of double" : "JSON"});
    }
}

TEST_CASE("gsh-view: a package holds its numbers, exactly or in steps") {
    Rng rng(3);
    std::vector<float> numbers;
    for (int i = 0; i < 300; ++i) numbers.push_back(static_cast<float>(rng.uniform(i % 3 == 1 ? -5 : 0, 2)));
    Package package;
    package.header["word"] = "x\xFFy"; // not UTF-8: replaced, not refused
    package.add("exact", numbers, 3);
    package.add("sixteen", numbers, 3, Stored::sixteen);
    package.add("eight", numbers, 3, Stored::eight);
    package.add("constant", std::vector<float>(6, 4.5f), 2, Stored::eight);
    package.add_indices("small", {1, 2, 255}, 3);
    package.add_indices("middle", {1, 256}, 1);
    package.add_indices("large", {65536, 3}, 1);
    package.add("none", {}, 2, Stored::sixteen);
    const std::string bytes = package.bytes();
    const auto [header, begin] = header_of(bytes);
    CHECK(begin % 8 == 0);
    const auto read = [&, &h = header, b = begin](const char* name, std::size_t i) {
        const ViewJson& at = h["arrays"][name];
        const std::string type = at["type"];
        const std::size_t width = type == "u8" ? 1 : type == "u16" ? 2 : 4, columns = at["shape"][1];
        const char* const from = bytes.data() + b + at["offset"].get<std::size_t>() + i * width;
        double value = 0;
        if (type == "f32") {
            float x;
            std::memcpy(&x, from, 4);
            value = static_cast<double>(x);
        } else {
            std::uint32_t x = 0;
            std::memcpy(&x, from, width);
            value = x;
        }
        return at.contains("low") ? at["low"][i % columns].get<double>() + at["step"][i % columns].get<double>() * value
                                  : value;
    };
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        const auto x = static_cast<double>(numbers[i]);
        CHECK(read("exact", i) == x);
        CHECK(std::abs(read("sixteen", i) - x) <= 7.01 / 65535 / 2);
        CHECK(std::abs(read("eight", i) - x) <= 7.01 / 255 / 2);
    }
    CHECK(read("constant", 3) == 4.5);
    CHECK(header["arrays"]["small"]["type"] == "u8");
    CHECK(header["arrays"]["middle"]["type"] == "u16");
    CHECK(read("middle", 1) == 256);
    CHECK(read("large", 0) == 65536);
    CHECK(header["arrays"]["none"]["shape"][0] == 0);
    CHECK_THROWS_AS(package.add("bad", numbers, 7), ValueError);
}

TEST_CASE("gsh-view: a compact package is much smaller than an exact one") {
    const ViewScene scene = test::view_scene({test::view_files().actor});
    const std::size_t exact = package_scene(scene).size(), compact = package_scene(scene, ScenePacking::compact).size();
    CHECK(3 * compact < exact);
}

TEST_CASE("gsh-view: outliers do not make the steps of a compact package visible") {
    ViewScene scene = test::view_scene({test::view_files().cloud});
    const auto type_of = [&](const char* name) {
        return header_of(package_scene(scene, ScenePacking::compact)).first["arrays"][name]["type"];
    };
    CHECK(type_of("0/means") == "u16");
    CHECK(type_of("0/sh_constant") == "u16");
    scene.cloud.means[1].x = 5e7f;
    CHECK(type_of("0/means") == "f32");
    CHECK(type_of("0/sh_constant") == "u16");
    scene.cloud.sh[0].y = 1e4f;
    CHECK(type_of("0/sh_constant") == "f32");
}

TEST_CASE("gsh-view: the ambient occlusion of motions is a low-rank product within its tolerance") {
    const auto& files = test::view_files();
    const ViewScene scene = test::view_scene({files.occluded}, {files.left, files.right});
    const AvatarData& data = scene.people->data[0];
    cpu::Threads backend(2);
    const LowRank product = occlusion_of_motions(backend, data, scene.motions[0]);
    REQUIRE(product.rank >= 2);
    CHECK(product.rank <= 3); // three poses: the motions differ in place alone
    CHECK(product.error <= occlusion_tolerance);
    const std::size_t N = data.gaussians.size();
    CHECK(product.basis.size() == product.rank * N);
    REQUIRE(product.coefficients.size() == 6 * product.rank);
    Avatar<cpu::Threads> avatar(backend, data);
    Avatar<cpu::Threads>::Cache cache;
    RigPose<cpu::Threads, float> pose;
    Splats<cpu::Threads, float> splats;
    splats.resize(N);
    for (std::size_t row = 0; row < 6; ++row) {
        avatar.rig().upload_pose(scene.motions[0][row / 3].motion, row % 3, pose);
        avatar.pose(pose, vec3<float>(0), splats.view(), cache);
        double square = 0, varies = 0;
        for (std::size_t i = 0; i < N; ++i) {
            float ao = data.ao[i];
            for (std::size_t k = 0; k < product.rank; ++k)
                ao += product.coefficients[row * product.rank + k] * product.basis[k * N + i];
            square += std::pow(static_cast<double>(ao - cache.ao[i]), 2);
            varies += std::pow(static_cast<double>(data.ao[i] - cache.ao[i]), 2);
        }
        CHECK(std::sqrt(square / static_cast<double>(N)) < 3 * occlusion_tolerance); // colours below 1 weigh less
        CHECK(std::sqrt(varies / static_cast<double>(N)) > 0.05);
    }
    const ViewJson basis = header_of(package_scene(scene, ScenePacking::compact, &product)).first["arrays"];
    CHECK(basis["0/occlusion_basis"]["shape"] == ViewJson{N, product.rank});
    const std::string bytes = package_motion(scene.motions[0][1], {}, &product, 3);
    const auto [header, begin] = header_of(bytes);
    CHECK(header["arrays"]["occlusion"]["shape"] == ViewJson{3, product.rank});
    float first = 0;
    const auto offset = header["arrays"]["occlusion"]["offset"].get<std::size_t>();
    std::memcpy(&first, bytes.data() + begin + offset, sizeof first);
    CHECK(first == product.coefficients[3 * product.rank]);
    CHECK(!header_of(package_motion(scene.motions[0][1])).first["arrays"].contains("occlusion"));
}

TEST_CASE("gsh-view: a page refers to nothing outside itself") {
    const std::string page = make_page({{"scene", "{}"}, {"motion-0-0", std::string("\0\xFF", 2)}}, "const more = 1;");
    for (const char* word :
         {"<script src", "<link rel=\"stylesheet\"", "https://", "http://", "@import", "<!-- data -->"})
        CHECK(page != test::contains(word));
    CHECK(page == test::contains("data-carried=\"scene\">e30=</script>"));
    CHECK(page == test::contains("data-carried=\"motion-0-0\">AP8=</script>"));
    CHECK(page == test::contains("const more = 1;"));
    for (const auto& [name, content] : web_files()) { // the end of a script would end it inside the page
        INFO(name);
        CHECK(content.size() > 0);
        if (name.ends_with(".js")) {
            CHECK(content != test::contains("</script"));
            CHECK(page == test::contains("data-module=\"" + std::string(name) + "\""));
        }
    }
    CHECK(base64("Man") == "TWFu");
    CHECK(base64("Ma") == "TWE=");
    CHECK(base64("") == "");
}

TEST_CASE("gsh-view: a JPEG is close to its picture") {
    Image<float> image(3, 40, 56);
    for (int c = 0; c < 3; ++c)
        for (int y = 0; y < 40; ++y)
            for (int x = 0; x < 56; ++x)
                image.at(c, y, x) = 0.5f + 0.4f * std::sin(0.2f * static_cast<float>(x + c * y));
    image.at(0, 0, 0) = std::numeric_limits<float>::quiet_NaN(), image.at(1, 0, 0) = 7, image.at(2, 0, 0) = -1;
    cpu::Threads backend(2);
    const PixelImage pixels = quantise_on(backend, image);
    CHECK(pixels.data == quantise(std::as_const(image).view()).data);
    const std::string good = encode_jpeg(pixels, 95), poor = encode_jpeg(pixels, 30);
    CHECK(psnr_of_mse(difference(decoded(good), pixels)) > 36);
    CHECK(poor.size() < good.size());
}

TEST_CASE("gsh-view: an ellipsoid is a disc that is brightest in the middle, and the nearer one hides the other") {
    cpu::Threads backend(2);
    const auto camera = look_at<float>({0, 0, 4}, {0, 0, 0}, {0, 1, 0}, 0.5f, 64, 64);
    const float s = 0.2f * 0.2f;
    const std::vector<vec3<float>> means{{0, 0, 0}, {0, 0, -1}, {0, 0, 1}}, colors{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    const std::vector<sym3<float>> covariances{{s, 0, 0, s, 0, s}, {4 * s, 0, 0, 4 * s, 0, 4 * s}, {s, 0, 0, s, 0, s}};
    const std::vector<float> opacities{0.9f, 0.9f, 0.05f}; // the last one is too faint
    const Image<float> image = draw_ellipsoids(backend, camera, {means, covariances, opacities, colors}, {0, 0, 0.5f});
    CHECK(image.at(0, 32, 32) > 0.99f);
    CHECK(image.at(2, 32, 32) == 0);
    CHECK(image.at(2, 0, 0) == 0.5f);
    const float radius = ellipsoid_radius * 0.2f * camera.fx / 4; // pixels
    const int inside = 32 + static_cast<int>(radius) - 2, outside = 32 + static_cast<int>(radius) + 3;
    CHECK(image.at(0, 32, inside) > 0.35f);
    CHECK(image.at(0, 32, inside) < 0.8f);
    CHECK(image.at(0, 32, outside) == 0);
    CHECK(image.at(1, 32, outside) > 0.35f);
}

TEST_CASE("gsh-view: a light turns about the vertical through a point") {
    LightData light;
    light.points = {{1, 2, 3}}, light.directions = {{0, 0, 1}};
    const LightData turned = turned_light(light, std::numbers::pi / 2, {1, 0, 0});
    CHECK(length(turned.points[0] - vec3<double>(4, 2, 0)) < 1e-12);
    CHECK(length(turned.directions[0] - vec3<double>(1, 0, 0)) < 1e-12);
}

TEST_CASE("gsh-view: a later motion begins where the first one begins") {
    const ViewScene scene =
        test::view_scene({test::view_files().actor}, {test::view_files().stride, test::view_files().reach});
    REQUIRE(scene.motions[0].size() == 2);
    const Motion &first = scene.motions[0][0].motion, &second = scene.motions[0][1].motion;
    CHECK(first.transl[0].x == doctest::Approx(second.transl[0].x));
    CHECK(first.transl[0].z == doctest::Approx(second.transl[0].z));
    const auto& files = test::view_files();
    const ViewScene without = test::view_scene({files.actor}), tube = test::view_scene({files.polar});
    REQUIRE(without.motions[0].size() == 4); // those of the built-in actor, for SMPL-X's joints
    CHECK(without.motions[0][0].motion.frame_count() == 80);
    CHECK(without.motions[0][3].name == "canonical pose");
    REQUIRE(tube.motions[0].size() == 1);
    CHECK(tube.motions[0][0].motion.frame_count() == 1);
    CHECK_THROWS_AS((void)test::view_scene({files.polar, files.dual}, {files.left}), ValueError);
    CHECK_THROWS_AS((void)test::view_scene({files.polar, files.cloud}), ValueError);
    CHECK_THROWS_AS((void)test::view_scene({files.cloud}, {files.left}), ValueError);
}

TEST_CASE("gsh-view: a joint map names joints of motions, also of those that the page sends") {
    const test::Temporary folder;
    std::string walk = test::bvh_text(test::sample_rig({.units = 100}));
    const std::string known = "mixamorig:LeftUpLeg";
    walk.replace(walk.find(known), known.size(), "Bone");
    write_file(folder / "walk.bvh", walk);
    write_file(folder / "map.json", R"({"Bone": "left_hip"})");
    const std::vector<std::filesystem::path> avatar{test::view_files().actor}, poses{folder / "walk.bvh"};
    std::vector<std::string> warnings;
    CHECK_THROWS_AS((void)load_view_scene(avatar, poses, {}, {}, warnings), ValueError);
    RigOption named;
    named.joint_map = folder / "map.json";
    const ViewScene scene = load_view_scene(avatar, poses, {}, named, warnings);
    const Motion& motion = scene.motions[0][0].motion;
    CHECK(read_sent_motion(scene, 0, "walk.bvh", walk, warnings).motion.pose == motion.pose);
    const auto last = [&](const ViewScene& shown, double fps) {
        return read_sent_motion(shown, 0, "walk.bvh", walk, warnings, fps).motion.timestamps.back();
    };
    CHECK(last(scene, 0) == doctest::Approx(motion.timestamps.back()));
    CHECK(last(scene, 10) == doctest::Approx(0.3)); // the page states the rate of 4 frames
    RigOption stated = named;
    stated.input_fps = {15};
    const ViewScene slow = load_view_scene(avatar, poses, {}, stated, warnings);
    CHECK(slow.motions[0][0].motion.timestamps.back() == doctest::Approx(0.2));
    CHECK(last(slow, 0) == doctest::Approx(0.2)); // --input-fps is for dropped files, too
    CHECK(last(slow, 10) == doctest::Approx(0.3));
    stated.input_fps = {15, 30};
    CHECK_THROWS_AS((void)load_view_scene(avatar, poses, {}, stated, warnings), ValueError);
    CHECK_THROWS_AS((void)read_sent_motion(test::view_scene(avatar), 0, "walk.bvh", walk, warnings), IoError);
}

TEST_CASE("gsh-view: names of files tell them apart") {
    using Names = std::vector<std::string>;
    CHECK(names_of_files({"runs/stride.npz", "reach.npz"}) == Names{"stride.npz", "reach.npz"});
    CHECK(names_of_files({"hard/poses.npz", "soft/poses.npz", "x/walk.bvh"}) ==
          Names{"hard/poses.npz", "soft/poses.npz", "walk.bvh"});
    CHECK(names_of_files({"a/1/poses.npz", "b/1/poses.npz", "b/2/poses.npz"}) ==
          Names{"a/1/poses.npz", "b/1/poses.npz", "2/poses.npz"});
    CHECK(names_of_files({"/poses.npz", "/a/poses.npz"}) == Names{"poses.npz", "a/poses.npz"});
    CHECK(names_of_files({"a/../poses.npz", "./poses.npz"}) == Names{"poses.npz", "poses.npz (2)"});
    CHECK(names_of_files({"capture/", "other/smplx"}) == Names{"capture", "smplx"});

    const test::Temporary folder;
    const auto& files = test::view_files();
    for (const char* name : {"hard", "soft"}) {
        std::filesystem::create_directory(folder / name);
        std::filesystem::copy_file(files.left, folder / name / "poses.npz");
        std::filesystem::copy_file(files.polar, folder / name / "avatar.gsh");
    }
    const std::vector<std::filesystem::path> poses{folder / "hard" / "poses.npz", folder / "soft" / "poses.npz"};
    const ViewJson one = ViewJson::parse(describe(test::view_scene({files.polar}, poses)));
    CHECK(one["people"][0]["motions"][0]["name"] == "hard/poses.npz");
    CHECK(one["people"][0]["motions"][1]["name"] == "soft/poses.npz");
    const ViewJson two = ViewJson::parse(
        describe(test::view_scene({folder / "hard" / "avatar.gsh", folder / "soft" / "avatar.gsh"}, poses)));
    CHECK(two["names"] == ViewJson{"hard/avatar.gsh", "soft/avatar.gsh"});
    CHECK(two["people"][1]["motions"][0]["name"] == "soft/poses.npz");
}

TEST_CASE("gsh-view: messages about files on the page say what can be done there") {
    const ViewScene scene = test::view_scene({test::view_files().actor});
    std::vector<std::string> warnings;
    const auto message = [&](const char* name, const std::string& bytes) {
        try {
            (void)read_sent_motion(scene, 0, name, bytes, warnings);
        } catch (const IoError& error) {
            return std::string(error.what());
        }
        return std::string("was read");
    };
    const auto has = [](const std::string& text, const char* words) { return text.find(words) != std::string::npos; };
    const char* const accepted = ".npz, .bvh, .glb, .gltf, .vrm and .vrma";
    const std::string bvh = test::bvh_text(test::sample_rig({.units = 100}));
    std::string strange = bvh, slow = bvh;
    for (const std::string known : {"LeftUpLeg", "LeftLeg"})
        for (std::size_t at; (at = strange.find(known)) != std::string::npos;)
            strange.replace(at, known.size(), "Bone");
    const std::string unmatched = message("a.bvh", strange);
    CHECK(has(unmatched, "gsh-motion"));
    const auto step = slow.find("Frame Time:");
    slow.replace(step, slow.find('\n', step) - step, "Frame Time: 900");
    const std::string rate = message("a.bvh", slow);
    CHECK(has(rate, "File's fps"));
    const std::string json = message("a.json", "{}");
    CHECK(has(json, "gsh-motion"));
    for (const std::string& text : {unmatched, rate, json, message("a.npz", "nonsense"), message("a.fbx", "; FBX 7.7"),
                                    message("a.txt", "nonsense"), message("a", "")}) {
        INFO(text);
        CHECK(!has(text, "was read"));
        CHECK(!has(text, "--")); // no option of a program
    }
    for (const char* name : {"a.npz", "a.jpg", "a.json", "a"}) CHECK(has(message(name, "nonsense"), accepted));
    CHECK(!has(unmatched, accepted)); // its format is not the reason

    // Warnings are in such words, too.
    std::string still = bvh;
    still.replace(step, still.find('\n', step) - step, "Frame Time: 0");
    warnings.clear();
    (void)read_sent_motion(scene, 0, "a.bvh", still, warnings);
    std::string all;
    for (const std::string& warning : warnings) all += warning + "\n";
    CHECK(has(all, "the unit is guessed"));
    CHECK(has(all, "state another as File's fps"));
    CHECK(!has(all, "--"));
}
