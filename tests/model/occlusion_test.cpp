// SPDX-License-Identifier: Apache-2.0
#include <gsh/model/occlusion.hpp>

#include "support/occlusion_probe.hpp"

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

using AnyDoubleOcclusion = AnyOcclusion<cpu::Serial, double>;

static_assert(OcclusionPolicy<AnyDoubleOcclusion, cpu::Serial, double>);
static_assert(OcclusionPolicy<NoOcclusion<cpu::Serial, double>, cpu::Serial, double>);
static_assert(std::constructible_from<AnyDoubleOcclusion, TimeOcclusion<cpu::Serial, double, 3, 2>>);
static_assert(
    !std::constructible_from<AnyDoubleOcclusion, TimeOcclusion<cpu::Serial, float, 3, 2>>); // another number type
static_assert(!std::constructible_from<AnyDoubleOcclusion, int>);
static_assert(!OcclusionPolicy<PlainOcclusion<cpu::Serial, double>, cpu::Serial, double>); // it lacks the passes

/// A fixed policy on a base: the same ao for every Gaussian.
struct Dusk : PlainOcclusion<cpu::Serial, double> {
    void forward(const OcclusionInput<cpu::Serial, double>&, Span<double> ao) {
        std::fill(ao.data(), ao.data() + ao.size(), 0.5);
    }
    void backward(const OcclusionInput<cpu::Serial, double>&, Span<const double>, Span<double>, Span<vec3<double>>) {}
    LearnedArrays<double> learned() { return {}; }
};
static_assert(OcclusionPolicy<Dusk, cpu::Serial, double>);

/// A policy and the same policy inside AnyOcclusion give bit-identical results. make(scene) is the policy.
template <class Make>
void check_same_occlusion(const Make& make) {
    test::OcclusionScene<cpu::Serial> scene;
    auto policy = make(scene);
    AnyDoubleOcclusion any = make(scene);
    test::randomize(policy), test::randomize(any);
    CHECK(any.occludes() == policy.occludes());
    CHECK(any.follows_pose() == policy.follows_pose());
    CHECK(any.baked().has_value() == baked_field(policy).has_value());
    CHECK(scene.ao_of(any) == scene.ao_of(policy));
    std::vector<vec3<double>> expected(4, vec3<double>(0.0)), found = expected;
    scene.backward(policy, expected), scene.backward(any, found);
    scene.backward_to_pose(policy, expected), scene.backward_to_pose(any, found);
    CHECK(found == expected);
    CHECK(test::learned_gradients(any) == test::learned_gradients(policy));
    const auto arrays = any.learned(), wanted = policy.learned();
    REQUIRE(arrays.size() == wanted.size());
    for (std::size_t i = 0; i < arrays.size(); ++i) {
        CHECK(arrays[i].name == wanted[i].name);
        CHECK(arrays[i].rate == wanted[i].rate);
    }
}

} // namespace

TEST_CASE("any occlusion policy is bit-identical to the policy inside") {
    check_same_occlusion([](auto& scene) {
        return TimeOcclusion<cpu::Serial, double, 3, 2>(scene.backend, scene.points, scene.frames, scene.params());
    });
    check_same_occlusion([](auto& scene) {
        return PoseOcclusion<cpu::Serial, double, 3, 2>(scene.backend, scene.points, scene.pose_feature_count(),
                                                        scene.params());
    });
    check_same_occlusion([](auto&) { return NoOcclusion<cpu::Serial, double>(); });
    check_same_occlusion([](auto&) { return Dusk(); });
}

TEST_CASE("a policy on the plain base occludes, does not follow the pose, and adds nothing to its gradient") {
    test::OcclusionScene<cpu::Serial> scene;
    Dusk dusk;
    CHECK(dusk.occludes());
    CHECK(!dusk.follows_pose());
    CHECK(scene.ao_of(dusk) == std::vector<double>(scene.size(), 0.5));
    std::vector<vec3<double>> dL_dpose(4, vec3<double>(0.25));
    scene.backward_to_pose(dusk, dL_dpose);
    CHECK(dL_dpose == std::vector<vec3<double>>(4, vec3<double>(0.25)));
}

TEST_CASE("no ambient occlusion learns nothing, follows nothing and writes nothing") {
    test::OcclusionScene<cpu::Serial> scene;
    NoOcclusion<cpu::Serial, double> none;
    CHECK(!none.occludes());
    CHECK(!none.follows_pose());
    CHECK(none.learned().empty());
    CHECK(!baked_field(none));
    std::vector<double> ao(scene.size(), 0.25);
    none.forward(scene.input(), ao);
    CHECK(ao == std::vector<double>(scene.size(), 0.25));
}
