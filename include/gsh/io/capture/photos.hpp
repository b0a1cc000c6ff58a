// SPDX-License-Identifier: Apache-2.0
/// @file  The photographs of a capture as training takes them.
#pragma once

#include <gsh/core/span.hpp>
#include <gsh/image/trimap.hpp>
#include <gsh/io/capture/capture_data.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/photo/photo.hpp>

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <mutex>
#include <vector>

namespace gsh {

/// All photographs for training, or for evaluation if `test`, named CAMERA_FRAME; cameras are numbered as in the
/// capture. The pixels stay the capture's, which must outlive the result. Photographs of stored images have a source.
[[nodiscard]] inline std::vector<Photo> photos_of(const Capture& capture, bool test);

/// The pixels of a photograph whose mask is not believed (Photo::unknown): the unknown region of its trimap, and those
/// that `hidden` lists.
///
/// @param band  half the width of the region along the mask's outline, as a share of the photograph's height.
/// Shapes  rgba [height, width, 4].
/// Errors  those of unknown_pixels.
[[nodiscard]] inline std::vector<UnknownPixel> unbelieved_pixels(Span<const std::uint8_t> rgba, int height, int width,
                                                                 double band, Span<const UnknownPixel> hidden) {
    return with_hidden(unknown_pixels(rgba, height, width, band * height), hidden);
}

/// The stored images of a capture as photographs, cropped. Those that were read first are kept, as many as fit into a
/// limit of memory; the others are read from their files each time.
class StoredPhotos : public PhotoSource {
public:
    /// The capture must outlive this object. `band`: that of unbelieved_pixels; 0: masks are believed. `memory`: bytes
    /// for what is kept.
    StoredPhotos(const Capture& capture, double band, std::uint64_t memory)
        : capture_(&capture), band_(band), kept_(capture.stored->facts.size()), memory_(memory) {}

    /// The limit of memory.
    [[nodiscard]] std::uint64_t memory() const {
        const std::lock_guard lock(mutex_);
        return memory_;
    }
    /// Changes the limit of memory. What is kept already stays.
    void keep_within(std::uint64_t memory) {
        const std::lock_guard lock(mutex_);
        memory_ = memory;
    }

    /// @param index  of Capture::index.
    [[nodiscard]] PhotoContents read(std::size_t index) const override {
        {
            const std::lock_guard lock(mutex_);
            if (kept_[index]) return *kept_[index];
        }
        PhotoContents contents = read_file(index);
        const std::uint64_t bytes =
            contents.rgba.size() + contents.unknown.size() * sizeof(UnknownPixel) + sizeof(PhotoContents);
        const std::lock_guard lock(mutex_);
        if (!kept_[index] && bytes_ + bytes <= memory_) {
            kept_[index] = std::make_unique<const PhotoContents>(contents);
            bytes_ += bytes;
        }
        return contents;
    }

private:
    [[nodiscard]] PhotoContents read_file(std::size_t index) const {
        const PixelImage image = capture_->stored->read(index);
        const CaptureView view{index / capture_->frame_count(), index % capture_->frame_count()};
        PhotoContents contents;
        contents.unknown = unbelieved_pixels(image.data, image.height, image.width, band_, capture_->hidden_in(view));
        Photo photo;
        photo.camera.height = image.height, photo.camera.width = image.width;
        photo.rgba = Span<const std::uint8_t>(image.data);
        photo.unknown = Span<const UnknownPixel>(contents.unknown);
        contents.rgba = crop_photo(photo);
        contents.box = photo.pixels();
        return contents;
    }

    const Capture* capture_;
    double band_;
    mutable std::mutex mutex_; // of what follows
    mutable std::vector<std::unique_ptr<const PhotoContents>> kept_;
    mutable std::uint64_t bytes_ = 0; // that are kept
    std::uint64_t memory_;
};

// -------------------------------------------------------------------------------------------------------------

inline std::vector<Photo> photos_of(const Capture& capture, bool test) {
    std::vector<Photo> photos;
    const std::shared_ptr<const PhotoSource> source =
        capture.stored ? std::make_shared<StoredPhotos>(capture, 0, test ? 0 : capture.stored->memory) : nullptr;
    for (const CaptureView& view : capture.views(test)) {
        const NamedCamera& camera = capture.cameras[view.camera];
        char frame[16];
        std::snprintf(frame, sizeof frame, "%04zu", view.frame);
        const PixelImage* plate = capture.background(view.camera);
        photos.push_back({.name = camera.name + "_" + frame,
                          .camera = camera.camera,
                          .frame = view.frame,
                          .rgba = source ? Span<const std::uint8_t>() : capture.image(view).data,
                          .camera_index = view.camera,
                          .plate = plate ? Span<const std::uint8_t>(plate->data) : Span<const std::uint8_t>(),
                          .unknown = source ? Span<const UnknownPixel>() : capture.hidden_in(view),
                          .source = source,
                          .source_index = capture.index(view)});
    }
    return photos;
}

} // namespace gsh
