// SPDX-License-Identifier: Apache-2.0
#include <gsh/registration/keypoint_scale.hpp>

#include "support/bodies.hpp"
#include "support/gradient.hpp"

#include <doctest/doctest.h>

#include <cstddef>
#include <vector>

using namespace gsh;

namespace {

/// A person of twelve landmarks in four frames, seen by two cameras, with what a detector finds of it.
struct Seen {
    static constexpr std::size_t frames = 4, count = 12;
    std::vector<Camera<double>> cameras;
    BodyModel body = test::tube(count, 4, 6);
    Motion motion;
    Landmarks marks{}; // every second number is a landmark of this body
    std::vector<MotionLandmarks> posed;

    Seen() {
        test::Rng rng(8);
        for (const double x : {-1.0, 1.5})
            cameras.push_back(look_at<double>({x, 0.3, 3}, {0, 0, 0}, {0, 1, 0}, 0.8, 640, 480));
        motion.joint_count = count;
        motion.pose = rng.vecs(frames * count, -0.7, 0.7);
        motion.transl = rng.vecs(frames, -0.2, 0.2);
        for (std::size_t t = 0; t < frames; ++t) motion.timestamps.push_back(static_cast<double>(t));
        for (Landmark& mark : marks) mark.joint = -1;
        for (std::size_t j = 0; j < count; ++j)
            marks[2 * j] = {static_cast<int>(j), rng.vecs(1, -0.5, 0.5)[0], 0.02};
        posed.emplace_back(body, motion, marks);
    }
    /// Keypoints of camera c are off by up to `noise` pixels, in images `scale` times as large.
    [[nodiscard]] std::vector<PhotoKeypoints> found(std::vector<double> scale, double noise) const {
        test::Rng rng(3);
        std::vector<PhotoKeypoints> result;
        for (std::size_t c = 0; c < cameras.size(); ++c)
            for (std::size_t t = 0; t < frames; ++t) {
                PhotoKeypoints photo{c, t, {{}, {}}};
                for (std::size_t j = 0; j < count; ++j) {
                    const int landmark = static_cast<int>(2 * j);
                    const vec2<double> pixel = to_pixel(cameras[c], to_camera(cameras[c], posed[0].at(t, landmark)));
                    const vec3<double> off = rng.vecs(1, -noise, noise)[0];
                    photo.people[1].points.push_back({landmark, scale[c] * (pixel + vec2<double>(off.x, off.y)), 0.7});
                    photo.people[0].points.push_back({landmark, {off.x + 100, off.y + 50}, 0.9}); // somebody far away
                }
                result.push_back(photo);
            }
        return result;
    }
    [[nodiscard]] auto scales(const std::vector<double>& scale, double noise) const {
        return keypoint_scales(found(scale, noise), cameras, posed);
    }
};

} // namespace

TEST_CASE_FIXTURE(Seen, "keypoints of images of another size are told, camera by camera") {
    for (const double scale : {0.5, 0.75, 2.0, 4.0, 0.01}) {
        const auto found = scales({1, scale}, 10);
        REQUIRE(found.size() == 2);
        CHECK(!found[0]);
        REQUIRE(found[1]);
        CHECK(*found[1] == doctest::Approx(scale).epsilon(0.03));
    }
}

TEST_CASE_FIXTURE(Seen, "keypoints that are off, or few, are of no other size") {
    for (const double noise : {0.0, 30.0, 120.0})
        for (const auto& scale : scales({1, 1}, noise)) CHECK(!scale);
    for (const auto& scale : scales({1.1, 0.9}, 5)) CHECK(!scale);
    auto few = found({2, 2}, 1);
    for (PhotoKeypoints& photo : few)
        for (Detection& person : photo.people) person.points.resize(3);
    for (const auto& scale : keypoint_scales(few, cameras, posed)) CHECK(!scale);
    CHECK(!keypoint_scales({}, cameras, posed)[0]);
    // Landmarks that the body does not have do not count.
    for (Landmark& mark : marks) mark.joint = -1;
    for (const auto& scale : keypoint_scales(found({2, 2}, 1), cameras, {MotionLandmarks(body, motion, marks)}))
        CHECK(!scale);
}
