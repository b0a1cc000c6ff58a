// SPDX-License-Identifier: Apache-2.0
/// @file  The pixels of photographs in the memory of a backend, where every step of training can read them.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>
#include <gsh/pipeline/photo.hpp>

#include <cstddef>
#include <cstdint>
#include <map>
#include <vector>

namespace gsh {

/// Pixels and plates of photographs as bytes. On a backend with host memory they are the caller's own; elsewhere each
/// is uploaded once. Photographs that share a plate share its copy.
template <Backend B>
class PhotoPixels {
public:
    using Bytes = Span<const std::uint8_t>;
    struct View {
        Bytes rgba;  ///< [height, width, 4]
        Bytes plate; ///< likewise, or empty
    };

    PhotoPixels() = default;
    PhotoPixels(B& backend, const std::vector<Photo>& photos) {
        views_.reserve(photos.size());
        std::map<const std::uint8_t*, Bytes> known;
        const auto place = [&]([[maybe_unused]] Bytes bytes) {
            if constexpr (B::host_memory) {
                return bytes;
            } else {
                if (bytes.empty()) return Bytes{};
                const auto [entry, is_new] = known.try_emplace(bytes.data());
                if (is_new) {
                    copies_.emplace_back(bytes.size());
                    backend.upload(bytes, Span<std::uint8_t>(copies_.back()));
                    entry->second = copies_.back();
                }
                return entry->second;
            }
        };
        for (const Photo& photo : photos) views_.push_back({place(photo.rgba), place(photo.plate)});
    }

    [[nodiscard]] const View& operator[](std::size_t photo) const { return views_[photo]; }

private:
    std::vector<View> views_;
    std::vector<typename B::template Buffer<std::uint8_t>> copies_;
};

} // namespace gsh
