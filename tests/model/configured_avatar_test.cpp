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
#include <type_traits>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

constexpr std::size_t tube_frames = 4;
constexpr std::uint64_t tube_seed = 7;

ConfiguredAvatarParams small_tube(ConfiguredAvatarParams config) {
    config.appearance.field.grid.base = 3, config.appearance.field.grid.table_size = 128,
    config.occlusion.grid.table_size = 64;
    config.appearance.field.width = 8, config.appearance.field.hidden_layers = 1, config.appearance.fine_level = 1,
    config.model.occlusion_start = 0;
    return config;
}

struct ConfiguredTube {
    cpu::Serial backend;
    BodyModel body = test::tube(4, 6, 6);
    std::vector<double> betas{0.2, -0.4};
    SurfaceSamples samples =
        sample_surface(body, shaped_vertices(body, betas), std::vector<double>(body.vertex_count(), 1.0), 3);
    RigData rig = make_rig(body, betas, samples);

    ConfiguredAvatar<cpu::Serial, float, 2> make(const ConfiguredAvatarParams& config,
                                                 const CanonicalPriors& priors = {}) {
        return make_avatar<cpu::Serial, AvatarParts, float, 3, 2, 2>(backend, rig, samples, tube_frames, tube_seed,
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
    const auto parts = [&](const ConfiguredAvatarParams& config) {
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
    for (const char* ao : {AmbientOcclusion::time, AmbientOcclusion::pose})
        CHECK(parts({.hash_displacement = false, .hash_sh = false, .ao = ao}) ==
              Names{"displacements", "sh", "shadow_field.table", "shadow_field.network"});
    CHECK(tube.make({.head_time = true}).appearance().reads_time());
    CHECK(!tube.make({}).appearance().reads_time());
    CHECK(tube.make({.ao = AmbientOcclusion::pose}).occlusion().follows_pose());
    CHECK(!tube.make({.ao = AmbientOcclusion::time}).occlusion().follows_pose());
    CHECK(!tube.make({}).occlusion().occludes());
}

TEST_CASE("a configured avatar is bit-identical to the avatar of the same types") {
    ConfiguredTube tube;
    const ConfiguredAvatarParams config =
        small_tube({.head_time = true, .ao = AmbientOcclusion::pose, .model = {.deformation = Deformation::polar}});
    auto configured = tube.make(config);
    const auto points = std::make_shared<const CanonicalPoints<cpu::Serial>>(tube.backend, tube.samples.positions);
    using Appearance = SharedField<cpu::Serial, float, 2, 3, 2>;
    using Occlusion = PoseOcclusion<cpu::Serial, float, 3, 2>;
    AvatarModel<cpu::Serial, Appearance, Occlusion> typed(
        tube.backend, tube.rig, tube.samples, points,
        Appearance(tube.backend, points, config.appearance_of(tube_frames, tube_seed)),
        Occlusion(tube.backend, *points, tube.rig.body.pose_feature_count(), config.occlusion_of(tube_seed)),
        config.model);
    CHECK(names_of_parts(typed) == names_of_parts(configured));
    CHECK(test::learned_values(typed) == test::learned_values(configured));
    test::randomize(typed), test::randomize(configured);
    CHECK(tube.pass(typed) == tube.pass(configured));
}

TEST_CASE("a configuration chooses the sizes of the field of ambient occlusion") {
    const ConfiguredAvatarParams config = small_tube({.ao = AmbientOcclusion::time});
    ConfiguredAvatarParams wide = config, fine = config;
    wide.occlusion.width = 2 * config.occlusion.width;
    fine.occlusion.grid.growth = 2 * config.occlusion.grid.growth;
    const auto size = [](const ConfiguredAvatarParams& c) {
        return avatar_size<cpu::Serial, AvatarParts, float, 3, 2>(c, 4, {}).fixed();
    };
    CHECK(size(wide) > size(config));
    CHECK(fine.occlusion_of(5).grid.growth == 2 * config.occlusion.grid.growth);
    const FieldOcclusionParams made = config.occlusion_of(5); // what is not its own is the appearance's
    CHECK(made.grid.base == config.appearance.field.grid.base);
    CHECK(made.hidden_layers == config.appearance.field.hidden_layers);
    CHECK(made.width == config.occlusion.width);
    CHECK(made.seed == 5);
}

TEST_CASE("rates are those of the configuration") {
    ConfiguredTube tube;
    ConfiguredAvatarParams plain;
    plain.model.joint_rate = 1, plain.model.quat_rate = 2, plain.model.log_scale_rate = 3;
    plain.model.opacity_logit_rate = 4;
    plain.appearance.displacement_rate = 5, plain.appearance.sh_rate = 6;
    plain.appearance.stored_displacement_rate = 7, plain.appearance.stored_sh_rate = 8;
    plain.occlusion.rate = 9;
    ConfiguredAvatarParams timed = plain, separate = plain, of_stored = plain;
    timed.ao = AmbientOcclusion::time;
    separate.heads = Heads::separate;
    of_stored.hash_displacement = of_stored.hash_sh = false;
    const auto check = [&](const ConfiguredAvatarParams& config,
                           const std::vector<std::pair<std::string, double>>& expected) {
        auto model = tube.make(config);
        for (const auto& [name, rate] : expected) {
            CAPTURE(name);
            CHECK(test::learned_array(model, name).rate == rate);
        }
    };
    check(timed, {{"joints", 1},
                  {"quats", 2},
                  {"log_scales", 3},
                  {"opacity_logits", 4},
                  {"shared_field.table", 6},
                  {"shared_field.network", 6},
                  {"shadow_field.table", 9},
                  {"shadow_field.network", 9}});
    check(separate, {{"sh_field.table", 6}, {"displacement_field.table", 5}, {"displacement_field.network", 5}});
    check(of_stored, {{"displacements", 7}, {"sh", 8}});
    auto shared = tube.make(plain), stored = tube.make(of_stored);
    CHECK(test::learned_array(shared, "shared_field.network").other.rate == 5); // the displacements' weights
    CHECK(test::learned_array(stored, "sh").other.rate == 8.0 / 20);            // the bands
}

TEST_CASE("settings reach the parts") {
    ConfiguredTube tube;
    auto model = tube.make({.ao = AmbientOcclusion::time,
                            .occlusion = {.largest = 1.5, .initial = 0.75},
                            .model = {.initial_opacity = 0.3,
                                      .clamping = ColorClamp::below,
                                      .deformation = Deformation::dual_quaternion}});
    CHECK(model.params().deformation == Deformation::dual_quaternion);
    CHECK(model.params().clamping == ColorClamp::below);
    CHECK(model.params().initial_opacity == 0.3);
    RigPose<cpu::Serial, float> pose;
    model.rig().upload_pose(rest_motion(tube.rig), 0, pose);
    for (const float ao : model.ao(pose, 0)) CHECK(ao == doctest::Approx(0.75));
    const std::size_t N = tube.samples.size();
    CHECK(tube.make({}, {std::vector<double>(N, 0.0), {}}).appearance().lookups() == N * 8); // only the coarse level
}

namespace {

/// Parts of a user: a further appearance and a further ambient occlusion.
template <class B, class T, int Degree, int Levels, int Features>
struct Painted : StoredAttributes<B, T, Degree, Levels, Features> {
    using StoredAttributes<B, T, Degree, Levels, Features>::StoredAttributes;
};
template <class B, class T, int Levels, int Features>
struct Dimmed : PoseOcclusion<B, T, Levels, Features> {
    Dimmed(B& backend, const CanonicalPoints<B, T>& points, const OcclusionSizes& sizes, FieldOcclusionParams params)
        : PoseOcclusion<B, T, Levels, Features>(backend, points, sizes, dim(params)) {}
    static FieldOcclusionParams dim(FieldOcclusionParams params) { return params.initial /= 2, params; }
};
struct OwnParts : AvatarParts {
    template <Backend B, std::floating_point T, int Degree, int Levels, int Features>
    using Appearances = typename AvatarParts::Appearances<B, T, Degree, Levels, Features>::template With<
        Named<"painted", Painted<B, T, Degree, Levels, Features>>>;
    template <Backend B, std::floating_point T, int Levels, int Features>
    using Occlusions =
        typename AvatarParts::Occlusions<B, T, Levels,
                                         Features>::template With<Named<"dimmed", Dimmed<B, T, Levels, Features>>>;
};

} // namespace

TEST_CASE("settings name the parts of a user's list, and gsh's own by the same names as the three choices") {
    ConfiguredTube tube;
    const auto make = [&]<class Parts>(std::type_identity<Parts>, const ConfiguredAvatarParams& params) {
        return make_avatar<cpu::Serial, Parts, float, 3, 2, 2>(tube.backend, tube.rig, tube.samples, tube_frames,
                                                               tube_seed, small_tube(params));
    };
    const auto own = std::type_identity<OwnParts>();
    const ConfiguredAvatarParams params{.appearance_type = "painted", .ao = "dimmed", .occlusion = {.initial = 0.8}};
    auto model = make(own, params);
    const std::set<std::string> names = names_of_parts(model);
    for (const char* name : {"displacements", "sh", "shadow_field.table", "shadow_field.network"})
        CHECK(names.contains(name));
    RigPose<cpu::Serial, float> pose;
    model.rig().upload_pose(rest_motion(tube.rig), 0, pose);
    for (const float ao : model.ao(pose, 0)) CHECK(ao == doctest::Approx(0.4));
    const PartSize size = avatar_size<cpu::Serial, OwnParts, float, 3, 2, 2>(small_tube(params), 4, {});
    CHECK(size.fixed() > avatar_size<cpu::Serial, AvatarParts, float, 3, 2>(
                             small_tube({.hash_displacement = false, .hash_sh = false}), 4, {})
                             .fixed());
    CHECK_THROWS_WITH_AS((void)make(std::type_identity<AvatarParts>(), params),
                         doctest::Contains("appearance is 'painted', expected one of shared_field, separate_fields, "
                                           "color_field, displacement_field, stored"),
                         ValueError);
    CHECK_THROWS_WITH_AS((void)make(own, {.ao = "none of these"}),
                         doctest::Contains("expected one of none, time, pose, dimmed"), ValueError);
    for (const Heads heads : {Heads::shared, Heads::separate})
        for (const bool sh : {true, false})
            for (const bool displacement : {true, false}) {
                const ConfiguredAvatarParams by_choice{
                    .heads = heads, .hash_displacement = displacement, .hash_sh = sh};
                ConfiguredAvatarParams by_name{.appearance_type = std::string(by_choice.appearance_name())};
                auto chosen = make(own, by_choice), named = make(own, by_name);
                CHECK(names_of_parts(chosen) == names_of_parts(named));
                CHECK(test::learned_values(chosen) == test::learned_values(named));
            }
}

TEST_CASE("the same seed makes the same avatar, and another tube_seed another") {
    ConfiguredTube tube;
    auto a = tube.make({}), b = tube.make({});
    auto c = make_avatar<cpu::Serial, AvatarParts, float, 3, 2, 2>(tube.backend, tube.rig, tube.samples, tube_frames,
                                                                   tube_seed + 1, small_tube({}));
    CHECK(test::learned_values(a) == test::learned_values(b));
    CHECK(test::learned_values(a) != test::learned_values(c));
}

TEST_CASE("configurations that cannot be are refused") {
    ConfiguredTube tube;
    CHECK_THROWS_AS(tube.make({.hash_displacement = false, .hash_sh = false, .head_time = true}), ValueError);
    CHECK_THROWS_AS(tube.make({.occlusion = {.largest = 1, .initial = 1}}), ValueError);
    CHECK_THROWS_AS(tube.make({.occlusion = {.initial = 0}}), ValueError);
    tube.samples.positions.pop_back();
    CHECK_THROWS_AS(tube.make({}), ShapeError);
}
