// SPDX-License-Identifier: Apache-2.0
#include <gsh/avatar/avatar.hpp>
#include <gsh/avatar/light_place.hpp>
#include <gsh/body/moved_motion.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/cpu.hpp>

#include "support/bodies.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace gsh {
namespace {

constexpr double right_angle = 1.5707963267948966;

/// A lit tube that bends and walks a little, in front of `far` metres of x.
struct LitWalk {
    AvatarData avatar;
    Motion motion;

    LitWalk() {
        const BodyModel body = test::tube(4, 6, 6);
        const auto samples = sample_surface(body, body.v_template, std::vector<double>(body.vertex_count(), 2.0), 3);
        avatar = {.rig = make_rig(body, {}, samples), .gaussians = GaussianCloud<float>(samples.size(), 2)};
        test::Rng rng(6);
        for (std::size_t i = 0; i < samples.size(); ++i) {
            avatar.gaussians.means[i] = vec3<float>(samples.positions[i]);
            avatar.gaussians.log_scales[i] = vec3<float>(-4);
        }
        for (auto& value : avatar.gaussians.sh) value = vec3<float>(rng.vec(-0.3, 0.3));
        avatar.light = even_light(2, 3, {0, 0.5, 0}, 2);
        avatar.light->shadows = false; // the texels of a shadow map lie along the world's axes
        for (double& number : avatar.light->log_intensities) number += rng.uniform(-2, 0);

        motion.joint_count = body.joint_count();
        for (int t = 0; t < 3; ++t) {
            motion.timestamps.push_back(t);
            motion.transl.push_back({0.1 * t, 0, 0.05 * t});
            for (std::size_t j = 0; j < body.joint_count(); ++j) motion.pose.push_back(rng.vec(-0.2, 0.2));
        }
        avatar.light_place = place_of(motion, avatar.rig.joints[0]);
    }

    /// Colours at the last frame of a motion, seen from `center`, in the light at that motion's place.
    [[nodiscard]] std::vector<vec3<float>> colors(const Motion& shown, const vec3<double>& center) const {
        cpu::Serial backend;
        AvatarData data = avatar;
        data.light = light_at(*data.light, avatar.light_place, place_of(shown, data.rig.joints[0]));
        const Avatar<cpu::Serial> lit(backend, data);
        Avatar<cpu::Serial>::Cache cache;
        RigPose<cpu::Serial> pose;
        lit.rig().upload_pose(shown, 2, pose);
        Splats<cpu::Serial> splats;
        splats.resize(lit.size());
        lit.pose(pose, vec3<float>(center), splats.view(), cache);
        return {splats.colors.begin(), splats.colors.end()};
    }
    /// The motion in a world that is turned and shifted.
    [[nodiscard]] Motion moved(const Affine<double>& new_from_old) const {
        Motion result = motion;
        for (std::size_t t = 0; t < 3; ++t) move_frame(avatar.rig.body, result, t, new_from_old);
        return result;
    }
};

double light_difference(const std::vector<vec3<float>>& a, const std::vector<vec3<float>>& b) {
    double most = 0;
    for (std::size_t i = 0; i < a.size(); ++i)
        for (int c = 0; c < 3; ++c) most = std::max(most, static_cast<double>(std::abs(a[i][c] - b[i][c])));
    return most;
}

TEST_CASE("an avatar looks the same when its motion's world has another vertical axis or is elsewhere") {
    const LitWalk walk;
    const vec3<double> center(0.5, 1, 3);
    const auto expected = walk.colors(walk.motion, center);
    for (const vec3<double>& turn : {vec3<double>(right_angle, 0, 0), vec3<double>(-right_angle, 0, 0),
                                     vec3<double>(2 * right_angle, 0, 0), vec3<double>(0, 0, right_angle)})
        for (const vec3<double>& shift : {vec3<double>(0), vec3<double>(6, -5, 20)}) {
            const Affine<double> change{rotation_from_axis_angle(turn), shift};
            CHECK(light_difference(walk.colors(walk.moved(change), change(center)), expected) < 2e-4);
        }
    // A light that stayed would be another one.
    LitWalk fixed = walk;
    fixed.avatar.light_place.upright.reset();
    const Affine<double> over{rotation_from_axis_angle(vec3<double>(2 * right_angle, 0, 0)), vec3<double>(0)};
    CHECK(light_difference(fixed.colors(fixed.moved(over), over(center)), expected) > 0.02);
}

TEST_CASE("a light stays where it was for a motion in the place of the capture") {
    const LitWalk walk;
    const MotionPlace& place = walk.avatar.light_place;
    CHECK(light_at(*walk.avatar.light, place, place).points == walk.avatar.light->points);
    CHECK(place.high - place.low == vec3<double>(0.2, 0, 0.1));
    // Up to a metre beside the box is the same place; farther, the middle of the box moves to that of the other.
    for (const double gap : {0.99, 1.01}) {
        const MotionPlace beside{place.upright, {place.high.x + gap, 0, 0}, {place.high.x + gap + 0.6, 0, 0}};
        const LightData light = light_at(*walk.avatar.light, place, beside);
        CHECK(light.directions == walk.avatar.light->directions);
        const vec3<double> shift = light.points[1] - walk.avatar.light->points[1];
        const vec3<double> expected =
            gap < 1 ? vec3<double>(0) : (beside.low + beside.high - place.low - place.high) * 0.5;
        CHECK(length(shift - expected) < 1e-12);
    }
    CHECK_THROWS_AS((void)place_of(walk.motion, {0, 0, 0}, std::vector<std::size_t>{3}), ValueError);
    CHECK_THROWS_AS((void)place_of(Motion{}, {0, 0, 0}), ValueError);
}

} // namespace
} // namespace gsh
