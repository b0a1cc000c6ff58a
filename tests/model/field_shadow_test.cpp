// SPDX-License-Identifier: Apache-2.0
#include <gsh/model/field_shadow.hpp>

#include "support/shadow_probe.hpp"

#include <cmath>
#include <cstddef>
#include <vector>

using namespace gsh;

namespace {

template <class B>
using TimePolicy = TimeShadow<B, double, 3, 2>;
template <class B>
using PosePolicy = PoseShadow<B, double, 3, 2>;
template <class B>
using ShadowTube = test::ShadowScene<B>;

static_assert(ShadowPolicy<TimePolicy<cpu::Serial>, cpu::Serial, double>);
static_assert(ShadowPolicy<PosePolicy<cpu::Threads>, cpu::Threads, double>);

template <class B>
TimePolicy<B> time_shadow(ShadowTube<B>& scene) {
    return {scene.backend, scene.points, ShadowTube<B>::frames, ShadowTube<B>::params()};
}
template <class B>
PosePolicy<B> pose_shadow(ShadowTube<B>& scene) {
    return {scene.backend, scene.points, scene.pose_feature_count(), ShadowTube<B>::params()};
}

std::vector<vec3<double>> zero_pose() {
    return std::vector<vec3<double>>(4, vec3<double>(0.0));
}
Span<double> pose_numbers(auto& pose) {
    return {&pose[0].x, 3 * pose.size()};
}

/// Checks gradients against central differences, that a second pass adds, and threads. make(scene) is the shadow.
template <class Make>
void check_shadow(const Make& make) {
    ShadowTube<cpu::Serial> scene;
    auto shadow = make(scene);
    test::randomize(shadow);
    auto dL_dpose = zero_pose();
    scene.backward(shadow, dL_dpose);
    const auto loss = [&] { return scene.loss(shadow); };
    test::check_learned_gradients(shadow, loss);
    test::check_gradient(loss, pose_numbers(scene.pose.pose), test::scalars(dL_dpose),
                         {.may_vanish = !shadow.follows_pose()});
    const auto once = test::learned_gradients(shadow), ao = scene.ao_of(shadow);
    const auto once_pose = dL_dpose;
    scene.backward(shadow, dL_dpose);
    test::check_doubled(once, test::learned_gradients(shadow));
    for (std::size_t j = 0; j < 4; ++j) CHECK(length(dL_dpose[j] - 2.0 * once_pose[j]) < 1e-12);
    for (const std::size_t count : {1, 3}) {
        ShadowTube<cpu::Threads> there{cpu::Threads(count)};
        auto threaded = make(there);
        test::randomize(threaded);
        auto dL_dpose_there = zero_pose();
        there.backward(threaded, dL_dpose_there);
        CHECK(there.ao_of(threaded) == ao);
        CHECK(test::learned_gradients(threaded) == once);
        CHECK(dL_dpose_there == once_pose);
    }
}

} // namespace

TEST_CASE("a shadow over the time has the gradient of its ambient occlusion, and none with respect to the pose") {
    check_shadow([](auto& scene) { return time_shadow(scene); });
    ShadowTube<cpu::Serial> scene;
    auto shadow = time_shadow(scene);
    test::randomize(shadow);
    auto dL_dpose = zero_pose();
    scene.backward(shadow, dL_dpose);
    scene.backward_to_pose(shadow, dL_dpose);
    CHECK(dL_dpose == zero_pose());
    CHECK(shadow.casts());
    CHECK(!shadow.follows_pose());
    CHECK(!baked_field(shadow));
    CHECK(scene.ao_of(shadow, 1) != scene.ao_of(shadow, 2));
    CHECK_THROWS_AS((void)scene.ao_of(shadow, 5), ValueError);
}

