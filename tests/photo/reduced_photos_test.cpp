// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/image/trimap.hpp>
#include <gsh/photo/reduced_photos.hpp>

#include "photo/stored_photographs.hpp"

#include <doctest/doctest.h>

#include <cstdint>
#include <vector>

namespace gsh {

TEST_CASE("A reduced photograph shows each point at the reduced place, and keeps name, frame and camera's number") {
    cpu::Serial backend;
    std::vector<std::uint8_t> image(4 * 90 * 61, 200), plate(image.size(), 255);
    Photo photo{.name = "a", .camera = {}, .frame = 3, .rgba = Span<const std::uint8_t>(image), .camera_index = 2};
    photo.camera.width = 61, photo.camera.height = 90;
    photo.camera.fx = 80, photo.camera.fy = 82, photo.camera.cx = 31, photo.camera.cy = 44;
    photo.camera.t = {0, 0, 3};
    photo.plate = Span<const std::uint8_t>(plate);
    photo.half_chroma = true;
    const std::vector<Photo> photos{photo};
    CHECK(reduction_factor(Span<const Photo>(photos), 30) == 3);
    CHECK(reduction_factor(Span<const Photo>(photos), 500) == 1);

    const ReducedPhotos reduced(backend, Span<const Photo>(photos), 3);
    const Photo& small = reduced.photos().at(0);
    CHECK_NOTHROW(check_photo("test", small, 4));
    CHECK(small.camera.width == 20);
    CHECK(small.camera.height == 30);
    CHECK(small.rgba[0] == 200);
    CHECK(small.plate.size() == small.rgba.size());
    CHECK(small.name == "a");
    CHECK(small.frame == 3);
    CHECK(small.camera_index == 2);
    CHECK_FALSE(small.half_chroma);

    std::vector<UnknownPixel> unknown{{4, {}}, {7 + 61 * 5, {}, 1}, {8 + 61 * 5, {}, 1}, {60, {}, 1}};
    std::vector<Photo> doubted = photos;
    doubted[0].unknown = unknown;
    const ReducedPhotos hidden(backend, Span<const Photo>(doubted), 3);
    REQUIRE(hidden.photos().at(0).unknown.size() == 1); // unknown pixels are believed; column 60 is in no whole block
    CHECK(hidden.photos().at(0).unknown[0].index == 2 + 20 * 1);
    CHECK(hidden.photos().at(0).unknown[0].hidden == 1);

    for (std::size_t i = 0; i < image.size(); i += 4) image[i + 3] = i / 4 % 61 < 31 && i / 4 / 61 > 40 ? 180 : 0;
    const ReducedPhotos masked(backend, Span<const Photo>(photos), 3);
    std::vector<Photo> cropped = photos;
    const std::vector<std::uint8_t> pixels = crop_photo(cropped[0]);
    CHECK(pixels.size() < image.size() / 3);
    const ReducedPhotos of_cropped(backend, Span<const Photo>(cropped), 3);
    CHECK_NOTHROW(check_photo("test", of_cropped.photos().at(0), 4));
    const auto bytes = [](const ReducedPhotos& from) {
        return std::vector<std::uint8_t>(from.photos().at(0).rgba.begin(), from.photos().at(0).rgba.end());
    };
    CHECK(bytes(masked) == bytes(of_cropped));

    cropped[0].unknown = Span<const UnknownPixel>(unknown).subspan(0, 0);
    const ReducedPhotos of_source(backend, Span<const Photo>(test::with_source(cropped)), 3);
    const HeldPhoto held(of_source.photos().at(0));
    CHECK_NOTHROW(check_photo("test", *held, 4));
    CHECK(whole_photo(*held) == bytes(of_cropped));
    CHECK(held->camera.width == 20);
    CHECK(held->plate.size() == small.plate.size());
    const vec3<double> point{0.3, -0.2, 0.1}, seen = photo.camera.R * point + photo.camera.t;
    const auto x = [&](const Camera<double>& camera) { return camera.fx * seen.x / seen.z + camera.cx; };
    const auto y = [&](const Camera<double>& camera) { return camera.fy * seen.y / seen.z + camera.cy; };
    CHECK(x(small.camera) == doctest::Approx(x(photo.camera) / 3));
    CHECK(y(small.camera) == doctest::Approx(y(photo.camera) / 3));
}

} // namespace gsh
