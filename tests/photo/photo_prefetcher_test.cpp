// SPDX-License-Identifier: Apache-2.0
/// Photographs of a source arrive whole in any order, each is read once if it is announced, few at a time; what fails
/// is told where the photograph is needed.
#include <gsh/photo/photo_prefetcher.hpp>

#include "photo/stored_photographs.hpp"
#include "support/contains.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

using namespace gsh;

namespace {

/// Photographs of 4 x 2 pixels; photograph k is full of the byte k.
std::vector<PhotoContents> small_contents(std::size_t count) {
    std::vector<PhotoContents> all;
    for (std::size_t k = 0; k < count; ++k)
        all.push_back({std::vector<std::uint8_t>(32, static_cast<std::uint8_t>(k)), {0, 0, 4, 2}, {}});
    return all;
}
std::vector<Photo> photos_from(const std::shared_ptr<const PhotoSource>& source, std::size_t count) {
    std::vector<Photo> photos(count);
    for (std::size_t k = 0; k < count; ++k) {
        photos[k].camera.height = 2, photos[k].camera.width = 4;
        photos[k].source = source, photos[k].source_index = k;
    }
    return photos;
}

/// Waits in each read until `released`, and counts those that wait.
class SlowSource : public PhotoSource {
public:
    [[nodiscard]] PhotoContents read(std::size_t index) const override {
        std::unique_lock lock(mutex_);
        ++begun_;
        changed_.notify_all();
        changed_.wait(lock, [&] { return released_; });
        return {std::vector<std::uint8_t>(32, static_cast<std::uint8_t>(index)), {0, 0, 4, 2}, {}};
    }
    void wait_for(int begun) const {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [&] { return begun_ >= begun; });
    }
    void release() {
        const std::lock_guard lock(mutex_);
        released_ = true;
        changed_.notify_all();
    }
    [[nodiscard]] int begun() const {
        const std::lock_guard lock(mutex_);
        return begun_;
    }

private:
    mutable std::mutex mutex_;
    mutable std::condition_variable changed_;
    mutable int begun_ = 0;
    bool released_ = false;
};

} // namespace

TEST_CASE("photographs that are announced are read once, and arrive in any order") {
    constexpr std::size_t count = 40;
    for (const PhotoPrefetchParams params :
         {PhotoPrefetchParams{1, 4}, PhotoPrefetchParams{3, 8}, PhotoPrefetchParams{0, 4}, PhotoPrefetchParams{2, 1}}) {
        CAPTURE(params.threads);
        CAPTURE(params.depth);
        const auto source = std::make_shared<test::StoredPhotographs>(small_contents(count));
        PhotoPrefetcher photos(photos_from(source, count), params);
        CHECK(photos.depth() == params.depth);
        const auto at = [&](std::size_t step) { return step * 7 % count; };
        for (std::size_t step = 0; step < count; ++step) {
            const PhotoContents& contents = photos.get(at(step));
            CHECK(contents.rgba == std::vector<std::uint8_t>(32, static_cast<std::uint8_t>(at(step))));
            CHECK(contents.box == PixelBox{0, 0, 4, 2});
            CHECK(photos.get(at(step)).rgba.data() == contents.rgba.data()); // it stays
            for (std::size_t ahead = 1; ahead <= photos.depth() && step + ahead < count; ++ahead)
                photos.fetch(at(step + ahead));
        }
        for (std::size_t k = 0; k < count; ++k) CHECK(source->reads(k) == 1);
    }
}

TEST_CASE("no more photographs than the depth are read ahead, and an older announcement makes room for a new one") {
    const auto source = std::make_shared<test::StoredPhotographs>(small_contents(20));
    {
        PhotoPrefetcher photos(photos_from(source, 20), {0, 3}); // nothing is read before get
        for (std::size_t k = 0; k < 20; ++k) photos.fetch(k);
        photos.fetch(99); // a hint about nothing
        for (const std::size_t k : {19, 2, 18, 17, 0}) CHECK(photos.get(k).rgba[0] == k);
    }
    for (std::size_t k = 0; k < 20; ++k) CHECK(source->reads(k) == (k > 16 || k == 2 || k == 0 ? 1 : 0));

    const auto slow = std::make_shared<SlowSource>();
    PhotoPrefetcher photos(photos_from(slow, 20), {2, 4});
    for (std::size_t k = 0; k < 20; ++k) photos.fetch(k);
    slow->wait_for(2);
    CHECK(slow->begun() == 2); // one for each thread
    slow->release();
    for (const std::size_t k : {3, 19, 18, 0}) CHECK(photos.get(k).rgba[0] == k);
}

