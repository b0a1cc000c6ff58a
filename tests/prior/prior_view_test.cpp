// SPDX-License-Identifier: Apache-2.0
#include "io/temporary.hpp"
#include "prior/shapes.hpp"

#include <gsh/math/rotation.hpp>
#include <gsh/prior/prior_view.hpp>

#include <limits>

namespace gsh {
namespace {

using test::serial;

vec3<double> normal_at(const PriorView& view, int y, int x) {
    return {view.map.values.at(0, y, x), view.map.values.at(1, y, x), view.map.values.at(2, y, x)};
}

TEST_CASE("four depth views of a box: half the frame less half the box") {
    const auto mesh = test::box({-0.2, 0, -0.1}, {0.4, 1.8, 0.3});
    const auto views = four_depth_views(serial, mesh.vertices, mesh.faces, {.resolution = 100});
    REQUIRE(views.size() == 4);
    for (std::size_t v = 0; v < 4; ++v) {
        CHECK_NOTHROW(check_prior_view("test", "view", views[v], 1));
        const double half_depth = v < 2 ? 0.2 : 0.3, half_width = v < 2 ? 0.3 : 0.2;
        CHECK(views[v].map.values.at(0, 50, 50) == doctest::Approx(1.0 - half_depth)); // the frame is 1.8 / 0.9 m
        std::size_t covered = 0;
        for (const auto m : views[v].map.mask.data) covered += m;
        CHECK(covered == static_cast<std::size_t>(std::lround(2 * half_width * 50 * 90)));
        CHECK(views[v].bones.empty());
    }
}

TEST_CASE("normals of a sphere are its radii in the camera's frame, from every camera") {
    const vec3<double> center(0.3, 1, -0.2);
    const auto mesh = test::sphere(center, 0.5, 60, 120);
    const auto check = [&](const PriorView& view, const auto& camera, const auto& direction) {
        CHECK_NOTHROW(check_prior_view("test", "view", view, 3));
        std::size_t covered = 0;
        for (int y = 0; y < camera.height; ++y)
            for (int x = 0; x < camera.width; ++x) {
                const vec3<double> n = normal_at(view, y, x);
                if (!view.map.mask.at(0, y, x)) {
                    CHECK(n == vec3<double>(0));
                    continue;
                }
                ++covered;
                CHECK(length(n) == doctest::Approx(1));
                const vec3<double> c = to_camera(camera, center), sight = direction(x + 0.5, y + 0.5);
                const vec3<double> foot = sight * (dot(c, sight) / dot(sight, sight)); // pinhole: through the origin
                vec3<double> offset = foot - c;
                if constexpr (requires { camera.scale; })
                    offset =
                        vec3<double>((x + 0.5 - camera.cx) / camera.scale, (y + 0.5 - camera.cy) / camera.scale, c.z) -
                        c;
                const double squared = dot(offset, offset);
                if (squared > 0.24) continue; // the rim
                const vec3<double> radius = (offset - sight * (std::sqrt(0.25 - squared) / length(sight))) / 0.5;
                if (length(n - radius) > 0.02) FAIL_CHECK(x, " ", y, " ", length(n - radius));
            }
        CHECK(covered > 500);
    };
    for (const auto& view : two_normal_views(serial, mesh.vertices, mesh.faces, {.resolution = 64})) {
        const auto& camera = std::get<OrthographicCamera>(view.camera);
        check(view, camera, [](double, double) { return vec3<double>(0, 0, 1); });
    }
    const auto eye = look_at<double>({2, 1.5, 1}, center, {0, 1, 0}, 0.6, 60, 60);
    check(normal_view(serial, mesh.vertices, mesh.faces, eye), eye, [&](double u, double v) {
        return vec3<double>((u - eye.cx) / eye.fx, (v - eye.cy) / eye.fy, 1);
    });
}

TEST_CASE("an open surface shows the side that is seen") {
    test::Mesh sheet;
    sheet.vertices = {{-1, -1, 0}, {1, -1, 0}, {1, 1, 0.5}, {-1, 1, 0.5}};
    sheet.faces = {{0, 1, 2}, {0, 2, 3}};
    const auto views = two_normal_views(serial, sheet.vertices, sheet.faces, {.resolution = 20});
    for (const auto& view : views) {
        const auto& camera = std::get<OrthographicCamera>(view.camera);
        const vec3<double> n = normal_at(view, 10, 10), world = transposed_times(camera.R, n);
        CHECK(n.z < 0);
        const double side = camera.R[2].z < 0 ? 1 : -1; // the front camera stands on +z
        CHECK(length(world - normalize(vec3<double>(0, -0.25, 1)) * side) < 1e-6);
    }
}

TEST_CASE("views that do not hold together") {
    const auto mesh = test::box({0, 0, 1}, {1, 1, 2});
    const PriorView good = depth_view(serial, mesh.vertices, mesh.faces, test::square_camera(8, 4));
    const auto refuse = [&](auto&& spoil, std::initializer_list<std::string_view> words) {
        PriorView view = good;
        spoil(view);
        test::check_throws([&] { check_prior_view("here", "views[2]", view, 1); }, words);
    };
    test::check_throws<ShapeError>([&] { check_prior_view("here", "v", good, 3); },
                                   {"here", "v.map.values", "1x8x8", "3x8x8"});
    refuse([](auto& v) { v.map.mask = Image<std::uint8_t>(1, 8, 7); }, {"views[2].map.mask", "1x8x7"});
    refuse([](auto& v) { v.map.values.data.pop_back(); }, {"views[2].map.values"});
    refuse([](auto& v) { std::get<OrthographicCamera>(v.camera).scale = -1; }, {"views[2].camera", "scale"});
    refuse([](auto& v) { v.camera = Camera<double>(); }, {"views[2].camera"});
    refuse(
        [](auto& v) {
            v.map.values.at(0, 7, 7) = std::numeric_limits<double>::quiet_NaN(), v.map.mask.at(0, 7, 7) = 1;
        },
        {"values[63]", "not finite"});
    PriorView masked = good;
    masked.map.values.at(0, 0, 0) = std::numeric_limits<double>::quiet_NaN();
    masked.map.mask.at(0, 0, 0) = 0;
    CHECK_NOTHROW(check_prior_view("here", "v", masked, 1));
}

} // namespace
} // namespace gsh
