// SPDX-License-Identifier: Apache-2.0
#include <gsh/setup/static_start.hpp>

#include "io/temporary.hpp"
#include "support/gradient.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

/// Four cameras on the z and x axes look at the origin from 4 m away. A camera shows 1/4 of the distance in each
/// direction. Its mask ends at 1/8 of it on the left, right and top, and at 3/16 below, so the limits of the hull are
/// known.
struct FourMasks {
    static constexpr int size = 32;
    std::vector<std::vector<std::uint8_t>> images;
    std::vector<Photo> photos;

    explicit FourMasks(std::uint8_t inside = 255, std::uint8_t outside = 0) {
        const std::array<vec3<double>, 4> eyes{{{0, 0, 4}, {0, 0, -4}, {4, 0, 0}, {-4, 0, 0}}};
        const std::uint8_t colors[4][3] = {{255, 0, 0}, {0, 51, 0}, {0, 0, 102}, {255, 255, 255}};
        for (std::size_t i = 0; i < 4; ++i) {
            images.emplace_back();
            for (int y = 0; y < size; ++y)
                for (int x = 0; x < size; ++x) {
                    images[i].insert(images[i].end(), std::begin(colors[i]), std::end(colors[i]));
                    images[i].push_back(x >= 8 && x < 24 && y >= 8 && y < 28 ? inside : outside);
                }
            photos.push_back({"cam" + std::to_string(i), camera_at(eyes[i], {0, 0, 0}), 0, {}});
        }
        for (std::size_t i = 0; i < 4; ++i) photos[i].rgba = images[i];
    }
    FourMasks(const FourMasks&) = delete;

    static Camera<double> camera_at(const vec3<double>& eye, const vec3<double>& target) {
        Camera<double> camera = look_at<double>(eye, target, {0, 1, 0}, 0.5, size, size);
        camera.fx = camera.fy = 64;
        return camera;
    }
    /// Turns a camera round.
    void look_away(std::size_t i) {
        const vec3<double> eye = photos[i].camera.center();
        photos[i].camera = camera_at(eye, eye * 2.0);
    }
    [[nodiscard]] static bool holds(const vec3<double>& p) {
        const double near = 4 - std::max(std::abs(p.x), std::abs(p.z)); // distance of the nearest camera
        return std::abs(p.x) <= (4 - std::abs(p.z)) / 8 && std::abs(p.z) <= (4 - std::abs(p.x)) / 8 &&
               p.y <= near / 8 && p.y >= -near * 3 / 16;
    }
};

const Box roomy{vec3<double>(-1.0), vec3<double>(1.0)}; // larger than the hull

} // namespace

TEST_CASE("the hull's box is that of its cells, found in a coarse grid and then in a fine one") {
    const FourMasks scene;
    const Box box = hull_box(scene.photos);
    // x: in the first grid, cells of 12.5 cm in a cube of 8 m, the last centre inside is at 43.75 cm. Two and a half
    // more cells give 75 cm. In the second grid, cells of 2.34375 cm, the last centre below 1/8 of 4 m is at
    // 48.046875 cm. One and a half more cells give this limit:
    for (const int axis : {0, 2}) {
        CHECK(box.high[axis] == doctest::Approx(0.515625).epsilon(1e-12));
        CHECK(box.low[axis] == doctest::Approx(-0.515625).epsilon(1e-12));
    }
    // y: the same above, but 3/16 below. The second grid lies between -1 m and 0.75 m, with cells of 2.734375 cm.
    CHECK(box.high.y == doctest::Approx(0.53125).epsilon(1e-12));
    CHECK(box.low.y == doctest::Approx(-0.78125).epsilon(1e-12));
}

TEST_CASE("without masks the box is what three of four photographs see, not the cube around the cameras") {
    const FourMasks scene(255, 255);
    const Box box = hull_box(scene.photos);
    // Upwards, both x cameras and one on z show 1/4 of 4 m. Sideways they show up to x = (4 + z) / 4, z = (4 - x) / 4.
    CHECK(std::abs(box.high.y - 1) < 0.1);
    CHECK(std::abs(box.low.y + 1) < 0.1);
    for (const int axis : {0, 2}) {
        CHECK(std::abs(box.high[axis] - 20 / 17.0) < 0.1);
        CHECK(std::abs(box.low[axis] + 20 / 17.0) < 0.1);
    }
}

