// SPDX-License-Identifier: Apache-2.0
/// @file  Photographs in a backend's memory are those of the caller, whatever part of them fits a budget.
#include <gsh/photo/photo_pixels.hpp>

#include <gsh/backend/serial.hpp>

#include "photo/stored_photographs.hpp"
#include "support/gradient.hpp"
#include "support/guarded.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

/// Photographs of 5 x 3 pixels: of two cameras with a plate each and of one without, in turn. The second of each is
/// cropped. Photograph k has k unknown pixels.
struct PixelPhotos {
    static constexpr int height = 3, width = 5;
    std::vector<std::vector<std::uint8_t>> images, plates;
    std::vector<std::vector<UnknownPixel>> unknown;
    std::vector<Photo> photos;

    explicit PixelPhotos(std::size_t count) {
        test::Rng rng(2);
        const auto bytes = [&](std::size_t size) {
            std::vector<std::uint8_t> values(size);
            for (auto& value : values) value = static_cast<std::uint8_t>(rng.below(256));
            return values;
        };
        for (int camera = 0; camera < 2; ++camera) plates.push_back(bytes(4 * height * width));
        for (std::size_t k = 0; k < count; ++k) {
            Photo photo;
            photo.camera.height = height, photo.camera.width = width;
            if (k % 6 > 2) photo.box = PixelBox{1, 0, 2, 3};
            images.push_back(bytes(4 * photo.pixels().size()));
            unknown.emplace_back();
            for (std::uint32_t i = 0; i < k; ++i) unknown.back().push_back({5 * (i % 3) + 1, {1, 2, 3}});
            photo.rgba = Span<const std::uint8_t>(images.back());
            photo.unknown = Span<const UnknownPixel>(unknown.back());
            if (k % 3 < 2) photo.plate = Span<const std::uint8_t>(plates[k % 3]);
            photos.push_back(photo);
        }
    }
};

template <class T>
bool equal_bytes(const std::vector<T>& found, Span<const T> expected) {
    return found.size() == expected.size() &&
           std::equal(found.begin(), found.end(), expected.begin(), [](const T& a, const T& b) {
               if constexpr (std::is_same_v<T, UnknownPixel>)
                   return a.index == b.index && std::equal(a.background, a.background + 3, b.background);
               else
                   return a == b;
           });
}

template <Backend B>
void check_view(B& backend, const typename PhotoPixels<B>::View& view, const Photo& photo) {
    CHECK(equal_bytes(downloaded(backend, view.rgba), photo.rgba));
    CHECK(equal_bytes(downloaded(backend, view.plate), photo.plate));
    CHECK(equal_bytes(downloaded(backend, view.unknown), photo.unknown));
    CHECK(view.box == photo.pixels());
}

} // namespace

TEST_CASE("in host memory, photographs are the caller's own") {
    const PixelPhotos from(7);
    cpu::Serial backend;
    PhotoPixels<cpu::Serial> pixels(backend, from.photos, 0); // a budget is for copies
    for (std::size_t k = 0; k < 7; ++k) {
        pixels.prepare(k), pixels.fetch((k + 1) % 7);
        CHECK(pixels[k].rgba.data() == from.photos[k].rgba.data());
        CHECK(pixels[k].plate.data() == from.photos[k].plate.data());
        CHECK(pixels[k].unknown.data() == from.photos[k].unknown.data());
        check_view(backend, pixels[k], from.photos[k]);
    }
}

TEST_CASE("elsewhere, photographs arrive whole in any order, whatever the budget") {
    const PixelPhotos from(9); // of 60 bytes, or 24
    test::Guarded backend;
    for (const std::uint64_t budget : {std::uint64_t(0), std::uint64_t(59), std::uint64_t(100), std::uint64_t(400),
                                       std::uint64_t(500), PhotoPixels<test::Guarded>::no_limit}) {
        CAPTURE(budget);
        PhotoPixels<test::Guarded> pixels(backend, from.photos, budget);
        for (const std::size_t k : {8, 0, 3, 3, 4, 1, 7, 6, 2, 5, 0}) {
            pixels.prepare(k);
            check_view(backend, pixels[k], from.photos[k]);
            pixels.fetch((k + 1) % 9); // may be another than the next
        }
    }
    PhotoPixels<test::Guarded> none(backend, {}), moved;
    moved = PhotoPixels<test::Guarded>(backend, from.photos);
    check_view(backend, moved[8], from.photos[8]);
}

