// SPDX-License-Identifier: Apache-2.0
#include <gsh/gaussian/cloud_edits.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/splat/splat_file.hpp>

#include "io/damage.hpp"
#include "io/splat_clouds.hpp"
#include "io/temporary.hpp"

#include <cmath>
#include <cstring>
#include <limits>
#include <string>

using namespace gsh;

TEST_CASE("a .splat file holds all but the bands that depend on the view") {
    const test::Temporary folder;
    for (const std::size_t count : {1, 300}) {
        const auto cloud = test::splat_cloud(count, 2);
        write_splat(folder / "a.splat", cloud);
        CHECK(std::filesystem::file_size(folder / "a.splat") == 32 * count);
        const StillSplats splats = read_splat(folder / "a.splat");
        CHECK(!splats.notes.up.has_value());
        test::check_near(splats.cloud, with_bands_up_to(cloud, 0),
                         {.mean = 0, .log_scale = 1e-6, .rotation = 0.035, .opacity = 2e-3, .dc = 0.007});
        write_splat(folder / "b.splat", cloud, UpAxis::minus_y);
        CHECK(read_splat(folder / "b.splat").cloud.means[0].y == -cloud.means[0].y);
    }
    CHECK_THROWS_AS(write_splat(folder / "a.splat", test::splat_cloud(0, 0)), ValueError);
}

TEST_CASE("the bytes of a .splat file are those of the format") {
    const test::Temporary folder;
    GaussianCloud<float> cloud(1, 0);
    cloud.means[0] = {1, 2, 3};
    cloud.log_scales[0] = {0, std::log(0.5f), std::log(0.25f)};
    cloud.quats[0] = {2, 0, 0, -2};
    cloud.opacity_logits[0] = 0;
    cloud.sh[0] = sh_of_color(vec3<float>(1, 0.2f, -3));
    write_splat(folder / "a.splat", cloud);
    const std::string bytes = read_file(folder / "a.splat");
    float numbers[6];
    std::memcpy(numbers, bytes.data(), sizeof numbers);
    for (int k = 0; k < 3; ++k) CHECK(numbers[k] == static_cast<float>(k + 1));
    CHECK(numbers[4] == doctest::Approx(0.5));
    const int expected[8] = {255, 51, 0, 128, 219, 128, 128, 37};
    for (std::size_t k = 0; k < 8; ++k) CHECK(static_cast<unsigned char>(bytes[24 + k]) == expected[k]);
}

TEST_CASE("flat Gaussians come back flat, and colours beyond 0 to 1 are counted") {
    const test::Temporary folder;
    auto cloud = test::splat_cloud(4, 0);
    for (auto& sh : cloud.sh) sh = vec3<float>(0);
    cloud.sh[1] = sh_of_color(vec3<float>(1.01f, 0, 1)), cloud.sh[2] = sh_of_color(vec3<float>(0.5f, -0.01f, 0));
    cloud.sh[3] = sh_of_color(vec3<float>(1, 0, 1));
    CHECK(write_splat(folder / "a.splat", cloud).colors == 2);
    std::string bytes = read_file(folder / "a.splat");
    bytes.replace(12, 4, 4, '\0'); // the first scale
    write_file(folder / "a.splat", bytes);
    CHECK(read_splat(folder / "a.splat").cloud.log_scales[0].x == flat_log_scale);
    const float large = 1e20f; // whose square is more than a float holds
    std::memcpy(bytes.data() + 12, &large, 4);
    write_file(folder / "a.splat", bytes);
    test::check_throws<ValueError>([&] { (void)read_splat(folder / "a.splat"); }, {"a.splat", "Gaussian 0", "e^44"});
}

TEST_CASE("what is no .splat file") {
    const test::Temporary folder;
    const auto path = folder / "a.splat";
    for (const std::size_t size : {0, 31, 33}) {
        write_file(path, std::string(size, '\1'));
        test::check_throws<IoError>([&] { (void)read_splat(path); }, {path.string(), std::to_string(size), "32"});
    }
    write_splat(path, test::splat_cloud(2, 0));
    const std::string good = read_file(path);
    const auto with = [&](std::size_t at, float value) {
        std::string bytes = good;
        std::memcpy(bytes.data() + at, &value, 4);
        write_file(path, bytes);
    };
    with(32 + 4, std::numeric_limits<float>::quiet_NaN());
    test::check_throws<ValueError>([&] { (void)read_splat(path); }, {path.string(), "position of Gaussian 1"});
    with(12, -1.0f);
    test::check_throws<ValueError>([&] { (void)read_splat(path); }, {path.string(), "scale of Gaussian 0", "-1"});
    std::string bytes = good;
    bytes.replace(28, 4, "\x80\x80\x80\x80");
    write_file(path, bytes);
    test::check_throws<ValueError>([&] { (void)read_splat(path); }, {path.string(), "quaternion of Gaussian 0"});
}

TEST_CASE("a file that is cut or changed anywhere is read or refused, never anything else") {
    const test::Temporary folder;
    write_splat(folder / "good.splat", test::splat_cloud(3, 0));
    CHECK(test::read_damaged(read_file(folder / "good.splat"), folder / "fuzz.splat", 7, 1000,
                             [](const auto& path) { (void)read_splat(path); }) > 10);
}
