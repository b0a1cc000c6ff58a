// SPDX-License-Identifier: Apache-2.0
#include <gsh/camera/distortion.hpp>
#include <gsh/math/wide.hpp>

#include "support/gradient.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>

using namespace gsh;

namespace {
constexpr Distortion<double> lens{-0.28, 0.09, 0.0012, -0.0008, -0.011}; // a strong wide-angle lens
}

TEST_CASE("distort agrees with the formula written out") {
    const double x = 0.3, y = -0.4, r2 = 0.25;
    const double radial = 1 + lens.k1 * r2 + lens.k2 * r2 * r2 + lens.k3 * r2 * r2 * r2;
    const vec2<double> q = distort(lens, vec2<double>(x, y));
    CHECK(q.x == doctest::Approx(x * radial + 2 * lens.p1 * x * y + lens.p2 * (r2 + 2 * x * x)).epsilon(1e-14));
    CHECK(q.y == doctest::Approx(y * radial + lens.p1 * (r2 + 2 * y * y) + 2 * lens.p2 * x * y).epsilon(1e-14));
    const vec2<double> p(0.7, -0.2);
    CHECK(distort(Distortion<double>{}, p) == p);
}

TEST_CASE("distort_backward is the gradient of distort in the point and the coefficients") {
    Distortion<double> d = lens, dL_dd;
    vec2<double> p(0.35, -0.52), dL_dp(0.0);
    const vec2<double> weight(0.7, -1.3);
    const auto loss = [&] {
        const vec2<double> q = distort(d, p);
        return weight.x * q.x + weight.y * q.y;
    };
    distort_backward(d, p, weight, dL_dp, dL_dd);
    test::check_gradient(loss, test::scalars(p), test::scalars(dL_dp));
    test::check_gradient(loss, test::scalars(d), test::scalars(dL_dd));

    const vec2<double> once = dL_dp;
    const Distortion<double> once_d = dL_dd;
    distort_backward(d, p, weight, dL_dp, dL_dd);
    CHECK(dL_dp == once * 2.0);
    CHECK(dL_dd.k3 == 2 * once_d.k3);
    CHECK(dL_dd.p1 == 2 * once_d.p1);
}

TEST_CASE("undistort inverts distort over a wide field of view") {
    double worst = 0;
    for (double y = -0.6; y <= 0.6; y += 0.05)
        for (double x = -0.8; x <= 0.8; x += 0.05) {
            const vec2<double> back = undistort_checked(lens, distort(lens, vec2<double>(x, y)));
            worst = std::max({worst, std::abs(back.x - x), std::abs(back.y - y)});
        }
    CHECK(worst < 1e-12);

    // In float, within rounding.
    const Distortion<float> d{-0.28f, 0.09f, 0.0012f, -0.0008f, -0.011f};
    const auto back = undistort(d, distort(d, vec2<float>(0.6f, -0.5f)));
    CHECK(back.residual < 1e-6f);
    CHECK(back.point.x == doctest::Approx(0.6).epsilon(1e-5));
}

TEST_CASE("a point that the lens cannot produce is refused") {
    // x (1 - 0.3 x²) has its maximum, 0.7027, at x = 1.054, so no point maps to 2.
    const Distortion<double> barrel{-0.3, 0, 0, 0, 0};
    CHECK_THROWS_AS((void)undistort_checked(barrel, vec2<double>(2, 0)), ValueError);
    CHECK_NOTHROW((void)undistort_checked(barrel, vec2<double>(0.7, 0)));

    Camera<double> camera;
    camera.fx = camera.fy = 500, camera.cx = 320, camera.cy = 240, camera.width = 640, camera.height = 480;
    CHECK_NOTHROW(check_distortion("test", "cam00", camera, barrel));
    camera.fx = camera.fy = 250; // the corners now lie beyond the radius at which the lens model folds over
    CHECK_THROWS_AS(check_distortion("test", "cam00", camera, barrel), ValueError);
    Distortion<double> bad = barrel;
    bad.p2 = std::numeric_limits<double>::quiet_NaN();
    CHECK_THROWS_AS(check_distortion("test", "cam00", camera, bad), ValueError);
}

