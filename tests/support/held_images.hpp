// SPDX-License-Identifier: Apache-2.0
/// @file  Stored images that tests hold in place of files.
#pragma once

#include <gsh/io/capture/capture_data.hpp>
#include <gsh/io/image/image_file.hpp>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

namespace gsh::test {

/// Images in place of files, which counts how often they are read.
class HeldImages : public StoredImages {
public:
    explicit HeldImages(std::vector<PixelImage> images) : images_(std::move(images)) {
        for (const PixelImage& image : images_) facts.push_back(image.data.empty() ? Facts() : facts_of(image));
    }
    [[nodiscard]] PixelImage read(std::size_t image) const override {
        ++reads_;
        return images_.at(image);
    }
    [[nodiscard]] std::size_t reads() const { return reads_; }

private:
    std::vector<PixelImage> images_;
    mutable std::atomic<std::size_t> reads_ = 0;
};

/// Turns the images of a capture into stored ones. `memory`: StoredImages::memory.
inline std::shared_ptr<const HeldImages> store_images(Capture& capture, std::uint64_t memory = 0) {
    const auto stored = std::make_shared<HeldImages>(std::exchange(capture.images, {}));
    stored->memory = memory;
    capture.stored = stored;
    return stored;
}

} // namespace gsh::test
