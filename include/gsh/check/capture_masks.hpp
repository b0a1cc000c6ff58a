// SPDX-License-Identifier: Apache-2.0
/// @file  The masks of a capture's images at the sizes at which they are compared.
#pragma once

#include <gsh/check/silhouette.hpp>
#include <gsh/io/capture/capture_data.hpp>

#include <cstddef>
#include <cstdint>
#include <map>
#include <mutex>
#include <utility>
#include <vector>

namespace gsh {

/// The masks of a capture's images, reduced. Those of stored images are kept, because a search compares the same masks
/// many times, and reading a file takes longer than the comparison. They take at most the memory that the capture gives
/// to stored images: when it is full, all are forgotten.
class CaptureMasks {
public:
    /// The capture must outlive this object.
    explicit CaptureMasks(const Capture& capture) : capture_(capture) {}

    /// mask_silhouette of a view's image. Several threads may call this at a time.
    /// Errors  those of Capture::read_image.
    [[nodiscard]] Silhouette reduced(CaptureView view, int reduction) const {
        if (!capture_.stored) return mask_silhouette(capture_.image(view), reduction);
        const std::pair key(capture_.index(view), reduction);
        {
            const std::lock_guard lock(mutex_);
            if (const auto kept = kept_.find(key); kept != kept_.end()) return unpacked(kept->second);
        }
        Silhouette mask = mask_silhouette(capture_.read_image(view), reduction);
        keep(key, packed(mask));
        return mask;
    }

private:
    /// A silhouette as the lengths of its runs, in the order of its pixels: outside, inside, outside, …
    struct Packed {
        int height, width;
        std::vector<std::uint32_t> runs;

        [[nodiscard]] std::uint64_t bytes() const { return sizeof(Packed) + runs.size() * sizeof(std::uint32_t); }
    };

    [[nodiscard]] static Packed packed(const Silhouette& mask) {
        Packed result{mask.height, mask.width, {0}};
        std::uint8_t last = 0;
        for (const std::uint8_t pixel : mask.inside) {
            if (pixel != last) result.runs.push_back(0);
            last = pixel;
            ++result.runs.back();
        }
        result.runs.shrink_to_fit();
        return result;
    }
    [[nodiscard]] static Silhouette unpacked(const Packed& mask) {
        Silhouette result{mask.height, mask.width, {}};
        result.inside.reserve(static_cast<std::size_t>(mask.height) * static_cast<std::size_t>(mask.width));
        std::uint8_t pixel = 0;
        for (const std::uint32_t run : mask.runs) {
            result.inside.insert(result.inside.end(), run, pixel);
            pixel ^= 1;
        }
        return result;
    }

    void keep(const std::pair<std::size_t, int>& key, Packed mask) const {
        const std::uint64_t bytes = mask.bytes(), most = capture_.stored->memory;
        const std::lock_guard lock(mutex_);
        if (bytes_ + bytes > most) kept_.clear(), bytes_ = 0;
        if (bytes <= most && kept_.try_emplace(key, std::move(mask)).second) bytes_ += bytes;
    }

    const Capture& capture_;
    mutable std::mutex mutex_;                                   // of what follows
    mutable std::map<std::pair<std::size_t, int>, Packed> kept_; // by image and reduction
    mutable std::uint64_t bytes_ = 0;                            // that are kept
};

} // namespace gsh
