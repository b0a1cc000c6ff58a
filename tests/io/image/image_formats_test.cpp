// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/image/image_formats.hpp>

#include "io/temporary.hpp"

#include <gsh/io/image/environment_file.hpp>
#include <gsh/io/image/image_file.hpp>

#include <string>
#include <utility>

using namespace gsh;

TEST_CASE("images of other formats are named by their first bytes, with the way to convert them") {
    const test::Temporary folder;
    const auto bytes = [](const char* text, std::size_t size) {
        return std::string(text, size) + std::string(16, 'x');
    };
    for (const auto& [begin, name] :
         {std::pair(bytes("RIFF\1\2\3\4WEBPVP8 ", 16), "WebP image"),
          std::pair(bytes("\0\0\0\x18"
                          "ftypheic\0\0\0\0",
                          16),
                    "HEIC image"),
          std::pair(bytes("\0\0\0\x18"
                          "ftypmif1\0\0\0\0",
                          16),
                    "HEIC image"),
          std::pair(bytes("\0\0\0\x1c"
                          "ftypavif\0\0\0\0",
                          16),
                    "AVIF image"),
          std::pair(bytes("II*\0", 4), "TIFF image"), std::pair(bytes("MM\0*", 4), "TIFF image"),
          std::pair(bytes("BM", 2), "BMP image"), std::pair(bytes("GIF89a", 6), "GIF image"),
          std::pair(bytes("\0\0\0\x0CJXL \r\n\x87\n", 12), "JPEG XL image"),
          std::pair(bytes("v/1\1\2\0\0\0", 8), "OpenEXR image")}) {
        write_file(folder / "a.png", begin);
        test::check_throws<IoError>([&] { (void)read_image(folder / "a.png"); },
                                    {"a.png", name, "expected a PNG or JPEG", "convert it to PNG"});
        test::check_throws<IoError>([&] { (void)read_environment(folder / "a.png"); },
                                    {"a.png", name, "Radiance HDR (.hdr), PNG or JPEG", "convert it"});
    }
    write_file(folder / "a.jpg", bytes("\0\0\0\x18"
                                       "ftypisom\0\0\0\0",
                                       16));
    test::check_throws<IoError>([&] { (void)read_image(folder / "a.jpg"); }, {"an MP4 video", "ffmpeg"});
    write_file(folder / "a.jpg", "version https://git-lfs.github.com/spec/v1\noid sha256:12\n");
    test::check_throws<IoError>([&] { (void)read_image(folder / "a.jpg"); }, {"a pointer of Git LFS", "git lfs pull"});
    for (const char* other : {"R", "RIFF", "MMxx", "text"}) {
        write_file(folder / "a.jpg", other);
        test::check_throws<IoError>([&] { (void)read_image(folder / "a.jpg"); }, {"is not a PNG or JPEG image"});
    }
}

TEST_CASE("names of images of other formats") {
    for (const char* name : {"a.webp", "a.HEIC", "0001.tif", "x/y.TIFF", "a.avif"})
        CHECK(detail::is_foreign_image(name));
    for (const char* name : {"a.png", "a.JPG", "a.jpeg", "a.json", "webp", ".webp"})
        CHECK(!detail::is_foreign_image(name));
}