TEST_CASE("an object ends while its threads read") {
    const auto slow = std::make_shared<SlowSource>();
    {
        PhotoPrefetcher photos(photos_from(slow, 4), {2, 4});
        for (std::size_t k = 0; k < 4; ++k) photos.fetch(k);
        slow->wait_for(1);
        slow->release();
    }
    CHECK(slow.use_count() == 1);
}

TEST_CASE("an error of a source is thrown where its photograph is needed, and only there") {
    const auto source = std::make_shared<test::StoredPhotographs>(small_contents(6));
    for (const std::size_t threads : {0, 1}) {
        CAPTURE(threads);
        source->fail(2);
        PhotoPrefetcher photos(photos_from(source, 6), {threads, 4});
        for (const std::size_t k : {1, 2, 3}) photos.fetch(k);
        CHECK(photos.get(1).rgba[0] == 1);
        test::check_throws<IoError>([&] { (void)photos.get(2); }, {"photograph 2", "the disk is gone"});
        CHECK(photos.get(3).rgba[0] == 3);
        test::check_throws<IoError>([&] { (void)photos.get(2); }, {"photograph 2"});
        source->fail(5);
        CHECK(photos.get(2).rgba[0] == 2); // it is read again
        CHECK_THROWS_AS((void)photos.get(6), ValueError);
    }
}

TEST_CASE("what does not fit its photograph is refused") {
    std::vector<PhotoContents> wrong = small_contents(4);
    wrong[0].rgba.pop_back();
    wrong[1].box = {1, 0, 4, 2};
    wrong[2].box = {2, 0, 2, 2}, wrong[2].rgba.resize(16), wrong[2].unknown = {{1, {}}};
    wrong[3].unknown = {{8, {}}};
    const auto source = std::make_shared<test::StoredPhotographs>(wrong);
    const std::vector<Photo> photos = photos_from(source, 4);
    PhotoPrefetcher ahead(photos);
    const auto check = [&](const auto& read) {
        test::check_throws<ShapeError>([&] { read(0); }, {"PhotoSource: photograph 0", "31"});
        test::check_throws<ValueError>([&] { read(1); }, {"PhotoSource: photograph 1's box", "columns 1 to 5"});
        for (const std::size_t k : {2, 3})
            test::check_throws<ValueError>([&] { read(k); }, {"PhotoSource: photograph", "unknown pixel outside"});
    };
    check([&](std::size_t k) { (void)ahead.get(k); });
    check([&](std::size_t k) { (void)HeldPhoto(photos[k]); });
}

TEST_CASE("a photograph is held as long as needed; without a source it is the caller's own") {
    const std::vector<std::uint8_t> own(32, 7);
    const std::vector<UnknownPixel> unknown{{3, {}}};
    Photo photo;
    photo.camera.height = 2, photo.camera.width = 4;
    photo.rgba = Span<const std::uint8_t>(own);
    photo.unknown = Span<const UnknownPixel>(unknown);
    CHECK(HeldPhoto(photo)->rgba.data() == own.data());

    std::shared_ptr<test::StoredPhotographs> source;
    std::vector<HeldPhoto> held;
    for (const Photo& one : test::with_source({photo, photo, photo}, &source)) held.emplace_back(one);
    for (const HeldPhoto& one : held) { // they have moved
        CHECK(std::equal(one->rgba.begin(), one->rgba.end(), own.begin(), own.end()));
        CHECK(one->unknown.size() == 1);
        CHECK(one->box == PixelBox{0, 0, 4, 2});
        CHECK(!one->source);
        CHECK_NOTHROW(check_photo("test", *one, 1));
    }
    CHECK(source->reads(0) == 1);
}
