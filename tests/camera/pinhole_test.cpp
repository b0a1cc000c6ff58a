// SPDX-License-Identifier: Apache-2.0
#include <gsh/camera/pinhole.hpp>
#include <gsh/math/quat.hpp>

#include "support/gradient.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

using namespace gsh;

namespace {
Camera<double> some_camera() {
    return look_at<double>({0.4, 1.3, 3.1}, {0.1, 1.0, 0.2}, {0.1, 1, 0}, 0.8, 640, 480);
}
} // namespace

TEST_CASE("projection's adjoints are the gradient in point, R, t and intrinsics") {
    test::Rng rng(11);
    Camera<double> camera = some_camera();
    camera.fx = 510, camera.fy = 495, camera.cx = 300, camera.cy = 255;
    vec3<double> point = rng.vec();
    const vec2<double> weight(0.01, -0.02);
    const vec3<double> center_weight = rng.vec();
    const auto loss = [&] {
        const vec2<double> pixel = to_pixel(camera, to_camera(camera, point));
        return weight.x * pixel.x + weight.y * pixel.y + dot(camera.center(), center_weight);
    };

    vec3<double> dL_dpoint(0.0);
    CameraGradient<double> dL_dcamera;
    const auto backward = [&] {
        vec3<double> dL_dp(0.0);
        to_pixel_backward(camera, to_camera(camera, point), weight, dL_dp, dL_dcamera);
        to_camera_backward(camera, point, dL_dp, dL_dpoint, dL_dcamera);
        center_backward(camera, center_weight, dL_dcamera);
    };
    backward();
    test::check_gradient(loss, test::scalars(point), test::scalars(dL_dpoint));
    test::check_gradient(loss, test::scalars(camera.R), test::scalars(dL_dcamera.dL_dR));
    test::check_gradient(loss, test::scalars(camera.t), test::scalars(dL_dcamera.dL_dt));
    test::check_gradient(loss, {&camera.fx, 1}, {&dL_dcamera.dL_dfx, 1});
    test::check_gradient(loss, {&camera.fy, 1}, {&dL_dcamera.dL_dfy, 1});
    test::check_gradient(loss, {&camera.cx, 1}, {&dL_dcamera.dL_dcx, 1});
    test::check_gradient(loss, {&camera.cy, 1}, {&dL_dcamera.dL_dcy, 1});

    const vec3<double> once_point = dL_dpoint;
    const CameraGradient<double> once = dL_dcamera;
    backward();
    CHECK(dL_dpoint == once_point * 2.0);
    CameraGradient<double> twice = once;
    twice += once;
    CHECK(dL_dcamera.dL_dfx == twice.dL_dfx);
    CHECK(length(dL_dcamera.dL_dt - twice.dL_dt) < 1e-12);
}

TEST_CASE("look_at centres its target, upright, with OpenCV's axes") {
    const auto camera = look_at<double>({0, 1, 3}, {0, 1, 0}, {0, 1, 0}, 0.5, 640, 480);
    CHECK(length(camera.center() - vec3<double>(0, 1, 3)) < 1e-12);
    CHECK(determinant(camera.R) == doctest::Approx(1));
    const auto pixel_of = [&](vec3<double> p) { return to_pixel(camera, to_camera(camera, p)); };
    CHECK(pixel_of({0, 1, 0}).x == doctest::Approx(320));
    CHECK(pixel_of({0, 1, 0}).y == doctest::Approx(240));
    CHECK(pixel_of({0.1, 1, 0}).x > 320); // the subject faces the camera, so its left, +x, is on the image's right
    CHECK(pixel_of({0, 1.1, 0}).y < 240); // +y is up in the image
    CHECK(pixel_of({0, 1 + 3 * std::tan(0.25), 0}).y == doctest::Approx(0));
    CHECK(transposed_times(camera.R, vec3<double>(0, 0, 1)).z == doctest::Approx(-1));

    CHECK_THROWS_AS((void)look_at<double>({0, 1, 3}, {0, 1, 3}, {0, 1, 0}, 0.5, 640, 480), ValueError);
    CHECK_THROWS_AS((void)look_at<double>({0, 3, 0}, {0, 1, 0}, {0, 1, 0}, 0.5, 640, 480), ValueError);
    CHECK_THROWS_AS((void)look_at<double>({0, 1, 3}, {0, 1, 0}, {0, 1, 0}, 3.5, 640, 480), ValueError);
    CHECK_THROWS_AS((void)look_at<double>({0, 1, 3}, {0, 1, 0}, {0, 1, 0}, 0.5, 0, 480), ValueError);
}

