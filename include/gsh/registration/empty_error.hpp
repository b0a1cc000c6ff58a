// SPDX-License-Identifier: Apache-2.0
/// @file  The squared error that an empty scene has in photographs: the reference of RegistrationFit.
#pragma once

#include <gsh/core/span.hpp>
#include <gsh/image/pixel_box.hpp>
#include <gsh/photo/photo.hpp>

#include <cstddef>
#include <cstdint>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

namespace gsh {

/// The squared error that an empty scene would have in a photograph in memory: the mean over its channels and pixels. A
/// random background has a variance of 1/12 about 1/2.
[[nodiscard]] inline double empty_error(const Photo& photo) {
    double sum = 0;
    const PixelBox whole = whole_picture(photo.camera.height, photo.camera.width);
    for (int y = 0; y < whole.height; ++y)
        for (int x = 0; x < whole.width; ++x) {
            const std::uint8_t* pixel = photo.pixel(x, y);
            const double alpha = pixel[3] / 255.0;
            for (std::size_t c = 0; c < 3; ++c) {
                const double behind = photo.plate.empty() ? 0.5 : photo.plate[4 * whole.index(x, y) + c] / 255.0;
                const double off = pixel[c] / 255.0 - behind;
                sum += alpha * alpha * (off * off + (photo.plate.empty() ? 1 / 12.0 : 0));
            }
        }
    return sum / static_cast<double>(3 * whole.size());
}

/// Photographs that are measured once by empty_error: those of a source when it first reads them. A training that reads
/// them ahead so measures them beside its steps, and reads nothing twice.
class MeasuredPhotos : public PhotoSource {
public:
    explicit MeasuredPhotos(std::vector<Photo> photos) : photos_(std::move(photos)), errors_(photos_.size()) {}

    /// A photograph with a source.
    /// Errors  as in HeldPhoto.
    [[nodiscard]] PhotoContents read(std::size_t index) const override {
        Photo photo = photos_[index];
        PhotoContents contents =
            detail::read_photo(*photo.source, photo.source_index, photo.camera.height, photo.camera.width);
        if (measured(index)) return contents;
        photo.rgba = Span<const std::uint8_t>(contents.rgba);
        photo.box = contents.box;
        set_measured(index, photo);
        return contents;
    }

    /// gsh::empty_error of a photograph, with a source or without.
    /// Errors  as in HeldPhoto, if it was not read yet.
    [[nodiscard]] double empty_error(std::size_t index) const {
        if (!measured(index)) set_measured(index, *HeldPhoto(photos_[index]));
        return *measured(index);
    }

private:
    [[nodiscard]] std::optional<double> measured(std::size_t index) const {
        const std::lock_guard lock(mutex_);
        return errors_[index];
    }
    void set_measured(std::size_t index, const Photo& photo) const {
        const double error = gsh::empty_error(photo);
        const std::lock_guard lock(mutex_);
        errors_[index] = error;
    }

    std::vector<Photo> photos_;
    mutable std::mutex mutex_; // of what follows
    mutable std::vector<std::optional<double>> errors_;
};

} // namespace gsh
