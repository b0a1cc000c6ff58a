// SPDX-License-Identifier: Apache-2.0
#include <gsh/camera/pinhole.hpp>
#include <gsh/cpu.hpp>
#include <gsh/learn/learned_light.hpp>
#include <gsh/loss/photometric.hpp>
#include <gsh/model/avatar_model.hpp>
#include <gsh/model/configured_avatar.hpp>
#include <gsh/render/rasterizer.hpp>

#include "support/bodies.hpp"
#include "support/gradient.hpp"
#include "support/learned.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <initializer_list>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

/// The whole pipeline in double: pose → rig → fields → skinned Gaussians → rasterizer → L1 + SSIM.
///
/// Central differences are meaningless across a jump. The rasterizer's jumps are made negligible: alpha_min is far
/// below the resolution of the differences, and pixels do not stop early. Random depths avoid ties in sorting. A random
/// photograph avoids the kinks of L1.
template <class B>
struct Chain {
    using Model = ConfiguredAvatar<B, double, 2>;
    static constexpr std::size_t frame_count = 7, frame = 3; // fields read the time of `frame`

    B backend{};
    BodyModel body = test::tube(4, 6, 6);
    std::vector<double> betas{0.2, -0.4};
    SurfaceSamples samples =
        sample_surface(body, shaped_vertices(body, betas), std::vector<double>(body.vertex_count(), 1.0), 3);
    RigData rig = make_rig(body, betas, samples);
    Model model;
    Camera<double> camera;
    RigPose<B, double> pose;
    Rasterizer<B, double> rasterizer{backend, raster_params()};
    PhotometricLoss<B, double> loss_function{backend};
    Image<double> truth{3, 40, 36};

    Splats<B, double> splats;
    typename Rasterizer<B, double>::Cache raster_cache;
    typename PhotometricLoss<B, double>::Cache loss_cache;
    Image<double> render{3, 40, 36};

    /// A configuration at the size of this test. Priors are off unless `config` sets them.
    explicit Chain(ConfiguredAvatarParams config = {.heads = Heads::separate}, bool with_priors = false)
        : model(make(backend, rig, samples, config, with_priors ? priors(samples.size()) : CanonicalPriors(),
                     config.light ? lit(backend) : ModelLight<B, double>())) {
        test::Rng rng(8);
        for (auto& value : truth.data) value = rng.uniform();
        // Fields with noticeable outputs: tables and rotations that are not near zero.
        const auto fill = [&](std::string_view name, double low, double high) {
            if (!test::learns(model, name)) return;
            for (double& value : test::learned_array(model, name).values) value = rng.uniform(low, high);
        };
        fill("sh_field.table", -0.3, 0.3);
        fill("shared_field.table", -0.1, 0.1);
        fill("displacement_field.table", -0.05, 0.05);
        fill("displacements", -0.05, 0.05);
        fill("sh", -0.3, 0.3);
        fill("shadow_field.table", -0.5, 0.5);
        for (const auto* network :
             {"shared_field.network", "sh_field.network", "displacement_field.network", "shadow_field.network"})
            fill(network, -0.5, 0.5);
        for (double& value : test::learned_array(model, "quats").values) value += rng.uniform(-0.5, 0.5);
        for (double& value : test::learned_array(model, "log_scales").values) value += rng.uniform(-0.3, 0.3);
        Motion motion;
        motion.joint_count = 4;
        motion.expression_count = 2;
        motion.betas = {0.1, 0.3};
        motion.pose = rng.vecs(4, -0.6, 0.6);
        motion.expression = {0.7, -0.5};
        motion.transl = {rng.vec(-0.1, 0.1)};
        motion.timestamps = {0};
        model.rig().upload_pose(motion, 0, pose);
        fill("normal_offsets", -0.3, 0.3);
        camera = {mat3<double>(1.0), {0.05, -0.78, 2.5}, 55, 58, 17.3, 20.9, 36, 40};
        splats.resize(model.size());
    }

