// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/image/jpeg_structure.hpp>

#include "io/exif_files.hpp"
#include "io/temporary.hpp"

#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <string>

using namespace gsh;
using namespace std::string_literals;

namespace {

/// 24 x 16 pixels of (10 x, 15 y, 128), written by libjpeg-turbo's cjpeg at quality 60 with a mark after every group of
/// blocks.
std::string stored(const char* name) {
    return read_file(std::filesystem::path(GSH_SOURCE_DIR) / "tests/fuzz/corpus/jpeg" / name);
}

/// A part that no JPEG has, in front: stb_image refuses it before it comes to what the tests damage.
std::string behind_unknown_part(std::string jpeg) { return jpeg.insert(2, "\xFF\x02\0\2"s); }

void refused(const std::string& jpeg, std::string_view words) {
    test::check_throws<IoError>([&] { detail::check_jpeg(behind_unknown_part(jpeg), "a.jpg"); },
                                {"a.jpg: the image is damaged: ", words});
}

std::string exchanged(std::string bytes, const std::string& old, const std::string& now) {
    const std::size_t at = bytes.find(old);
    REQUIRE(at != std::string::npos);
    return bytes.replace(at, old.size(), now);
}

/// Without the part that begins at the n-th such marker.
std::string without_part(std::string bytes, const std::string& marker, int n = 0) {
    std::size_t at = bytes.find(marker);
    for (; n > 0; --n) at = bytes.find(marker, at + 1);
    REQUIRE(at != std::string::npos);
    const auto byte = [&](std::size_t k) { return static_cast<std::size_t>(static_cast<std::uint8_t>(bytes[k])); };
    return bytes.erase(at, 2 + byte(at + 2) * 256 + byte(at + 3));
}

} // namespace

TEST_CASE("baseline and progressive JPEGs are read, also with marks at which decoding starts anew") {
    const test::Temporary folder;
    for (const char* name : {"restarts.jpg", "progressive_restarts.jpg"}) {
        CAPTURE(name);
        write_file(folder / "a.jpg", stored(name));
        const PixelImage image = read_image(folder / "a.jpg");
        REQUIRE(image.width == 24);
        REQUIRE(image.height == 16);
        double error = 0;
        for (int y = 0; y < 16; ++y)
            for (int x = 0; x < 24; ++x) {
                const std::uint8_t* const pixel = image.pixel(y, x);
                error += std::abs(pixel[0] - 10 * x) + std::abs(pixel[1] - 15 * y) + std::abs(pixel[2] - 128);
            }
        CHECK(error / (3 * 16 * 24) < 12);
    }
}

TEST_CASE("a scan has its tables before it") {
    const std::string jpeg = stored("restarts.jpg"), progressive = stored("progressive_restarts.jpg");
    detail::check_jpeg(jpeg, "a.jpg");
    detail::check_jpeg(behind_unknown_part(progressive), "a.jpg");
    refused(exchanged(jpeg, "\2\x11\3\x11\0\x3F"s, "\2\x31\3\x11\0\x3F"s), "Huffman table 3, which is missing");
    refused(exchanged(jpeg, "\2\x11\3\x11\0\x3F"s, "\2\x12\3\x11\0\x3F"s), "Huffman table 2, which is missing");
    for (int n = 0; n < 4; ++n) refused(without_part(jpeg, "\xFF\xC4", n), "which is missing");
    refused(without_part(progressive, "\xFF\xC4"), "Huffman table 0, which is missing");
    for (int n = 0; n < 2; ++n) {
        refused(without_part(jpeg, "\xFF\xDB", n), "quantization table " + std::to_string(n) + " is missing");
        refused(without_part(progressive, "\xFF\xDB", n), "quantization table " + std::to_string(n) + " is missing");
    }
    refused(exchanged(jpeg, "\2\x11\3\x11\0\x3F"s, "\2\x11\7\x11\0\x3F"s), "component 7, which the frame does not have");
    refused(without_part(jpeg, "\xFF\xC0"), "before the frame");
}

TEST_CASE("tables of a JPEG have at most 256 codes and the size of their part") {
    const std::string jpeg = stored("restarts.jpg");
    const auto with_part = [&](const std::string& part) { return std::string(jpeg).insert(2, part); };
    std::string codes = "\xFF\xC4\1\x14\x10"s;
    codes += std::string(14, '\0') + "\x02\xFF"s + std::string(257, 'a');
    refused(with_part(codes), "257 codes, expected at most 256");
    refused(with_part("\xFF\xC4\0\x12\0"s + std::string(15, '\0')), "Huffman tables are none");
    refused(with_part("\xFF\xC4\0\x13\x20"s + std::string(16, '\0')), "Huffman tables are none");
    refused(with_part("\xFF\xC4\0\x13\4"s + std::string(16, '\0')), "Huffman tables are none");
    refused(with_part("\xFF\xC4\0\x14\0"s + std::string(15, '\0') + "\2a"s), "Huffman tables are none");
    refused(with_part("\xFF\xDB\0\x42\0"s + std::string(63, '\1')), "quantization tables are none");
    refused(with_part("\xFF\xDB\0\x43\4"s + std::string(64, '\1')), "quantization tables are none");
    refused(with_part("\xFF\xFE\0\1"s), "length 1");
    detail::check_jpeg(behind_unknown_part(with_part("\xFF\xDB\0\x83\x13"s + std::string(128, '\1'))), "a.jpg");
}

TEST_CASE("scans of a JPEG are whole and begin all components") {
    const std::string jpeg = stored("restarts.jpg"), progressive = stored("progressive_restarts.jpg");
    // 24 x 16 pixels are two groups of 16 x 16, or three by two blocks of the first component.
    refused(exchanged(jpeg, "\xFF\xD0"s, ""), "a part of a scan is missing");
    refused(exchanged(progressive, "\xFF\xD4"s, ""), "a part of a scan is missing");
    detail::check_jpeg(behind_unknown_part(exchanged(without_part(jpeg, "\xFF\xDD"), "\xFF\xD0"s, "")), "a.jpg");
    refused(exchanged(jpeg, "\xFF\xDA\0\x0C\3\1\0\2\x11\3\x11"s, "\xFF\xDA\0\x0A\2\1\0\2\x11"s), "no scan of component 3");
    refused(exchanged(progressive, "\xFF\xDA\0\x0C\3\1\0\2\x10\3\x10"s, "\xFF\xDA\0\x0A\2\1\0\2\x10"s),
            "refines component 3 before");
    refused(exchanged(jpeg, "\xFF\xDA\0\x0C\3"s, "\xFF\xDA\0\x0C\4"s), "another length than its components");
    const std::size_t frame = jpeg.find("\xFF\xC0");
    refused(std::string(jpeg).insert(frame, jpeg.substr(frame, 19)), "two frames");
    refused(exchanged(jpeg, "\xFF\xC0\0\x11\x08\0\x10\0\x18\3"s, "\xFF\xC0\0\x11\x08\0\x10\0\x18\4"s), "another length");
}