TEST_CASE("frame_sphere shows the whole sphere, and fills the frame") {
    for (const auto& [width, height] : {std::pair{640, 480}, {300, 700}, {512, 512}}) {
        const vec3<double> center(0.2, 0.9, -0.1);
        const auto camera = frame_sphere<double>(center, 1.1, {0.3, 0.1, 1}, {0, 1, 0}, 0.7, width, height);
        test::Rng rng(5);
        double closest = 1e9; // to the border
        for (int i = 0; i < 4000; ++i) {
            const vec3<double> p = center + normalize(rng.vec()) * 1.1;
            const vec2<double> pixel = to_pixel(camera, to_camera(camera, p));
            closest = std::min({closest, pixel.x, pixel.y, width - pixel.x, height - pixel.y});
        }
        CHECK(closest >= -1e-9);
        CHECK(closest < 0.02 * std::min(width, height));
    }
    CHECK_THROWS_AS((void)frame_sphere<double>({0, 0, 0}, 0.0, {0, 0, 1}, {0, 1, 0}, 0.7, 4, 4), ValueError);
    CHECK_THROWS_AS((void)frame_sphere<double>({0, 0, 0}, 1.0, {0, 0, 1}, {0, 1, 0}, 0.7, 4, 0), ValueError);
}

TEST_CASE("camera_from_K reads rows and refuses what is no pinhole") {
    const double K[9] = {1000, 0, 640, 0, 980, 480, 0, 0, 2};
    const mat3<double> R(1.0);
    const vec3<double> t(0, 0, 3);
    const auto camera = camera_from_K<double>(K, R, t, 640, 480);
    CHECK(camera.fx == 500);
    CHECK(camera.fy == 490);
    CHECK(camera.cx == 320);
    CHECK(camera.cy == 240);

    const auto message_with = [&](int index, double value) {
        double bad[9];
        std::copy(K, K + 9, bad);
        bad[index] = value;
        try {
            (void)camera_from_K<double>(bad, R, t, 640, 480, "cam03");
        } catch (const ValueError& error) {
            return std::string(error.what());
        }
        return std::string("nothing");
    };
    const auto has = [](const std::string& text, const char* part) { return text.find(part) != std::string::npos; };
    CHECK(has(message_with(0, 0), "cam03: K is singular"));
    CHECK(has(message_with(4, 0), "cam03: K is singular"));
    CHECK(has(message_with(8, 0), "cam03: K is singular"));
    CHECK(has(message_with(0, -500), "focal lengths"));
    CHECK(has(message_with(1, 3), "skew"));
    CHECK(has(message_with(6, 320), "below its diagonal"));
    CHECK(has(message_with(2, std::numeric_limits<double>::quiet_NaN()), "K[2] is nan"));

    CHECK_THROWS_AS((void)camera_from_K<double>(Span<const double>(K, 8), R, t, 640, 480), ShapeError);
    CHECK_THROWS_AS((void)camera_from_K<double>(K, R, t, 0, 480), ValueError);
    CHECK_THROWS_AS((void)camera_from_K<double>(K, mat3<double>(2.0), t, 640, 480), ValueError);
    CHECK_THROWS_AS((void)camera_from_K<double>(K, mat3<double>(-1.0), t, 640, 480), ValueError);
    const double nan = std::numeric_limits<double>::quiet_NaN();
    CHECK_THROWS_AS((void)camera_from_K<double>(K, mat3<double>(nan), t, 640, 480), ValueError);
    CHECK_THROWS_AS((void)camera_from_K<double>(K, R, {0, nan, 0}, 640, 480), ValueError);
}
