// SPDX-License-Identifier: Apache-2.0
/// @file  The image files of a capture: lists, checks, masks, reduction and undistortion.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/resample.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/image/image_file.hpp>

#include <algorithm>
#include <cctype>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <filesystem>
#include <string>
#include <system_error>
#include <vector>

namespace gsh::detail {

/// Image files of a folder in the order of their names.
inline std::vector<std::filesystem::path> list_images(const std::filesystem::path& folder) {
    std::error_code error;
    std::vector<std::filesystem::path> files;
    for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
        std::string extension = entry.path().extension().string();
        for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
        if (extension == ".png" || extension == ".jpg" || extension == ".jpeg") files.push_back(entry.path());
    }
    if (error)
        throw IoError(folder.string() + ": cannot be listed: " + error.message() + "; expected a folder of images");
    std::sort(files.begin(), files.end());
    return files;
}

/// The missing file in a numbered sequence; empty if there is none.
inline std::string missing_in_row(const std::vector<std::filesystem::path>& files) {
    long expected = -1;
    for (const auto& file : files) {
        const std::string stem = file.stem().string();
        if (stem.empty() || stem.size() > 9 || stem.find_first_not_of("0123456789") != std::string::npos) return {};
        const long number = std::stol(stem);
        if (expected >= 0 && number > expected) {
            const std::string digits = std::to_string(expected);
            const std::string zeros(stem.size() > digits.size() ? stem.size() - digits.size() : 0, '0');
            return zeros + digits + file.extension().string();
        }
        expected = number + 1;
    }
    return {};
}

/// Images of one camera, one per frame.
inline std::vector<std::filesystem::path> list_frames(const std::filesystem::path& folder, std::size_t frames,
                                                      const std::filesystem::path& poses) {
    const auto files = list_images(folder);
    if (const std::string missing = missing_in_row(files); !missing.empty())
        throw IoError((folder / missing).string() + ": is missing from the numbered files");
    if (files.size() != frames)
        throw ShapeError(folder.string() + ": holds " + std::to_string(files.size()) + " images, expected " +
                         std::to_string(frames) + ", one per pose of " + poses.string());
    return files;
}

inline void check_image_size(const std::filesystem::path& path, const PixelImage& image, const NamedCamera& camera) {
    if (image.width != camera.camera.width || image.height != camera.camera.height)
        throw ShapeError(path.string() + ": is " + std::to_string(image.width) + " x " + std::to_string(image.height) +
                         " pixels, expected " + std::to_string(camera.camera.width) + " x " +
                         std::to_string(camera.camera.height) + " as camera '" + shortened(camera.name) + "' says");
}

/// Sets alpha from a mask's alpha channel if it has transparency, else from its red channel.
inline void apply_mask(const PixelImage& mask, PixelImage& image) {
    bool opaque = true;
    for (std::size_t i = 3; i < mask.data.size(); i += 4) opaque = opaque && mask.data[i] == 255;
    for (std::size_t i = 0; i < image.data.size(); i += 4) image.data[i + 3] = mask.data[i + (opaque ? 0 : 3)];
}

inline void check_mask(const std::filesystem::path& path, const PixelImage& image) {
    for (std::size_t i = 3; i < image.data.size(); i += 4)
        if (image.data[i] != 0) return;
    throw ValueError(path.string() + ": its mask (alpha) is empty everywhere, expected the person in it");
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

/// FOLDER/NAME.png, .jpg or .jpeg, the first that exists; the .png if none does, for the error message.
inline std::filesystem::path image_path(const std::filesystem::path& folder, const std::string& name) {
    std::error_code ignored;
    for (const char* extension : {".png", ".jpg", ".jpeg"})
        if (auto path = folder / (name + extension); std::filesystem::exists(path, ignored)) return path;
    return folder / (name + ".png");
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
