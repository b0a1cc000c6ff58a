// SPDX-License-Identifier: Apache-2.0
#include <gsh/cpu.hpp>
#include <gsh/model/configured_avatar.hpp>

#include "support/bodies.hpp"
#include "support/gradient.hpp"
#include "support/learned.hpp"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

constexpr std::size_t tube_frames = 4;
constexpr std::uint64_t tube_seed = 7;

AvatarConfig small_tube(AvatarConfig config) {
    config.hash_base = 3, config.hash_table_size = 128, config.ao_table_size = 64;
    config.mlp_width = 8, config.mlp_hidden_layers = 1, config.fine_level = 1, config.ao_start = 0;
    return config;
}

struct ConfiguredTube {
    cpu::Serial backend;
    BodyModel body = test::tube(4, 6, 6);
    std::vector<double> betas{0.2, -0.4};
    SurfaceSamples samples =
        sample_surface(body, shaped_vertices(body, betas), std::vector<double>(body.vertex_count(), 1.0), 3);
    RigData rig = make_rig(body, betas, samples);

    ConfiguredAvatar<cpu::Serial, float, 2> make(const AvatarConfig& config, const CanonicalPriors& priors = {}) {
        return make_avatar<cpu::Serial, float, 3, 2, 2>(backend, rig, samples, tube_frames, tube_seed,
                                                        small_tube(config), priors);
    }
    /// Splats' colours and means of a frame in a pose, and all gradients of an arbitrary backward pass.
    template <class Model>
    std::vector<float> pass(Model& model) {
        Motion motion = rest_motion(rig);
        test::Rng rng(3);
        motion.pose = rng.vecs(4, -0.5, 0.5);
        RigPose<cpu::Serial, float> pose;
        model.rig().upload_pose(motion, 0, pose);
        Splats<cpu::Serial> splats, weights;
        splats.resize(model.size()), weights.resize(model.size());
        fill_zero(backend, weights.view());
        for (auto& v : weights.colors) v = vec3<float>(rng.vec());
        for (auto& v : weights.means) v = vec3<float>(rng.vec());
        std::vector<vec3<float>> dL_dpose(4, vec3<float>(0));
        model.update_canonical(1);
        model.pose(pose, 1, {0, 1, 3}, splats.view());
        model.backward(pose, 1, {0, 1, 3}, std::as_const(weights).view(), {dL_dpose, {}, {}});
        std::vector<float> all = test::learned_gradients(model);
        for (const auto* vectors : {&splats.colors, &splats.means})
            for (const auto& v : *vectors) all.insert(all.end(), {v.x, v.y, v.z});
        for (const auto& v : dL_dpose) all.insert(all.end(), {v.x, v.y, v.z});
        return all;
    }
};

std::set<std::string> names_of_parts(auto&& model) {
    std::set<std::string> all;
    for (const auto& array : model.learned()) all.insert(array.name);
    return all;
}

} // namespace

TEST_CASE("each configuration learns the arrays of its parts") {
    ConfiguredTube tube;
    const auto parts = [&](const AvatarConfig& config) {
        auto all = names_of_parts(tube.make(config));
        for (const auto* own : {"joints", "quats", "log_scales", "opacity_logits"}) CHECK(all.erase(own) == 1);
        return all;
    };
    using Names = std::set<std::string>;
    CHECK(parts({}) == Names{"shared_field.table", "shared_field.network"});
    CHECK(parts({.heads = Heads::separate}) ==
          Names{"sh_field.table", "sh_field.network", "displacement_field.table", "displacement_field.network"});
    CHECK(parts({.hash_displacement = false}) == Names{"sh_field.table", "sh_field.network", "displacements"});
    CHECK(parts({.hash_sh = false}) == Names{"displacement_field.table", "displacement_field.network", "sh"});
    CHECK(parts({.hash_displacement = false, .hash_sh = false}) == Names{"displacements", "sh"});
    for (const AmbientOcclusion ao : {AmbientOcclusion::time, AmbientOcclusion::pose})
        CHECK(parts({.hash_displacement = false, .hash_sh = false, .ao = ao}) ==
              Names{"displacements", "sh", "shadow_field.table", "shadow_field.network"});
    CHECK(tube.make({.head_time = true}).appearance().reads_time());
    CHECK(!tube.make({}).appearance().reads_time());
    CHECK(tube.make({.ao = AmbientOcclusion::pose}).shadow().follows_pose());
    CHECK(!tube.make({.ao = AmbientOcclusion::time}).shadow().follows_pose());
    CHECK(!tube.make({}).shadow().casts());
}

