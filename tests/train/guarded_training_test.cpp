// SPDX-License-Identifier: Apache-2.0
/// @file  Training, refinement, pose fitting and rendering on a backend whose buffers the host cannot access. A host
///        read would crash, and every number equals that of the reference backend.
#include <gsh/backend/serial.hpp>

#include <doctest/doctest.h>

#include "support/guarded.hpp"
#include "support/small_runs.hpp"

#include <cstddef>
#include <cstdint>

namespace guarded_training { // joined builds: other tests have helpers of the same names

using namespace gsh;
using namespace test;

namespace {

void check_equal(const Outcome& found, const Outcome& expected) {
    REQUIRE(found.pictures.size() == expected.pictures.size());
    for (std::size_t i = 0; i < found.pictures.size(); ++i) {
        CAPTURE(i);
        CHECK(found.pictures[i].data == expected.pictures[i].data);
    }
    CHECK(found.losses == expected.losses);
    CHECK(found.learned == expected.learned);
}

} // namespace

TEST_CASE("an avatar trains without the host touching the backend's memory") {
    const SmallScene scene;
    for (const char* ao : {AmbientOcclusion::time, AmbientOcclusion::pose}) {
        CAPTURE(ao);
        check_equal(train_avatar<Guarded>(scene, {.ao = ao}), train_avatar<cpu::Serial>(scene, {.ao = ao}));
    }
}

TEST_CASE("so it does with photographs that are brought for their step") {
    const SmallScene scene;
    for (const std::uint64_t budget : {std::uint64_t(1), std::uint64_t(2 * scene.photos[0].rgba.size())}) {
        CAPTURE(budget);
        check_equal(train_avatar<Guarded>(scene, {.ao = AmbientOcclusion::none}, 6, with_photo_memory(budget)),
                    train_avatar<cpu::Serial>(scene, {.ao = AmbientOcclusion::none}, 6));
    }
}

TEST_CASE("so do stored attributes, separate heads and dual quaternions") {
    const SmallScene scene;
    const ConfiguredAvatarParams stored{
        .hash_displacement = false, .hash_sh = false, .model = {.deformation = Deformation::polar}};
    check_equal(train_avatar<Guarded>(scene, stored), train_avatar<cpu::Serial>(scene, stored));
    const ConfiguredAvatarParams separate{
        .heads = Heads::separate, .head_time = true, .model = {.deformation = Deformation::dual_quaternion}};
    check_equal(train_avatar<Guarded>(scene, separate), train_avatar<cpu::Serial>(scene, separate));
}

TEST_CASE("so does an avatar in a light, with its poses, and so is it shown") {
    const SmallScene small;
    check_equal(train_lit<Guarded>(small), train_lit<cpu::Serial>(small));
    const PosedScene scene;
    AvatarData avatar = scene.avatar;
    avatar.light = even_light(2, 3, {0, 0.8, 0}, 3);
    check_equal(show<Guarded>(scene, avatar), show<cpu::Serial>(scene, avatar));
}

TEST_CASE("so do a static scene and its density control") {
    const SmallScene scene;
    check_equal(train_static<Guarded>(scene, 20), train_static<cpu::Serial>(scene, 20));
}

TEST_CASE("so do poses, shape and cameras") {
    const SmallScene scene;
    check_equal(train_refined<Guarded>(scene), train_refined<cpu::Serial>(scene));
}

TEST_CASE("so is a pose fitted") {
    const PosedScene scene;
    check_equal(fit_pose<Guarded>(scene), fit_pose<cpu::Serial>(scene));
}

TEST_CASE("so is an avatar posed and rendered, with shadows that follow the pose") {
    const PosedScene scene;
    check_equal(show<Guarded>(scene, scene.avatar), show<cpu::Serial>(scene, scene.avatar));

    const SmallScene small;
    SmallTraining<cpu::Serial> training(small, cpu::Serial(), 3, {.ao = AmbientOcclusion::pose});
    for (int step = 0; step < 3; ++step) training.trainer.step(0.5);
    const AvatarData avatar = training.exported();
    REQUIRE(avatar.occlusion_field.has_value());
    check_equal(show<Guarded>(scene, avatar), show<cpu::Serial>(scene, avatar));
}

} // namespace guarded_training
