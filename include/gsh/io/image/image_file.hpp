// SPDX-License-Identifier: Apache-2.0
/// @file  Reads PNG and JPEG images and writes PNG images.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/image.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/crc32.hpp>
#include <gsh/io/file/foreign_file.hpp>

#include <stb/stb_image.h>
#include <stb/stb_image_write.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
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

/// Reads a PNG or JPEG as RGBA. An image without alpha is opaque; 16-bit samples are truncated to 8 bits.
///
/// Errors  IoError for a file that is missing, truncated, damaged, not an image, or larger than 2^26 pixels.
[[nodiscard]] inline PixelImage read_image(const std::filesystem::path& path);

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

namespace detail {

inline void check_pixel_count(const std::string& name, std::int64_t width, std::int64_t height) {
    constexpr std::int64_t most = std::int64_t(1) << 26;
    if (width <= 0 || height <= 0 || width > most || width * height > most)
        throw IoError(name + ": the image claims " + std::to_string(width) + " x " + std::to_string(height) +
                      " pixels, expected at most " + std::to_string(most) + " in all");
}

/// Four bytes of a PNG, most significant first.
inline std::uint32_t png_number(std::string_view bytes, std::size_t at) {
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < 4; ++i) value = value << 8 | static_cast<unsigned char>(bytes[at + i]);
    return value;
}

/// Checks the chunks of a PNG, which stb_image does not validate. Returns the fault, or an empty text.
inline std::string png_fault(std::string_view bytes) {
    for (std::size_t at = 8; at + 12 <= bytes.size();) {
        const std::size_t length = png_number(bytes, at);
        if (length > bytes.size() - at - 12) break;
        Crc32 crc;
        crc.add(bytes.data() + at + 4, length + 4);
        if (crc.value() != png_number(bytes, at + 8 + length)) return "damaged: a checksum does not fit";
        if (bytes.substr(at + 4, 4) == "IEND") return {};
        at += length + 12;
    }
    return "truncated";
}

/// Checks that a JPEG ends after its last scan; stb_image would fill a truncated image with grey. Returns as above.
inline std::string jpeg_fault(std::string_view bytes) {
    const std::size_t end = bytes.rfind("\xFF\xD9"), scan = bytes.rfind("\xFF\xDA");
    const bool whole = end != std::string_view::npos && scan != std::string_view::npos && scan < end;
    return whole ? "" : "truncated";
}

} // namespace detail

inline PixelImage read_image(const std::filesystem::path& path) {
    const std::string name = path.string(), bytes = read_file(path);
    const bool png = bytes.starts_with("\x89PNG\r\n\x1a\n"), jpeg = bytes.starts_with("\xFF\xD8\xFF");
    if (!png && !jpeg)
        throw IoError(name + ": " + not_the_kind(path, "a PNG or JPEG image", "", "is not a PNG or JPEG image"));
    if (const std::string fault = png ? detail::png_fault(bytes) : detail::jpeg_fault(bytes); !fault.empty())
        throw IoError(name + ": the image is " + fault);
    if (png) detail::check_pixel_count(name, detail::png_number(bytes, 16), detail::png_number(bytes, 20));

    const auto* data = reinterpret_cast<const stbi_uc*>(bytes.data());
    const int size = static_cast<int>(bytes.size()); // read_file reads at most 2^30
    const auto refuse = [&] { return IoError(name + ": the image cannot be decoded: " + stbi_failure_reason()); };
    int width = 0, height = 0, channels = 0;
    if (!stbi_info_from_memory(data, size, &width, &height, &channels)) throw refuse();
    detail::check_pixel_count(name, width, height);
    const auto release = [](stbi_uc* pixels) { stbi_image_free(pixels); };
    const std::unique_ptr<stbi_uc, decltype(release)> pixels(
        stbi_load_from_memory(data, size, &width, &height, &channels, 4), release);
    if (!pixels) throw refuse();
    PixelImage image;
    image.channels = 4, image.height = height, image.width = width;
    image.data.assign(pixels.get(), pixels.get() + std::size_t(4) * static_cast<std::size_t>(width) *
                                                       static_cast<std::size_t>(height));
    return image;
}

inline std::string encode_png(const PixelImage& image) {
    check_value(image.width > 0 && image.height > 0, "encode_png", "the image is empty");
    check_value(image.channels == 1 || image.channels == 3 || image.channels == 4, "encode_png",
                "image has " + std::to_string(image.channels) + " channels, expected 1, 3 or 4");
    check_size("encode_png", "image", image.data.size(),
               static_cast<std::size_t>(image.channels) * static_cast<std::size_t>(image.height) *
                   static_cast<std::size_t>(image.width));
    std::string bytes;
    const auto append = [](void* context, void* data, int size) {
        static_cast<std::string*>(context)->append(static_cast<const char*>(data), static_cast<std::size_t>(size));
    };
    if (!stbi_write_png_to_func(append, &bytes, image.width, image.height, image.channels, image.data.data(),
                                image.width * image.channels))
        throw IoError("encode_png: the image could not be encoded");
    return bytes;
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
