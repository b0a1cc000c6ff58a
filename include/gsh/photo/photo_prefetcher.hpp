// SPDX-License-Identifier: Apache-2.0
/// @file  Photographs that are read from their sources ahead of the work on them, on threads of their own.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/photo/photo.hpp>

#include <algorithm>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <memory>
#include <mutex>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

namespace gsh {

/// The most threads that read photographs without being told otherwise.
inline constexpr std::size_t most_photo_threads = 4;

struct PhotoPrefetchParams {
    /// That read. Training works on all processors beside them, so they matter where its steps are shorter than reading
    /// takes, as on reduced photographs.
    std::size_t threads = std::clamp<std::size_t>(std::thread::hardware_concurrency() / 2, 2, most_photo_threads);
    /// The most photographs that are announced and not yet returned.
    std::size_t depth = 2 * threads + 2;
};

/// Reads photographs one after the other, in an order that is known a little ahead. fetch announces one; threads read
/// it. get returns it, and reads what was not announced. So many photographs are in memory as may be announced, and the
/// one that get has returned, whatever the number of all.
///
/// Threads start with the first announcement. Where the system gives none, get reads everything.
///
/// Errors  get throws what the source threw for this photograph, ShapeError and ValueError for what does not fit it.
///         The next call reads it again.
class PhotoPrefetcher {
public:
    using Params = PhotoPrefetchParams;

    /// The photographs of `photos` that have a source; others are empty.
    explicit PhotoPrefetcher(const std::vector<Photo>& photos, const Params& params = {})
        : slots_(std::max<std::size_t>(params.depth, 1)), most_threads_(params.threads) {
        places_.reserve(photos.size());
        for (const Photo& photo : photos)
            places_.push_back({photo.source, photo.source_index, photo.camera.height, photo.camera.width});
    }
    PhotoPrefetcher(const PhotoPrefetcher&) = delete;
    PhotoPrefetcher& operator=(const PhotoPrefetcher&) = delete;
    ~PhotoPrefetcher() {
        {
            const std::lock_guard lock(mutex_);
            ends_ = true;
        }
        announced_.notify_all();
        for (std::thread& thread : threads_) thread.join();
    }

    /// Whether a photograph has a source.
    [[nodiscard]] bool has_source(std::size_t photo) const { return places_[photo].source != nullptr; }
    /// How many photographs may be announced ahead.
    [[nodiscard]] std::size_t depth() const { return slots_.size(); }

    /// The photograph, until the next call.
    [[nodiscard]] const PhotoContents& get(std::size_t photo) {
        check_value(photo < places_.size(), "PhotoPrefetcher",
                    "there is no photograph " + std::to_string(photo) + ", expected one of " +
                        std::to_string(places_.size()));
        if (current_ == photo) return contents_;
        current_ = none;
        std::unique_lock lock(mutex_);
        const auto slot = std::find_if(slots_.begin(), slots_.end(), [&](const Slot& s) { return s.photo == photo; });
        if (slot == slots_.end() || slot->state == State::waiting) { // no thread has begun
            if (slot != slots_.end()) slot->clear();
            lock.unlock();
            contents_ = read(photo);
        } else {
            read_.wait(lock, [&] { return slot->state == State::read; });
            const std::exception_ptr error = std::exchange(slot->error, nullptr);
            std::swap(contents_, slot->contents);
            slot->clear();
            lock.unlock();
            if (error) std::rethrow_exception(error);
        }
        current_ = photo;
        return contents_;
    }

    /// Announces a photograph. It is a hint: if there is no room, the one that was announced first is forgotten.
    void fetch(std::size_t photo) noexcept {
        if (photo >= places_.size() || photo == current_ || !places_[photo].source) return;
        {
            const std::lock_guard lock(mutex_);
            if (std::any_of(slots_.begin(), slots_.end(), [&](const Slot& slot) { return slot.photo == photo; }))
                return;
            const auto age = [](const Slot& slot) { // a slot without a photograph first, one that is being read last
                return slot.state == State::reading ? ~std::uint64_t(0) : slot.state == State::empty ? 0 : slot.turn;
            };
            const auto slot = std::min_element(slots_.begin(), slots_.end(),
                                               [&](const Slot& a, const Slot& b) { return age(a) < age(b); });
            if (slot->state == State::reading) return;
            slot->clear();
            slot->photo = photo, slot->state = State::waiting, slot->turn = ++turns_;
        }
        start_threads();
        announced_.notify_one();
    }

private:
    static constexpr std::size_t none = ~std::size_t(0);
    struct Place {
        std::shared_ptr<const PhotoSource> source;
        std::size_t index = 0;
        int height = 0, width = 0; // of the photograph
    };
    enum class State { empty, waiting, reading, read };
    struct Slot {
        std::size_t photo = none;
        State state = State::empty;
        std::uint64_t turn = 0; // when it was announced
        PhotoContents contents;
        std::exception_ptr error;

        void clear() { photo = none, state = State::empty, contents = {}, error = nullptr; }
    };

    [[nodiscard]] PhotoContents read(std::size_t photo) const {
        const auto& [source, index, height, width] = places_[photo];
        return source ? detail::read_photo(*source, index, height, width) : PhotoContents();
    }
    void start_threads() noexcept {
        if (!threads_.empty()) return;
        try {
            threads_.reserve(most_threads_);
            while (threads_.size() < most_threads_) threads_.emplace_back([this] { read_announced(); });
        } catch (const std::exception&) { // no more threads, or no memory: those that run, or get, read
            most_threads_ = threads_.size();
        }
    }
    /// What a thread does.
    void read_announced() {
        std::unique_lock lock(mutex_);
        const auto next = [&] { // the one that was announced first
            auto first = slots_.end();
            for (auto slot = slots_.begin(); slot != slots_.end(); ++slot)
                if (slot->state == State::waiting && (first == slots_.end() || slot->turn < first->turn)) first = slot;
            return first;
        };
        while (true) {
            announced_.wait(lock, [&] { return ends_ || next() != slots_.end(); });
            if (ends_) return;
            Slot& slot = *next();
            slot.state = State::reading;
            lock.unlock();
            PhotoContents contents;
            std::exception_ptr error;
            try {
                contents = read(slot.photo); // get and fetch leave a slot that is being read as it is
            } catch (...) {
                error = std::current_exception();
            }
            lock.lock();
            slot.contents = std::move(contents), slot.error = std::move(error), slot.state = State::read;
            read_.notify_all();
        }
    }

    std::vector<Place> places_;
    std::size_t current_ = none;
    PhotoContents contents_; // of the current photograph
    std::mutex mutex_;       // of what follows
    std::condition_variable announced_, read_;
    std::vector<Slot> slots_;
    std::uint64_t turns_ = 0;
    bool ends_ = false;
    std::size_t most_threads_;
    std::vector<std::thread> threads_;
};

} // namespace gsh
