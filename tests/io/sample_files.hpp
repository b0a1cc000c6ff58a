// SPDX-License-Identifier: Apache-2.0
/// @file  Shared by tests of foreign layouts: arrays in single precision, bodies seen as points, small photographs.
#pragma once

#include "io/temporary.hpp"

#include <gsh/io/capture/capture.hpp>
#include <gsh/io/file/npz_writer.hpp>
#include <gsh/io/image/image_file.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace gsh::test {

/// Rounds to float32, the type that Python programs save.
inline void add_floats(NpzWriter& file, const std::string& key, const std::vector<double>& data, const Shape& shape) {
    file.add(key, std::vector<float>(data.begin(), data.end()), shape);
}

/// Writes an array or a text without waiting for the disk, because samples are many files.
template <class T>
void write_array(const std::filesystem::path& path, const std::vector<T>& data, const Shape& shape) {
    const auto bytes = std::string_view(reinterpret_cast<const char*>(data.data()), data.size() * sizeof(T));
    write_file(path, detail::npy_header_bytes(detail::npy_dtype<T>(), shape) + std::string(bytes), Sync::none);
}
inline void write_text(const std::filesystem::path& path, std::string_view text) {
    write_file(path, text, Sync::none);
}

/// Joints and bones of a frame. Two motions of a body are equal if these agree.
inline std::vector<vec3<double>> posed_points(const BodyModel& body, const Motion& motion, std::size_t frame) {
    return detail::bone_points(body, motion, frame);
}

inline double largest_distance(const std::vector<vec3<double>>& a, const std::vector<vec3<double>>& b) {
    REQUIRE(a.size() == b.size());
    double largest = 0;
    for (std::size_t i = 0; i < a.size(); ++i) largest = std::max(largest, length(a[i] - b[i]));
    return largest;
}

/// An opaque image whose pixels encode camera, frame and position.
inline PixelImage numbered_image(int width, int height, int camera, int frame) {
    PixelImage image(3, height, width);
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            image.pixel(y, x)[0] = static_cast<std::uint8_t>(16 * x);
            image.pixel(y, x)[1] = static_cast<std::uint8_t>(16 * y);
            image.pixel(y, x)[2] = static_cast<std::uint8_t>(50 * camera + frame);
        }
    return image;
}

/// The image as RGBA: opaque where inside(y, x), else transparent.
template <class Inside>
PixelImage masked(const PixelImage& rgb, const Inside& inside) {
    PixelImage image(4, rgb.height, rgb.width);
    for (int y = 0; y < rgb.height; ++y)
        for (int x = 0; x < rgb.width; ++x) {
            std::copy_n(rgb.pixel(y, x), 3, image.pixel(y, x));
            image.pixel(y, x)[3] = inside(y, x) ? 255 : 0;
        }
    return image;
}

/// A camera's photograph without alpha, and the mask that an estimator makes of it.
inline PixelImage colors_of(const PixelImage& rgba) {
    PixelImage image(3, rgba.height, rgba.width);
    for (int y = 0; y < rgba.height; ++y)
        for (int x = 0; x < rgba.width; ++x) std::copy_n(rgba.pixel(y, x), 3, image.pixel(y, x));
    return image;
}
inline PixelImage mask_of(const PixelImage& rgba) {
    PixelImage mask(1, rgba.height, rgba.width);
    for (std::size_t i = 0; i < mask.data.size(); ++i) mask.data[i] = rgba.data[4 * i + 3] > 127 ? 255 : 0;
    return mask;
}

/// 7 as "0007".
inline std::string padded(int number, std::size_t digits = 4) {
    const std::string text = std::to_string(number);
    return std::string(text.size() < digits ? digits - text.size() : 0, '0') + text;
}

} // namespace gsh::test
