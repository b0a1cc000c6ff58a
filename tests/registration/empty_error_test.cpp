// SPDX-License-Identifier: Apache-2.0
/// The error of an empty scene is the mean that its definition says, and photographs of a source are read once for it.
#include <gsh/photo/photo.hpp>
#include <gsh/registration/empty_error.hpp>

#include "photo/stored_photographs.hpp"

#include <doctest/doctest.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

using namespace gsh;

namespace {

Photo photo_of(int height, int width, const std::vector<std::uint8_t>& rgba) {
    Photo photo;
    photo.camera.height = height, photo.camera.width = width;
    photo.rgba = Span<const std::uint8_t>(rgba);
    return photo;
}

} // namespace

TEST_CASE("the error of an empty scene: opaque, transparent, before a plate, cropped") {
    const std::vector<std::uint8_t> white(8, 255), half{255, 255, 255, 51, 0, 0, 0, 0};
    CHECK(empty_error(photo_of(1, 2, white)) == doctest::Approx(0.25 + 1 / 12.0));
    CHECK(empty_error(photo_of(1, 2, half)) == doctest::Approx(0.04 * (0.25 + 1 / 12.0) / 2));

    const std::vector<std::uint8_t> plate{51, 51, 51, 255, 255, 255, 255, 255};
    Photo before_plate = photo_of(1, 2, white);
    before_plate.plate = Span<const std::uint8_t>(plate);
    CHECK(empty_error(before_plate) == doctest::Approx(0.64 / 2));

    std::vector<std::uint8_t> wide(4 * 5 * 3, 0);
    for (std::size_t c = 0; c < 4; ++c) wide[4 * 7 + c] = static_cast<std::uint8_t>(200 + c);
    Photo photo = photo_of(3, 5, wide);
    const double whole = empty_error(photo);
    const std::vector<std::uint8_t> pixels = crop_photo(photo);
    CHECK(pixels.size() == 4);
    CHECK(empty_error(photo) == whole);
}

TEST_CASE("photographs are measured as they are read, and read again only if they were not") {
    std::vector<PhotoContents> contents;
    for (int k = 0; k < 3; ++k)
        contents.push_back({std::vector<std::uint8_t>(16, static_cast<std::uint8_t>(60 * k + 90)), {1, 0, 2, 2}, {}});
    const auto source = std::make_shared<const test::StoredPhotographs>(contents);
    std::vector<Photo> photos(4);
    for (std::size_t k = 0; k < photos.size(); ++k) {
        photos[k].camera.height = 2, photos[k].camera.width = 4;
        photos[k].source = source, photos[k].source_index = 2 - k;
    }
    const std::vector<std::uint8_t> own(32, 255);
    photos[3].source = nullptr, photos[3].rgba = Span<const std::uint8_t>(own);

    const MeasuredPhotos measured(photos);
    for (int time = 0; time < 2; ++time) {
        const PhotoContents read = measured.read(1);
        CHECK(read.rgba == contents[1].rgba);
        CHECK(read.box == contents[1].box);
    }
    CHECK(source->reads(1) == 2);
    for (int time = 0; time < 2; ++time)
        for (std::size_t k = 0; k < 3; ++k) CHECK(measured.empty_error(k) == empty_error(*HeldPhoto(photos[k])));
    CHECK(measured.empty_error(3) == empty_error(photos[3]));
    CHECK(source->reads(1) == 4); // of read() above and of HeldPhoto here
    CHECK(source->reads(2) == 3); // of HeldPhoto, and once to measure it
}