    static Model make(B& backend, const RigData& rig, const SurfaceSamples& samples,
                      const ConfiguredAvatarParams& config, const CanonicalPriors& priors = {},
                      ModelLight<B, double> light = {}) {
        return make_avatar<B, AvatarParts, double, 3, 2, 2>(backend, rig, samples, frame_count, 5, small(config),
                                                            priors, light);
    }
    /// Shadows have no gradient, so the loss must not depend on them.
    static ModelLight<B, double> lit(B& backend) {
        test::Rng rng(13);
        LightData light = even_light(2, 3, {0, 0.8, 0}, 2.5);
        light.shadows = false;
        for (double& number : light.log_intensities) number += rng.uniform(-0.5, 0.5);
        light.gloss = {-1.5, 1.5};
        return {std::make_shared<LearnedLight<B, double>>(backend, light)};
    }
    static ConfiguredAvatarParams small(ConfiguredAvatarParams config) {
        config.appearance.field.grid.base = 3, config.appearance.field.grid.growth = 1.6,
        config.appearance.field.grid.table_size = 128, config.occlusion.grid.table_size = 64;
        config.appearance.field.width = 8, config.appearance.field.hidden_layers = 1;
        config.appearance.fine_level = 1;
        config.model.initial_opacity = 0.4, config.appearance.sh_dc_scale = 2;
        config.model.occlusion_start = 0;
        return config;
    }
    static CanonicalPriors priors(std::size_t count) {
        test::Rng rng(9);
        CanonicalPriors result{rng.numbers(count), rng.numbers(2 * count)};
        for (double& tau : result.region) tau = std::max(tau, 0.0); // about half of the points read no fine level
        return result;
    }

    static RasterParams<double> raster_params() {
        RasterParams<double> params;
        params.alpha_min = 1e-14;
        params.transmittance_min = 0;
        return params;
    }

    // A sum over the image, not a mean, so that the tolerance of 1e-6 is strict.
    static constexpr double scale = 3 * 40 * 36;

    double loss() {
        model.update_canonical(frame);
        model.pose(pose, frame, camera.center(), splats.view());
        rasterizer.forward(camera, std::as_const(splats).view(), {.color = {0.9, 0.8, 0.7}}, {.color = render.view()},
                           raster_cache);
        loss_function.forward(std::as_const(render).view(), std::as_const(truth).view(), loss_cache);
        return scale * loss_function.values(loss_cache).loss;
    }

    struct Gradient {
        std::map<std::string, std::vector<double>, std::less<>> arrays;
        std::vector<vec3<double>> pose, transl;
        std::vector<double> coefficients;
        std::vector<vec3<double>> means; // with respect to x̂₀
    };

    /// The sum of the gradients of `passes` passes.
    Gradient gradient(int passes = 1) {
        for (const auto& array : model.learned()) backend.fill(array.gradient, 0.0);
        Gradient g;
        g.pose.assign(4, vec3<double>(0.0));
        g.transl.assign(1, vec3<double>(0.0));
        g.coefficients.assign(model.rig().coefficient_count(), 0);
        for (int pass = 0; pass < passes; ++pass) {
            loss();
            Image<double> dL_drender(3, 40, 36);
            loss_function.backward(std::as_const(render).view(), std::as_const(truth).view(), scale, loss_cache,
                                   dL_drender.view());
            Splats<B, double> dL_dsplats;
            dL_dsplats.resize(model.size());
            fill_zero(backend, dL_dsplats.view());
            rasterizer.backward(camera, std::as_const(splats).view(), {.color = {0.9, 0.8, 0.7}},
                                {.color = std::as_const(dL_drender).view()}, raster_cache, dL_dsplats.view());
            // The camera's centre depends on its extrinsics, but here it is a constant.
            model.backward(pose, frame, camera.center(), std::as_const(dL_dsplats).view(),
                           {g.pose, g.coefficients, g.transl}, {});
        }
        for (const auto& array : model.learned())
            g.arrays[array.name].assign(array.gradient.begin(), array.gradient.end());
        const auto& means = model.cache().dL_dmeans;
        g.means.assign(means.begin(), means.end());
        return g;
    }
};

template <class Buffer>
Span<double> chain_numbers(Buffer& buffer) {
    return view_as<double>(Span<std::remove_reference_t<decltype(buffer[0])>>(buffer));
}

} // namespace

