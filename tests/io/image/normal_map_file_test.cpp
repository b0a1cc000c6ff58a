// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/image/normal_map_file.hpp>

#include "io/exif_files.hpp"
#include "io/temporary.hpp"

#include <cmath>
#include <cstdint>
#include <limits>
#include <string>

using namespace gsh;

namespace {

/// A bump seen from the front: unit normals in gsh's camera frame, where z is negative towards the viewer.
vec3<double> bump(int y, int x, int height, int width) {
    const double u = (x + 0.5) / width - 0.5, v = (y + 0.5) / height - 0.5;
    return normalize(vec3<double>(0.9 * u, 0.8 * v, -0.7));
}

vec3<double> normal_of(const PriorMap& map, int y, int x) {
    return {map.values.at(0, y, x), map.values.at(1, y, x), map.values.at(2, y, x)};
}

std::uint8_t byte(double component) { return static_cast<std::uint8_t>(std::lround((component + 1) * 127.5)); }

/// A picture of the bump, its components times `sign`.
PixelImage picture(int channels, int height, int width, const vec3<double>& sign) {
    PixelImage image(channels, height, width);
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            for (int k = 0; k < 3; ++k) image.pixel(y, x)[k] = byte(sign[k] * bump(y, x, height, width)[k]);
            if (channels == 4) image.pixel(y, x)[3] = 255;
        }
    return image;
}

/// A PNG of 16-bit RGB samples [height, width, 3], stored without compression.
std::string png16(int height, int width, const std::vector<std::uint16_t>& samples) {
    std::string raw, png = "\x89PNG\r\n\x1a\n";
    const auto number = [](std::uint32_t value, int bytes) {
        std::string text;
        for (int shift = 8 * bytes - 8; shift >= 0; shift -= 8) text.push_back(static_cast<char>(value >> shift & 255));
        return text;
    };
    for (int y = 0; y < height; ++y) {
        raw.push_back('\0'); // no filter
        for (int i = 0; i < 3 * width; ++i) raw += number(samples[static_cast<std::size_t>(3 * width * y + i)], 2);
    }
    std::uint32_t a = 1, b = 0; // Adler-32
    for (const char c : raw) a = (a + static_cast<unsigned char>(c)) % 65521, b = (b + a) % 65521;
    const auto length = static_cast<std::uint16_t>(raw.size());
    REQUIRE(raw.size() < 65536);
    std::string data = "\x78\x01\x01";
    for (const int v : {length & 255, length >> 8, ~length & 255, (~length >> 8) & 255})
        data.push_back(static_cast<char>(v));
    data += raw + number(b << 16 | a, 4);
    const auto chunk = [&](const std::string& type, const std::string& content) {
        Crc32 crc;
        crc.add(type.data(), type.size());
        crc.add(content.data(), content.size());
        png += number(static_cast<std::uint32_t>(content.size()), 4) + type + content + number(crc.value(), 4);
    };
    chunk("IHDR", number(static_cast<std::uint32_t>(width), 4) + number(static_cast<std::uint32_t>(height), 4) +
                      std::string("\x10\x02\x00\x00\x00", 5));
    chunk("IDAT", data);
    chunk("IEND", "");
    return png;
}

struct Encoding {
    NormalEncoding encoding;
    vec3<double> sign; ///< of the file's components relative to gsh's
};
const Encoding encodings[] = {{NormalEncoding::y_up, {1, -1, -1}},
                              {NormalEncoding::y_down, {1, 1, -1}},
                              {NormalEncoding::opencv, {1, 1, 1}},
                              {NormalEncoding::x_left, {-1, -1, 1}}};

} // namespace

TEST_CASE("8-bit images of every encoding come back as the same normals") {
    const test::Temporary folder;
    for (const auto& [encoding, sign] : encodings)
        for (const int channels : {3, 4}) {
            write_png(folder / "n.png", picture(channels, 9, 14, sign));
            const PriorMap map = read_normal_map(folder / "n.png", {.encoding = encoding});
            REQUIRE(map.values.height == 9);
            REQUIRE(map.values.width == 14);
            for (int y = 0; y < 9; ++y)
                for (int x = 0; x < 14; ++x) {
                    CHECK(map.mask.at(0, y, x) == 1);
                    CHECK(length(normal_of(map, y, x)) == doctest::Approx(1));
                    CHECK(length(normal_of(map, y, x) - bump(y, x, 9, 14)) < 0.01);
                }
        }
}

