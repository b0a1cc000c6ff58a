// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/image/exif.hpp>

#include "io/exif_files.hpp"

#include <doctest/doctest.h>

#include <cstdint>
#include <string>

using namespace gsh;

TEST_CASE("the orientation of JPEG and PNG files, in either order of bytes") {
    PixelImage grey(3, 8, 8);
    for (const std::string& file : {test::jpeg_bytes(grey), encode_png(grey)}) {
        CHECK(detail::exif_orientation(file) == 1);
        for (const bool little : {true, false})
            for (int orientation = 1; orientation <= 8; ++orientation)
                CHECK(detail::exif_orientation(test::with_exif(file, test::orientation_tiff(orientation, little))) ==
                      orientation);
        for (const int none : {0, 9, 300})
            CHECK(detail::exif_orientation(test::with_exif(file, test::orientation_tiff(none))) == 1);
    }
    // Behind other segments and filling bytes, and with the lead-in that some programs write into a PNG.
    const std::string jpeg = test::with_exif(test::jpeg_bytes(grey), test::orientation_tiff(6));
    CHECK(detail::exif_orientation("\xFF\xD8\xFF\xE0" + std::string("\0\4ab\xFF", 5) + jpeg.substr(2)) == 6);
    const std::string lead = std::string("Exif\0\0", 6) + test::orientation_tiff(8);
    CHECK(detail::exif_orientation(test::with_exif(encode_png(grey), lead)) == 8);
    // APP1 that holds XMP instead comes first.
    CHECK(detail::exif_orientation("\xFF\xD8\xFF\xE1" + std::string("\0\7http:", 7) + jpeg.substr(2)) == 6);
}

TEST_CASE("damaged Exif data are as none, wherever they end") {
    PixelImage grey(3, 8, 8);
    const std::string tiff = test::orientation_tiff(6, true);
    for (const std::string& file : {test::jpeg_bytes(grey), encode_png(grey)}) {
        for (std::size_t size = 0; size < 34; ++size) // before the end of the second tag
            CHECK(detail::exif_orientation(test::with_exif(file, tiff.substr(0, size))) == 1);
        std::string far = tiff;
        far.replace(4, 4, "\xF0\xFF\xFF\xFF"); // where the directory is said to be
        CHECK(detail::exif_orientation(test::with_exif(file, far)) == 1);
        std::string many = tiff;
        many.replace(8, 2, "\xFF\xFF"); // tags
        many.replace(22, 2, "\x13\x01");
        CHECK(detail::exif_orientation(test::with_exif(file, many)) == 1);
        const std::string whole = test::with_exif(file, tiff);
        for (std::size_t size = 0; size < whole.size(); ++size) (void)detail::exif_orientation(whole.substr(0, size));
    }
    CHECK(detail::exif_orientation("") == 1);
    CHECK(detail::exif_orientation("\xFF\xD8\xFF") == 1);
}
