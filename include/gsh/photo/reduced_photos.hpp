// SPDX-License-Identifier: Apache-2.0
/// @file  Photographs at a reduced size, with cameras that fit: for fits from coarse to fine.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/serial.hpp>
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
#include <map>
#include <memory>
#include <utility>
#include <vector>

namespace gsh {

/// The whole factor that brings the longest side of all photographs nearest to `pixels`, at least 1.
[[nodiscard]] inline int reduction_factor(Span<const Photo> photos, int pixels) {
    int longest = 0;
    for (const Photo& photo : photos) longest = std::max({longest, photo.camera.height, photo.camera.width});
    return std::max(1, static_cast<int>(std::lround(longest / static_cast<double>(std::max(pixels, 1)))));
}

namespace detail {

/// The pixels of a photograph in memory, reduced by a whole factor.
template <CpuBackend B>
PhotoContents reduced_contents(B& backend, const Photo& photo, int factor) {
    const int height = photo.camera.height, width = photo.camera.width;
    PhotoContents reduced{.rgba = {}, .box = whole_picture(height / factor, width / factor), .unknown = {}};
    reduced.rgba.resize(4 * reduced.box.size());
    const std::vector<std::uint8_t> whole = photo.box ? whole_photo(photo) : std::vector<std::uint8_t>();
    reduce_rgba8(backend, photo.box ? Span<const std::uint8_t>(whole) : photo.rgba, height, width, factor,
                 Span<std::uint8_t>(reduced.rgba));
    std::vector<std::uint8_t> hidden(reduced.box.size(), 0);
    for (const UnknownPixel& pixel : photo.unknown) {
        const int x = static_cast<int>(pixel.index) % width / factor,
                  y = static_cast<int>(pixel.index) / width / factor;
        if (pixel.hidden && reduced.box.contains(x, y)) hidden[reduced.box.index(x, y)] = 255;
    }
    reduced.unknown = hidden_pixels(hidden);
    return reduced;
}

/// Photographs of sources, reduced on a backend of their own where they are read, since the caller's is at work.
template <CpuBackend B>
class ReducedSource : public PhotoSource {
public:
    ReducedSource(std::vector<Photo> full, int factor) : full_(std::move(full)), factor_(factor) {}

    [[nodiscard]] PhotoContents read(std::size_t index) const override {
        B backend;
        return reduced_contents(backend, *HeldPhoto(full_[index]), factor_);
    }

private:
    std::vector<Photo> full_;
    int factor_;
};

} // namespace detail

/// Copies of photographs, reduced by a whole factor. A mask's outline is believed, because it is finer than a pixel,
/// and colours have the resolution of their brightness. A pixel is hidden if one of those that it is made of is.
/// Photographs with a source are reduced each time that they are read.
class ReducedPhotos {
public:
    /// Errors  those of reduce_rgba8.
    template <CpuBackend B>
    ReducedPhotos(B& backend, Span<const Photo> full, int factor) {
        std::vector<Photo> with_source;
        for (const Photo& photo : full) {
            Photo& reduced = photos_.emplace_back(photo);
            if (photo.source) {
                reduced.source_index = with_source.size();
                with_source.push_back(photo);
            } else {
                const PhotoContents& held = held_.emplace_back(detail::reduced_contents(backend, photo, factor));
                reduced.rgba = Span<const std::uint8_t>(held.rgba);
                reduced.unknown = Span<const UnknownPixel>(held.unknown);
                reduced.box.reset();
            }
            if (!photo.plate.empty()) reduced.plate = reduced_plate(backend, photo, factor);
            reduced.half_chroma = false;
            reduced.camera = reduced_camera(photo.camera, factor);
        }
        if (with_source.empty()) return;
        const auto source = std::make_shared<const detail::ReducedSource<cpu::Serial>>(std::move(with_source), factor);
        for (Photo& photo : photos_)
            if (photo.source) photo.source = source;
    }
    ReducedPhotos(const ReducedPhotos&) = delete;
    ReducedPhotos& operator=(const ReducedPhotos&) = delete;

    /// They refer to this object's pixels.
    [[nodiscard]] const std::vector<Photo>& photos() const { return photos_; }

private:
    /// Photographs of a camera share its plate.
    template <CpuBackend B>
    [[nodiscard]] Span<const std::uint8_t> reduced_plate(B& backend, const Photo& photo, int factor) {
        std::vector<std::uint8_t>& plate = plates_[photo.plate.data()];
        if (plate.empty()) {
            plate.resize(4 * whole_picture(photo.camera.height / factor, photo.camera.width / factor).size());
            reduce_rgba8(backend, photo.plate, photo.camera.height, photo.camera.width, factor,
                         Span<std::uint8_t>(plate));
        }
        return Span<const std::uint8_t>(plate);
    }

    std::vector<Photo> photos_;
    std::deque<PhotoContents> held_; // a deque: their addresses do not change
    std::map<const std::uint8_t*, std::vector<std::uint8_t>> plates_;
};

} // namespace gsh
