// SPDX-License-Identifier: Apache-2.0
/// @file  The pixels of photographs in the memory of a backend, where every step of training can read them.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/fetch_ahead.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/pixel_box.hpp>
#include <gsh/image/trimap.hpp>
#include <gsh/photo/photo.hpp>
#include <gsh/photo/photo_prefetcher.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <utility>
#include <vector>

namespace gsh {

namespace detail {

/// Arrays of bytes in a backend's memory: those that fit a budget stay there, the others are brought one by one.
template <Backend B>
class BudgetedBytes {
public:
    using Bytes = Span<const std::uint8_t>;

    /// Returns the array's number. An array that stays is subtracted from the budget.
    std::size_t add(B& backend, Bytes from, std::uint64_t& budget) {
        const bool stays = from.size() <= budget;
        arrays_.emplace_back();
        places_.push_back(stays ? resident : others_.size());
        if (!stays) {
            others_.push_back(from);
        } else if (!from.empty()) {
            budget -= from.size();
            copies_.emplace_back(from.size());
            backend.upload(from, Span<std::uint8_t>(copies_.back()));
            arrays_.back() = copies_.back();
        }
        return arrays_.size() - 1;
    }
    /// After the last array.
    void finish(B& backend) {
        if (!others_.empty()) brought_ = std::make_unique<FetchAhead<B>>(backend, std::exchange(others_, {}));
    }
    /// The array; one that does not stay is valid until the next call.
    [[nodiscard]] Bytes get(std::size_t array) {
        return places_[array] == resident ? arrays_[array] : brought_->get(places_[array]);
    }
    /// The array if it stays, or nothing.
    [[nodiscard]] Bytes resident_bytes(std::size_t array) const { return arrays_[array]; }
    /// FetchAhead::fetch.
    void fetch(std::size_t array) {
        if (places_[array] != resident) brought_->fetch(places_[array]);
    }

private:
    static constexpr std::size_t resident = ~std::size_t(0);

    std::vector<typename B::template Buffer<std::uint8_t>> copies_;
    std::vector<Bytes> arrays_;              // empty if they do not stay
    std::vector<std::size_t> places_;        // of each array among those that are brought, or `resident`
    std::vector<Bytes> others_;              // until finish
    std::unique_ptr<FetchAhead<B>> brought_; // null if all stay
};

} // namespace detail

/// Pixels and plates of photographs as bytes. On a backend with host memory they are the caller's own. Elsewhere,
/// unknown pixels are uploaded once, and as many plates, which photographs share, and photographs as a budget allows.
/// The others are brought one by one, ahead of their step (FetchAhead). On any backend, photographs with a source are
/// read from there, ahead of their step, too (PhotoPrefetcher); before prepare, their views are empty.
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
    /// `budget`: bytes of the backend's memory. Unknown pixels, which are few, are taken first, then plates.
    PhotoPixels(B& backend, const std::vector<Photo>& photos, std::uint64_t budget = no_limit) {
        views_.reserve(photos.size());
        if constexpr (B::host_memory) {
            for (const Photo& photo : photos)
                views_.push_back({photo.rgba, photo.pixels(), photo.plate, photo.unknown});
        } else {
            std::map<const std::uint8_t*, std::size_t> known;
            for (const Photo& photo : photos)
                views_.push_back({{}, photo.pixels(), {}, upload_unknown(backend, photo.unknown, budget)});
            for (const Photo& photo : photos) {
                const auto [plate, is_new] = known.try_emplace(photo.plate.data());
                if (is_new) plate->second = plates_.add(backend, photo.plate, budget);
                plate_of_.push_back(plate->second);
            }
            for (std::size_t k = 0; k < photos.size(); ++k) {
                (void)rgba_.add(backend, photos[k].rgba, budget);
                views_[k].rgba = rgba_.resident_bytes(k), views_[k].plate = plates_.resident_bytes(plate_of_[k]);
            }
            rgba_.finish(backend), plates_.finish(backend);
        }
        if (std::none_of(photos.begin(), photos.end(), [](const Photo& photo) { return photo.source != nullptr; }))
            return;
        prefetcher_ = std::make_unique<PhotoPrefetcher>(photos);
        backend_ = &backend;
    }

    /// Makes operator[] valid for a photograph until the next call. Not inside a repeated step (RepeatedStep).
    /// Errors  those of PhotoSource::read.
    void prepare(std::size_t photo) {
        if constexpr (!B::host_memory)
            views_[photo].rgba = rgba_.get(photo), views_[photo].plate = plates_.get(plate_of_[photo]);
        if (prefetcher_ && prefetcher_->has_source(photo)) show(prefetcher_->get(photo), views_[photo]);
    }
    /// Announces the photograph of the next call of prepare, after the work on the present one has been queued.
    void fetch(std::size_t photo) {
        if constexpr (!B::host_memory) rgba_.fetch(photo), plates_.fetch(plate_of_[photo]);
        read_ahead(photo);
    }
    /// Announces a photograph of a later call, in their order, so that its source is read in time.
    void read_ahead(std::size_t photo) {
        if (prefetcher_) prefetcher_->fetch(photo);
    }
    /// How many photographs may be announced: 1 without sources.
    [[nodiscard]] std::size_t depth() const { return prefetcher_ ? prefetcher_->depth() : 1; }

    [[nodiscard]] const View& operator[](std::size_t photo) const { return views_[photo]; }

private:
    void show(const PhotoContents& contents, View& view) {
        view.box = contents.box;
        if constexpr (B::host_memory) {
            view.rgba = Span<const std::uint8_t>(contents.rgba);
            view.unknown = Span<const UnknownPixel>(contents.unknown);
        } else {
            view.rgba = uploaded(contents.rgba, shown_rgba_);
            view.unknown = uploaded(contents.unknown, shown_unknown_);
        }
    }
    template <class T>
    [[nodiscard]] Span<const T> uploaded(const std::vector<T>& from, typename B::template Buffer<T>& to) {
        to.resize(from.size());
        if (!from.empty()) backend_->upload(Span<const T>(from), Span<T>(to));
        return to;
    }
    [[nodiscard]] Span<const UnknownPixel> upload_unknown(B& backend, Span<const UnknownPixel> from,
                                                          std::uint64_t& budget) {
        if (from.empty()) return {};
        budget -= std::min<std::uint64_t>(budget, from.size() * sizeof(UnknownPixel));
        unknown_.emplace_back(from.size());
        backend.upload(from, Span<UnknownPixel>(unknown_.back()));
        return unknown_.back();
    }

    std::vector<View> views_;
    std::vector<typename B::template Buffer<UnknownPixel>> unknown_;
    detail::BudgetedBytes<B> rgba_, plates_;
    std::vector<std::size_t> plate_of_; // of each photograph
    std::unique_ptr<PhotoPrefetcher> prefetcher_; // null if no photograph has a source
    B* backend_ = nullptr;                        // to which the current one goes
    typename B::template Buffer<std::uint8_t> shown_rgba_;
    typename B::template Buffer<UnknownPixel> shown_unknown_;
};

} // namespace gsh
