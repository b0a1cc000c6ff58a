// SPDX-License-Identifier: Apache-2.0
/// @file  Reads environment images, equirectangular and in linear light, from Radiance HDR, PNG or JPEG files.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/image/color.hpp>
#include <gsh/image/image.hpp>
#include <gsh/io/file/foreign_file.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/text_lines.hpp>
#include <gsh/io/image/image_bounds.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/light/environment.hpp>

#include <array>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

namespace gsh {

/// Reads the radiance in every direction, [3, height, 2 height]: a Radiance HDR (.hdr, .pic) in linear light, or a PNG
/// or JPEG in sRGB, which is converted to linear light. The kind is detected from the file's first bytes. Alpha is
/// ignored.
///
/// Frame   environment_direction.
/// Units   those of the file; environment_light does not depend on them.
/// Errors  IoError for a file that is missing, truncated, damaged or of another kind; those of check_environment with
///         the file's name.
[[nodiscard]] inline Image<float> read_environment(const InputFile& input);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// A Radiance HDR in memory, read from front to back. Our own reader, because stb_image 2.27, which Debian 12 has, does
/// not return from a truncated file.
class RadianceReader {
public:
    RadianceReader(std::string name, std::string_view bytes) : name_(std::move(name)), bytes_(bytes) {}

    [[nodiscard]] Image<float> read() {
        std::string_view text = line(); // "#?RADIANCE"
        for (text = line(); !text.empty(); text = line())
            if (text.starts_with("FORMAT=") && text != "FORMAT=32-bit_rle_rgbe")
                throw IoError(name_ + ": is stored as '" + shortened(text) + "', expected FORMAT=32-bit_rle_rgbe");
        const std::string resolution(line());
        std::int64_t height = 0, width = 0;
        const char *at = resolution.data(), *end = at + resolution.size();
        const auto number = [&](std::string_view before, std::int64_t& value) {
            if (!std::string_view(at, end).starts_with(before)) return false;
            const auto result = std::from_chars(at + before.size(), end, value);
            at = result.ptr;
            return result.ec == std::errc();
        };
        if (!number("-Y ", height) || !number(" +X ", width) || at != end)
            throw IoError(name_ + ": its rows are stored as '" + shortened(resolution) +
                          "', expected '-Y height +X width': rows from the top, pixels from the left");
        check_pixel_count(name_, width, height);
        const auto columns = static_cast<std::size_t>(width);
        const std::size_t least = columns < 8 || columns > 32767 ? 4 * columns : 4 + 8 * ((columns + 126) / 127);
        if (static_cast<std::size_t>(height) > bytes_.size() / least)
            throw IoError(name_ + ": the image is truncated: its " + std::to_string(height) + " rows take at least " +
                          std::to_string(least) + " bytes each, but " + std::to_string(bytes_.size()) + " follow");
        Image<float> image(3, static_cast<int>(height), static_cast<int>(width));
        std::string row(4 * static_cast<std::size_t>(width), '\0');
        for (int y = 0; y < image.height; ++y) {
            read_row(row);
            for (int x = 0; x < image.width; ++x) {
                const auto channel = [&](int c) {
                    return static_cast<unsigned char>(row[static_cast<std::size_t>(4 * x + c)]);
                };
                const float unit = channel(3) ? std::ldexp(1.0f, channel(3) - 136) : 0.0f;
                for (int c = 0; c < 3; ++c) image.at(c, y, x) = unit * static_cast<float>(channel(c));
            }
        }
        return image;
    }

private:
    [[nodiscard]] std::string_view take(std::size_t count) {
        if (count > bytes_.size()) throw IoError(name_ + ": the image is truncated");
        const std::string_view taken = bytes_.substr(0, count);
        bytes_.remove_prefix(count);
        return taken;
    }
    [[nodiscard]] std::string_view line() {
        const std::size_t end = bytes_.find('\n');
        if (end == std::string_view::npos) throw IoError(name_ + ": the image is truncated");
        const std::string_view text = take(end + 1);
        return text.substr(0, text.ends_with("\r\n") ? end - 1 : end);
    }
    /// A row of pixels, four bytes each; either plain, or run lengths of each of the four bytes apart.
    void read_row(std::string& row) {
        const std::size_t width = row.size() / 4;
        const std::array<char, 4> runs{2, 2, static_cast<char>(width >> 8), static_cast<char>(width & 255)};
        if (width < 8 || width > 32767 || !bytes_.starts_with(std::string_view(runs.data(), 4))) {
            row.assign(take(row.size()));
            return;
        }
        (void)take(4);
        for (std::size_t c = 0; c < 4; ++c)
            for (std::size_t x = 0; x < width;) {
                const auto code = static_cast<unsigned char>(take(1)[0]);
                const std::size_t count = code > 128 ? code - 128u : code;
                if (count == 0 || count > width - x) throw IoError(name_ + ": the image is damaged: a run is too long");
                const std::string_view values = take(code > 128 ? 1 : count);
                for (std::size_t k = 0; k < count; ++k) row[4 * x++ + c] = values[code > 128 ? 0 : k];
            }
    }

    std::string name_;
    std::string_view bytes_;
};

} // namespace detail

inline Image<float> read_environment(const InputFile& input) {
    const std::string name = input.name();
    const std::string bytes = read_file(input);
    const std::string_view view = bytes;
    Image<float> image;
    if (view.starts_with("#?RADIANCE") || view.starts_with("#?RGBE")) {
        image = detail::RadianceReader(name, view).read();
    } else if (view.starts_with(detail::png_signature) || view.starts_with(detail::jpeg_signature)) {
        const PixelImage pixels = read_image(input);
        std::array<float, 256> linear;
        for (std::size_t k = 0; k < linear.size(); ++k) linear[k] = srgb_to_linear(static_cast<float>(k) / 255);
        image = Image<float>(3, pixels.height, pixels.width);
        for (int y = 0; y < image.height; ++y)
            for (int x = 0; x < image.width; ++x)
                for (int c = 0; c < 3; ++c) image.at(c, y, x) = linear[pixels.pixel(y, x)[c]];
    } else {
        throw IoError(name + ": " +
                      not_the_kind(input, "an environment image: Radiance HDR (.hdr), PNG or JPEG", "",
                                   "is not an environment image: Radiance HDR (.hdr), PNG or JPEG"));
    }
    check_environment(name, std::as_const(image).view());
    return image;
}

} // namespace gsh