TEST_CASE("starting points fill the visual hull and have the photographs' mean colour") {
    const FourMasks scene;
    const ColoredPoints start = visual_hull_points(scene.photos, roomy, 2000, 3);
    REQUIRE(start.points.size() == 2000);
    REQUIRE(start.colors.size() == 2000);
    vec3<double> low(1.0), high(-1.0);
    for (std::size_t i = 0; i < 2000; ++i) {
        const vec3<double> p = start.points[i], off = start.colors[i] - vec3<double>(0.5, 0.3, 0.35);
        CHECK(FourMasks::holds(p));
        CHECK(length(off) < 1e-12);
        for (int c = 0; c < 3; ++c) low[c] = std::min(low[c], p[c]), high[c] = std::max(high[c], p[c]);
    }
    CHECK(low.y < -0.72); // the limit is -0.75
    CHECK(high.y > 0.48); // the limit is 0.5
    for (const int axis : {0, 2}) {
        CHECK(low[axis] < -0.48);
        CHECK(high[axis] > 0.48);
    }
    CHECK(visual_hull_points(scene.photos, roomy, 10, 3).points[7] == start.points[7]);
    CHECK(visual_hull_points(scene.photos, roomy, 10, 4).points[7] != start.points[7]);
    CHECK(visual_hull_points(scene.photos, roomy, 0, 3).points.empty());
}

TEST_CASE("a point of the hull is seen by three quarters of the photographs, and on the mask of each that sees it") {
    FourMasks scene;
    scene.look_away(3); // the camera with white photographs
    const vec3<double> color = visual_hull_points(scene.photos, roomy, 1, 3).colors[0];
    CHECK(length(color - vec3<double>(1 / 3.0, 51 / 765.0, 102 / 765.0)) < 1e-12);
    scene.look_away(2);
    test::check_throws<ValueError>([&] { (void)visual_hull_points(scene.photos, roomy, 1, 3); }, {"masks", "box"});
    test::check_throws<ValueError>([&] { (void)hull_box(scene.photos); }, {"masks"});

    // A pixel is inside from an alpha of 1/2.
    const FourMasks half(128), less(127);
    CHECK(visual_hull_points(half.photos, roomy, 1, 3).points.size() == 1);
    test::check_throws<ValueError>([&] { (void)visual_hull_points(less.photos, roomy, 1, 3); }, {"masks"});
    test::check_throws<ValueError>([&] { (void)hull_box(less.photos); }, {"masks"});
    // A point is outside if one camera's mask is empty there.
    FourMasks one;
    one.photos[1].rgba = less.images[1];
    test::check_throws<ValueError>([&] { (void)visual_hull_points(one.photos, roomy, 1, 3); }, {"masks"});
}

TEST_CASE("boxes and cameras without a hull are refused") {
    const FourMasks scene;
    const auto refuse = [&](const Box& box, const char* word) {
        test::check_throws<ValueError>([&] { (void)visual_hull_points(scene.photos, box, 5, 1); }, {word});
    };
    refuse({{2, 2, 2}, {3, 3, 3}}, "of 100000 points of the box 0 lie on the masks");
    refuse({{1, 0, 0}, {0, 1, 1}}, "box is empty");
    refuse({{0, 0, 0}, {1, 0, 1}}, "box is empty");
    test::check_throws<ValueError>([&] { (void)hull_box({scene.photos[0], scene.photos[1]}); }, {"one line"});
    test::check_throws<ValueError>([&] { (void)hull_box({}); }, {"no photographs"});
}

