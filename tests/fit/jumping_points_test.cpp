// SPDX-License-Identifier: Apache-2.0
#include <gsh/fit/jumping_points.hpp>

#include "fit/filmed_person.hpp"

#include <doctest/doctest.h>

#include <cstddef>
#include <vector>

using namespace gsh;

namespace {

/// Twenty frames of a stride before one camera.
struct Stride {
    std::vector<Camera<double>> cameras = test::cameras_around(1);
    std::vector<ViewKeypoints> views;
    std::vector<ViewKeypoints*> pointers;

    Stride() {
        const Motion motion = actor_motion(ActorMotion::stride, 20);
        for (const PersonPhoto& photo : test::seen(test::fitted_actor(), motion, cameras, 0.01))
            views.push_back({cameras[0], photo.person.points, photo.person.metric, 0, {}});
        for (ViewKeypoints& view : views) pointers.push_back(&view);
    }
    [[nodiscard]] bool has(std::size_t v, const char* landmark) const {
        for (const Keypoint& point : views[v].points)
            if (point.landmark == landmark_number(landmark)) return true;
        return false;
    }
    [[nodiscard]] std::size_t count() const {
        std::size_t sum = 0;
        for (const ViewKeypoints& view : views) sum += view.points.size();
        return sum;
    }
};

} // namespace

TEST_CASE("points of a body that strides stay, all of them") {
    Stride scene;
    const std::size_t before = scene.count();
    CHECK(drop_jumping_points(scene.pointers) == std::vector<bool>(20, false));
    CHECK(scene.count() == before);
}

TEST_CASE("a point that jumps goes, its neighbours stay") {
    Stride scene;
    for (Keypoint& point : scene.views[9].points)
        if (point.landmark == landmark_number("left_ankle")) point.pixel.y -= 150;
    const std::size_t before = scene.count();
    CHECK(drop_jumping_points(scene.pointers) == std::vector<bool>(20, false));
    CHECK(!scene.has(9, "left_ankle"));
    CHECK((scene.has(9, "right_ankle") && scene.has(8, "left_ankle") && scene.has(10, "left_ankle")));
    CHECK(scene.count() == before - 1);
}

TEST_CASE("where the whole person jumps, in two frames beside each other, nothing of them is believed") {
    Stride scene;
    for (const std::size_t v : {12, 13})
        for (Keypoint& point : scene.views[v].points) point.pixel.y = 200 + 0.3 * (point.pixel.y - 200);
    const auto dropped = drop_jumping_points(scene.pointers);
    for (std::size_t v = 0; v < 20; ++v) {
        CHECK(dropped[v] == (v == 12 || v == 13));
        CHECK(scene.views[v].points.empty() == dropped[v]);
        CHECK(scene.views[v].metric.empty() == dropped[v]);
    }
    std::vector<ViewKeypoints*> few(scene.pointers.begin(), scene.pointers.begin() + 5);
    CHECK(drop_jumping_points(few) == std::vector<bool>(5, false)); // too few to tell
}
