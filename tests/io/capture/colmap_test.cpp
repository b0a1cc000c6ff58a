// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/capture/colmap.hpp>

#include "io/colmap_files.hpp"
#include "io/temporary.hpp"

#include <gsh/io/file/input_file.hpp>

#include <bit>
#include <cmath>

using namespace gsh;
using test::Bytes;
using test::ColmapFiles;

namespace {

/// Names with a blank, in the order 5 to 9.
std::string room(std::size_t i) {
    return std::string("room ").append(std::to_string(i)).append(".png");
}

/// Five images, one per camera, none, two or three features each; three points with tracks; ids out of order.
ColmapFiles sample() {
    ColmapFiles files;
    files.cameras = {{7, 0, "SIMPLE_PINHOLE", 64, 48, {50.5, 32, 24}},
                     {3, 1, "PINHOLE", 64, 48, {50, 51, 31, 23.5}},
                     {4, 2, "SIMPLE_RADIAL", 64, 48, {50, 32, 24, 0.01}},
                     {5, 3, "RADIAL", 64, 48, {50, 32, 24, -0.02, 0.003}},
                     {6, 4, "OPENCV", 64, 48, {50, 51, 31, 23, -0.02, 0.003, 0.001, -0.002}}};
    constexpr double half_root = 0.70710678118654752440; // a quarter turn about z
    for (std::uint32_t i = 0; i < 5; ++i)
        files.images.push_back(
            {10 + i, {half_root, 0, 0, half_root}, {0.25, -0.5, 2.0 + i}, files.cameras[i].id, room(9 - i), i});
    for (const std::uint8_t id : {9, 2, 5})
        files.points.push_back({id, {0.5 * id, -1.25, 3e-3}, {255, id, 0}, id == 2 ? 0u : 2u});
    return files;
}

void write_text(const std::filesystem::path& folder) {
    std::string cameras =
        "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n";
    const ColmapFiles files = sample();
    for (const ColmapFiles::Camera& camera : files.cameras) {
        cameras += std::to_string(camera.id) + " " + camera.model_name + " 64 48";
        for (const double p : camera.parameters) cameras.append(" ").append(std::to_string(p));
        cameras += "\n";
    }
    std::string images = "# Image list with two lines of data per image:\n#   IMAGE_ID, QW, ...\n";
    for (std::uint32_t i = 0; i < 5; ++i) {
        images += std::to_string(10 + i) + " 0.70710678118654752440 0 0 0.70710678118654752440 0.25 -0.5 " +
                  std::to_string(2 + i) + " " + std::to_string(files.cameras[i].id);
        images.append(" ").append(room(9 - i)).append("\n");
        for (std::uint32_t k = 0; k < i; ++k) images += k ? " 1.5 2.5 2" : "1.5 2.5 -1";
        images += "\n"; // an empty line where there are no features
    }
    std::string points = "# 3D point list with one line of data per point:\n";
    points +=
        "9 4.5 -1.25 3e-3 255 9 0 0.75 1 1 1 1\r\n2 1 -1.25 0.003 255 2 0 0.75\n5 2.5 -1.25 3e-3 255 5 0 0.75 1 1 1 1";
    write_file(folder / "cameras.txt", cameras);
    write_file(folder / "images.txt", images);
    write_file(folder / "points3D.txt", points);
}

void check_sample(const ColmapScene& scene) {
    REQUIRE(scene.images.size() == 5);
    for (std::size_t i = 0; i < 5; ++i) {
        CAPTURE(i);
        const ColmapImage& image = scene.images[i]; // by name: the reverse of the file
        const std::size_t written = 4 - i;
        CHECK(image.name == room(5 + i));
        CHECK(image.camera.width == 64);
        CHECK(image.camera.height == 48);
        CHECK(image.camera.t == vec3<double>(0.25, -0.5, 2.0 + static_cast<double>(written)));
        const vec3<double> turned = image.camera.R * vec3<double>(1, 0, 0);
        CHECK(std::abs(turned.y - 1) < 1e-12);
        CHECK(image.distortion.has_value() == (written >= 2));
    }
    const auto& simple = scene.images[4].camera;
    CHECK(simple.fx == 50.5);
    CHECK(simple.fy == 50.5);
    CHECK(simple.cx == 32);
    CHECK(simple.cy == 24);
    const auto& pinhole = scene.images[3].camera;
    CHECK(pinhole.fx == 50);
    CHECK(pinhole.fy == 51);
    CHECK(pinhole.cx == 31);
    CHECK(pinhole.cy == 23.5);
    CHECK(scene.images[2].distortion->k1 == 0.01);
    CHECK(scene.images[2].distortion->k2 == 0);
    CHECK(scene.images[1].distortion->k1 == -0.02);
    CHECK(scene.images[1].distortion->k2 == 0.003);
    CHECK(scene.images[1].distortion->p1 == 0);
    CHECK(scene.images[0].distortion->p1 == 0.001);
    CHECK(scene.images[0].distortion->p2 == -0.002);
    CHECK(scene.images[0].camera.fy == 51);

    REQUIRE(scene.points.size() == 3);
    CHECK(scene.points[0] == vec3<double>(1, -1.25, 3e-3)); // by id: 2, 5, 9
    CHECK(scene.points[1].x == 2.5);
    CHECK(scene.points[2].x == 4.5);
    CHECK(scene.colors[2].x == 1);
    CHECK(scene.colors[2].y == 9 / 255.0);
    CHECK(scene.colors[2].z == 0);
}

} // namespace

