// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/image/mask_file.hpp>

#include "io/exif_files.hpp"
#include "io/sample_files.hpp"
#include "io/temporary.hpp"

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

using namespace gsh;

namespace {

/// Bytes of a grey PNG of 16 bits, or of one with a palette: the parts that stb_image_write does not write.
std::string grey_png(std::uint8_t depth, std::uint8_t kind, int height, int width, const std::string& rows,
                   const std::string& palette = {}) {
    std::string png = "\x89PNG\r\n\x1a\n";
    const auto number = [](std::uint32_t value) { return test::stored_number(value, 4, false); };
    const auto chunk = [&](const std::string& name, const std::string& data) {
        Crc32 crc;
        crc.add((name + data).data(), name.size() + data.size());
        png += number(static_cast<std::uint32_t>(data.size())) + name + data + number(crc.value());
    };
    chunk("IHDR", number(static_cast<std::uint32_t>(width)) + number(static_cast<std::uint32_t>(height)) +
                      std::string{static_cast<char>(depth), static_cast<char>(kind), 0, 0, 0});
    if (!palette.empty()) chunk("PLTE", palette);
    std::string packed = "\x78\x01\x01"; // zlib, one stored block
    const auto size = static_cast<std::uint32_t>(rows.size());
    packed += test::stored_number(size, 2, true) + test::stored_number(~size & 0xFFFF, 2, true) + rows;
    std::uint32_t a = 1, b = 0;
    for (const char c : rows) a = (a + static_cast<unsigned char>(c)) % 65521, b = (b + a) % 65521;
    chunk("IDAT", packed + number(b << 16 | a));
    chunk("IEND", "");
    return png;
}

struct Masks {
    test::Temporary folder;
    std::filesystem::path path = folder / "a.png";

    StoredMask grey(const std::vector<int>& values) {
        PixelImage image(1, 1, static_cast<int>(values.size()));
        for (std::size_t i = 0; i < values.size(); ++i) image.data[i] = static_cast<std::uint8_t>(values[i]);
        write_png(path, image);
        return read_mask(path);
    }
    [[nodiscard]] static std::vector<int> values(const StoredMask& mask) {
        return {mask.values.data.begin(), mask.values.data.end()};
    }
    static MaskMeaning meaning(const StoredMask& mask, bool plain = false) {
        return mask_meaning("here", mask.levels, plain);
    }
};
using MaskValues = std::vector<int>;

} // namespace

TEST_CASE_FIXTURE(Masks, "white, soft and empty masks are as they are") {
    CHECK(values(grey({0, 255, 7, 128})) == MaskValues{0, 255, 7, 128});
    CHECK(grey({0, 255, 7}).levels.plain());
    CHECK(grey({0, 250, 3, 120}).levels.plain()); // a JPEG file of a mask
    CHECK(meaning(grey({0, 244, 3})) == MaskMeaning::soft);
    CHECK(grey({0, 0}).levels.empty());
    CHECK(meaning(grey({0, 0})) == MaskMeaning::soft);
    // Faint values and no person, in a camera whose other masks are plain.
    CHECK(meaning(grey({0, 3, 12, 9}), true) == MaskMeaning::soft);

    PixelImage alpha(4, 1, 3); // a white picture whose alpha is the mask
    alpha.data = {255, 255, 255, 0, 255, 255, 255, 200, 255, 255, 255, 255};
    write_png(path, alpha);
    CHECK(values(read_mask(path)) == MaskValues{0, 200, 255});
    write_file(path, grey_png(1, 0, 1, 8, std::string{0, '\x90'})); // one bit a pixel
    CHECK(values(read_mask(path)) == MaskValues{255, 0, 0, 255, 0, 0, 0, 0});
    write_file(path, grey_png(16, 0, 1, 3, std::string("\0\xFF\xFF\x80\x00\x00\x00", 7)));
    CHECK(values(read_mask(path)) == MaskValues{255, 128, 0});
}

TEST_CASE_FIXTURE(Masks, "one small number is the person") {
    for (const int label : {1, 2, 38, 128, 239}) {
        const StoredMask mask = grey({0, label, 0, label});
        CHECK(!mask.levels.plain());
        CHECK(!mask.levels.empty());
        CHECK(meaning(mask) == MaskMeaning::binary);
    }
    write_file(path, grey_png(16, 0, 1, 3, std::string("\0\0\1\0\0\0\1", 7))); // 16 bits: 1, 0, 1
    CHECK(values(read_mask(path)) == MaskValues{1, 0, 1});
    CHECK(meaning(read_mask(path)) == MaskMeaning::binary);

    // A palette of black and one colour, and such colours in full: decoders turn numbers into colours.
    const std::string palette("\0\0\0\x80\0\0\0\x80\0", 9);
    write_file(path, grey_png(8, 3, 1, 3, std::string("\0\1\0\1", 4), palette));
    CHECK(values(read_mask(path)) == MaskValues{255, 0, 255});
    CHECK(meaning(read_mask(path)) == MaskMeaning::binary);
    write_file(path, grey_png(8, 3, 1, 3, std::string("\0\2\0\2", 4), palette)); // green: its red is 0
    CHECK(values(read_mask(path)) == MaskValues{255, 0, 255});
    CHECK(meaning(read_mask(path)) == MaskMeaning::binary);
    write_file(path, grey_png(8, 3, 1, 2, std::string("\0\0\0", 3), palette));
    CHECK(read_mask(path).levels.empty());
}

