// SPDX-License-Identifier: Apache-2.0
/// @file  The image files of a capture: lists, checks, reduction and undistortion.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/resample.hpp>
#include <gsh/io/capture/camera_image.hpp>
#include <gsh/io/capture/named_camera.hpp>
#include <gsh/io/file/folder_list.hpp>
#include <gsh/io/file/text_lines.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/image/image_formats.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <filesystem>
#include <string>
#include <system_error>
#include <vector>

namespace gsh::detail {

/// PNG and JPEG files of a folder in the order of their names.
///
/// Errors  IoError for a folder that cannot be listed, or that holds images of other formats in place of these.
inline std::vector<std::filesystem::path> list_images(const std::filesystem::path& folder) {
    std::vector<std::filesystem::path> files, foreign;
    for (const auto& path : list_folder(folder, "a folder of images")) {
        const std::string extension = path.extension().string();
        if (is_word(extension, ".png") || is_word(extension, ".jpg") || is_word(extension, ".jpeg"))
            files.push_back(path);
        else if (is_foreign_image(path))
            foreign.push_back(path);
    }
    if (files.empty() && !foreign.empty())
        throw IoError(folder.string() + ": holds " + std::to_string(foreign.size()) + " images such as " +
                      foreign[0].filename().string() + ", expected PNG or JPEG; convert them, for instance with " +
                      "ImageMagick: mogrify -format png *" + foreign[0].extension().string());
    return files;
}

/// The image at 1/factor of its size: each pixel is the mean of a square. Colours and alpha are averaged separately, as
/// other readers of these data sets reduce photograph and mask before combining them.
inline PixelImage shrink(const PixelImage& image, int factor) {
    if (factor == 1) return image;
    PixelImage small(image.channels, image.height / factor, image.width / factor);
    const int area = factor * factor;
    for (int y = 0; y < small.height; ++y)
        for (int x = 0; x < small.width; ++x)
            for (int c = 0; c < image.channels; ++c) {
                int sum = area / 2;
                for (int k = 0; k < area; ++k) sum += image.pixel(y * factor + k / factor, x * factor + k % factor)[c];
                small.pixel(y, x)[c] = static_cast<std::uint8_t>(sum / area);
            }
    return small;
}

/// The camera of reduced images.
///
/// Errors  ValueError for a factor that does not divide the size.
inline Camera<double> shrink(const Camera<double>& camera, int factor, const std::string& where) {
    check_value(factor >= 1 && camera.width % factor == 0 && camera.height % factor == 0, where,
                "images of " + std::to_string(camera.width) + " x " + std::to_string(camera.height) +
                    " pixels cannot be shrunk by " + std::to_string(factor) + "; take a factor that divides both");
    Camera<double> small = camera;
    small.fx /= factor, small.fy /= factor, small.cx /= factor, small.cy /= factor;
    small.width /= factor, small.height /= factor;
    return small;
}

/// Runs load(i) for all i. If several fail, the first in order is reported, independently of the threads.
template <HostExecutor E, class Load>
void load_all(E& executor, std::size_t count, const Load& load) {
    std::vector<std::exception_ptr> failures(count);
    executor.for_chunks(count, 1, [&](std::size_t, std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) try {
                load(i);
            } catch (...) {
                failures[i] = std::current_exception();
            }
    });
    for (const auto& failure : failures)
        if (failure) std::rethrow_exception(failure);
}

/// The PNG or JPEG file NAME of a folder, the first in order; NAME.png if there is none, for the error message.
inline std::filesystem::path image_path(const std::filesystem::path& folder, const std::string& name) {
    const auto is_called = [&](const std::filesystem::path& path) { return path.stem().string() == name; };
    const auto files = list_images(folder);
    const auto found = std::find_if(files.rbegin(), files.rend(), is_called); // a .png before a .jpg
    return found != files.rend() ? *found : folder / (name + ".png");
}

/// Throws ValueError if a background has a transparent pixel.
inline void check_opaque(const std::filesystem::path& path, const PixelImage& image) {
    for (std::size_t i = 3; i < image.data.size(); i += 4)
        check_value(image.data[i] == 255, path.string(), "is transparent somewhere, expected an opaque background");
}

inline PixelImage straighten(const PixelImage& image, const NamedCamera& camera) {
    PixelImage straight(4, image.height, image.width);
    cpu::Serial serial;
    resample_rgba8<double>(serial, Span<const std::uint8_t>(image.data), image.height, image.width,
                           UndistortMap<double>{camera.camera, camera.camera, *camera.distortion},
                           Span<std::uint8_t>(straight.data), straight.height, straight.width);
    return straight;
}

} // namespace gsh::detail