namespace {

/// Checks every array that the configuration has, and the pose.
template <class B>
void check_chain(const ConfiguredAvatarParams& config, bool with_priors,
                 std::initializer_list<std::string_view> expected) {
    Chain<B> chain(config, with_priors);
    auto gradient = chain.gradient();
    const auto loss = [&] { return chain.loss(); };
    const test::GradientCheck check{.step = 1e-6, .tolerance = 1e-6};
    for (const std::string_view name : expected) CHECK(test::learns(chain.model, name));
    test::check_learned_gradients(chain.model, loss, check);
    test::check_gradient(loss, chain_numbers(chain.pose.pose), test::scalars(gradient.pose), check);
    test::check_gradient(loss, chain_numbers(chain.pose.coefficients), test::scalars(gradient.coefficients), check);
    test::check_gradient(loss, chain_numbers(chain.pose.transl), test::scalars(gradient.transl), check);
}

} // namespace

TEST_CASE_TEMPLATE("the whole chain's adjoint is the gradient of the loss", B, cpu::Serial, cpu::Threads) {
    SUBCASE("fields apart, as the baseline has them") {
        check_chain<B>({.heads = Heads::separate}, false,
                       {"joints", "quats", "log_scales", "opacity_logits", "displacement_field.table",
                        "displacement_field.network", "sh_field.table", "sh_field.network"});
    }
    SUBCASE("one head, regions, priors, ambient occlusion that knows the time") {
        check_chain<B>({.ao = AmbientOcclusion::time}, true,
                       {"joints", "quats", "log_scales", "opacity_logits", "shared_field.table", "shared_field.network",
                        "shadow_field.table", "shadow_field.network"});
    }
    SUBCASE("a table each for coarse and fine, heads that know the time") {
        check_chain<B>({.head_time = true, .appearance = {.separate_tables = true}}, true,
                       {"shared_field.table", "shared_field.network"});
    }
    SUBCASE("nothing from fields, ambient occlusion that knows the pose") {
        check_chain<B>(
            {.hash_displacement = false, .hash_sh = false, .ao = AmbientOcclusion::pose, .occlusion = {.largest = 1.7}},
            false, {"displacements", "sh", "shadow_field.table", "shadow_field.network"});
    }
    SUBCASE("colours from a field alone, polar blending") {
        check_chain<B>({.hash_displacement = false, .model = {.deformation = Deformation::polar}}, true,
                       {"displacements", "sh_field.table", "sh_field.network"});
    }
    SUBCASE("light on the posed mesh") {
        // Colours above 1 pass a gradient only downwards, so here they are not clamped there.
        check_chain<B>(
            {.light = true, .model = {.clamping = ColorClamp::below, .normal_offset_rate = 5e-3}}, true,
            {"joints", "shared_field.table", "normal_offsets", "light_points", "light_log_intensities", "light_gloss"});
    }
    SUBCASE("colours that do not depend on the direction yet") {
        check_chain<B>({.model = {.sh_start = 0.5}}, false, {"joints", "shared_field.table", "shared_field.network"});
    }
    SUBCASE("displacements from a field alone, dual quaternions") {
        check_chain<B>({.hash_sh = false, .model = {.deformation = Deformation::dual_quaternion}}, true,
                       {"sh", "displacement_field.table", "displacement_field.network"});
    }
}

TEST_CASE("each backward pass adds, and its sum is the same on threads bit for bit") {
    for (const ConfiguredAvatarParams& config :
         {ConfiguredAvatarParams{.ao = AmbientOcclusion::pose},
          ConfiguredAvatarParams{.heads = Heads::separate, .head_time = true, .ao = AmbientOcclusion::time},
          ConfiguredAvatarParams{.hash_displacement = false, .hash_sh = false},
          ConfiguredAvatarParams{.light = true}}) {
        Chain<cpu::Serial> chain(config, true);
        Chain<cpu::Threads> threaded(config, true);
        const auto once = chain.gradient(), twice = chain.gradient(2);
        const auto on_threads = threaded.gradient();
        CHECK(on_threads.arrays == once.arrays);
        CHECK(on_threads.pose == once.pose);
        CHECK(on_threads.transl == once.transl);
        CHECK(on_threads.coefficients == once.coefficients);
        for (const auto& [name, gradient] : once.arrays) {
            CAPTURE(name);
            test::check_doubled(gradient, twice.arrays.at(name));
        }
        for (std::size_t j = 0; j < 4; ++j) CHECK(length(twice.pose[j] - 2.0 * once.pose[j]) < 1e-9);
    }
}