TEST_CASE("a face that looks at the viewer is lilac") {
    const test::Temporary folder;
    PixelImage image(3, 1, 2);
    const std::uint8_t lilac[] = {128, 128, 255, 218, 128, 218}; // the second looks to the right of the image
    std::copy(std::begin(lilac), std::end(lilac), image.data.begin());
    write_png(folder / "n.png", image);
    const PriorMap map = read_normal_map(folder / "n.png");
    CHECK(length(normal_of(map, 0, 0) - vec3<double>(0, 0, -1)) < 0.01);
    CHECK(length(normal_of(map, 0, 1) - normalize(vec3<double>(1, 0, -1))) < 0.01);
}

TEST_CASE("16-bit images keep their lower half") {
    const test::Temporary folder;
    std::vector<std::uint16_t> samples;
    for (int y = 0; y < 8; ++y)
        for (int x = 0; x < 11; ++x)
            for (int k = 0; k < 3; ++k) {
                const double component = (k == 0 ? 1 : -1) * bump(y, x, 8, 11)[k];
                samples.push_back(static_cast<std::uint16_t>(std::lround((component + 1) * 32767.5)));
            }
    write_file(folder / "n.png", png16(8, 11, samples));
    const PriorMap map = read_normal_map(folder / "n.png");
    for (int y = 0; y < 8; ++y)
        for (int x = 0; x < 11; ++x) CHECK(length(normal_of(map, y, x) - bump(y, x, 8, 11)) < 5e-5);
}

TEST_CASE("what is no normal does not count: transparent, black, grey and white pixels") {
    const test::Temporary folder;
    PixelImage image = picture(4, 6, 6, {1, -1, -1});
    image.pixel(1, 1)[3] = 100;
    for (int k = 0; k < 3; ++k) image.pixel(2, 2)[k] = 0, image.pixel(3, 3)[k] = 127, image.pixel(4, 4)[k] = 255;
    write_png(folder / "n.png", image);
    const PriorMap map = read_normal_map(folder / "n.png");
    int count = 0;
    for (int y = 0; y < 6; ++y)
        for (int x = 0; x < 6; ++x) {
            const bool hole = x == y && x > 0 && x < 5;
            CHECK(map.mask.at(0, y, x) == !hole);
            if (hole) CHECK(normal_of(map, y, x) == vec3<double>(0));
            count += map.mask.at(0, y, x);
        }
    CHECK(count == 32);
    CHECK(read_normal_map(folder / "n.png", {.alpha = 0.3}).mask.at(0, 1, 1) == 1);
}

TEST_CASE("npy: rows or planes, real numbers, halves of a byte's range, NaN for nothing") {
    const test::Temporary folder;
    constexpr std::size_t H = 5, W = 7;
    std::vector<float> rows(H * W * 3), planes(H * W * 3);
    std::vector<std::uint8_t> bytes(H * W * 3);
    std::vector<double> with_alpha(H * W * 4);
    for (std::size_t y = 0; y < H; ++y)
        for (std::size_t x = 0; x < W; ++x)
            for (std::size_t k = 0; k < 3; ++k) {
                const double n = (k == 0 ? 1 : -1) * bump(int(y), int(x), int(H), int(W))[int(k)];
                rows[(y * W + x) * 3 + k] = planes[(k * H + y) * W + x] = static_cast<float>(2 * n) / 2;
                bytes[(y * W + x) * 3 + k] = byte(n);
                with_alpha[(y * W + x) * 4 + k] = n;
                with_alpha[(y * W + x) * 4 + 3] = x > 0;
            }
    rows[0] = std::numeric_limits<float>::quiet_NaN();
    const auto path = folder / "n.npy";
    const auto check = [&](double tolerance, bool first_column, bool first) {
        const PriorMap map = read_normal_map(path);
        REQUIRE(map.values.width == 7);
        for (int y = 0; y < 5; ++y)
            for (int x = 0; x < 7; ++x) {
                const bool counts = (x > 0 || first_column) && (x + y > 0 || first);
                CHECK(map.mask.at(0, y, x) == counts);
                CHECK(length(normal_of(map, y, x) - (counts ? bump(y, x, 5, 7) : vec3<double>(0))) < tolerance);
            }
    };
    write_npy<float>(path, rows, {H, W, 3});
    check(1e-6, true, false);
    write_npy<float>(path, planes, {3, H, W});
    check(1e-6, true, true);
    write_npy<double>(path, with_alpha, {H, W, 4});
    check(1e-12, false, false);
    write_npy<std::uint8_t>(path, bytes, {H, W, 3});
    check(0.01, true, true);
}

