// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/image/image_file.hpp>

#include "io/temporary.hpp"

#include <cmath>
#include <cstdint>
#include <string>

using namespace gsh;

namespace {

PixelImage pattern(int channels, int height, int width) {
    PixelImage image(channels, height, width);
    for (std::size_t i = 0; i < image.data.size(); ++i) image.data[i] = static_cast<std::uint8_t>(i * 37 + i / 11);
    return image;
}

std::string jpeg_bytes(const PixelImage& image) {
    std::string bytes;
    const auto append = [](void* context, void* data, int size) {
        static_cast<std::string*>(context)->append(static_cast<const char*>(data), static_cast<std::size_t>(size));
    };
    REQUIRE(stbi_write_jpg_to_func(append, &bytes, image.width, image.height, image.channels, image.data.data(), 95));
    return bytes;
}

} // namespace

TEST_CASE("PNG images come back byte for byte") {
    const test::Temporary folder;
    for (const auto& [height, width] : {std::pair{1, 1}, std::pair{5, 7}, std::pair{64, 33}}) {
        const PixelImage rgba = pattern(4, height, width);
        write_png(folder / "a.png", rgba);
        const PixelImage read = read_image(folder / "a.png");
        CHECK(read.width == width);
        CHECK(read.height == height);
        CHECK(read.channels == 4);
        CHECK(read.data == rgba.data);
    }
    const PixelImage rgb = pattern(3, 4, 3);
    write_png(folder / "b.png", rgb);
    const PixelImage read = read_image(folder / "b.png");
    CHECK(read.pixel(2, 1)[0] == rgb.pixel(2, 1)[0]);
    CHECK(read.pixel(2, 1)[2] == rgb.pixel(2, 1)[2]);
    CHECK(read.pixel(2, 1)[3] == 255);
    write_png(folder / "c.png", pattern(1, 2, 2));
    CHECK(read_image(folder / "c.png").pixel(0, 1)[2] == 37);
}

TEST_CASE("JPEG images are read, and come out opaque") {
    const test::Temporary folder;
    PixelImage image(3, 16, 24);
    for (auto& value : image.data) value = 200;
    write_file(folder / "a.jpg", jpeg_bytes(image));
    const PixelImage read = read_image(folder / "a.jpg");
    CHECK(read.width == 24);
    CHECK(std::abs(int(read.pixel(8, 8)[1]) - 200) <= 2);
    CHECK(read.pixel(8, 8)[3] == 255);
}

TEST_CASE("planar numbers are rounded to nearest and clamped") {
    Image<float> image(3, 1, 4);
    const float values[] = {0.0f, 1.0f, -3.0f, 7.0f, 100.4f / 255, 100.6f / 255, std::nanf(""), 0.5f};
    for (int x = 0; x < 4; ++x) image.at(0, 0, x) = values[x], image.at(2, 0, x) = values[4 + x];
    const PixelImage bytes = quantise(image.view());
    const int expected[] = {0, 255, 0, 255, 100, 101, 0, 128};
    for (int x = 0; x < 4; ++x) {
        CHECK(int(bytes.pixel(0, x)[0]) == expected[x]);
        CHECK(int(bytes.pixel(0, x)[2]) == expected[4 + x]);
    }
    const test::Temporary folder;
    write_png(folder / "a.png", image);
    CHECK(read_image(folder / "a.png").pixel(0, 1)[0] == 255);
}

TEST_CASE("what is no image, or no longer one, is named") {
    const test::Temporary folder;
    const auto path = folder / "a.png";
    const auto read = [&] { (void)read_image(path); };
    test::check_throws<IoError>(read, {path.string(), "No such file"});
    write_file(path, "");
    test::check_throws<IoError>(read, {path.string(), "is empty, expected a PNG or JPEG image"});
    write_file(path, "<html>");
    test::check_throws<IoError>(read, {path.string(), "is a web page, expected a PNG or JPEG image"});
    write_file(path, "RIFF1234WEBPVP8 ");
    test::check_throws<IoError>(read, {path.string(), "is a WebP picture, expected a PNG or JPEG image"});
    write_file(path, "words");
    test::check_throws<IoError>(read, {path.string(), "is not a PNG or JPEG image"});

    const std::string png = encode_png(pattern(4, 32, 32));
    for (const std::size_t cut : {std::size_t(1), std::size_t(12), std::size_t(30), png.size() / 2, png.size() - 20}) {
        write_file(path, png.substr(0, png.size() - cut));
        test::check_throws<IoError>(read, {path.string(), "truncated"});
    }
    std::string damaged = png;
    damaged[png.size() / 2] ^= 4;
    write_file(path, damaged);
    test::check_throws<IoError>(read, {path.string(), "damaged"});

    const std::string jpeg = jpeg_bytes(pattern(3, 64, 64));
    write_file(path, jpeg.substr(0, jpeg.size() / 2));
    test::check_throws<IoError>(read, {path.string(), "truncated"});
}

TEST_CASE("an absurd size is refused before anything is allocated") {
    const test::Temporary folder;
    std::string png = encode_png(pattern(4, 2, 2));
    const auto put = [&](std::size_t at, std::uint32_t value) {
        for (std::size_t i = 0; i < 4; ++i) png[at + i] = static_cast<char>(value >> (24 - 8 * i));
    };
    for (const std::uint32_t side : {1u << 15, 1u << 23, ~0u}) {
        put(16, side), put(20, side); // width, height
        Crc32 crc;
        crc.add(png.data() + 12, 17);
        put(29, crc.value());
        write_file(folder / "a.png", png);
        const std::string claim = std::to_string(side) + " x " + std::to_string(side);
        test::check_throws<IoError>([&] { (void)read_image(folder / "a.png"); }, {"a.png", claim});
    }
}

TEST_CASE("images that cannot be written") {
    CHECK_THROWS_AS((void)encode_png(PixelImage()), ValueError);
    CHECK_THROWS_AS((void)encode_png(PixelImage(2, 3, 3)), ValueError);
    PixelImage image(3, 3, 3);
    image.data.pop_back();
    CHECK_THROWS_AS((void)encode_png(image), ShapeError);
}