TEST_CASE("ambient occlusion starts the same everywhere, and as it was asked to") {
    Chain<cpu::Serial> chain;
    auto model = Chain<cpu::Serial>::make(chain.backend, chain.rig, chain.samples,
                                          {.ao = AmbientOcclusion::time, .occlusion = {.initial = 0.9}});
    const auto factors = model.ao(chain.pose, chain.frame);
    REQUIRE(factors.size() == model.size());
    for (const double ao : factors) CHECK(ao == doctest::Approx(0.9));
    CHECK_THROWS_AS((void)chain.model.ao(chain.pose, chain.frame), ValueError); // it has none
}

TEST_CASE("ambient occlusion joins when the run has come to its start") {
    Chain<cpu::Serial> chain({.ao = AmbientOcclusion::time});
    CHECK(chain.model.occludes());
    auto config = Chain<cpu::Serial>::small({.ao = AmbientOcclusion::time});
    config.model.occlusion_start = 0.3;
    auto model = make_avatar<cpu::Serial, AvatarParts, double, 3, 2, 2>(chain.backend, chain.rig, chain.samples,
                                                                        Chain<cpu::Serial>::frame_count, 5, config);
    CHECK(!model.occludes());
    model.update_canonical(chain.frame);
    model.pose(chain.pose, chain.frame, chain.camera.center(), chain.splats.view());
    CHECK(model.cache().ao.size() == 0);
    model.set_progress(0.3);
    CHECK(model.occludes());
    model.pose(chain.pose, chain.frame, chain.camera.center(), chain.splats.view());
    CHECK(model.cache().ao.size() == model.size());
    model.set_progress(0.29);
    CHECK(!model.occludes());
}

TEST_CASE("colours depend on the direction from sh_start on") {
    Chain<cpu::Serial> chain({.hash_sh = false, .model = {.sh_start = 0.3}});
    const auto colors_from = [&](const vec3<double>& center) {
        chain.model.update_canonical(chain.frame);
        chain.model.pose(chain.pose, chain.frame, center, chain.splats.view());
        return std::vector<vec3<double>>(chain.splats.colors.begin(), chain.splats.colors.end());
    };
    const vec3<double> here = chain.camera.center(), there = {3, 1, 0.5};
    // How many coefficients above the constants have a gradient.
    const auto learning = [&] {
        const auto gradient = chain.gradient();
        const std::vector<double>& sh = gradient.arrays.at("sh"); // [N, 9, 3]
        std::size_t count = 0;
        for (std::size_t k = 0; k < sh.size(); ++k) count += k % 27 >= 3 && sh[k] != 0;
        return count;
    };
    CHECK(!chain.model.is_view_dependent());
    CHECK(colors_from(here) == colors_from(there));
    CHECK(learning() == 0);
    chain.model.set_progress(0.3);
    CHECK(chain.model.is_view_dependent());
    CHECK(colors_from(here) != colors_from(there));
    CHECK(learning() > 0);
    chain.model.set_progress(0.29);
    CHECK(!chain.model.is_view_dependent());
}

TEST_CASE("the canonical body starts whole, whatever the priors say") {
    Chain<cpu::Serial> chain;
    for (const Heads heads : {Heads::shared, Heads::separate}) {
        auto priors = Chain<cpu::Serial>::priors(chain.samples.size());
        for (double& feature : priors.features) feature *= 10;
        auto model = Chain<cpu::Serial>::make(chain.backend, chain.rig, chain.samples, {.heads = heads}, priors);
        model.update_canonical();
        std::vector<vec3<double>> means(model.size());
        model.write_means(means);
        for (std::size_t i = 0; i < means.size(); ++i) CHECK(length(means[i] - chain.samples.positions[i]) < 1e-3);
    }
}

TEST_CASE("Gaussians start flat on the surface, or round") {
    Chain<cpu::Serial> chain;
    auto samples = chain.samples;
    samples.normals[0] = vec3<double>(0); // unknown
    const auto start = [&](double thickness) {
        return Chain<cpu::Serial>::make(chain.backend, chain.rig, samples, {.model = {.initial_thickness = thickness}});
    };
    auto flat_model = start(0.25), round_model = start(1);
    const SkinnedView<const double> flat = flat_model.gaussians(), round = round_model.gaussians();
    REQUIRE(flat.quats.size() == samples.size());
    for (std::size_t i = 0; i < samples.size(); ++i) {
        const double scale = chain.samples.scales[i];
        const mat3<double> R = rotation_matrix(flat.quats[i]);
        if (i > 0) CHECK(length(R[2] - samples.normals[i]) < 1e-9);
        for (int axis = 0; axis < 3; ++axis) {
            CHECK(std::exp(flat.log_scales[i][axis]) == doctest::Approx(axis == 2 && i > 0 ? scale / 4 : scale));
            CHECK(std::exp(round.log_scales[i][axis]) == doctest::Approx(scale));
        }
        CHECK(round.quats[i].w == 1);
    }
}

