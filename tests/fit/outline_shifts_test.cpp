// SPDX-License-Identifier: Apache-2.0
#include <gsh/fit/outline_shifts.hpp>

#include "fit/filmed_person.hpp"

#include <gsh/fit/pose_axes.hpp>
#include <gsh/math/rotation.hpp>

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

using namespace gsh;

namespace {

/// A body in six frames that turns a little, and its masks in two cameras, which have moved by `shifts`.
struct FilmedTurn {
    const BodyModel& model = test::fitted_actor();
    FittedBody body{model, 2};
    OutlineSamples samples{model, body};
    MotionState state;
    std::vector<Camera<double>> cameras = test::cameras_around(2);
    std::vector<Image<std::uint8_t>> masks;
    std::vector<std::vector<ViewKeypoints>> views{6};

    explicit FilmedTurn(const std::vector<vec2<double>>& shifts) {
        state.betas = {0, 0};
        Motion motion;
        motion.joint_count = model.joint_count();
        motion.betas.assign(static_cast<std::size_t>(model.shape_count), 0.0);
        std::vector<PersonPhoto> photos;
        for (std::size_t t = 0; t < 6; ++t) {
            FrameNumbers frame{.transl = vec3<double>(0), .angles = {}};
            frame.root = rotation_from_axis_angle(vec3<double>(0, 0.2 * static_cast<double>(t), 0));
            for (const PoseAxis& axis : body.axes) frame.angles.push_back(axis.mean);
            std::vector<vec3<double>> pose = body.pose(frame.angles);
            pose[0] = axis_angle_from_rotation(frame.root);
            motion.pose.insert(motion.pose.end(), pose.begin(), pose.end());
            motion.transl.push_back(frame.transl);
            motion.timestamps.push_back(static_cast<double>(t));
            state.frames.push_back(frame);
            for (std::size_t c = 0; c < 2; ++c) photos.push_back({c, t, {}, {}});
        }
        auto moved = cameras;
        for (std::size_t c = 0; c < 2; ++c) moved[c].cx += shifts[c].x, moved[c].cy += shifts[c].y;
        masks = test::masks_of(model, motion, moved, photos);
        for (std::size_t i = 0; i < photos.size(); ++i)
            views[photos[i].frame].push_back({cameras[photos[i].camera],
                                              {},
                                              {},
                                              photos[i].camera,
                                              {masks[i].height, masks[i].width, masks[i].data.data()}});
    }
    [[nodiscard]] std::vector<OutlineShift> find(std::size_t camera_count = 2) const {
        return outline_shifts(body, samples, state, views, camera_count);
    }
};

} // namespace

TEST_CASE("outlines of masks tell by how much each camera has moved, to a tenth of a pixel") {
    const std::vector<vec2<double>> shifts{{2.4, -1.3}, {-2.4, 1.3}};
    const auto found = FilmedTurn(shifts).find();
    for (std::size_t c = 0; c < 2; ++c) {
        CAPTURE(c);
        CHECK(std::abs(found[c].shift.x - shifts[c].x) < 0.15);
        CHECK(std::abs(found[c].shift.y - shifts[c].y) < 0.15);
        CHECK(std::max(found[c].error.x, found[c].error.y) < 0.1);
    }
}

TEST_CASE("things beside the person, and a mask that is larger all around, move cameras by little") {
    const std::vector<vec2<double>> shifts{{0.5, 0}, {-0.5, 0}};
    FilmedTurn scene(shifts);
    for (std::size_t i = 0; i < scene.masks.size(); ++i) {
        Image<std::uint8_t>& mask = scene.masks[i];
        const auto before = mask.data;
        const auto width = static_cast<std::size_t>(mask.width);
        for (std::size_t k = width + 1; k + width + 1 < mask.data.size(); ++k)
            mask.data[k] = std::max({before[k], before[k - 1], before[k + 1], before[k - width], before[k + width]});
        for (std::size_t k = 0; k < mask.data.size() / 2; ++k) // a thing to the left of the head and the arm
            if (k % width < width * 45 / 100) mask.data[k] = 255;
    }
    const auto found = scene.find();
    for (std::size_t c = 0; c < 2; ++c) {
        CAPTURE(c);
        CHECK(std::abs(found[c].shift.x - shifts[c].x) < 0.5);
        CHECK(std::abs(found[c].shift.y - shifts[c].y) < 0.5);
    }
}

TEST_CASE("without masks, or with few, no camera has a shift, and its error is large") {
    FilmedTurn scene({{1, 0}, {-1, 0}});
    for (std::size_t t = 0; t < 2; ++t) scene.views[t][1].mask = {};
    const auto found = scene.find(3);
    CHECK(found[0].shift == vec2<double>(0)); // it has no other to differ from
    CHECK(found[0].error.x < 1);
    for (const std::size_t c : {1, 2}) {
        CHECK(found[c].shift == vec2<double>(0));
        CHECK(found[c].error.x > 1e6);
    }
}
