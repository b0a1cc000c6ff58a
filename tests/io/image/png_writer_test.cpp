// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/image/png_writer.hpp>

#include <gsh/core/rng.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/image/png_structure.hpp>

#include <doctest/doctest.h>
#include <zlib.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <set>
#include <string>
#include <string_view>
#include <utility>

using namespace gsh;

namespace {

/// Rows of a PNG, each with the number of its filter, as its chunks hold them.
std::string filtered_rows(const std::string& png, std::size_t size) {
    std::string packed, rows(size, '\0');
    detail::visit_png_chunks(png, "test", [&](std::string_view type, std::string_view data, std::string_view) {
        if (type == "IDAT") packed += data;
    });
    uLongf found = size; // zlib itself compares the checksum of the stream
    REQUIRE(uncompress(reinterpret_cast<Bytef*>(rows.data()), &found, reinterpret_cast<const Bytef*>(packed.data()),
                       packed.size()) == Z_OK);
    CHECK(found == size);
    return rows;
}

/// A picture of noise, in which every second row is like nothing, the left, above, the mean of both, or a plane.
PixelImage bands(int channels) {
    PixelImage image(channels, 50, 37);
    Rng rng(1);
    for (int y = 0; y < image.height; ++y)
        for (int x = 0; x < image.width; ++x)
            for (int c = 0; c < channels; ++c) {
                const int noise = static_cast<int>(rng.below(256)), small = noise % 3;
                const int left = x > 0 ? image.pixel(y, x - 1)[c] : 0, above = y > 0 ? image.pixel(y - 1, x)[c] : 0;
                const int corner = x > 0 && y > 0 ? image.pixel(y - 1, x - 1)[c] : 0;
                const int plane = std::clamp(left + above - corner, std::min(left, above), std::max(left, above));
                const int kinds[] = {small, left + small, above + small, (left + above) / 2 + small, plane + small};
                image.pixel(y, x)[c] = static_cast<std::uint8_t>(y % 2 == 0 ? noise : kinds[y / 2 % 5]);
            }
    return image;
}

} // namespace

TEST_CASE("a picture comes back from its bytes, with each filter and each number of channels") {
    std::set<char> filters;
    for (const int channels : {1, 3, 4}) {
        const PixelImage image = bands(channels);
        const std::string png = detail::png_bytes(image.data.data(), image.height, image.width, channels);
        const PixelImage again = decode_image(png, "test").image; // by stb_image, which undoes the filters by itself
        REQUIRE(again.height == image.height);
        REQUIRE(again.width == image.width);
        bool same = true;
        for (int y = 0; y < image.height; ++y)
            for (int x = 0; x < image.width; ++x) {
                const std::uint8_t *stored = image.pixel(y, x), *read = again.pixel(y, x);
                for (int c = 0; c < 3; ++c) same &= read[c] == stored[channels == 1 ? 0 : c];
                same &= read[3] == (channels == 4 ? stored[3] : 255);
            }
        CHECK(same);
        const std::size_t row = 1 + static_cast<std::size_t>(channels * image.width);
        const std::string rows = filtered_rows(png, row * static_cast<std::size_t>(image.height));
        for (std::size_t at = 0; at < rows.size(); at += row) filters.insert(rows[at]);
    }
    CHECK(filters == std::set<char>{0, 1, 2, 3, 4});
}

TEST_CASE("a picture of one pixel, and rows of one pixel") {
    for (const auto& [height, width] : {std::pair(1, 1), std::pair(1, 3000), std::pair(3000, 1)}) {
        PixelImage image(4, height, width);
        for (std::size_t i = 0; i < image.data.size(); ++i) image.data[i] = static_cast<std::uint8_t>(i * 7 + i / 256);
        CHECK(decode_image(encode_png(image), "test").image.data == image.data);
    }
}

TEST_CASE("a plain picture is small") {
    const PixelImage image(4, 1024, 1024);
    CHECK(encode_png(image).size() < 8192); // 4 MiB, at a rate near deflate's largest
}
