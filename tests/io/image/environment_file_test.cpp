// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/image/environment_file.hpp>

#include "io/temporary.hpp"

#include <stb/stb_image_write.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

using namespace gsh;

namespace {

/// Pixels whose four bytes differ from each other, some of them in runs.
std::string rgbe_pixels(int height, int width) {
    std::string bytes;
    for (int i = 0; i < height * width; ++i)
        for (const int value : {10 + i / 5, 200 - i, 128, 127 + i % 3}) bytes += static_cast<char>(value);
    return bytes;
}

std::string hdr_header(const std::string& resolution, const std::string& more = "FORMAT=32-bit_rle_rgbe\n") {
    return "#?RADIANCE\n# made by a test\n" + more + "EXPOSURE=1\n\n" + resolution + "\n";
}

float hdr_value(int mantissa, int exponent) { return std::ldexp(static_cast<float>(mantissa), exponent - 136); }

} // namespace

TEST_CASE("a Radiance HDR with plain pixels is read as linear light") {
    const test::Temporary folder;
    write_file(folder / "a.hdr", hdr_header("-Y 3 +X 6") + rgbe_pixels(3, 6));
    const Image<float> image = read_environment(folder / "a.hdr");
    REQUIRE(image.channels == 3);
    REQUIRE(image.height == 3);
    REQUIRE(image.width == 6);
    CHECK(image.at(0, 1, 2) == hdr_value(10 + 8 / 5, 127 + 8 % 3));
    CHECK(image.at(1, 2, 5) == hdr_value(200 - 17, 127 + 17 % 3));
    CHECK(image.at(2, 0, 0) == 0.25f);
}

TEST_CASE("a Radiance HDR with run lengths, as stb writes it, is read as linear light") {
    const test::Temporary folder;
    const int height = 10, width = 20;
    std::vector<float> pixels;
    for (int i = 0; i < height * width * 3; ++i)
        pixels.push_back(i % 60 < 24 ? 0.5f : std::ldexp(static_cast<float>(128 + i % 100), i % 7));
    std::string bytes;
    const auto append = [](void* context, void* data, int size) {
        static_cast<std::string*>(context)->append(static_cast<const char*>(data), static_cast<std::size_t>(size));
    };
    REQUIRE(stbi_write_hdr_to_func(append, &bytes, width, height, 3, pixels.data()));
    write_file(folder / "a.hdr", bytes);
    const Image<float> image = read_environment(folder / "a.hdr");
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            const std::size_t first = 3 * static_cast<std::size_t>(y * width + x);
            const float most = std::fmax(std::fmax(pixels[first], pixels[first + 1]), pixels[first + 2]);
            for (int c = 0; c < 3; ++c)
                CHECK(std::abs(image.at(c, y, x) - pixels[first + static_cast<std::size_t>(c)]) <= most / 128);
        }

    for (const std::size_t cut : {std::size_t(1), bytes.size() / 2, bytes.size() - 20}) {
        write_file(folder / "cut.hdr", bytes.substr(0, bytes.size() - cut));
        test::check_throws<IoError>([&] { (void)read_environment(folder / "cut.hdr"); }, {"cut.hdr", "truncated"});
    }
    const std::size_t row = bytes.find(std::string("\2\2\0\24", 4));
    REQUIRE(row != std::string::npos);
    for (const char run : {'\0', '\177', '\377'}) {
        bytes[row + 4] = run;
        write_file(folder / "bad.hdr", bytes);
        test::check_throws<IoError>([&] { (void)read_environment(folder / "bad.hdr"); }, {"bad.hdr", "damaged"});
    }
}

TEST_CASE("PNG and JPEG environments are converted from sRGB to linear light") {
    const test::Temporary folder;
    PixelImage image(3, 8, 16);
    for (std::size_t i = 0; i < image.data.size(); ++i) image.data[i] = static_cast<std::uint8_t>(i % 3 ? 128 : 255);
    write_png(folder / "a.png", image);
    const Image<float> png = read_environment(folder / "a.png");
    CHECK(png.at(0, 3, 7) == doctest::Approx(1));
    CHECK(png.at(1, 7, 15) == doctest::Approx(0.2158605));
    std::string bytes;
    const auto append = [](void* context, void* data, int size) {
        static_cast<std::string*>(context)->append(static_cast<const char*>(data), static_cast<std::size_t>(size));
    };
    REQUIRE(stbi_write_jpg_to_func(append, &bytes, 16, 8, 3, image.data.data(), 98));
    write_file(folder / "a.jpg", bytes);
    CHECK(read_environment(folder / "a.jpg").at(1, 3, 7) == doctest::Approx(0.2158605).epsilon(0.05));
}

TEST_CASE("an environment file that cannot be used is named, with what was expected") {
    using test::check_throws;
    const test::Temporary folder;
    const auto file = folder / "a.hdr";
    const auto refuse = [&](const std::string& bytes, std::initializer_list<std::string_view> words) {
        write_file(file, bytes);
        check_throws<Error>([&] { (void)read_environment(file); }, words);
    };
    check_throws<IoError>([&] { (void)read_environment(folder / "none.hdr"); }, {"none.hdr"});
    refuse("no image", {"a.hdr", "Radiance HDR (.hdr), PNG or JPEG"});
    refuse("#?RADIANCE\n", {"a.hdr", "truncated"});
    refuse(hdr_header("-Y 2 +X 4"), {"a.hdr", "truncated"});
    refuse(hdr_header("-Y 2 +X 4", "FORMAT=32-bit_rle_xyze\n"), {"a.hdr", "xyze", "32-bit_rle_rgbe"});
    refuse(hdr_header("+Y 2 +X 4"), {"a.hdr", "'+Y 2 +X 4'", "-Y height +X width"});
    refuse(hdr_header("-Y 4096 +X 8192") + std::string(4000, '\2'), {"a.hdr", "truncated", "4096 rows"});
    refuse(hdr_header("-Y 200000 +X 400000"), {"a.hdr", "400000 x 200000", "at most"});
    refuse(hdr_header("-Y 3 +X 4") + rgbe_pixels(3, 4), {"a.hdr", "4 x 3", "twice as wide as high"});
    refuse(hdr_header("-Y 2 +X 4") + std::string(32, '\0'), {"a.hdr", "black"});
    PixelImage square(3, 4, 4);
    write_png(folder / "b.png", square);
    check_throws<ShapeError>([&] { (void)read_environment(folder / "b.png"); }, {"b.png", "4 x 4", "twice"});
}
