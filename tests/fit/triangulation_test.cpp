// SPDX-License-Identifier: Apache-2.0
#include <gsh/fit/triangulation.hpp>

#include "fit/filmed_person.hpp"

#include <gsh/fit/side_swaps.hpp>

#include <doctest/doctest.h>

#include <cstddef>
#include <vector>

using namespace gsh;

TEST_CASE("rays of several views meet where the point is; one that misses is left aside") {
    const auto cameras = test::cameras_around(4);
    const vec3<double> point(0.3, 1.2, -0.2);
    std::vector<SightLine> lines;
    for (const auto& camera : cameras) lines.push_back({&camera, to_pixel(camera, to_camera(camera, point)), 0.8});
    const auto exact = triangulate(lines);
    REQUIRE(exact);
    CHECK(length(exact->position - point) < 1e-9);
    CHECK(exact->distance < 1e-9);
    lines[2].pixel.x += 60;
    const auto robust = triangulate(lines);
    CHECK(length(robust->position - point) < 0.01);
    CHECK(robust->distance > 0.05); // of which all is the one view's
    CHECK(!triangulate(Span<const SightLine>(lines).subspan(0, 1)));
    const std::vector<SightLine> parallel{lines[0], lines[0]};
    CHECK(!triangulate(parallel));
}

TEST_CASE("of several views, those that contradict the others are swapped") {
    const Motion motion = actor_motion(ActorMotion::stride, 1);
    for (const std::size_t count : {3, 4, 8}) { // beyond six, views are tried one after the other
        const auto cameras = test::cameras_around(count);
        std::vector<ViewKeypoints> views;
        for (const PersonPhoto& photo : test::seen(test::fitted_actor(), motion, cameras, 0.01))
            views.push_back({cameras[photo.camera], photo.person.points, photo.person.metric, photo.camera, {}});
        const auto none = swap_contradicting_sides(views);
        CHECK(none == std::vector<bool>(count, false));
        const auto before = views;
        std::vector<bool> expected(count, false);
        for (const std::size_t v : {count - 1, std::size_t(0)}) {
            if (count < 8 && v == 0) continue; // fewer than half of the views, so that the others outvote them
            swap_sides(views[v]), expected[v] = true;
        }
        CHECK(swap_contradicting_sides(views) == expected);
        for (std::size_t v = 0; v < count; ++v)
            for (std::size_t k = 0; k < views[v].points.size(); ++k)
                CHECK(views[v].points[k].landmark == before[v].points[k].landmark);
    }
    std::vector<ViewKeypoints> empty;
    CHECK(swap_contradicting_sides(empty).empty());
}

TEST_CASE("in one camera's frames, a swap that jumps is undone, and stays undone while the person turns") {
    Motion motion = actor_motion(ActorMotion::talk, 24);
    for (std::size_t t = 0; t < 24; ++t) motion.pose[55 * t] = vec3<double>(0, 0.26 * static_cast<double>(t), 0);
    const auto cameras = test::cameras_around(1);
    std::vector<ViewKeypoints> views;
    for (const PersonPhoto& photo : test::seen(test::fitted_actor(), motion, cameras, 0.005))
        views.push_back({cameras[0], photo.person.points, {}, 0, {}});
    std::vector<ViewKeypoints*> pointers;
    for (ViewKeypoints& view : views) pointers.push_back(&view);
    CHECK(swap_jumping_sides(pointers) == std::vector<bool>(24, false));
    std::vector<bool> expected(24, false);
    for (const std::size_t t : {2, 3, 10, 22, 23}) swap_sides(views[t]), expected[t] = true;
    CHECK(swap_jumping_sides(pointers) == expected);
    CHECK(swap_jumping_sides(pointers) == std::vector<bool>(24, false));
}
