// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/image/image_file.hpp>

#include <gsh/io/file/crc32.hpp>
#include <gsh/io/file/gzip.hpp>

#include "io/exif_files.hpp"
#include "io/temporary.hpp"

#include <zlib.h>

#include <cmath>
#include <cstdint>
#include <string>

using namespace gsh;
using test::jpeg_bytes;

namespace {

PixelImage pattern(int channels, int height, int width) {
    PixelImage image(channels, height, width);
    for (std::size_t i = 0; i < image.data.size(); ++i) image.data[i] = static_cast<std::uint8_t>(i * 37 + i / 11);
    return image;
}

/// A chunk of a PNG with its checksum.
std::string chunk(const std::string& type, const std::string& data) {
    const auto number = [](std::uint32_t value) {
        std::string bytes;
        for (int shift = 24; shift >= 0; shift -= 8) bytes.push_back(static_cast<char>(value >> shift & 255));
        return bytes;
    };
    Crc32 crc;
    crc.add(type.data(), 4), crc.add(data.data(), data.size());
    return number(static_cast<std::uint32_t>(data.size())) + type + data + number(crc.value());
}

/// A PNG of these rows, each with its filter; `more` are chunks before the pixels.
std::string png_of(std::uint32_t width, std::uint32_t height, int depth, int color, const std::string& rows,
                   bool interlaced = false, const std::string& more = {}) {
    std::string header;
    for (const std::uint32_t value : {width, height})
        for (int shift = 24; shift >= 0; shift -= 8) header.push_back(static_cast<char>(value >> shift & 255));
    header += {static_cast<char>(depth), static_cast<char>(color), 0, 0, static_cast<char>(interlaced)};
    std::string stream = "\x78\x9c" + deflated(rows);
    const auto checksum = adler32(1, reinterpret_cast<const Bytef*>(rows.data()), static_cast<uInt>(rows.size()));
    for (int shift = 24; shift >= 0; shift -= 8) stream.push_back(static_cast<char>(checksum >> shift & 255));
    return "\x89PNG\r\n\x1a\n" + chunk("IHDR", header) + more + chunk("IDAT", stream.substr(0, stream.size() / 2)) +
           chunk("IDAT", stream.substr(stream.size() / 2)) + chunk("IEND", "");
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

TEST_CASE("what a phone appends to a JPEG, or a camera puts before its pixels, does not matter") {
    const test::Temporary folder;
    const std::string plain = jpeg_bytes(pattern(3, 8, 8));
    std::string film;
    for (int k = 0; k < 300; ++k) film += "film\xFF\xDA..";
    write_file(folder / "a.jpg", plain + film);
    CHECK(read_image(folder / "a.jpg").width == 8);
    std::string notes = "\xFF\xE1";
    notes += {static_cast<char>((film.size() + 2) >> 8), static_cast<char>((film.size() + 2) & 255)};
    write_file(folder / "a.jpg", plain.substr(0, 2) + notes + film + plain.substr(2));
    CHECK(read_image(folder / "a.jpg").width == 8);
}

TEST_CASE("all eight orientations of Exif are shown upright, and what is stored can be had, too") {
    const test::Temporary folder;
    const PixelImage visible = pattern(4, 5, 7);
    for (int orientation = 1; orientation <= 8; ++orientation) {
        CAPTURE(orientation);
        const PixelImage lying = test::stored_lying(visible, orientation);
        write_file(folder / "a.png", test::with_exif(encode_png(lying), test::orientation_tiff(orientation)));
        const PixelImage read = read_image(folder / "a.png");
        CHECK(read.width == 7);
        CHECK(read.height == 5);
        CHECK(read.data == visible.data);
        const StoredImage stored = read_stored_image(folder / "a.png");
        CHECK(stored.orientation == orientation);
        CHECK(stored.image.width == (orientation >= 5 ? 5 : 7));
        CHECK(stored.image.data == lying.data);
        CHECK(!stored.sixteen_bits);
    }
    PixelImage wide(3, 16, 32); // white on the left
    for (int y = 0; y < 16; ++y)
        for (int x = 0; x < 16; ++x) std::fill_n(wide.pixel(y, x), 3, std::uint8_t(255));
    write_file(folder / "a.jpg", test::with_exif(jpeg_bytes(wide), test::orientation_tiff(6, true)));
    const PixelImage read = read_image(folder / "a.jpg"); // turned clockwise: white above
    CHECK(read.width == 16);
    CHECK(read.height == 32);
    CHECK(int(read.pixel(4, 8)[0]) > 250);
    CHECK(int(read.pixel(28, 8)[0]) < 5);
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

TEST_CASE("palettes, 16 bits, and interlaced rows") {
    const test::Temporary folder;
    const auto read = [&](const std::string& bytes) {
        write_file(folder / "a.png", bytes);
        return read_image(folder / "a.png").data;
    };
    using PixelBytes = std::vector<std::uint8_t>;
    const std::string palette = chunk("PLTE", "\x01\x02\x03\x04\x05\x06") + chunk("tRNS", "\x07");
    CHECK(read(png_of(2, 1, 8, 3, std::string("\0\1\0", 3), false, palette)) == PixelBytes{4, 5, 6, 255, 1, 2, 3, 7});
    CHECK(read(png_of(3, 1, 1, 0, std::string("\0\xA0", 2))) ==
          PixelBytes{255, 255, 255, 255, 0, 0, 0, 255, 255, 255, 255, 255});
    CHECK(read(png_of(1, 1, 16, 2, std::string("\0\x10\xFF\x20\xFF\x30\xFF", 7))) == PixelBytes{16, 32, 48, 255});
    // 2 x 2 pixels: the first pass has the first one, the sixth that at its right, the seventh the second row.
    const PixelBytes grey = read(png_of(2, 2, 8, 0, std::string("\0\x0A\0\x14\0\x1E\x28", 7), true));
    CHECK(PixelBytes{grey[0], grey[4], grey[8], grey[12]} == PixelBytes{10, 20, 30, 40});
}

TEST_CASE("no byte beyond a short file is read") {
    const test::Temporary folder;
    const std::string png = encode_png(pattern(4, 4, 4)), jpeg = jpeg_bytes(pattern(3, 8, 8));
    for (std::size_t size = 0; size <= 64; ++size)
        for (const std::string& bytes : {png, jpeg}) {
            write_file(folder / "a.png", bytes.substr(0, size), Sync::none);
            test::check_throws<IoError>([&] { (void)read_image(folder / "a.png"); },
                                        {(folder / "a.png").string() + ": "});
        }
    const std::string signature = png.substr(0, 8);
    for (const std::string& chunks : {chunk("IEND", ""), chunk("IHDR", "1234") + chunk("IEND", ""),
                                      chunk("IDAT", "") + png.substr(8), png.substr(8, 25) + png.substr(8)}) {
        write_file(folder / "a.png", signature + chunks);
        test::check_throws<IoError>([&] { (void)read_image(folder / "a.png"); }, {"a.png", "does not begin with its"});
    }
}

TEST_CASE("more pixels than the bytes can hold are refused before they are decoded") {
    const test::Temporary folder;
    const auto refused = [&](const std::string& bytes, std::initializer_list<std::string_view> words) {
        write_file(folder / "a.png", bytes);
        test::check_throws<IoError>([&] { (void)read_image(folder / "a.png"); }, words);
    };
    refused(png_of(8000, 8000, 8, 6, std::string(1000, '\0')), {"8000 x 8000", "can hold"});
    refused(png_of(20, 20, 8, 6, std::string(1000, '\0')), {"truncated", "too few pixels"});
    refused(png_of(2, 2, 8, 6, "").replace(60, 8, std::string(8, '\0')), {"damaged"});
    refused(png_of(2, 2, 3, 6, std::string(100, '\0')), {"damaged", "depth 3"});
    // What the stream holds beyond the image is not inflated.
    write_file(folder / "a.png", png_of(1, 1, 8, 0, std::string(2, '\x02') + std::string(std::size_t(1) << 26, '\0')));
    CHECK(read_image(folder / "a.png").data.size() == 4);

    std::string jpeg = jpeg_bytes(pattern(3, 8, 8));
    const std::size_t frame = jpeg.find("\xFF\xC0");
    REQUIRE(frame != std::string::npos);
    jpeg.replace(frame + 5, 4, "\x1F\x40\x1F\x40"); // 8000 x 8000
    refused(jpeg, {"8000 x 8000", "can hold"});
    const std::size_t scan = jpeg.find("\xFF\xDA");
    const std::string head = jpeg.substr(scan, 14);
    for (int k = 0; k < 100; ++k) jpeg.insert(scan, head);
    refused(jpeg, {"damaged", "scans"});
}

TEST_CASE("images that cannot be written") {
    CHECK_THROWS_AS((void)encode_png(PixelImage()), ValueError);
    CHECK_THROWS_AS((void)encode_png(PixelImage(2, 3, 3)), ValueError);
    PixelImage image(3, 3, 3);
    image.data.pop_back();
    CHECK_THROWS_AS((void)encode_png(image), ShapeError);
}