TEST_CASE("a shadow over the pose has the gradient of its ambient occlusion, with respect to the pose, too") {
    check_shadow([](auto& scene) { return pose_shadow(scene); });
    ShadowTube<cpu::Serial> scene;
    auto shadow = pose_shadow(scene);
    test::randomize(shadow);
    CHECK(shadow.casts());
    CHECK(shadow.follows_pose());
    CHECK(scene.ao_of(shadow, 1) == scene.ao_of(shadow, 2)); // ao does not depend on the frame
    auto dL_dpose = zero_pose(), alone = zero_pose();
    scene.backward(shadow, dL_dpose);
    double largest = 0;
    for (const auto& g : dL_dpose) largest = std::max(largest, length(g));
    CHECK(largest > 1e-3);
    test::zero_gradients(scene.backend, shadow);
    scene.backward_to_pose(shadow, alone);
    CHECK(alone == dL_dpose);
    for (const double g : test::learned_gradients(shadow)) CHECK(g == 0); // the shadow does not learn
    scene.backward(shadow, {});                                           // without a gradient of the pose
    test::check_learned_gradients(shadow, [&] { return scene.loss(shadow); });
}

TEST_CASE("shadows that follow the pose read the joints' rotations, all but the root's") {
    ShadowTube<cpu::Serial> scene;
    auto shadow = pose_shadow(scene);
    (void)scene.ao_of(shadow);
    const Span<const double> feature = shadow.feature();
    REQUIRE(feature.size() == 9 * 3);
    for (std::size_t j = 1; j < 4; ++j) {
        const mat3<double> R = rotation_from_axis_angle(scene.pose.pose[j]);
        double difference = 0, size = 0; // of R - I
        for (std::size_t k = 0; k < 9; ++k) {
            const double entry = R[static_cast<int>(k % 3)][static_cast<int>(k / 3)], here = feature[9 * (j - 1) + k];
            difference += std::abs(here - (entry - (k % 4 == 0 ? 1 : 0)));
            size += std::abs(here);
        }
        CHECK(difference < 1e-5);
        CHECK(size > 0.1);
    }
}

TEST_CASE("shadows start the same everywhere, and as they were asked to") {
    ShadowTube<cpu::Serial> scene;
    auto time = time_shadow(scene);
    auto pose = pose_shadow(scene);
    for (const double ao : scene.ao_of(time)) CHECK(ao == doctest::Approx(0.9));
    for (const double ao : scene.ao_of(pose)) CHECK(ao == doctest::Approx(0.9));
    CHECK(test::learned_array(pose, "shadow_field.table").rate == 5e-3);
    CHECK(test::learned_array(pose, "shadow_field.network").rate == 5e-3);
}

TEST_CASE("shadows stay below the largest, and settings that cannot be are refused") {
    ShadowTube<cpu::Serial> scene;
    auto shadow = pose_shadow(scene);
    for (double& weight : test::learned_array(shadow, "shadow_field.network").values) weight *= 1e3;
    for (double& weight : test::learned_array(shadow, "shadow_field.table").values) weight *= 1e5;
    for (const double ao : scene.ao_of(shadow)) CHECK((ao >= 0 && ao <= 1.7));
    for (const double initial : {0.0, -1.0, 1.7, 2.0}) {
        auto params = ShadowTube<cpu::Serial>::params();
        params.initial = initial;
        CHECK_THROWS_AS(TimePolicy<cpu::Serial>(scene.backend, scene.points, 5, params), ValueError);
        CHECK_THROWS_AS(PosePolicy<cpu::Serial>(scene.backend, scene.points, 27, params), ValueError);
    }
}

TEST_CASE("a baked shadow is kept in float, and not where its network is a single matrix") {
    cpu::Serial backend;
    test::Rng rng(2);
    const auto positions = rng.vecs(11);
    const CanonicalPoints<cpu::Serial> points(backend, Span<const vec3<double>>(positions));
    FieldShadowParams params = ShadowTube<cpu::Serial>::params();
    const PoseShadow<cpu::Serial, float, 3, 2> shadow(backend, points, 27, params);
    REQUIRE(shadow.baked());
    CHECK(shadow.baked()->largest == doctest::Approx(1.7));
    params.field.hidden_layers = 0;
    CHECK(!PoseShadow<cpu::Serial, float, 3, 2>(backend, points, 27, params).baked());
    ShadowTube<cpu::Serial> scene;
    CHECK(!pose_shadow(scene).baked()); // fields in double are not baked
}
