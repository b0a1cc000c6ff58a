// SPDX-License-Identifier: Apache-2.0
#include <gsh/image/resample.hpp>
#include <gsh/io/capture/colmap_image.hpp>

#include "io/exif_files.hpp"
#include "io/temporary.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>

using namespace gsh;

TEST_CASE("a straightened picture shows nothing beyond the photograph, and lines become straight") {
    Camera<double> camera;
    camera.fx = 60, camera.fy = 62, camera.cx = 50, camera.cy = 38, camera.width = 96, camera.height = 80;
    for (const Distortion<double> d :
         {Distortion<double>{0.1, 0.02, 0, 0, 0}, Distortion<double>{-0.12, 0.01, 0.002, -0.003, 0}}) {
        CAPTURE(d.k1);
        const Camera<double> straight = straight_camera("lens", camera, d);
        CHECK(straight.fx == camera.fx);
        CHECK(straight.R == camera.R);
        const UndistortMap<double> map{straight, camera, d};
        bool inside = true;
        double nearest = 1e9; // to the photograph's border: nothing is given away
        for (int y = 0; y <= straight.height; ++y)
            for (int x = 0; x <= straight.width; ++x) {
                const auto at = map({double(x), double(y)});
                inside = inside && at.x >= 0 && at.y >= 0 && at.x <= camera.width && at.y <= camera.height;
                nearest = std::min({nearest, at.x, at.y, camera.width - at.x, camera.height - at.y});
            }
        CHECK(inside);
        CHECK(nearest < 0.1);
    }
    CHECK_THROWS_AS((void)straight_camera("lens", camera, {-2, 0, 0, 0, 0}), ValueError);
}

TEST_CASE("images come with masks, straightened where the lens was not") {
    const test::Temporary folder;
    std::filesystem::create_directories(folder / "images");
    std::filesystem::create_directories(folder / "masks");
    PixelImage image(3, 48, 64), mask(1, 48, 64);
    for (int y = 0; y < 48; ++y)
        for (int x = 0; x < 64; ++x) {
            image.pixel(y, x)[0] = static_cast<std::uint8_t>(4 * x),
                           image.pixel(y, x)[1] = static_cast<std::uint8_t>(5 * y);
            mask.pixel(y, x)[0] = x < 32 ? 0 : 255;
        }
    write_png(folder / "images" / "a.png", image);
    write_png(folder / "masks" / "a.png", mask);

    ColmapImage entry;
    entry.name = "a.png";
    entry.camera.fx = entry.camera.fy = 50, entry.camera.cx = 32, entry.camera.cy = 24;
    entry.camera.width = 64, entry.camera.height = 48;
    const StraightImage plain = read_colmap_image(entry, folder / "images");
    CHECK(plain.image.width == 64);
    CHECK(plain.image.pixel(3, 5)[0] == 20);
    CHECK(plain.image.pixel(3, 5)[3] == 255);
    CHECK(read_colmap_image(entry, folder / "images", folder / "masks").image.pixel(3, 5)[3] == 0);
    CHECK(read_colmap_image(entry, folder / "images", folder / "masks").image.pixel(3, 50)[3] == 255);

    entry.distortion = Distortion<double>{0.05, 0, 0, 0, 0};
    const StraightImage straight = read_colmap_image(entry, folder / "images");
    CHECK(straight.image.width == straight.camera.width);
    CHECK(straight.image.height == straight.camera.height);
    bool opaque = true;
    for (std::size_t i = 3; i < straight.image.data.size(); i += 4) opaque = opaque && straight.image.data[i] == 255;
    CHECK(opaque);
    // The picture is a ramp, so a pixel's value says where it came from.
    const UndistortMap<double> map{straight.camera, entry.camera, *entry.distortion};
    for (const int x : {2, 20, straight.camera.width - 3})
        CHECK(std::abs(straight.image.pixel(10, x)[0] - 4 * (map({x + 0.5, 10.5}).x - 0.5)) <= 1.01);

    entry.camera.width = 63;
    test::check_throws<ShapeError>([&] { (void)read_colmap_image(entry, folder / "images"); },
                                   {"a.png", "64 x 48", "63 x 48"});
    entry.name = "b.png";
    CHECK_THROWS_AS((void)read_colmap_image(entry, folder / "images"), IoError);
}

TEST_CASE("Exif data: pixels stay as COLMAP read them, unless only the turned picture has the camera's size") {
    const test::Temporary folder;
    PixelImage visible(3, 6, 4), mask(1, 6, 4);
    for (std::size_t i = 0; i < visible.data.size(); ++i) visible.data[i] = static_cast<std::uint8_t>(3 * i);
    for (std::size_t i = 0; i < mask.data.size(); ++i) mask.data[i] = i % 5 < 2 ? 255 : 0;
    ColmapImage entry;
    entry.name = "a.png";
    entry.camera.fx = entry.camera.fy = 5, entry.camera.cx = entry.camera.cy = 2;
    const auto read = [&](int width, int height) {
        entry.camera.width = width, entry.camera.height = height;
        return read_colmap_image(entry, folder / "", folder / "masks").image;
    };
    const auto has = [](const PixelImage& image, const PixelImage& colors, const PixelImage& alpha) {
        bool same = image.width == colors.width && image.height == colors.height;
        for (std::size_t i = 0; same && i < alpha.data.size(); ++i)
            same = image.data[4 * i] == colors.data[3 * i] && image.data[4 * i + 3] == alpha.data[i];
        return same;
    };
    std::filesystem::create_directories(folder / "masks");
    for (const int orientation : {3, 6, 8}) {
        CAPTURE(orientation);
        const PixelImage lying = test::stored_lying(visible, orientation),
                         lying_mask = test::stored_lying(mask, orientation);
        write_file(folder / "a.png", test::with_exif(encode_png(lying), test::orientation_tiff(orientation)));
        write_png(folder / "masks/a.png", lying_mask); // COLMAP wants masks of the pixels as stored
        CHECK(has(read(lying.width, lying.height), lying, lying_mask));
        if (orientation != 3) CHECK(has(read(4, 6), visible, mask)); // and so it was turned after its mask was made
    }
    // A label image is the person's.
    write_png(folder / "a.png", visible);
    PixelImage label = mask;
    for (std::uint8_t& value : label.data) value /= 255;
    write_png(folder / "masks/a.png", label);
    CHECK(has(read(4, 6), visible, mask));
    label.data[0] = 2;
    write_png(folder / "masks/a.png", label);
    test::check_throws<ValueError>([&] { (void)read(4, 6); }, {"masks/a.png", "labels 0, 1, 2"});
}