TEST_CASE("a back map in the front view's frame, and maps of the wrong encoding") {
    const test::Temporary folder;
    write_png(folder / "back.png", picture(3, 12, 12, {-1, 1, 1})); // y_up, with all normals reversed
    test::check_throws<ValueError>([&] { (void)read_normal_map(folder / "back.png"); },
                                   {"back.png", "144 of 144", "away from the viewer", "facing: away"});
    const PriorMap map = read_normal_map(folder / "back.png", {.facing = NormalFacing::away});
    CHECK(length(normal_of(map, 3, 8) + bump(3, 8, 12, 12)) < 0.01);
    write_png(folder / "front.png", picture(3, 12, 12, {1, -1, -1}));
    test::check_throws<ValueError>([&] { (void)read_normal_map(folder / "front.png", {.facing = NormalFacing::away}); },
                                   {"far side"});
    test::check_throws<ValueError>(
        [&] { (void)read_normal_map(folder / "front.png", {.encoding = NormalEncoding::opencv}); },
        {"another encoding"});
}

TEST_CASE("a map that is to be turned is refused, because its normals would have to turn, too") {
    const test::Temporary folder;
    PixelImage lilac(3, 4, 6);
    for (std::size_t i = 0; i < lilac.data.size(); ++i) lilac.data[i] = i % 3 == 2 ? 255 : 128;
    write_file(folder / "a.png", test::with_exif(encode_png(lilac), test::orientation_tiff(1)));
    CHECK(read_normal_map(folder / "a.png").mask.width == 6);
    write_file(folder / "a.png", test::with_exif(encode_png(lilac), test::orientation_tiff(6)));
    test::check_throws<IoError>([&] { (void)read_normal_map(folder / "a.png"); }, {"a.png", "Exif", "upright"});
}

TEST_CASE("files that hold no normal map") {
    const test::Temporary folder;
    const auto refuse = [&]<class E>(E, const char* file, std::initializer_list<std::string_view> words,
                                     const NormalMapParams& params = {}) {
        test::check_throws<E>([&] { (void)read_normal_map(folder / file, params); }, words);
    };
    refuse(IoError(""), "missing.png", {"missing.png"});
    refuse(IoError(""), "missing.npy", {"missing.npy", "opened"});
    write_file(folder / "a.jpg", "\xFF\xD8\xFF what a JPEG begins with");
    refuse(IoError(""), "a.jpg", {"a.jpg", "PNG", "JPEG"});
    const std::string png = encode_png(picture(3, 20, 20, {1, -1, -1}));
    write_file(folder / "cut.png", png.substr(0, png.size() / 2));
    refuse(IoError(""), "cut.png", {"truncated"});
    write_png(folder / "grey.png", PixelImage(1, 4, 4));
    refuse(ShapeError(""), "grey.png", {"grey"});
    PixelImage plain(3, 30, 30);
    write_png(folder / "black.png", plain);
    refuse(ValueError(""), "black.png", {"black.png", "no pixel holds a normal"});

    write_file(folder / "a.npy", "not an array");
    refuse(IoError(""), "a.npy", {"a.npy"});
    write_npy<float>(folder / "flat.npy", std::vector<float>(12), {4, 3});
    refuse(ShapeError(""), "flat.npy", {"(4, 3)", "height, width"});
    write_npy<std::int32_t>(folder / "int.npy", std::vector<std::int32_t>(48), {4, 4, 3});
    refuse(IoError(""), "int.npy", {"i4"});
    write_npy<float>(folder / "encoded.npy", std::vector<float>(300 * 3, 0.6f), {10, 30, 3});
    refuse(ValueError(""), "encoded.npy", {"colours in [0, 1]"});
    write_npy<float>(folder / "none.npy", std::vector<float>(), {0, 4, 3});
    refuse(IoError(""), "none.npy", {"none.npy"});
}
