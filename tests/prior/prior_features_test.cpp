// SPDX-License-Identifier: Apache-2.0
#include "io/temporary.hpp"
#include "prior/shapes.hpp"
#include "support/gradient.hpp"

#include <gsh/math/rotation.hpp>
#include <gsh/prior/prior_features.hpp>

namespace gsh {
namespace {

using test::serial;

SkinWeightTable<double> two_bones(Span<const vec3<double>> points) {
    SkinWeightBuilder builder;
    for (const auto& p : points) {
        const double w = std::clamp(p.y, 0.0, 1.0);
        builder.add(std::vector<double>{w, 1 - w});
        builder.finish_point();
    }
    return builder.table();
}

TEST_CASE("depth features are signed distances along the view, in units; raw ones the map's depth") {
    const auto mesh = test::box({-0.2, 0, -0.1}, {0.4, 1.8, 0.3});
    const auto views = four_depth_views(serial, mesh.vertices, mesh.faces, {.resolution = 128});
    const std::vector<vec3<double>> points{{0.1, 0.9, 0.3}, {0.1, 0.5, 0.5}, {0, 1, 0}, {0.3, 1.0, -0.1}};
    const auto features = depth_features(points, views);
    REQUIRE(features.size() == 16);
    for (std::size_t i = 0; i < points.size(); ++i) {
        const vec3<double>& p = points[i];
        const bool inside_z = std::abs(p.z - 0.1) <= 0.2 + 1e-9; // outside, the side views show nothing
        // From the front: positive if the point is in front of the surface.
        CHECK(std::abs(features[4 * i + 0] - (p.z - 0.3) / 0.1) < 1e-9);
        CHECK(std::abs(features[4 * i + 1] - (-0.1 - p.z) / 0.1) < 1e-9);
        CHECK(std::abs(features[4 * i + 2] - (inside_z ? (p.x - 0.4) / 0.1 : 0)) < 1e-9);
        CHECK(std::abs(features[4 * i + 3] - (inside_z ? (-0.2 - p.x) / 0.1 : 0)) < 1e-9);
    }
    const auto raw = depth_features(points, views, {}, {.depth = DepthFeature::raw, .depth_unit = 1});
    CHECK(raw[0] == doctest::Approx(0.8)); // half of the 2 m frame, less 0.2 m
    CHECK(raw[2] == doctest::Approx(0.7));
    CHECK(depth_features({}, views).empty());
    CHECK(depth_features(points, {}).empty());
}

TEST_CASE("a plane's depth is sampled exactly, and pixels outside the mask do not pull") {
    PriorView view{test::square_camera(8, 1), {Image<double>(1, 8, 8), Image<std::uint8_t>(1, 8, 8)}, {}};
    for (int y = 0; y < 8; ++y)
        for (int x = 0; x < 5; ++x) {
            view.map.values.at(0, y, x) = 2 + 0.5 * (x + 0.5) - 0.25 * (y + 0.5);
            view.map.mask.at(0, y, x) = 1;
        }
    view.map.values.at(0, 4, 6) = 1e9; // outside the mask: must never be read
    const PriorFeatureParams raw{.depth = DepthFeature::raw, .depth_unit = 1};
    const auto at = [&](double u, double v) {
        return depth_features(std::vector<vec3<double>>{{u - 4, v - 4, 0}}, Span<const PriorView>(&view, 1), {},
                              raw)[0];
    };
    test::Rng rng(5);
    for (int k = 0; k < 50; ++k) {
        const double u = rng.uniform(0.5, 4.5), v = rng.uniform(0.5, 7.5);
        CHECK(at(u, v) == doctest::Approx(2 + 0.5 * u - 0.25 * v));
    }
    CHECK(at(4.5, 2.5) == doctest::Approx(2 + 2.25 - 0.625)); // the last column that counts
    // The last column's value, as long as its weight is positive.
    CHECK(at(5.3, 2.5) == doctest::Approx(2 + 2.25 - 0.625));
    CHECK(at(5.5, 2.5) == 0);
    CHECK(at(6.4, 4.4) == 0);
    CHECK(at(0.1, 2.5) == doctest::Approx(2 + 0.25 - 0.625)); // the same at the image's border
    CHECK(at(-0.6, 2.5) == 0);
    CHECK(at(4, 8.6) == 0);
}

TEST_CASE("normal features are canonical normals, whichever camera saw them") {
    const auto mesh = test::sphere({0, 1, 0}, 0.5, 90, 180);
    const std::vector<vec3<double>> points{{0, 1, 0.5}, {0.2, 1.1, 0.1}, {-0.3, 0.8, -0.2}, {0.9, 1, 0}};
    const auto features =
        normal_features(points, two_normal_views(serial, mesh.vertices, mesh.faces, {.resolution = 256}));
    REQUIRE(features.size() == 24);
    for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t side = 0; side < 2; ++side) {
            const vec3<double> d = (points[i] - vec3<double>(0, 1, 0)) / 0.5;
            const double z = std::sqrt(1 - d.x * d.x - d.y * d.y) * (side ? -1 : 1);
            const double* f = &features[6 * i + 3 * side];
            CHECK(length(vec3<double>(f[0], f[1], f[2]) - vec3<double>(d.x, d.y, z)) < 0.01);
        }
    for (std::size_t k = 18; k < 24; ++k) CHECK(features[k] == 0); // beside the sphere
}

TEST_CASE("a posed view seen by a camera that moves along is the canonical view") {
    // With one rigid motion for all bones, a map of the moved mesh from the moved camera equals the canonical map.
    auto mesh = test::sphere({0, 0.5, 0.1}, 0.4, 60, 80);
    mesh.add(test::box({0.1, 0.2, 0.3}, {0.3, 0.9, 0.6}));
    const mat3<double> R = rotation_from_axis_angle(vec3<double>(0.4, -1.1, 0.7));
    const Affine<double> motion{R, vec3<double>(3, -2, 5)};
    auto posed = mesh.vertices;
    for (auto& v : posed) v = motion(v);
    const std::vector<Affine<double>> bones(2, motion);
    std::vector<PriorView> depth, normals;
    for (const BodySide side : {BodySide::front, BodySide::left}) {
        OrthographicCamera camera = side_camera(mesh.vertices, side, {.resolution = 200});
        depth.push_back(depth_view(serial, mesh.vertices, mesh.faces, camera));
        normals.push_back(normal_view(serial, mesh.vertices, mesh.faces, camera));
        camera.R = camera.R * transpose(R), camera.t = camera.t - camera.R * motion.translation;
        depth.push_back(depth_view(serial, posed, mesh.faces, camera, bones));
        normals.push_back(normal_view(serial, posed, mesh.faces, camera, bones));
    }
    test::Rng rng(8);
    auto points = rng.vecs(400, -0.3, 0.3);
    for (auto& p : points) p += vec3<double>(0, 0.5, 0.1);
    const auto skin = two_bones(points);
    const auto d = depth_features(points, depth, skin.view());
    const auto n = normal_features(points, normals, skin.view());
    std::size_t off = 0, same = 0;
    for (std::size_t i = 0; i < points.size(); ++i)
        for (std::size_t pair = 0; pair < 2; ++pair) {
            const std::size_t a = 4 * i + 2 * pair;
            bool equal = std::abs(d[a] - d[a + 1]) < 1e-3;
            for (std::size_t k = 0; k < 3; ++k) equal = equal && std::abs(n[3 * a + k] - n[3 * a + 3 + k]) < 1e-3;
            ++(equal ? same : off);
        }
    CHECK(same > 700);
    CHECK(off < 4); // rounding may flip a pixel of the silhouette
}

TEST_CASE("a point is posed by its own blend of bones, and its normal comes back by the transpose") {
    const Affine<double> turn{rotation_from_axis_angle(vec3<double>(0, 0.5, 0)), vec3<double>(0, 0, 0.2)};
    const std::vector<vec3<double>> points{{0.1, 1, 0}, {0.1, 0, 0}, {0.2, 0.5, -0.1}};
    const auto skin = two_bones(points);
    PriorView depth{test::square_camera(32, 16),
                    {Image<double>(1, 32, 32, 2.0), Image<std::uint8_t>(1, 32, 32, 1)},
                    {Affine<double>(), turn}};
    PriorView normal{depth.camera, {Image<double>(3, 32, 32, 0.0), depth.map.mask}, depth.bones};
    const vec3<double> n = normalize(vec3<double>(0.3, 0.2, -0.8));
    for (int k = 0; k < 3; ++k) std::fill_n(normal.map.values.view().row(k, 0), 32 * 32, n[k]);
    const auto d = depth_features(points, Span<const PriorView>(&depth, 1), skin.view());
    const auto f = normal_features(points, Span<const PriorView>(&normal, 1), skin.view());
    for (std::size_t i = 0; i < points.size(); ++i) {
        const Affine<double> M = blend<double>(skin.view(), i, depth.bones);
        CHECK(d[i] == doctest::Approx((2 - M(points[i]).z) / 0.1));
        const vec3<double> found(f[3 * i], f[3 * i + 1], f[3 * i + 2]);
        CHECK(length(found) == doctest::Approx(1));
        const vec3<double> forth = transposed_times(inverse(M.linear), found); // M⁻ᵀ
        CHECK(length(normalize(forth) - n) < 1e-12);
    }
}

TEST_CASE("a photograph's own camera, with what lies behind it left out") {
    Camera<double> eye;
    eye.fx = eye.fy = 40, eye.cx = 16, eye.cy = 18, eye.width = 32, eye.height = 36;
    const PriorView view{eye, {Image<double>(1, 36, 32, 3.0), Image<std::uint8_t>(1, 36, 32, 1)}, {}};
    const std::vector<vec3<double>> points{{0.1, 0.1, 2.5}, {0, 0, -1}, {0, 0, 0}, {3, 0, 1}};
    const auto d = depth_features(points, Span<const PriorView>(&view, 1));
    CHECK(d[0] == doctest::Approx(5));
    for (std::size_t i = 1; i < 4; ++i) CHECK(d[i] == 0);
}

TEST_CASE("features that cannot be computed") {
    const std::vector<vec3<double>> points{{0.1, 1, 0}, {0.1, 0, 0}};
    const auto skin = two_bones(points);
    PriorView view{
        test::square_camera(4, 2), {Image<double>(1, 4, 4, 2.0), Image<std::uint8_t>(1, 4, 4, 1)}, {Affine<double>()}};
    const Span<const PriorView> views(&view, 1);
    test::check_throws<ShapeError>([&] { (void)depth_features(points, views); },
                                   {"depth_features", "skin.weights", "views[0]"});
    test::check_throws<ShapeError>([&] { (void)depth_features(points, views, skin.view()); },
                                   {"views[0].bones", "expected 2"});
    test::check_throws<ShapeError>([&] { (void)normal_features(points, views, skin.view()); },
                                   {"normal_features", "views[0].map"});
    view.bones.clear();
    test::check_throws<ValueError>([&] { (void)depth_features(points, views, {}, {.depth_unit = 0}); }, {"depth_unit"});
    CHECK_NOTHROW((void)depth_features(points, views));
}

} // namespace
} // namespace gsh
