// SPDX-License-Identifier: Apache-2.0
#include <gsh/fit/outlines.hpp>

#include "fit/filmed_person.hpp"

#include <gsh/backend/serial.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/image/image.hpp>
#include <gsh/prior/mesh_rasterizer.hpp>

#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

using namespace gsh;

TEST_CASE("a mask is read between its pixels, and is 0 outside") {
    const std::vector<std::uint8_t> pixels{0, 255, 255, 0, 0, 255}; // 3 x 2
    const MaskView mask{2, 3, pixels.data()};
    CHECK(mask.at(1.5, 0.5) == 1);
    CHECK(mask.at(1.0, 0.5) == doctest::Approx(0.5));
    CHECK(mask.at(2.5, 1.0) == 1);
    CHECK(mask.at(3.0, 1.0) == doctest::Approx(0.5)); // half-way to the outside
    CHECK(mask.at(-4, 20) == 0);
    CHECK(!MaskView{});
    const std::vector<std::uint8_t> rgba{1, 2, 3, 255};
    CHECK(MaskView{1, 1, rgba.data() + 3, 4}.at(0.5, 0.5) == 1);
}

TEST_CASE("points of the outline lie on the posed body's silhouette, and find it again from beside it") {
    const BodyModel& model = test::fitted_actor();
    const FittedBody body(model, 2);
    const OutlineSamples samples(model, body);
    test::Rng rng(3);
    FrameNumbers frame{.transl = vec3<double>(0.02, 0, 0.1), .angles = {}};
    frame.root = rotation_from_axis_angle(vec3<double>(0, 0.7, 0));
    for (const PoseAxis& axis : body.axes) frame.angles.push_back(axis.mean);
    const std::vector<double> betas{0.5, -1};
    const Camera<double> camera = test::cameras_around(1)[0];

    std::vector<vec3<double>> pose = body.pose(frame.angles);
    pose[0] = axis_angle_from_rotation(frame.root);
    std::vector<double> all = betas;
    all.resize(static_cast<std::size_t>(model.shape_count), 0.0);
    const PosedBody posed = pose_body(model, pose, frame.transl, all);
    cpu::Serial backend;
    Image<std::uint8_t> image =
        rasterize_mesh(backend, Span<const vec3<double>>(posed.vertices), model.faces, camera).mask();
    for (std::uint8_t& pixel : image.data) pixel = static_cast<std::uint8_t>(255 * pixel);
    const MaskView mask{image.height, image.width, image.data.data()};

    const auto distances = [&](const FrameNumbers& numbers) {
        std::vector<double> result;
        const FrameKinematics kinematics(body, numbers, betas);
        for (const OutlinePoint& point : samples.find(body, numbers, betas, camera, 1, mask, 0.05)) {
            const vec2<double> pixel = to_pixel(
                camera, to_camera(camera, kinematics.point(static_cast<std::size_t>(point.joint), point.offset)));
            const vec2<double> off = point.target - pixel;
            CHECK(std::abs(off.x * point.normal.y - off.y * point.normal.x) < 1e-6); // along the normal
            result.push_back(off.x * point.normal.x + off.y * point.normal.y);
        }
        return result;
    };
    std::vector<double> exact = distances(frame);
    CHECK(exact.size() > 100);
    std::size_t near = 0;
    for (const double d : exact) near += std::abs(d) < 1.5; // pixels: of 3.4 mm
    CHECK(near > exact.size() * 9 / 10);

    // A body 2 cm to the side: its outline is drawn back, the sum of the distances along x is that shift.
    FrameNumbers moved = frame;
    const vec3<double> right = transposed_times(camera.R, vec3<double>(1, 0, 0));
    moved.transl += right * 0.02;
    const FrameKinematics kinematics(body, moved, betas);
    double sum = 0, weight = 0;
    for (const OutlinePoint& point : samples.find(body, moved, betas, camera, 1, mask, 0.05)) {
        const vec2<double> pixel =
            to_pixel(camera, to_camera(camera, kinematics.point(static_cast<std::size_t>(point.joint), point.offset)));
        if (std::abs(point.normal.x) < 0.9) continue;
        sum += (point.target.x - pixel.x), weight += 1;
    }
    const double pixels = camera.fx * 0.02 / to_camera(camera, moved.transl + vec3<double>(0, 0.9, 0)).z;
    CHECK(sum / weight == doctest::Approx(-pixels).epsilon(0.25));
    // An empty mask has no outline.
    std::fill(image.data.begin(), image.data.end(), std::uint8_t(0));
    CHECK(samples.find(body, frame, betas, camera, 1, mask, 0.05).empty());
}