TEST_CASE("fine levels cost nothing where the region is not") {
    Chain<cpu::Serial> chain;
    const std::size_t N = chain.samples.size();
    const auto everywhere = Chain<cpu::Serial>::make(chain.backend, chain.rig, chain.samples, {});
    const auto nowhere =
        Chain<cpu::Serial>::make(chain.backend, chain.rig, chain.samples, {}, {std::vector<double>(N, 0.0), {}});
    CHECK(everywhere.appearance().lookups() == N * 3 * 8);
    CHECK(nowhere.appearance().lookups() == N * 8); // levels 1 and 2 are fine
}

TEST_CASE("a box about a slim body has more of its cells on the body than a cube") {
    Chain<cpu::Serial> chain;
    auto config = Chain<cpu::Serial>::small({.heads = Heads::separate});
    config.appearance.field.grid.table_size = 1u << 16; // no collisions
    const auto touched = [&](FieldBounds bounds) {
        config.points.bounds = bounds;
        auto model = make_avatar<cpu::Serial, AvatarParts, double, 3, 2, 2>(chain.backend, chain.rig, chain.samples,
                                                                            Chain<cpu::Serial>::frame_count, 5, config);
        return test::learned_array(model, "sh_field.table").touched_rows.size();
    };
    CAPTURE(touched(FieldBounds::cube));
    CHECK(touched(FieldBounds::box) > 3 * touched(FieldBounds::cube) / 2);
}

TEST_CASE("the chain's gradient of a Gaussian's mean") {
    Chain<cpu::Serial> chain;
    const auto gradient = chain.gradient();
    const auto& cache = chain.model.cache();
    std::vector<vec3<double>> means(cache.means.begin(), cache.means.end()); // x̂₀(t)
    SkinnedView<const double> gaussians = chain.model.gaussians();
    gaussians.means = means;
    gaussians.weights = chain.model.rig().skin();
    const SkinnedSplats<cpu::Serial, 2, double> skin(chain.backend);
    SkinnedSplats<cpu::Serial, 2, double>::Cache skin_cache;
    const auto loss = [&] {
        skin.forward(gaussians, cache.rig.bones, chain.camera.center(), chain.splats.view(), skin_cache);
        chain.rasterizer.forward(chain.camera, std::as_const(chain.splats).view(), {.color = {0.9, 0.8, 0.7}},
                                 {.color = chain.render.view()}, chain.raster_cache);
        chain.loss_function.forward(std::as_const(chain.render).view(), std::as_const(chain.truth).view(),
                                    chain.loss_cache);
        return Chain<cpu::Serial>::scale * chain.loss_function.values(chain.loss_cache).loss;
    };
    CHECK(loss() == chain.loss());
    auto expected = gradient.means;
    test::check_gradient(loss, test::scalars(means), test::scalars(expected), {.step = 1e-6, .tolerance = 1e-6});
}

TEST_CASE("untouched table entries have no gradient") {
    Chain<cpu::Serial> chain;
    const auto gradient = chain.gradient().arrays.at("sh_field.table");
    const auto array = test::learned_array(chain.model, "sh_field.table");
    REQUIRE(array.row_size == 2);
    std::vector<bool> is_touched(gradient.size() / 2, false);
    for (const std::uint32_t row : array.touched_rows) is_touched[row] = true;
    std::size_t with_gradient = 0;
    for (std::size_t i = 0; i < gradient.size(); ++i) {
        with_gradient += gradient[i] != 0;
        CHECK((gradient[i] == 0 || is_touched[i / 2]));
    }
    CHECK(with_gradient > 0);
}