TEST_CASE_FIXTURE(Masks, "what is unclear is refused, with what was found and what to do") {
    const auto refused = [&](const StoredMask& mask, bool plain, std::initializer_list<std::string_view> words) {
        test::check_throws<ValueError>([&] { (void)meaning(mask, plain); }, words);
    };
    refused(grey({0, 1, 2}), false, {"here", "labels 0, 1, 2,", "255 for the labels of people"});
    refused(grey({1, 2}), false, {"labels 1, 2"});
    refused(grey({0, 1, 2, 3, 4, 5, 6, 7, 8}), false, {"0, 1, 2, 3, 4, 5 and 3 more"});
    MaskValues soft(180);
    for (int i = 0; i < 180; ++i) soft[static_cast<std::size_t>(i)] = i;
    refused(grey(soft), false, {"values 0, 1,", "scale the masks"});
    write_file(path, grey_png(8, 3, 1, 3, std::string("\0\1\2\0", 4), std::string("\0\0\0\x80\0\0\0\x80\0", 9)));
    refused(read_mask(path), false, {"labels 0, (0, 128, 0), (128, 0, 0)"});
    refused(read_mask(path), true, {"labels"}); // also beside white masks
    // One label in each of two masks of a camera, but not the same one.
    StoredMask both = grey({0, 1});
    both.levels.add(grey({0, 2}).levels);
    refused(both, false, {"labels 0, 1, 2"});

    PixelImage photo(3, 32, 32);
    for (std::size_t i = 0; i < photo.data.size(); ++i) photo.data[i] = static_cast<std::uint8_t>(i * 37 + i / 11);
    write_png(path, photo);
    test::check_throws<ValueError>([&] { (void)read_mask(path); }, {"a.png", "many colours", "white on the person"});
}

TEST_CASE_FIXTURE(Masks, "arrays: 0 and 1, real numbers, bytes and labels") {
    const auto file = folder / "a.npy";
    test::write_array(file, std::vector<std::uint8_t>{0, 1, 1, 0}, {2, 2});
    CHECK(values(read_mask(file)) == MaskValues{0, 255, 255, 0});
    CHECK(read_mask(file).levels.unit);
    CHECK(read_mask(file).values.width == 2);
    const StoredMask unit = read_mask(file);
    test::write_array(file, std::vector<float>{0, 0.5f, 1, 0.2f, 0, 0}, {2, 3, 1});
    CHECK(values(read_mask(file)) == MaskValues{0, 128, 255, 51, 0, 0});
    CHECK(!read_mask(file).levels.unit);
    test::write_array(file, std::vector<std::uint8_t>{0, 255, 30, 0}, {1, 4});
    CHECK(values(read_mask(file)) == MaskValues{0, 255, 30, 0});
    test::write_array(file, std::vector<std::int32_t>{0, 2, 0, 2}, {2, 2});
    CHECK(meaning(read_mask(file)) == MaskMeaning::binary);
    StoredMask both = read_mask(file); // labels 1 and 2, in different arrays
    both.levels.add(unit.levels);
    test::check_throws<ValueError>([&] { (void)meaning(both); }, {"labels 0, 1, 2"});
    test::write_array(file, std::vector<float>{0, 300}, {1, 2});
    test::check_throws<ValueError>([&] { (void)read_mask(file); }, {"a.npy", "300", "0 to 255"});
    test::write_array(file, std::vector<float>{0, -1}, {1, 2});
    test::check_throws<ValueError>([&] { (void)read_mask(file); }, {"a.npy", "-1"});
    test::write_array(file, std::vector<float>{1, std::nanf("")}, {1, 2});
    test::check_throws([&] { (void)read_mask(file); }, {"a.npy", "NaN"});
    test::write_array(file, std::vector<float>{0, 1}, {2});
    test::check_throws<ShapeError>([&] { (void)read_mask(file); }, {"a.npy", "(2,)", "(height, width)"});
    test::write_array(file, std::vector<float>(12), {2, 2, 3});
    test::check_throws<ShapeError>([&] { (void)read_mask(file); }, {"a.npy", "(2, 2, 3)"});
}
