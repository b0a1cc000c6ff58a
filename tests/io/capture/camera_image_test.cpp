// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/capture/camera_image.hpp>

#include "io/exif_files.hpp"
#include "io/temporary.hpp"

#include <cstdint>
#include <filesystem>
#include <string>

using namespace gsh;
using detail::CameraImage;
using detail::read_camera_image;

namespace {

struct Photos {
    test::Temporary folder;
    std::filesystem::path file = folder / "0000.png", mask_file = folder / "mask.png";

    static PixelImage picture(int channels, int height, int width) {
        PixelImage image(channels, height, width);
        for (std::size_t i = 0; i < image.data.size(); ++i) image.data[i] = static_cast<std::uint8_t>(7 * i % 251);
        return image;
    }
    static NamedCamera camera(int width, int height) {
        NamedCamera named;
        named.name = "front";
        named.camera.width = width, named.camera.height = height;
        return named;
    }
    /// Writes a picture as a phone stores it.
    void write_lying(const PixelImage& visible, int orientation) const {
        write_file(file, test::with_exif(encode_png(test::stored_lying(visible, orientation)),
                                         test::orientation_tiff(orientation)));
    }
    [[nodiscard]] PixelImage fitted(const PixelImage& mask, const CameraImage& photo) const {
        write_png(mask_file, mask);
        return detail::fitted_mask(mask_file, read_mask(mask_file), photo);
    }
};

} // namespace

TEST_CASE_FIXTURE(Photos, "photographs are turned as their Exif data state, to the size of the camera") {
    const PixelImage visible = picture(4, 6, 4);
    for (int orientation = 1; orientation <= 8; ++orientation) {
        CAPTURE(orientation);
        write_lying(visible, orientation);
        const CameraImage read = read_camera_image(file, camera(4, 6));
        CHECK(read.image.data == visible.data);
        CHECK(read.turned == (orientation != 1));
        CHECK(read.ambiguous == (orientation > 1 && orientation < 5)); // half a turn keeps the size
        CHECK(read.orientation == orientation);
    }
    write_lying(picture(4, 5, 5), 6);
    CHECK(read_camera_image(file, camera(5, 5)).turned);
    CHECK(read_camera_image(file, camera(5, 5)).ambiguous);
}

TEST_CASE_FIXTURE(Photos, "a camera that was calibrated on pixels as stored gets them so") {
    const PixelImage visible = picture(4, 6, 4);
    for (const int orientation : {5, 6, 7, 8}) {
        CAPTURE(orientation);
        write_lying(visible, orientation);
        const CameraImage read = read_camera_image(file, camera(6, 4));
        CHECK(!read.turned);
        CHECK(!read.ambiguous);
        CHECK(read.image.data == test::stored_lying(visible, orientation).data);
    }
    write_lying(visible, 6);
    test::check_throws<ShapeError>([&] { (void)read_camera_image(file, camera(7, 6)); },
                                   {"0000.png", "4 x 6", "Exif orientation", "7 x 6", "front"});
}

TEST_CASE_FIXTURE(Photos, "a mask of either orientation comes to lie on its photograph") {
    const PixelImage visible = picture(4, 6, 4), mask = picture(1, 6, 4);
    for (int orientation = 1; orientation <= 8; ++orientation) {
        CAPTURE(orientation);
        write_lying(visible, orientation);
        const CameraImage read = read_camera_image(file, camera(4, 6));
        CHECK(fitted(mask, read).data == mask.data); // made of the visible picture
        write_file(mask_file, test::with_exif(encode_png(test::stored_lying(mask, orientation)),
                                              test::orientation_tiff(orientation)));
        CHECK(detail::fitted_mask(mask_file, read_mask(mask_file), read).data == mask.data); // with Exif data
        if (orientation < 5) continue;
        const PixelImage lying = test::stored_lying(mask, orientation); // made of the pixels as stored
        CHECK(fitted(lying, read).data == mask.data);
        const CameraImage stored = read_camera_image(file, camera(6, 4));
        CHECK(fitted(lying, stored).data == lying.data);
        CHECK(fitted(mask, stored).data == lying.data);
    }
    const CameraImage plain{visible};
    test::check_throws<ShapeError>([&] { (void)fitted(picture(1, 4, 6), plain); }, {"mask.png", "6 x 4", "4 x 6"});
    write_lying(visible, 6);
    const CameraImage read = read_camera_image(file, camera(4, 6));
    test::check_throws<ShapeError>([&] { (void)fitted(picture(1, 6, 6), read); }, {"mask.png", "6 x 6", "4 x 6"});
}

TEST_CASE("alpha of a mask, and whether it shows a person") {
    PixelImage mask(1, 1, 3), image(4, 1, 3);
    mask.data = {0, 1, 127};
    detail::set_alpha(mask, image);
    CHECK(int(image.data[7]) == 1);
    CHECK(!detail::shows_person(image));
    detail::set_alpha(mask, image, MaskMeaning::binary);
    CHECK(int(image.data[3]) == 0);
    CHECK(int(image.data[7]) == 255);
    CHECK(detail::shows_person(image));
    mask.data = {0, 0, 128};
    detail::set_alpha(mask, image);
    CHECK(detail::shows_person(image));
}