TEST_CASE("a reconstruction is read from binary files, from text, and from where COLMAP puts them") {
    const test::Temporary folder;
    std::filesystem::create_directories(folder / "text");
    write_text(folder / "text");
    check_sample(read_colmap(folder / "text"));
    std::filesystem::create_directories(folder / "project" / "sparse" / "0");
    sample().write_binary(folder / "project" / "sparse" / "0");
    check_sample(read_colmap(folder / "project"));
    write_file(folder / "text" / "cameras.bin", "x"); // binary files win
    CHECK_THROWS_AS((void)read_colmap(folder / "text"), IoError);
}

TEST_CASE("files that are no reconstruction are refused by name") {
    const test::Temporary folder;
    const auto place = folder / "model";
    std::filesystem::create_directories(place);
    const auto read = [&] { (void)read_colmap(place); };
    test::check_throws<IoError>(read, {"model", "cameras.bin", "sparse/0"});

    sample().write_binary(place);
    for (const char* name : {"cameras.bin", "images.bin", "points3D.bin"}) {
        CAPTURE(name);
        const std::string whole = read_file(place / name);
        for (std::size_t size = 0; size < whole.size(); size += 7) {
            write_file(place / name, whole.substr(0, size), Sync::none);
            test::check_throws<IoError>(read, {name});
        }
        write_file(place / name, whole + "x");
        test::check_throws<IoError>(read, {name, "goes on"});
        write_file(place / name, Bytes().put(~std::uint64_t(0)).data() + whole.substr(8));
        test::check_throws<IoError>(read, {name, "claims"});
        write_file(place / name, whole);
    }
    write_file(place / "cameras.bin", Bytes()
                                          .put<std::uint64_t>(1)
                                          .put<std::uint32_t>(3)
                                          .put<std::int32_t>(5)
                                          .put<std::uint64_t>(64)
                                          .put<std::uint64_t>(48)
                                          .put(1.0)
                                          .put(1.0)
                                          .put(1.0)
                                          .put(1.0)
                                          .put(0.0)
                                          .put(0.0)
                                          .put(0.0)
                                          .put(0.0)
                                          .data());
    test::check_throws<ValueError>(read, {"cameras.bin", "camera 3", "model 5", "image_undistorter"});
    write_file(place / "cameras.bin", Bytes().put<std::uint64_t>(0).data());
    test::check_throws<ValueError>(read, {"images.bin", "room 9.png", "camera 7"});
    write_file(place / "images.bin", Bytes().put<std::uint64_t>(0).data());
    test::check_throws<ValueError>(read, {"no registered image"});
}

TEST_CASE("names of images do not lead out of the folder of images") {
    const test::Temporary folder;
    for (const char* name : {"../secret.png", "/etc/secret.png", "a/../../secret.png"}) {
        test::ColmapFiles files = sample();
        files.images[0].name = name;
        files.write_binary(folder / "");
        test::check_throws<ValueError>([&] { (void)read_colmap(folder / ""); }, {"images.bin", name, "leads out"});
    }
    test::ColmapFiles files = sample();
    files.images[0].name = "left/room 9.png";
    files.write_binary(folder / "");
    CHECK_NOTHROW((void)read_colmap(folder / ""));
    files.images[1].name = files.images[0].name; // each would be loaded
    files.write_binary(folder / "");
    test::check_throws<ValueError>([&] { (void)read_colmap(folder / ""); }, {"'left/room 9.png' twice"});
}

TEST_CASE("lines that are no reconstruction are refused by number") {
    const test::Temporary folder;
    const auto place = folder / "model";
    std::filesystem::create_directories(place);
    const auto refuse = [&](const char* file, const std::string& text, std::initializer_list<std::string_view> words) {
        write_text(place);
        write_file(place / file, text);
        test::check_throws([&] { (void)read_colmap(place); }, words);
    };
    refuse("cameras.txt", "# none\n1 FISHEYE 64 48 1 2 3\n", {"cameras.txt: line 2", "FISHEYE"});
    refuse("cameras.txt", "1 PINHOLE 64 48 50 50 32\n", {"line 1", "ends too early"});
    refuse("cameras.txt", "1 PINHOLE 64 48 50 50 32 24 1\n", {"line 1", "more parameters"});
    refuse("cameras.txt", "1 PINHOLE 64 48 50 5x 32 24\n", {"line 1", "'5x'"});
    refuse("cameras.txt", "1 PINHOLE 64 48 50 nan 32 24\n", {"line 1"});
    refuse("cameras.txt", "1 PINHOLE 64 48 0 50 32 24\n", {"line 1", "focal"});
    refuse("cameras.txt", "1 PINHOLE 0 48 50 50 32 24\n", {"line 1", "0 x 48"});
    refuse("images.txt", "1 0 0 0 0 0 0 1 7 a.png\n\n", {"images.txt: line 1", "quaternion"});
    refuse("images.txt", "1 1e200 0 0 0 0 0 1 7 a.png\n\n", {"images.txt: line 1", "quaternion of length inf"});
    refuse("images.txt", "1 1 0 0 0 0 0 inf 7 a.png\n\n", {"line 1"});
    refuse("images.txt", "1 1 0 0 0 0 0 1 70 a.png\n\n", {"line 1", "camera 70"});
    refuse("images.txt", "1 1 0 0 0 0 0 1 7 a\x01.png\n\n", {"line 1", "'a?.png'", "cannot be shown"});
    refuse("images.txt", "1 1 0 0 0 0 0 1 7 " + std::string(300, 'a') + "\n\n", {"line 1", "longer than 255 bytes"});
    refuse("images.txt", "1 1 0 0 0 0 0 1 7\n\n", {"line 1", "ends too early"});
    refuse("points3D.txt", "1 0 0 0 256 0 0 1\n", {"points3D.txt: line 1", "colour"});
    refuse("points3D.txt", "1 0 0\n", {"line 1", "ends too early"});
}
