// SPDX-License-Identifier: Apache-2.0
/// @file  Reads PNG and JPEG images and writes PNG images.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/image.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/foreign_file.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/image/exif.hpp>
#include <gsh/io/image/image_bounds.hpp>
#include <gsh/io/image/jpeg_structure.hpp>
#include <gsh/io/image/png_structure.hpp>
#include <gsh/io/image/png_writer.hpp>

#include <stb/stb_image.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// Pixels in file order: rows of interleaved 8-bit channels, [height, width, channels]; alpha is straight.
struct PixelImage {
    std::vector<std::uint8_t> data;
    int channels = 0, height = 0, width = 0;

    PixelImage() = default;
    PixelImage(int channel_count, int rows, int columns)
        : data(static_cast<std::size_t>(channel_count) * static_cast<std::size_t>(rows) *
               static_cast<std::size_t>(columns)),
          channels(channel_count), height(rows), width(columns) {}

    [[nodiscard]] std::uint8_t* pixel(int y, int x) { return data.data() + offset(y, x); }
    [[nodiscard]] const std::uint8_t* pixel(int y, int x) const { return data.data() + offset(y, x); }

private:
    [[nodiscard]] std::size_t offset(int y, int x) const {
        return (static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x)) *
               static_cast<std::size_t>(channels);
    }
};

/// An image as its file stores it.
struct StoredImage {
    PixelImage image;
    int orientation = 1;       ///< 1 to 8, of its Exif data: how it is to be turned for display; 1: not at all
    bool sixteen_bits = false; ///< whether samples were truncated to 8 bits
};

/// Reads a PNG or JPEG as RGBA, as it is stored. An image without alpha is opaque; 16-bit samples are truncated to 8
/// bits.
///
/// Errors  IoError for a file that is missing, truncated, damaged, not an image, or larger than 2^26 pixels. Images of
///         other formats are named.
[[nodiscard]] inline StoredImage read_stored_image(const InputFile& input);

/// The same for the bytes of a PNG or JPEG file; `name` begins messages.
[[nodiscard]] inline StoredImage decode_image(std::string bytes, const std::string& name);

/// The picture as viewers show it: turned or mirrored as an orientation of Exif (1 to 8) states.
[[nodiscard]] inline PixelImage upright(PixelImage image, int orientation);

/// Reads a PNG or JPEG as RGBA, upright. Errors as above.
[[nodiscard]] inline PixelImage read_image(const InputFile& input) {
    StoredImage stored = read_stored_image(input);
    return upright(std::move(stored.image), stored.orientation);
}

/// The bytes of a PNG file with 1 (grey), 3 (RGB) or 4 (RGBA) channels.
[[nodiscard]] inline std::string encode_png(const PixelImage& image);

/// Writes a PNG atomically, without waiting for the disk.
inline void write_png(const std::filesystem::path& path, const PixelImage& image) {
    write_file(path, encode_png(image), Sync::none);
}

/// Planar numbers in [0, 1] as bytes: rounded to nearest and clamped; NaN becomes 0.
template <class T>
[[nodiscard]] PixelImage quantise(const ImageView<T>& image);

template <class T>
void write_png(const std::filesystem::path& path, const ImageView<T>& image) {
    write_png(path, quantise(image));
}
template <class T>
void write_png(const std::filesystem::path& path, const Image<T>& image) {
    write_png(path, quantise(image.view()));
}

// -------------------------------------------------------------------------------------------------------------

inline StoredImage read_stored_image(const InputFile& input) {
    const std::string name = input.name();
    std::string bytes = read_file(input);
    if (!bytes.starts_with(detail::png_signature) && !bytes.starts_with(detail::jpeg_signature))
        throw IoError(name + ": " + not_the_kind(input, "a PNG or JPEG image", "", "is not a PNG or JPEG image"));
    return decode_image(std::move(bytes), name);
}

inline StoredImage decode_image(std::string bytes, const std::string& name) {
    const bool png = bytes.starts_with(detail::png_signature), jpeg = bytes.starts_with(detail::jpeg_signature);
    if (!png && !jpeg) throw IoError(name + ": is not a PNG or JPEG image");
    const int orientation = detail::exif_orientation(bytes);
    if (png)
        bytes = detail::unpacked_png(bytes, name); // without Exif data
    else
        detail::check_jpeg(bytes, name);

    const auto* data = reinterpret_cast<const stbi_uc*>(bytes.data());
    const int size = static_cast<int>(bytes.size()); // at most 2^30, and 2^29 of pixels
    const auto refuse = [&] { return IoError(name + ": the image cannot be decoded: " + stbi_failure_reason()); };
    int width = 0, height = 0, channels = 0;
    if (!stbi_info_from_memory(data, size, &width, &height, &channels)) throw refuse();
    if (jpeg) detail::check_jpeg_size(bytes, name, width, height);
    const auto release = [](stbi_uc* pixels) { stbi_image_free(pixels); };
    const std::unique_ptr<stbi_uc, decltype(release)> pixels(
        stbi_load_from_memory(data, size, &width, &height, &channels, 4), release);
    if (!pixels) throw refuse();
    StoredImage stored{{}, orientation, stbi_is_16_bit_from_memory(data, size) != 0};
    PixelImage& image = stored.image;
    image.channels = 4, image.height = height, image.width = width;
    image.data.assign(pixels.get(), pixels.get() + std::size_t(4) * static_cast<std::size_t>(width) *
                                                       static_cast<std::size_t>(height));
    return stored;
}

inline PixelImage upright(PixelImage image, int orientation) {
    if (orientation <= 1 || orientation > 8) return image;
    const bool on_its_side = orientation >= 5;
    PixelImage turned(image.channels, on_its_side ? image.width : image.height,
                      on_its_side ? image.height : image.width);
    const bool from_right = orientation == 2 || orientation == 3 || orientation == 7 || orientation == 8;
    const bool from_below = orientation == 3 || orientation == 4 || orientation == 6 || orientation == 7;
    for (int y = 0; y < turned.height; ++y)
        for (int x = 0; x < turned.width; ++x) {
            const int row = on_its_side ? x : y, column = on_its_side ? y : x; // of the stored picture
            std::copy_n(
                image.pixel(from_below ? image.height - 1 - row : row, from_right ? image.width - 1 - column : column),
                image.channels, turned.pixel(y, x));
        }
    return turned;
}

inline std::string encode_png(const PixelImage& image) {
    check_value(image.width > 0 && image.height > 0, "encode_png", "the image is empty");
    check_value(image.channels == 1 || image.channels == 3 || image.channels == 4, "encode_png",
                "image has " + std::to_string(image.channels) + " channels, expected 1, 3 or 4");
    check_size("encode_png", "image", image.data.size(),
               static_cast<std::size_t>(image.channels) * static_cast<std::size_t>(image.height) *
                   static_cast<std::size_t>(image.width));
    return detail::png_bytes(image.data.data(), image.height, image.width, image.channels);
}

template <class T>
PixelImage quantise(const ImageView<T>& image) {
    PixelImage result(image.channels, image.height, image.width);
    for (int y = 0; y < image.height; ++y)
        for (int x = 0; x < image.width; ++x)
            for (int c = 0; c < image.channels; ++c) {
                const double value = 255 * static_cast<double>(image.at(c, y, x));
                result.pixel(y, x)[c] = static_cast<std::uint8_t>(value > 0 ? std::fmin(value, 255.0) + 0.5 : 0.0);
            }
    return result;
}

} // namespace gsh
