// SPDX-License-Identifier: Apache-2.0
/// @file  The pixels of photographs in the memory of a backend, where every step of training can read them.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/fetch_ahead.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/pixel_box.hpp>
#include <gsh/image/trimap.hpp>
#include <gsh/pipeline/photo.hpp>

#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <utility>
#include <vector>

namespace gsh {

/// Pixels and plates of photographs as bytes. On a backend with host memory they are the caller's own. Elsewhere they
/// are uploaded once: plates, which photographs share, unknown pixels, and as many photographs as a budget allows. The
/// others are brought one by one, ahead of their step (FetchAhead).
template <Backend B>
class PhotoPixels {
public:
    using Bytes = Span<const std::uint8_t>;
    struct View {
        Bytes rgba;   ///< Photo::rgba
        PixelBox box; ///< whose pixels rgba has
        Bytes plate;  ///< [height, width, 4] or empty
        Span<const UnknownPixel> unknown;
    };
    static constexpr std::uint64_t no_limit = std::numeric_limits<std::uint64_t>::max();

    PhotoPixels() = default;
    /// `budget`: bytes of the backend's memory for photographs without their plates.
    PhotoPixels(B& backend, const std::vector<Photo>& photos, std::uint64_t budget = no_limit) {
        views_.reserve(photos.size());
        if constexpr (B::host_memory) {
            for (const Photo& photo : photos)
                views_.push_back({photo.rgba, photo.pixels(), photo.plate, photo.unknown});
        } else {
            std::map<const std::uint8_t*, Bytes> plates;
            std::vector<Bytes> others;
            for (const Photo& photo : photos) {
                const auto [plate, is_new] = plates.try_emplace(photo.plate.data());
                if (is_new) plate->second = upload(backend, photo.plate, copies_);
                const bool stays = photo.rgba.size() <= budget;
                if (stays) budget -= photo.rgba.size();
                places_.push_back(stays ? resident : others.size());
                if (!stays) others.push_back(photo.rgba);
                views_.push_back({stays ? upload(backend, photo.rgba, copies_) : Bytes{}, photo.pixels(), plate->second,
                                  upload(backend, photo.unknown, unknown_)});
            }
            if (!others.empty()) others_ = std::make_unique<FetchAhead<B>>(backend, std::move(others));
        }
    }

    /// Makes operator[] valid for a photograph until the next call. Not inside a repeated step (RepeatedStep).
    void prepare(std::size_t photo) {
        if (is_fetched(photo)) views_[photo].rgba = others_->get(places_[photo]);
    }
    /// Announces the photograph of the next call of prepare, after the work on the present one has been queued.
    void fetch(std::size_t photo) {
        if (is_fetched(photo)) others_->fetch(places_[photo]);
    }

    [[nodiscard]] const View& operator[](std::size_t photo) const { return views_[photo]; }

private:
    static constexpr std::size_t resident = ~std::size_t(0);

    [[nodiscard]] bool is_fetched(std::size_t photo) const { return others_ != nullptr && places_[photo] != resident; }
    template <class U, class Buffer>
    [[nodiscard]] static Span<const U> upload(B& backend, Span<const U> from, std::vector<Buffer>& copies) {
        if (from.empty()) return {};
        copies.emplace_back(from.size());
        backend.upload(from, Span<U>(copies.back()));
        return copies.back();
    }

    std::vector<View> views_;
    std::vector<typename B::template Buffer<std::uint8_t>> copies_;
    std::vector<typename B::template Buffer<UnknownPixel>> unknown_;
    std::vector<std::size_t> places_;       // of each photograph in others_, or `resident`
    std::unique_ptr<FetchAhead<B>> others_; // null if all stay
};

} // namespace gsh
