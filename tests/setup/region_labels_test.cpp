// SPDX-License-Identifier: Apache-2.0
#include "support/skip.hpp"

#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/io/body/body_file.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/loss/metrics.hpp>
#include <gsh/setup/region_labels.hpp>

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

using namespace gsh;

namespace {

using Triangle = std::array<int, 3>;

/// Squares across the z axis, 4 corners and 2 triangles each.
struct Squares {
    std::vector<vec3<double>> vertices;
    std::vector<Triangle> faces;

    void add(double z, double half, double x = 0) {
        const int v = int(vertices.size());
        for (const double dy : {-half, half})
            for (const double dx : {-half, half}) vertices.push_back({x + dx, dy, z});
        faces.push_back({v, v + 1, v + 2});
        faces.push_back({v + 2, v + 1, v + 3});
    }
};

/// A camera that shows x and y from -1 to 1 at z = 1, where a pixel is 1/10 wide.
Camera<double> camera() {
    Camera<double> c;
    c.fx = c.fy = 10, c.cx = c.cy = 10, c.width = c.height = 20;
    return c;
}

std::size_t count(const RegionLabels& labels, int label) {
    return std::size_t(std::count(labels.labels.begin(), labels.labels.end(), label));
}

} // namespace

TEST_CASE("a triangle belongs to the first region that holds all its corners") {
    const std::vector<Triangle> faces{{0, 1, 2}, {1, 2, 3}, {2, 3, 4}};
    const std::vector<MeshRegion> regions{{"a", {2, 1, 0}}, {"b", {3, 1, 2, 0, 3}}, {"none", {}}};
    CHECK(triangle_regions(5, faces, regions) == std::vector<int>{0, 1, -1});
    CHECK(triangle_regions(5, {}, regions).empty());
    CHECK(triangle_regions(5, faces, {}) == std::vector<int>{-1, -1, -1});
    CHECK_THROWS_AS((void)triangle_regions(4, faces, regions), ValueError);
    CHECK_THROWS_AS((void)triangle_regions(5, faces, std::vector<MeshRegion>{{"a", {5}}}), ValueError);
    CHECK_THROWS_AS((void)triangle_regions(5, faces, std::vector<MeshRegion>{{"a", {-1}}}), ValueError);
}

TEST_CASE("a pixel shows what is nearest") {
    Squares scene;
    scene.add(1, 0.6);      // the trunk: 12 x 12 pixels
    scene.add(0.5, 0.1);    // a hand in front of it: 4 x 4 pixels
    scene.add(2, 0.2);      // a hand behind it
    scene.add(1, 0.1, 0.8); // a face beside it: 2 x 2 pixels
    const std::vector<MeshRegion> regions{
        {"left hand", {4, 5, 6, 7}}, {"right hand", {8, 9, 10, 11}}, {"face", {12, 13, 14, 15}}};
    cpu::Serial backend;
    const auto label = [&](auto& engine) {
        return region_labels(engine, Span<const vec3<double>>(scene.vertices), Span<const Triangle>(scene.faces),
                             camera(), Span<const MeshRegion>(regions));
    };
    const RegionLabels labels = label(backend);
    CHECK(labels.height == 20);
    CHECK(labels.width == 20);
    CHECK(count(labels, 0) == 16);
    CHECK(count(labels, 1) == 0);
    CHECK(count(labels, 2) == 4);
    CHECK(count(labels, RegionLabels::rest) == 144 - 16);
    CHECK(count(labels, RegionLabels::nothing) == 400 - 144 - 4);

    const Image<std::uint8_t> hand = labels.mask(0);
    for (int y = 0; y < 20; ++y)
        for (int x = 0; x < 20; ++x) CHECK(hand.at(0, y, x) == (x >= 8 && x < 12 && y >= 8 && y < 12));

    Image<float> alpha(1, 20, 20); // a skirt below the trunk
    for (int y = 4; y < 18; ++y)
        for (int x = 4; x < 16; ++x) alpha.at(0, y, x) = y == 17 ? 0.5f : 1;
    const Image<std::uint8_t> rest = labels.remainder(alpha.view());
    for (int y = 0; y < 20; ++y)
        for (int x = 0; x < 20; ++x) CHECK(rest.at(0, y, x) == (alpha.at(0, y, x) > 0.5f && !hand.at(0, y, x)));
    CHECK_THROWS_AS((void)labels.remainder(Image<float>(1, 20, 21).view()), ShapeError);
    CHECK_THROWS_AS((void)labels.remainder(Image<float>(4, 20, 20).view()), ShapeError);

    cpu::Threads threads(2);
    CHECK(label(threads).labels == labels.labels);
    const RegionLabels none = region_labels<cpu::Serial>(backend, {}, {}, camera(), {});
    CHECK(count(none, RegionLabels::nothing) == 400);
    scene.vertices[3].x = std::nan("");
    CHECK_THROWS_AS((void)label(backend), ValueError);
}