TEST_CASE("a configured avatar is bit-identical to the avatar of the same types") {
    ConfiguredTube tube;
    const AvatarConfig config =
        small_tube({.head_time = true, .ao = AmbientOcclusion::pose, .deformation = Deformation::polar});
    auto configured = tube.make(config);
    const auto points = std::make_shared<const CanonicalPoints<cpu::Serial>>(tube.backend, tube.samples.positions);
    using Appearance = SharedField<cpu::Serial, float, 2, 3, 2>;
    using Shadow = PoseShadow<cpu::Serial, float, 3, 2>;
    AvatarModel<cpu::Serial, Appearance, Shadow> typed(
        tube.backend, tube.rig, tube.samples, points,
        Appearance(tube.backend, points, appearance_params(config, tube_frames, tube_seed)),
        Shadow(tube.backend, *points, tube.rig.body.pose_feature_count(), shadow_params(config, tube_seed)),
        model_params(config));
    CHECK(names_of_parts(typed) == names_of_parts(configured));
    CHECK(test::learned_values(typed) == test::learned_values(configured));
    test::randomize(typed), test::randomize(configured);
    CHECK(tube.pass(typed) == tube.pass(configured));
}

TEST_CASE("a configuration chooses the sizes of the shadow's field") {
    const AvatarConfig config = small_tube({.ao = AmbientOcclusion::time});
    AvatarConfig wide = config, fine = config;
    wide.ao_width = 2 * config.ao_width;
    fine.ao_growth = 2 * config.ao_growth;
    const auto size = [](const AvatarConfig& c) {
        return avatar_size<cpu::Serial, float, 3, 2>(c, 4, {}).fixed();
    };
    CHECK(size(wide) > size(config));
    CHECK(shadow_params(fine, 0).field.growth == 2 * config.ao_growth);
    CHECK(shadow_params(wide, 0).field.width == 2 * config.ao_width);
    CHECK(appearance_params(wide, 1, 0).field.width == config.mlp_width);
}

TEST_CASE("rates are those of the configuration") {
    ConfiguredTube tube;
    const LearningRates rates{1, 2, 3, 4, 5, 6, 7, 8, 9};
    const auto check = [&](const AvatarConfig& config, const std::vector<std::pair<std::string, double>>& expected) {
        auto model = tube.make(config);
        for (const auto& [name, rate] : expected) {
            CAPTURE(name);
            CHECK(test::learned_array(model, name).rate == rate);
        }
    };
    check({.ao = AmbientOcclusion::time, .rates = rates}, {{"joints", 1},
                                                           {"quats", 2},
                                                           {"log_scales", 3},
                                                           {"opacity_logits", 4},
                                                           {"shared_field.table", 6},
                                                           {"shared_field.network", 6},
                                                           {"shadow_field.table", 9},
                                                           {"shadow_field.network", 9}});
    check({.heads = Heads::separate, .rates = rates},
          {{"sh_field.table", 6}, {"displacement_field.table", 5}, {"displacement_field.network", 5}});
    check({.hash_displacement = false, .hash_sh = false, .rates = rates}, {{"displacements", 7}, {"sh", 8}});
    auto shared = tube.make({.rates = rates}),
         stored = tube.make({.hash_displacement = false, .hash_sh = false, .rates = rates});
    CHECK(test::learned_array(shared, "shared_field.network").other.rate == 5); // the displacements' weights
    CHECK(test::learned_array(stored, "sh").other.rate == 8.0 / 20);            // the bands
}

TEST_CASE("settings reach the parts") {
    ConfiguredTube tube;
    auto model = tube.make({.ao = AmbientOcclusion::time,
                            .largest_ao = 1.5,
                            .initial_ao = 0.75,
                            .deformation = Deformation::dual_quaternion,
                            .initial_opacity = 0.3,
                            .clamping = ColorClamp::below});
    CHECK(model.params().deformation == Deformation::dual_quaternion);
    CHECK(model.params().clamping == ColorClamp::below);
    CHECK(model.params().initial_opacity == 0.3);
    RigPose<cpu::Serial, float> pose;
    model.rig().upload_pose(rest_motion(tube.rig), 0, pose);
    for (const float ao : model.ao(pose, 0)) CHECK(ao == doctest::Approx(0.75));
    const std::size_t N = tube.samples.size();
    CHECK(tube.make({}, {std::vector<double>(N, 0.0), {}}).appearance().lookups() == N * 8); // only the coarse level
}

TEST_CASE("the same seed makes the same avatar, and another tube_seed another") {
    ConfiguredTube tube;
    auto a = tube.make({}), b = tube.make({});
    auto c = make_avatar<cpu::Serial, float, 3, 2, 2>(tube.backend, tube.rig, tube.samples, tube_frames, tube_seed + 1,
                                                      small_tube({}));
    CHECK(test::learned_values(a) == test::learned_values(b));
    CHECK(test::learned_values(a) != test::learned_values(c));
}

TEST_CASE("configurations that cannot be are refused") {
    ConfiguredTube tube;
    CHECK_THROWS_AS(tube.make({.hash_displacement = false, .hash_sh = false, .head_time = true}), ValueError);
    CHECK_THROWS_AS(tube.make({.largest_ao = 1, .initial_ao = 1}), ValueError);
    CHECK_THROWS_AS(tube.make({.initial_ao = 0}), ValueError);
    tube.samples.positions.pop_back();
    CHECK_THROWS_AS(tube.make({}), ShapeError);
}
