// SPDX-License-Identifier: Apache-2.0
#include "io/temporary.hpp"
#include "prior/shapes.hpp"

#include <gsh/prior/orthographic_camera.hpp>

#include <limits>

namespace gsh {
namespace {

TEST_CASE("side cameras frame the body as one sees it") {
    const std::vector<vec3<double>> corners{{-1, -2, -0.5}, {3, 4, 0.7}};
    const double edge = 6 / 0.9; // y is the longest axis, with a margin of 5% at each end
    const vec3<double> center(1, 1, 0.1);
    struct Case {
        BodySide side;
        vec3<double> right, forward;
    };
    for (const auto& [side, right, forward] : {Case{BodySide::front, {1, 0, 0}, {0, 0, -1}},
                                               Case{BodySide::back, {-1, 0, 0}, {0, 0, 1}},
                                               Case{BodySide::left, {0, 0, -1}, {-1, 0, 0}},
                                               Case{BodySide::right, {0, 0, 1}, {1, 0, 0}}}) {
        const OrthographicCamera camera = side_camera(corners, side, {.resolution = 90});
        CHECK_NOTHROW(check_camera("test", "camera", camera));
        const vec3<double> middle = to_camera(camera, center);
        CHECK(middle.z == doctest::Approx(edge / 2));
        CHECK(to_pixel(camera, middle).x == doctest::Approx(45));
        CHECK(to_pixel(camera, middle).y == doctest::Approx(45));
        const vec2<double> beside = to_pixel(camera, to_camera(camera, center + right * 0.1));
        CHECK(beside.x == doctest::Approx(45 + 0.1 * 90 / edge));
        CHECK(to_pixel(camera, to_camera(camera, center + vec3<double>(0, 3, 0))).y == doctest::Approx(0.05 * 90));
        CHECK(to_camera(camera, center + forward * 0.3).z == doctest::Approx(edge / 2 + 0.3));
    }
}

TEST_CASE("cameras that cannot be") {
    const std::vector<vec3<double>> one{{1, 2, 3}}, two{{0, 0, 0}, {1, 0, 0}};
    const std::vector<vec3<double>> bad{{0, 0, 0}, {std::numeric_limits<double>::quiet_NaN(), 0, 0}};
    test::check_throws<ValueError>([&] { (void)side_camera({}, BodySide::front); }, {"side_camera", "no vertices"});
    test::check_throws<ValueError>([&] { (void)side_camera(one, BodySide::front); }, {"one point"});
    test::check_throws<ValueError>([&] { (void)side_camera(bad, BodySide::front); }, {"vertices[3]", "finite"});
    test::check_throws<ValueError>([&] { (void)side_camera(two, BodySide::left, {.resolution = 0}); }, {"resolution"});
    test::check_throws<ValueError>([&] { (void)side_camera(two, BodySide::left, {.margin = 0.5}); }, {"margin"});

    const OrthographicCamera good = side_camera(two, BodySide::front);
    const auto refuse = [&](auto&& spoil, std::string_view word) {
        OrthographicCamera camera = good;
        spoil(camera);
        test::check_throws<ValueError>([&] { check_camera("here", "my camera", camera); }, {"here", "my camera", word});
    };
    refuse([](auto& c) { c.scale = 0; }, "scale");
    refuse([](auto& c) { c.cx = std::numeric_limits<double>::infinity(); }, "infinity");
    refuse([](auto& c) { c.width = 0; }, "pixels");
    refuse([](auto& c) { c.R = mat3<double>(2.0); }, "rotation");
    refuse([](auto& c) { c.R[0] = -c.R[0]; }, "rotation");
}

} // namespace
} // namespace gsh
