// SPDX-License-Identifier: Apache-2.0
/// @file  A part of an avatar has everything that belongs to its Gaussians, in its own order, and nothing of others.
#include <gsh/avatar/avatar_part.hpp>
#include <gsh/avatar/still_frames.hpp>
#include <gsh/cpu.hpp>

#include "support/tube_avatar.hpp"

#include <doctest/doctest.h>

#include <cstddef>
#include <cstdint>
#include <vector>

using namespace gsh;

namespace {

/// A tube's Gaussians with random numbers in all their arrays, but for an occlusion field.
AvatarData varied_avatar() {
    AvatarData avatar = test::tube_avatar(2);
    test::Rng rng(6);
    auto& cloud = avatar.gaussians;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        cloud.log_scales[i] = vec3<float>(rng.vec(-5, -3));
        cloud.opacity_logits[i] = static_cast<float>(rng.normal());
        for (std::size_t k = 0; k < 4; ++k) cloud.sh[4 * i + k] = vec3<float>(rng.vec(-0.3, 0.3));
        avatar.ao.push_back(static_cast<float>(rng.uniform(0.5, 1)));
        avatar.mean_irradiance.push_back(static_cast<float>(rng.uniform(0.5, 2)));
    }
    return avatar;
}

AvatarData part_of(const AvatarData& avatar, const std::vector<std::uint32_t>& order) {
    return avatar_part(avatar, Span<const std::uint32_t>(order));
}

/// Every third Gaussian, from the last on.
std::vector<std::uint32_t> every_third(const AvatarData& avatar) {
    std::vector<std::uint32_t> order;
    for (std::size_t i = 0; i < avatar.gaussians.size(); i += 3)
        order.push_back(static_cast<std::uint32_t>(avatar.gaussians.size() - 1 - i));
    return order;
}

/// Row i of the part must be row order[i] of the whole, in an array with rows of `width` elements.
template <class T>
void check_part_rows(const std::vector<T>& part, const std::vector<T>& whole, const std::vector<std::uint32_t>& order,
                     std::size_t width = 1) {
    REQUIRE(part.size() == order.size() * width);
    for (std::size_t i = 0; i < part.size(); ++i) CHECK(part[i] == whole[order[i / width] * width + i % width]);
}

} // namespace

TEST_CASE("a part of an avatar has the rows of its list in every array of Gaussians") {
    AvatarData avatar = varied_avatar();
    avatar.occlusion_field.emplace();
    avatar.occlusion_field->width = 3;
    avatar.occlusion_field->pose_weights = {0.5f, 1.5f};
    for (std::size_t k = 0; k < 3 * avatar.gaussians.size(); ++k)
        avatar.occlusion_field->neurons.push_back(static_cast<float>(k));
    REQUIRE(avatar.rig.skin.influences > 1);
    std::vector<std::uint32_t> order = every_third(avatar);
    order.push_back(order.front()); // a Gaussian may occur twice
    const AvatarData part = part_of(avatar, order);
    check_part_rows(part.gaussians.means, avatar.gaussians.means, order);
    check_part_rows(part.gaussians.sh, avatar.gaussians.sh, order, 4);
    check_part_rows(part.rig.triangles, avatar.rig.triangles, order);
    check_part_rows(part.rig.barycentric, avatar.rig.barycentric, order);
    check_part_rows(part.rig.skin.joints, avatar.rig.skin.joints, order, avatar.rig.skin.influences);
    check_part_rows(part.rig.skin.weights, avatar.rig.skin.weights, order, avatar.rig.skin.influences);
    check_part_rows(part.ao, avatar.ao, order);
    check_part_rows(part.mean_irradiance, avatar.mean_irradiance, order);
    check_part_rows(part.occlusion_field->neurons, avatar.occlusion_field->neurons, order, 3);
    CHECK(part.occlusion_field->pose_weights == avatar.occlusion_field->pose_weights); // what all share stays
    CHECK(part.rig.joints == avatar.rig.joints);
    CHECK(part.rig.body.v_template == avatar.rig.body.v_template);
}

TEST_CASE("a part is posed as in the whole") {
    const AvatarData avatar = varied_avatar();
    Motion motion = rest_motion(avatar.rig);
    for (std::size_t j = 0; j < 4; ++j) motion.pose[j] = vec3<double>(0.5, 0.1 * static_cast<double>(j), 0.2);
    motion.transl = {{0.2, 0.2, 0}};
    const std::vector<std::uint32_t> order = every_third(avatar);
    const AvatarData part = part_of(avatar, order);
    cpu::Threads backend(2);
    StillFrames<cpu::Threads> whole(backend, avatar), some(backend, part);
    const GaussianCloud<float> all = whole.frame(motion, 0), found = some.frame(motion, 0);
    REQUIRE(found.size() == order.size());
    for (std::size_t i = 0; i < order.size(); ++i) {
        CHECK(length(found.means[i] - all.means[order[i]]) < 1e-6f);
        CHECK(found.sh[4 * i] == all.sh[4 * order[i]]);
    }
}

TEST_CASE("a part may be empty, arrays that an avatar does not have stay so, and beyond its Gaussians there are none") {
    AvatarData avatar = varied_avatar();
    const AvatarData none = part_of(avatar, {});
    CHECK(none.gaussians.size() == 0);
    CHECK(none.rig.point_count() == 0);
    CHECK(none.rig.skin.size() == 0);
    CHECK(none.ao.empty());
    avatar.ao.clear(), avatar.mean_irradiance.clear();
    const AvatarData plain = part_of(avatar, {2, 1});
    CHECK(plain.gaussians.size() == 2);
    CHECK(plain.ao.empty());
    CHECK(plain.mean_irradiance.empty());
    CHECK(!plain.occlusion_field);
    CHECK_THROWS_WITH_AS((void)part_of(avatar, {0, static_cast<std::uint32_t>(avatar.gaussians.size())}),
                         "reordered: an index is beyond the cloud", ValueError);
}