TEST_CASE("UndistortMap leads from the straight image to the photographed one") {
    UndistortMap<double> map;
    map.straight.fx = map.straight.fy = 400, map.straight.cx = 300, map.straight.cy = 200;
    map.photographed.fx = 520, map.photographed.fy = 510, map.photographed.cx = 333, map.photographed.cy = 251;
    map.distortion = lens;
    // A world point seen by both cameras.
    const vec3<double> X(0.3, -0.2, 1.1);
    const vec2<double> ideal(X.x / X.z, X.y / X.z), bent = distort(lens, ideal);
    const vec2<double> pixel = map(to_pixel(map.straight, X));
    CHECK(pixel.x == doctest::Approx(520 * bent.x + 333));
    CHECK(pixel.y == doctest::Approx(510 * bent.y + 251));
}

TEST_CASE("a register of points equals its lanes, through camera and lens") {
    using P = Wide<double>;
    constexpr std::size_t width = LaneTraits<P>::width;
    const Camera<double> camera = look_at<double>({0.4, 1.3, 3.1}, {0.1, 1.0, 0.2}, {0, 1, 0}, 0.8, 640, 480);
    test::Rng rng(9);
    const auto points = rng.vecs(width);
    vec3<P> pack;
    for (int k = 0; k < 3; ++k) {
        double lanes[width];
        for (std::size_t i = 0; i < width; ++i) lanes[i] = points[i][k];
        pack[k] = P::load(lanes);
    }
    Camera<P> cameras;
    for (int c = 0; c < 3; ++c) {
        cameras.t[c] = P(camera.t[c]);
        for (int r = 0; r < 3; ++r) cameras.R[c][r] = P(camera.R[c][r]);
    }
    cameras.fx = P(camera.fx), cameras.fy = P(camera.fy), cameras.cx = P(camera.cx), cameras.cy = P(camera.cy);
    const Distortion<P> lenses{P(lens.k1), P(lens.k2), P(lens.p1), P(lens.p2), P(lens.k3)};
    const UndistortMap<double> map{camera, camera, lens};
    const UndistortMap<P> maps{cameras, cameras, lenses};

    /// Forward and backward. Each path contributes one number.
    const auto chain = [](const auto& cam, const auto& map_, const auto& d, const auto& point) {
        using T = std::remove_cvref_t<decltype(point.x)>;
        const vec3<T> p = to_camera(cam, point);
        const vec2<T> pixel = map_(to_pixel(cam, p));
        const vec2<T> back = undistort(d, vec2<T>(p.x / p.z, p.y / p.z)).point;
        vec3<T> dL_dp(T(0.0)), dL_dpoint(T(0.0));
        CameraGradient<T> dL_dcamera;
        Distortion<T> dL_dd;
        vec2<T> dL_dback(T(0.0));
        to_pixel_backward(cam, p, pixel, dL_dp, dL_dcamera);
        to_camera_backward(cam, point, dL_dp, dL_dpoint, dL_dcamera);
        center_backward(cam, dL_dpoint, dL_dcamera);
        distort_backward(d, back, pixel, dL_dback, dL_dd);
        return pixel.x + pixel.y + back.x + back.y + dL_dpoint.x + dL_dcamera.dL_dR[1][2] + dL_dcamera.dL_dt.y +
               dL_dcamera.dL_dfx + dL_dback.x + dL_dd.k3 + dL_dd.p1;
    };
    double lanes[width];
    chain(cameras, maps, lenses, pack).store(lanes);
    for (std::size_t i = 0; i < width; ++i)
        CHECK(lanes[i] == doctest::Approx(chain(camera, map, lens, points[i])).epsilon(1e-12));
}
