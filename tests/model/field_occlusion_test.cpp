// SPDX-License-Identifier: Apache-2.0
#include <gsh/model/field_occlusion.hpp>

#include "support/occlusion_probe.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

using namespace gsh;

namespace {

template <class B>
using TimePolicy = TimeOcclusion<B, double, 3, 2>;
template <class B>
using PosePolicy = PoseOcclusion<B, double, 3, 2>;
template <class B>
using OcclusionTube = test::OcclusionScene<B>;

static_assert(OcclusionPolicy<TimePolicy<cpu::Serial>, cpu::Serial, double>);
static_assert(OcclusionPolicy<PosePolicy<cpu::Threads>, cpu::Threads, double>);

template <class B>
TimePolicy<B> time_occlusion(OcclusionTube<B>& scene) {
    return {scene.backend, scene.points, OcclusionTube<B>::frames, OcclusionTube<B>::params()};
}
/// The same, evaluated at every fourth point.
template <class B>
TimePolicy<B> interpolated_occlusion(OcclusionTube<B>& scene) {
    FieldOcclusionParams params = OcclusionTube<B>::params();
    params.most_points = static_cast<int>((scene.size() + 3) / 4);
    return {scene.backend, scene.points, OcclusionTube<B>::frames, params};
}
template <class B>
PosePolicy<B> pose_occlusion(OcclusionTube<B>& scene) {
    return {scene.backend, scene.points, scene.pose_feature_count(), OcclusionTube<B>::params()};
}

std::vector<vec3<double>> zero_pose() {
    return std::vector<vec3<double>>(4, vec3<double>(0.0));
}
Span<double> pose_numbers(auto& pose) {
    return {&pose[0].x, 3 * pose.size()};
}

/// Checks gradients against central differences, that a second pass adds, and threads. make(scene) is the policy.
template <class Make>
void check_occlusion(const Make& make) {
    OcclusionTube<cpu::Serial> scene;
    auto occlusion = make(scene);
    test::randomize(occlusion);
    auto dL_dpose = zero_pose();
    scene.backward(occlusion, dL_dpose);
    const auto loss = [&] { return scene.loss(occlusion); };
    test::check_learned_gradients(occlusion, loss);
    test::check_gradient(loss, pose_numbers(scene.pose.pose), test::scalars(dL_dpose),
                         {.may_vanish = !occlusion.follows_pose()});
    const auto once = test::learned_gradients(occlusion), ao = scene.ao_of(occlusion);
    const auto once_pose = dL_dpose;
    scene.backward(occlusion, dL_dpose);
    test::check_doubled(once, test::learned_gradients(occlusion));
    for (std::size_t j = 0; j < 4; ++j) CHECK(length(dL_dpose[j] - 2.0 * once_pose[j]) < 1e-12);
    for (const std::size_t count : {1, 3}) {
        OcclusionTube<cpu::Threads> there{cpu::Threads(count)};
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

TEST_CASE("ambient occlusion over the time has its gradient, and none with respect to the pose") {
    check_occlusion([](auto& scene) { return time_occlusion(scene); });
    OcclusionTube<cpu::Serial> scene;
    auto occlusion = time_occlusion(scene);
    test::randomize(occlusion);
    auto dL_dpose = zero_pose();
    scene.backward(occlusion, dL_dpose);
    scene.backward_to_pose(occlusion, dL_dpose);
    CHECK(dL_dpose == zero_pose());
    CHECK(occlusion.occludes());
    CHECK(!occlusion.follows_pose());
    CHECK(!baked_field(occlusion));
    CHECK(scene.ao_of(occlusion, 1) != scene.ao_of(occlusion, 2));
    CHECK_THROWS_AS((void)scene.ao_of(occlusion, 5), ValueError);
}

TEST_CASE("ambient occlusion that is interpolated has its gradient, and keeps the values of a part of the points") {
    check_occlusion([](auto& scene) { return interpolated_occlusion(scene); });
    OcclusionTube<cpu::Serial> scene;
    auto everywhere = time_occlusion(scene), interpolated = interpolated_occlusion(scene);
    test::randomize(everywhere), test::randomize(interpolated);
    const std::vector<double> expected = scene.ao_of(everywhere), found = scene.ao_of(interpolated);
    double largest = 0;
    for (std::size_t i = 0; i < found.size(); ++i) {
        if (i % 4 == 0) CHECK(found[i] == doctest::Approx(expected[i]).epsilon(1e-12));
        else largest = std::max(largest, std::abs(found[i] - expected[i]));
    }
    CHECK(largest > 1e-4); // the field varies between them
    FieldOcclusionParams params = OcclusionTube<cpu::Serial>::params();
    params.most_points = static_cast<int>(scene.size());
    TimePolicy<cpu::Serial> all(scene.backend, scene.points, OcclusionTube<cpu::Serial>::frames, params);
    test::randomize(all);
    CHECK(scene.ao_of(all) == expected);
}

TEST_CASE("ambient occlusion over the pose has its gradient, with respect to the pose, too") {
    check_occlusion([](auto& scene) { return pose_occlusion(scene); });
    OcclusionTube<cpu::Serial> scene;
    auto occlusion = pose_occlusion(scene);
    test::randomize(occlusion);
    CHECK(occlusion.occludes());
    CHECK(occlusion.follows_pose());
    CHECK(scene.ao_of(occlusion, 1) == scene.ao_of(occlusion, 2)); // ao does not depend on the frame
    auto dL_dpose = zero_pose(), alone = zero_pose();
    scene.backward(occlusion, dL_dpose);
    double largest = 0;
    for (const auto& g : dL_dpose) largest = std::max(largest, length(g));
    CHECK(largest > 1e-3);
    test::zero_gradients(scene.backend, occlusion);
    scene.backward_to_pose(occlusion, alone);
    CHECK(alone == dL_dpose);
    for (const double g : test::learned_gradients(occlusion)) CHECK(g == 0); // nothing is learned
    scene.backward(occlusion, {});                                           // without a gradient of the pose
    test::check_learned_gradients(occlusion, [&] { return scene.loss(occlusion); });
}

TEST_CASE("ambient occlusion that follows the pose reads the joints' rotations, all but the root's") {
    OcclusionTube<cpu::Serial> scene;
    auto occlusion = pose_occlusion(scene);
    (void)scene.ao_of(occlusion);
    const Span<const double> feature = occlusion.feature();
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

TEST_CASE("fields of ambient occlusion start the same everywhere, and as they were asked to") {
    OcclusionTube<cpu::Serial> scene;
    auto time = time_occlusion(scene);
    auto pose = pose_occlusion(scene);
    for (const double ao : scene.ao_of(time)) CHECK(ao == doctest::Approx(0.9));
    for (const double ao : scene.ao_of(pose)) CHECK(ao == doctest::Approx(0.9));
    CHECK(test::learned_array(pose, "shadow_field.table").rate == 5e-3);
    CHECK(test::learned_array(pose, "shadow_field.network").rate == 5e-3);
}

TEST_CASE("ambient occlusion stays below the largest, and settings that cannot be are refused") {
    OcclusionTube<cpu::Serial> scene;
    auto occlusion = pose_occlusion(scene);
    for (double& weight : test::learned_array(occlusion, "shadow_field.network").values) weight *= 1e3;
    for (double& weight : test::learned_array(occlusion, "shadow_field.table").values) weight *= 1e5;
    for (const double ao : scene.ao_of(occlusion)) CHECK((ao >= 0 && ao <= 1.7));
    for (const double initial : {0.0, -1.0, 1.7, 2.0}) {
        auto params = OcclusionTube<cpu::Serial>::params();
        params.initial = initial;
        CHECK_THROWS_AS(TimePolicy<cpu::Serial>(scene.backend, scene.points, 5, params), ValueError);
        CHECK_THROWS_AS(PosePolicy<cpu::Serial>(scene.backend, scene.points, 27, params), ValueError);
    }
}

TEST_CASE("a baked field is kept in float, and not where its network is a single matrix") {
    cpu::Serial backend;
    test::Rng rng(2);
    const auto positions = rng.vecs(11);
    const CanonicalPoints<cpu::Serial> points(backend, Span<const vec3<double>>(positions));
    FieldOcclusionParams params = OcclusionTube<cpu::Serial>::params();
    const PoseOcclusion<cpu::Serial, float, 3, 2> occlusion(backend, points, 27, params);
    REQUIRE(occlusion.baked());
    CHECK(occlusion.baked()->largest == doctest::Approx(1.7));
    params.hidden_layers = 0;
    CHECK(!PoseOcclusion<cpu::Serial, float, 3, 2>(backend, points, 27, params).baked());
    OcclusionTube<cpu::Serial> scene;
    CHECK(!pose_occlusion(scene).baked()); // fields in double are not baked
}