TEST_CASE("unknown pixels stay, then plates and the first photographs that fit, smaller ones behind larger ones too") {
    const PixelPhotos from(9); // 60, 60, 60, 24, 24, 24, 60, 60, 60 bytes, two plates of 60
    test::Guarded backend;
    constexpr std::uint64_t unknown = 36 * sizeof(UnknownPixel);
    constexpr std::size_t plate = 100; // and the camera
    using Numbers = std::vector<std::size_t>;
    const auto staying = [&](std::uint64_t budget) {
        const PhotoPixels<test::Guarded> pixels(backend, from.photos, budget);
        std::vector<std::size_t> found;
        for (const std::size_t camera : {0, 1})
            if (!pixels[camera].plate.empty()) found.push_back(plate + camera);
        for (std::size_t k = 0; k < 9; ++k) {
            if (!pixels[k].rgba.empty()) found.push_back(k);
            CHECK(pixels[k].unknown.size() == k);
        }
        return found;
    };
    CHECK(staying(0) == Numbers{});
    CHECK(staying(unknown + 59) == Numbers{3, 4});
    CHECK(staying(unknown + 60) == Numbers{plate});
    CHECK(staying(unknown + 60 + 59) == Numbers{plate, 3, 4});
    const std::uint64_t with_plates = unknown + 2 * 60;
    CHECK(staying(with_plates + 60) == Numbers{plate, plate + 1, 0});
    CHECK(staying(with_plates + 60 + 60 + 59) == Numbers{plate, plate + 1, 0, 1, 3, 4});
    CHECK(staying(with_plates + 3 * 60 + 3 * 24 + 3 * 60 - 1) == Numbers{plate, plate + 1, 0, 1, 2, 3, 4, 5, 6, 7});
    CHECK(staying(with_plates + 3 * 60 + 3 * 24 + 3 * 60).size() == 2 + 9);
    CHECK(staying(PhotoPixels<test::Guarded>::no_limit).size() == 2 + 9);
}

TEST_CASE("photographs of one camera share its plate, and those that stay are copied once") {
    const PixelPhotos from(6);
    test::Guarded backend;
    PhotoPixels<test::Guarded> pixels(backend, from.photos);
    CHECK(pixels[3].plate.data() == pixels[0].plate.data());
    CHECK(pixels[4].plate.data() == pixels[1].plate.data());
    CHECK(pixels[0].plate.data() != pixels[1].plate.data());
    CHECK(pixels[2].plate.empty());
    CHECK(pixels[5].plate.empty());
    for (std::size_t k = 0; k < 6; ++k) {
        const auto* const at = pixels[k].rgba.data();
        pixels.prepare(k);
        CHECK(pixels[k].rgba.data() == at);
        CHECK(backend.owns(at, pixels[k].rgba.size()));
    }
}

TEST_CASE("photographs of a source arrive on any backend, beside others, and are read ahead") {
    const PixelPhotos from(9);
    const auto check = [&](auto backend) {
        using B = decltype(backend);
        std::shared_ptr<test::StoredPhotographs> source;
        std::vector<Photo> photos = test::with_source(from.photos, &source);
        photos[4] = from.photos[4];
        PhotoPixels<B> pixels(backend, photos, 200);
        CHECK(pixels.depth() > 1);
        CHECK(pixels[3].rgba.empty());
        for (const std::size_t k : {8, 0, 3, 3, 4, 1, 7, 6, 2, 5, 0}) {
            pixels.prepare(k);
            check_view(backend, pixels[k], from.photos[k]);
            pixels.fetch((k + 1) % 9);
            pixels.read_ahead((k + 2) % 9);
        }
        CHECK(source->reads(4) == 0);
        CHECK(source->reads(8) > 0);
        PhotoPixels<B> moved;
        CHECK(moved.depth() == 1);
        moved = std::move(pixels);
        moved.prepare(8);
        check_view(backend, moved[8], from.photos[8]);
        CHECK(PhotoPixels<B>(backend, from.photos).depth() == 1);
    };
    check(cpu::Serial());
    check(test::Guarded());
}