TEST_CASE("squared distances to the nearest points are found by the tree as by hand and by trying all") {
    const std::vector<vec3<double>> line{{0, 7, 0}, {0, 0, 0}, {0, 3, 0}, {0, 1, 0}};
    CHECK(neighbor_distances(line, 1) == std::vector<double>{16, 1, 4, 1});
    CHECK(neighbor_distances(line, 2) == std::vector<double>{26, 5, 6.5, 2.5});
    CHECK(neighbor_distances(line, 9) == std::vector<double>{101 / 3.0, 59 / 3.0, 29 / 3.0, 41 / 3.0});
    CHECK(neighbor_distances(line, 0) == std::vector<double>(4, 0.0));
    CHECK(neighbor_distances({}, 3).empty());
    CHECK(neighbor_distances({{1, 2, 3}}, 3) == std::vector<double>{0});
    CHECK(neighbor_distances(std::vector<vec3<double>>(40, vec3<double>(1.0)), 3) == std::vector<double>(40, 0.0));

    test::Rng rng(3);
    std::vector<vec3<double>> points = rng.vecs(200);
    points.push_back({1000, 0, 0}); // an outlier, as reconstructions have them
    points.push_back(points[0]);
    const auto found = neighbor_distances(points, 3);
    for (std::size_t i = 0; i < points.size(); ++i) {
        std::vector<double> squared;
        for (std::size_t j = 0; j < points.size(); ++j)
            if (j != i) squared.push_back(dot(points[i] - points[j], points[i] - points[j]));
        std::sort(squared.begin(), squared.end());
        CHECK(found[i] == doctest::Approx((squared[0] + squared[1] + squared[2]) / 3));
    }
}

TEST_CASE("Gaussians start round, as wide as the way to their three nearest neighbours, in their points' colours") {
    // The first five form a cross. The middle is 2 m from all ends. An end is √8 m from its neighbours.
    const ColoredPoints start{{{0, 0, 0}, {2, 0, 0}, {-2, 0, 0}, {0, 2, 0}, {0, -2, 0}},
                              {{1, 0.5, 0}, {0.25, 0.5, 1}, {0, 0, 0}, {0, 0, 0}, {0, 0, 0}}};
    const auto cloud = initial_gaussians<float>(start);
    REQUIRE(cloud.size() == 5);
    CHECK(cloud.sh_degree == 0);
    REQUIRE(cloud.sh.size() == 5);
    for (std::size_t i = 0; i < 5; ++i) {
        CHECK(cloud.means[i] == vec3<float>(start.points[i]));
        const quat<float> q = cloud.quats[i];
        CHECK((q.w == 1 && q.x == 0 && q.y == 0 && q.z == 0));
        CHECK(sigmoid(cloud.opacity_logits[i]) == doctest::Approx(0.1));
        for (int axis = 0; axis < 3; ++axis)
            CHECK(std::exp(cloud.log_scales[i][axis]) == doctest::Approx(i == 0 ? 2 : std::sqrt((4 + 8 + 8) / 3.0)));
        const vec3<float> seen = shade<0>(&cloud.sh[i], vec3<float>(0, 0, 1), 1.0f, ColorClamp::below);
        CHECK(length(vec3<double>(seen) - start.colors[i]) < 1e-6);
    }
    CHECK(sigmoid(initial_gaussians<float>(start, 0.75).opacity_logits[2]) == doctest::Approx(0.75));
    // Gaussians of coincident points are a third of a millimetre wide, not zero.
    const auto heap = initial_gaussians<double>({std::vector(4, vec3<double>(1.0)), std::vector(4, vec3<double>(0.5))});
    CHECK(1e7 * std::exp(2 * heap.log_scales[3].x) == doctest::Approx(1));
    CHECK(initial_gaussians<float>({}).size() == 0);

    CHECK_THROWS_AS((void)initial_gaussians<float>({{{0, 0, 0}}, {}}), ShapeError);
    const auto refuse = [](const ColoredPoints& points, double opacity, const char* word) {
        test::check_throws<ValueError>([&] { (void)initial_gaussians<float>(points, opacity); }, {word});
    };
    refuse({{{0, 0, std::nan("")}}, {{0, 0, 0}}}, 0.1, "point 0");
    refuse({{{0, 0, 0}, {0, 0, 0}}, {{0, 0, 0}, {0, HUGE_VAL, 0}}}, 0.1, "point 1");
    refuse({}, 1, "opacity");
    refuse({}, 0, "opacity");
}