TEST_CASE("the model refuses what does not fit") {
    Chain<cpu::Serial> chain;
    auto fewer = chain.samples;
    fewer.positions.pop_back();
    const auto make = [&](const SurfaceSamples& samples, const ConfiguredAvatarParams& config = {},
                          const CanonicalPriors& priors = {}) {
        return make_avatar<cpu::Serial, AvatarParts, double, 3, 2, 2>(
            chain.backend, chain.rig, samples, Chain<cpu::Serial>::frame_count, 1, config, priors);
    };
    CHECK_THROWS_AS(make(fewer), ShapeError);
    auto no_normals = chain.samples;
    no_normals.normals.pop_back();
    CHECK_THROWS_AS(make(no_normals), ShapeError);
    CHECK_THROWS_AS(make(chain.samples, {.model = {.initial_opacity = 1}}), ValueError);
    CHECK_THROWS_AS(make(chain.samples, {.occlusion = {.initial = 0}}), ValueError);
    CHECK_THROWS_AS(make(chain.samples, {.model = {.initial_thickness = 0}}), ValueError);
    CHECK_THROWS_AS(make(chain.samples, {.model = {.initial_thickness = 1.5}}), ValueError);
    CHECK_THROWS_AS(make(chain.samples, {.points = {.bounds_margin = 0}}), ValueError);
    CHECK_THROWS_AS(make(chain.samples, {.points = {.prior_scale = 0}}), ValueError);
    CHECK_THROWS_AS(make(chain.samples, {.model = {.occlusion_start = -0.1}}), ValueError);
    CHECK_THROWS_AS(make(chain.samples, {.model = {.sh_start = -0.1}}), ValueError);
    CHECK_THROWS_AS(make(chain.samples, {}, {std::vector<double>(chain.samples.size(), 0.5), {}}),
                    ValueError); // level 12, but there are 3
    CHECK_THROWS_AS(make(chain.samples, {.hash_displacement = false, .hash_sh = false, .head_time = true}), ValueError);
    CHECK_THROWS_AS(make(chain.samples, {}, {{0.5}, {}}), ShapeError);
    CHECK_THROWS_AS(make(chain.samples, {}, {{}, {0.5}}), ValueError);
    // Parts made of other points.
    const auto points = std::make_shared<const CanonicalPoints<cpu::Serial, double>>(
        chain.backend, Span<const vec3<double>>(fewer.positions));
    using Stored = StoredAttributes<cpu::Serial, double, 2, 3, 2>;
    using Model = AvatarModel<cpu::Serial, Stored, NoOcclusion<cpu::Serial, double>, double>;
    CHECK_THROWS_AS(Model(chain.backend, chain.rig, chain.samples, points, Stored(chain.backend, points)), ShapeError);
}

TEST_CASE("a pose's gradient through its ambient occlusion, the avatar being what it is") {
    using B = cpu::Serial;
    Chain<B> chain({.ao = AmbientOcclusion::pose, .occlusion = {.largest = 1.7}});
    test::Rng rng(12);
    Splats<B, double> weights;
    weights.resize(chain.model.size());
    fill_zero(chain.backend, weights.view());
    for (auto& v : weights.colors) v = rng.vec();
    chain.model.update_canonical(chain.frame);
    const auto loss = [&] {
        chain.model.pose(chain.pose, chain.frame, chain.camera.center(), chain.splats.view());
        double sum = 0;
        for (std::size_t i = 0; i < chain.model.size(); ++i) sum += dot(chain.splats.colors[i], weights.colors[i]);
        return sum;
    };
    std::vector<vec3<double>> dL_dpose(4, vec3<double>(0.0));
    const auto backward = [&] {
        loss();
        chain.model.backward_to_pose(chain.pose, chain.frame, chain.camera.center(), std::as_const(weights).view(),
                                     {dL_dpose, {}, {}});
    };
    backward();
    const auto once = dL_dpose;
    test::check_gradient(loss, chain_numbers(chain.pose.pose), test::scalars(dL_dpose));
    backward();
    for (std::size_t j = 0; j < 4; ++j) CHECK(length(dL_dpose[j] - 2.0 * once[j]) < 1e-12);

    // AvatarModel::ao gives the same ao.
    const auto& cached = chain.model.cache().ao;
    const std::vector<double> of_pass(cached.begin(), cached.end());
    REQUIRE(of_pass.size() == chain.model.size());
    const auto alone = chain.model.ao(chain.pose, chain.frame);
    CHECK(std::equal(alone.begin(), alone.end(), of_pass.begin(), of_pass.end()));
}
