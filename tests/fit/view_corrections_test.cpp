// SPDX-License-Identifier: Apache-2.0
#include <gsh/fit/view_corrections.hpp>

#include "fit/filmed_person.hpp"

#include <gsh/fit/view_misfit.hpp>

#include <doctest/doctest.h>

#include <cstddef>
#include <optional>
#include <vector>

using namespace gsh;

namespace {

/// The views of twelve frames of a stride, and where its landmarks are.
struct FilmedStride {
    Motion motion = actor_motion(ActorMotion::stride, 12);
    std::vector<Camera<double>> cameras;
    std::vector<std::vector<ViewKeypoints>> views{12};
    MotionLandmarks places{test::fitted_actor(), motion, landmarks_of(test::fitted_actor())};

    explicit FilmedStride(std::size_t camera_count) : cameras(test::cameras_around(camera_count)) {
        for (const PersonPhoto& photo : test::seen(test::fitted_actor(), motion, cameras, 0.01))
            views[photo.frame].push_back(
                {cameras[photo.camera], photo.person.points, photo.person.metric, photo.camera, {}});
    }
    [[nodiscard]] auto place() const {
        return [this](std::size_t frame) {
            return [this, frame](int landmark) -> std::optional<vec3<double>> {
                if (!places.has(landmark)) return std::nullopt;
                return places.at(frame, landmark);
            };
        };
    }
    /// The mean distance of all keypoints from their landmarks, metres.
    [[nodiscard]] double misfit() const {
        double sum = 0, count = 0;
        for (std::size_t t = 0; t < views.size(); ++t)
            for (const ViewKeypoints& view : views[t]) {
                const ViewMisfit of = view_misfit(view, place()(t));
                for (const double metres : of.metres) sum += metres, ++count;
            }
        return sum / count;
    }
};

} // namespace

TEST_CASE("sides are corrected, by other cameras where there are some, else by the frames beside, and jumps go") {
    FilmedStride scene(3);
    const double right = scene.misfit();
    CHECK(right < 0.02);
    swap_sides(scene.views[4][2]);
    scene.views[8].erase(scene.views[8].begin() + 1, scene.views[8].end()); // only the first camera sees frames 6 to 10
    for (const std::size_t t : {6, 7, 9, 10}) scene.views[t] = {scene.views[t][0]};
    swap_sides(scene.views[8][0]);
    for (Keypoint& point : scene.views[2][1].points) point.pixel = {point.pixel.x, 200 + 0.3 * (point.pixel.y - 200)};
    const ViewCorrections found = correct_views(scene.views, 3);
    CHECK(found.swapped == ViewPlaces{{2, 4}, {0, 8}});
    CHECK(found.left_out == ViewPlaces{{1, 2}});
    CHECK(scene.misfit() < 1.1 * right);
}

TEST_CASE("a motion tells which views are swapped, even most of them; a second look swaps none") {
    FilmedStride scene(2);
    const double right = scene.misfit();
    for (const std::size_t t : {0, 1, 2, 3, 4, 5, 6, 9})
        for (ViewKeypoints& view : scene.views[t]) swap_sides(view);
    CHECK(scene.misfit() > 0.05);
    ViewPlaces swapped{{1, 3}}; // a swap that was wrong is taken back
    CHECK(swap_sides_against_motion(scene.views, scene.place(), swapped));
    CHECK(scene.misfit() == doctest::Approx(right));
    CHECK(swapped.size() == 15);
    for (const auto& [camera, frame] : swapped) CHECK((frame != 3 || camera == 0));
    CHECK(!swap_sides_against_motion(scene.views, scene.place(), swapped));
    CHECK(swapped.size() == 15);
}

TEST_CASE("guesses do not tell sides, nor do a few points") {
    FilmedStride scene(1);
    ViewKeypoints view = scene.views[0][0];
    swap_sides(view);
    CHECK(view_misfit(view, scene.place()(0)).contradicts_sides());
    ViewKeypoints guessed = view, few = view;
    for (Keypoint& point : guessed.points) point.confidence = 0.4;
    few.points.resize(5);
    CHECK(view_misfit(guessed, scene.place()(0)).metres.empty());
    CHECK(!view_misfit(guessed, scene.place()(0)).contradicts_sides());
    CHECK(!view_misfit(few, scene.place()(0)).contradicts_sides());
}
