// SPDX-License-Identifier: Apache-2.0
#include <gsh/camera/camera_increment.hpp>

#include "support/gradient.hpp"

using namespace gsh;

namespace {
struct Fixture {
    test::Rng rng{3};
    Camera<double> camera = look_at<double>({0.4, 1, 3}, {0, 0.8, 0}, {0, 1, 0}, 0.6, 40, 30);
    vec3<double> pivot{0.1, 0.9, -0.1};
    CameraIncrement<double> increment{rng.vec() * 0.3, rng.vec() * 0.2, 0.1, {1.5, -2}};
};
} // namespace

TEST_CASE("a camera that is not moved keeps its bits") {
    const Fixture f;
    const auto same = moved_camera(f.camera, f.pivot, {});
    CHECK(same.R == f.camera.R);
    CHECK(same.t == f.camera.t);
    CHECK(same.fx == f.camera.fx);
    CHECK(same.cy == f.camera.cy);
}

TEST_CASE("a turned camera sees the pivot where it was, a shifted one elsewhere") {
    const Fixture f;
    const auto turned_only = moved_camera(f.camera, f.pivot, {.rotation = f.increment.rotation});
    CHECK(length(to_camera(turned_only, f.pivot) - to_camera(f.camera, f.pivot)) < 1e-14);
    const auto all = moved_camera(f.camera, f.pivot, f.increment);
    CHECK(length(to_camera(all, f.pivot) - to_camera(f.camera, f.pivot) - f.increment.translation) < 1e-14);
    CHECK_NOTHROW(check_camera("test", "moved", all));
    CHECK(all.fx / f.camera.fx == doctest::Approx(std::exp(0.1)));
    CHECK(all.cx == f.camera.cx + 1.5);
}

TEST_CASE("moved_camera_backward is the gradient of moved_camera and adds") {
    Fixture f;
    const vec3<double> point = f.rng.vec() * 0.4, dL_dcenter = f.rng.vec();
    const vec2<double> dL_dpixel{0.3, -0.7};
    const auto loss = [&] {
        const auto camera = moved_camera(f.camera, f.pivot, f.increment);
        const auto pixel = to_pixel(camera, to_camera(camera, point));
        return pixel.x * dL_dpixel.x + pixel.y * dL_dpixel.y + dot(camera.center(), dL_dcenter);
    };
    const auto camera = moved_camera(f.camera, f.pivot, f.increment);
    CameraGradient<double> dL_dmoved;
    vec3<double> dL_dp(0.0), dL_dpoint(0.0);
    to_pixel_backward(camera, to_camera(camera, point), dL_dpixel, dL_dp, dL_dmoved);
    to_camera_backward(camera, point, dL_dp, dL_dpoint, dL_dmoved);
    center_backward(camera, dL_dcenter, dL_dmoved);
    CameraIncrement<double> dL_dincrement;
    moved_camera_backward(f.camera, f.pivot, f.increment, dL_dmoved, dL_dincrement);
    test::check_gradient(loss, test::scalars(f.increment), test::scalars(dL_dincrement));
    const auto once = dL_dincrement;
    moved_camera_backward(f.camera, f.pivot, f.increment, dL_dmoved, dL_dincrement);
    CHECK(dL_dincrement.rotation == once.rotation * 2.0);
    CHECK(dL_dincrement.log_focal == once.log_focal * 2);
}