TEST_CASE("of several people the one in front is seen, and clothes belong to the nearest") {
    Squares tall, small; // 12 x 12 pixels, and 4 x 4 in front of its middle
    tall.add(1, 0.6);
    small.add(0.5, 0.1);
    const std::vector<MeshRegion> whole{{"all", {0, 1, 2, 3}}};
    const std::vector<LabelledBody> people{{tall.vertices, tall.faces, whole}, {small.vertices, small.faces}};
    cpu::Serial backend;
    const auto labels = people_labels<cpu::Serial>(backend, people, camera());
    REQUIRE(labels.size() == 2);
    CHECK(count(labels[0], 0) == 144 - 16);
    CHECK(count(labels[0], RegionLabels::rest) == 0);
    CHECK(count(labels[1], RegionLabels::rest) == 16);
    CHECK(count(labels[1], RegionLabels::nothing) == 400 - 16);
    const auto alone = people_labels<cpu::Serial>(backend, Span<const LabelledBody>(people).subspan(0, 1), camera());
    CHECK(alone[0].labels == region_labels<cpu::Serial>(backend, tall.vertices, tall.faces, camera(), whole).labels);
    CHECK(people_labels<cpu::Serial>(backend, {}, camera()).empty());

    Image<float> alpha(1, 20, 20); // two people, a skirt below them, and a ball away from both
    for (int y = 4; y < 18; ++y)
        for (int x = 4; x < 16; ++x) alpha.at(0, y, x) = 1;
    alpha.at(0, 0, 0) = 1, alpha.at(0, 5, 5) = 0.5f; // and a hole
    const auto masks = people_masks(labels, std::as_const(alpha).view());
    const auto bare = people_masks(labels, std::as_const(alpha).view(), false);
    for (int y = 0; y < 20; ++y)
        for (int x = 0; x < 20; ++x) {
            const bool in_front = x >= 8 && x < 12 && y >= 8 && y < 12, body = x >= 4 && x < 16 && y >= 4 && y < 16;
            const bool skirt = x >= 4 && x < 16 && y >= 16 && y < 18, hole = x == 5 && y == 5;
            CHECK(masks[1].at(0, y, x) == in_front);
            CHECK(masks[0].at(0, y, x) == (!in_front && !hole && (body || skirt)));
            CHECK(bare[0].at(0, y, x) == (!in_front && !hole && body));
        }
    CHECK_THROWS_AS((void)people_masks(labels, Image<float>(1, 20, 21).view()), ShapeError);
}

TEST_CASE("regions of a captured body lie on its silhouette") {
    const auto body_file = test::shared_data("body/cc0_body_x.npz"), capture = test::shared_data("captures/A_multi");
    if (test::skip_without({body_file, capture / "poses.npz"})) return;
    const BodyModel body = load_body_model(body_file);
    const Motion motion = load_motion(capture / "poses.npz", body);
    const CameraList cameras = read_cameras(capture / "cameras.json");
    const std::vector<MeshRegion> regions{{"face", body.face_vertices},
                                          {"left hand", body.left_hand_vertices},
                                          {"right hand", body.right_hand_vertices}};
    cpu::Serial backend;
    std::size_t fewest_face = 1u << 20, most_face = 0;
    for (const NamedCamera& named : cameras.cameras) {
        const auto path = capture / "images" / named.name / "0004.png";
        if (!std::filesystem::exists(path)) continue;
        const PosedBody posed =
            pose_body(body, motion.pose_at(4), motion.transl[4], motion.betas, motion.expression_at(4));
        const RegionLabels labels =
            region_labels<cpu::Serial>(backend, posed.vertices, body.faces, named.camera, regions);
        const PixelImage image = read_image(path);
        std::size_t both = 0, either = 0;
        for (std::size_t i = 0; i < labels.labels.size(); ++i) {
            const bool mesh = labels.labels[i] != RegionLabels::nothing, photo = image.data[4 * i + 3] > 127;
            both += mesh && photo, either += mesh || photo;
        }
        const double overlap = double(both) / double(either);
        const std::size_t face = count(labels, 0);
        fewest_face = std::min(fewest_face, face), most_face = std::max(most_face, face);
        MESSAGE(named.name << ": overlap " << overlap << ", face " << face << ", left hand " << count(labels, 1)
                           << ", right hand " << count(labels, 2) << ", rest " << count(labels, RegionLabels::rest));
        CHECK(overlap > 0.99);
        CHECK(count(labels, RegionLabels::rest) > 8000);
    }
    CHECK(most_face > 400);
    CHECK(fewest_face < 20); // from behind
}
