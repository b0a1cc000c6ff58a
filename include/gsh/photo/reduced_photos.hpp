// SPDX-License-Identifier: Apache-2.0
/// @file  Photographs at a reduced size, with cameras that fit: for fits from coarse to fine.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/pixel_box.hpp>
#include <gsh/image/reduce.hpp>
#include <gsh/image/trimap.hpp>
#include <gsh/photo/photo.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <utility>
#include <vector>

namespace gsh {

/// The whole factor that brings the longest side of all photographs nearest to `pixels`, at least 1.
[[nodiscard]] inline int reduction_factor(Span<const Photo> photos, int pixels) {
    int longest = 0;
    for (const Photo& photo : photos) longest = std::max({longest, photo.camera.height, photo.camera.width});
    return std::max(1, static_cast<int>(std::lround(longest / static_cast<double>(std::max(pixels, 1)))));
}

/// Copies of photographs, reduced by a whole factor. A mask's outline is believed, because it is finer than a pixel,
/// and colours have the resolution of their brightness. A pixel is hidden if one of those that it is made of is.
class ReducedPhotos {
public:
    /// Errors  those of reduce_rgba8.
    template <CpuBackend B>
    ReducedPhotos(B& backend, Span<const Photo> full, int factor) {
        for (Photo photo : full) {
            const int height = photo.camera.height, width = photo.camera.width;
            const auto reduce = [&](Span<const std::uint8_t> rgba) {
                auto& out = pixels_.emplace_back(4 * static_cast<std::size_t>(height / factor) *
                                                 static_cast<std::size_t>(width / factor));
                reduce_rgba8(backend, rgba, height, width, factor, Span<std::uint8_t>(out));
                return Span<const std::uint8_t>(out);
            };
            photo.rgba = photo.box ? reduce(whole_photo(photo)) : reduce(photo.rgba);
            photo.box.reset();
            if (!photo.plate.empty()) photo.plate = reduce(photo.plate);
            std::vector<std::uint8_t> hidden(photo.rgba.size() / 4, 0);
            for (const UnknownPixel& pixel : photo.unknown) {
                const int x = static_cast<int>(pixel.index) % width / factor,
                          y = static_cast<int>(pixel.index) / width / factor;
                const PixelBox reduced = whole_picture(height / factor, width / factor);
                if (pixel.hidden && reduced.contains(x, y)) hidden[reduced.index(x, y)] = 255;
            }
            photo.unknown = Span<const UnknownPixel>(hidden_.emplace_back(hidden_pixels(hidden)));
            photo.half_chroma = false;
            photo.camera = reduced_camera(photo.camera, factor);
            photos_.push_back(std::move(photo));
        }
    }
    ReducedPhotos(const ReducedPhotos&) = delete;
    ReducedPhotos& operator=(const ReducedPhotos&) = delete;

    /// They refer to this object's pixels.
    [[nodiscard]] const std::vector<Photo>& photos() const { return photos_; }

private:
    std::vector<Photo> photos_;
    std::deque<std::vector<std::uint8_t>> pixels_; // a deque: their addresses do not change
    std::deque<std::vector<UnknownPixel>> hidden_;
};

} // namespace gsh
