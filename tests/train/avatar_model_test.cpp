// SPDX-License-Identifier: Apache-2.0
#include <gsh/camera/pinhole.hpp>
#include <gsh/cpu.hpp>
#include <gsh/loss/photometric.hpp>
#include <gsh/render/rasterizer.hpp>
#include <gsh/train/avatar_model.hpp>

#include "support/gradient.hpp"
#include "support/bodies.hpp"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

/// The whole pipeline in double: pose → rig → fields → skinned Gaussians → rasterizer → L1 + SSIM.
///
/// Central differences are meaningless across a jump. The rasterizer's are made negligible (alpha_min far below the
/// differences' resolution, no early stop); random depths keep sorting ties away, and a random picture as truth keeps
/// the kinks of L1 away.
template <class B>
struct Chain {
    using Model = AvatarModel<B, double, 3, 2, 2>;

    B backend{};
    BodyModel body = test::tube(4, 6, 6);
    std::vector<double> betas{0.2, -0.4};
    SurfaceSamples samples =
        sample_surface(body, shaped_vertices(body, betas), std::vector<double>(body.vertex_count(), 1.0), 3);
    RigData rig = make_rig(body, betas, samples);
    Model model;
    std::vector<double> head_code, ao_code;
    Camera<double> camera;
    RigPose<B, double> pose;
    Rasterizer<B, double> rasterizer{backend, raster_params()};
    PhotometricLoss<B, double> loss_function{backend};
    Image<double> truth{3, 40, 36};

    typename Model::Cache cache;
    Splats<B, double> splats;
    typename Rasterizer<B, double>::Cache raster_cache;
    typename PhotometricLoss<B, double>::Cache loss_cache;
    Image<double> render{3, 40, 36};

    /// A configuration at the size of this test; priors only where it is asked for them.
    explicit Chain(AvatarConfig config = {.heads = Heads::separate}, bool with_priors = false)
        : model(backend, rig, samples, 5, small(config), with_priors ? priors(samples.size()) : CanonicalPriors()) {
        test::Rng rng(8);
        for (auto& value : truth.data) value = rng.uniform();
        // Fields that say something: tables and rotations that are not near zero.
        const auto fill = [&](ParameterGroup group, double low, double high) {
            for (double& value : model.parameters()[group]) value = rng.uniform(low, high);
        };
        fill(ParameterGroup::sh_table, -0.3, 0.3);
        fill(ParameterGroup::joint_table, -0.1, 0.1);
        fill(ParameterGroup::displacement_table, -0.05, 0.05);
        fill(ParameterGroup::displacements, -0.05, 0.05);
        fill(ParameterGroup::sh, -0.3, 0.3);
        fill(ParameterGroup::ao_table, -0.5, 0.5);
        for (const auto network : {ParameterGroup::joint_network, ParameterGroup::sh_network,
                                   ParameterGroup::displacement_network, ParameterGroup::ao_network})
            fill(network, -0.5, 0.5);
        head_code = rng.numbers(model.head_code_size());
        ao_code = rng.numbers(model.ao_code_size());
        for (double& value : model.parameters()[ParameterGroup::quats]) value += rng.uniform(-0.5, 0.5);
        for (double& value : model.parameters()[ParameterGroup::log_scales]) value += rng.uniform(-0.3, 0.3);
        Motion motion;
        motion.joint_count = 4;
        motion.expression_count = 2;
        motion.betas = {0.1, 0.3};
        motion.pose = rng.vecs(4, -0.6, 0.6);
        motion.expression = {0.7, -0.5};
        motion.transl = {rng.vec(-0.1, 0.1)};
        motion.timestamps = {0};
        model.rig().upload_pose(motion, 0, pose);
        camera = {mat3<double>(1.0), {0.05, -0.78, 2.5}, 55, 58, 17.3, 20.9, 36, 40};
        splats.resize(model.size());
    }

    static AvatarConfig small(AvatarConfig config) {
        config.hash_base = 3, config.hash_growth = 1.6, config.hash_table_size = 128, config.ao_table_size = 64;
        config.mlp_width = 8, config.mlp_hidden_layers = 1;
        config.fine_level = 1;
        config.initial_opacity = 0.4, config.sh_dc_scale = 2;
        return config;
    }
    static CanonicalPriors priors(std::size_t count) {
        test::Rng rng(9);
        CanonicalPriors result{rng.numbers(count), rng.numbers(2 * count)};
        for (double& tau : result.region) tau = std::max(tau, 0.0); // about half of the points know no fine level
        return result;
    }
    FrameCode<double> code() const { return {head_code, ao_code}; }

    static RasterParams<double> raster_params() {
        RasterParams<double> params;
        params.alpha_min = 1e-14;
        params.transmittance_min = 0;
        return params;
    }

    static constexpr double scale = 3 * 40 * 36; // a sum over the image, not a mean: a tolerance of 1e-6 must bite

    double loss() {
        model.update_canonical(cache, code());
        model.pose(pose, camera.center(), splats.view(), cache, code());
        rasterizer.forward(camera, std::as_const(splats).view(), {.color = {0.9, 0.8, 0.7}}, {.color = render.view()},
                           raster_cache);
        loss_function.forward(std::as_const(render).view(), std::as_const(truth).view(), loss_cache);
        return scale * loss_function.values(loss_cache).loss;
    }

    struct Gradient {
        Parameters<B, double> parameters;
        std::vector<vec3<double>> pose, transl;
        std::vector<double> coefficients;
        std::vector<vec3<double>> means; // with respect to x̂₀
    };

    Gradient gradient() {
        loss();
        Image<double> dL_drender(3, 40, 36);
        loss_function.backward(std::as_const(render).view(), std::as_const(truth).view(), scale, loss_cache,
                               dL_drender.view());
        Splats<B, double> dL_dsplats;
        dL_dsplats.resize(model.size());
        fill_zero(backend, dL_dsplats.view());
        rasterizer.backward(camera, std::as_const(splats).view(), {.color = {0.9, 0.8, 0.7}},
                            {.color = std::as_const(dL_drender).view()}, raster_cache, dL_dsplats.view());
        Gradient g;
        g.parameters.become_zero_like(backend, model.parameters());
        g.pose.assign(4, vec3<double>(0.0));
        g.transl.assign(1, vec3<double>(0.0));
        g.coefficients.assign(model.rig().coefficient_count(), 0);
        // The camera's centre is a function of its extrinsics; here it is a constant.
        model.backward(pose, camera.center(), std::as_const(dL_dsplats).view(), cache, g.parameters,
                       {g.pose, g.coefficients, g.transl}, {}, code());
        g.means.assign(cache.dL_dmeans.begin(), cache.dL_dmeans.end());
        return g;
    }
};

template <class Buffer>
Span<double> numbers(Buffer& buffer) {
    return view_as<double>(Span<std::remove_reference_t<decltype(buffer[0])>>(buffer));
}

} // namespace

namespace {

/// Checks every group that the configuration has, and the pose.
template <class B>
void check_chain(const AvatarConfig& config, bool with_priors, std::initializer_list<ParameterGroup> expected) {
    Chain<B> chain(config, with_priors);
    auto gradient = chain.gradient();
    const auto loss = [&] { return chain.loss(); };
    const test::GradientCheck check{.step = 1e-6, .tolerance = 1e-6};
    std::size_t found = 0;
    for (std::size_t g = 0; g < parameter_group_count; ++g) {
        const auto group = static_cast<ParameterGroup>(g);
        CAPTURE(parameter_group_names[g]);
        const Span<double> values = chain.model.parameters()[group];
        if (values.empty()) continue;
        if (std::find(expected.begin(), expected.end(), group) != expected.end()) ++found;
        double largest = 0;
        for (const double value : gradient.parameters[group]) largest = std::max(largest, std::abs(value));
        CHECK(largest > 1e-3); // the check below must have something to see
        auto options = check;
        options.elements = test::spread_elements(values.size(), chain.model.touched_entries(group), 2, 30);
        test::check_gradient(loss, values, Span<const double>(gradient.parameters[group]), options);
    }
    CHECK(found == expected.size());
    test::check_gradient(loss, numbers(chain.pose.pose), test::scalars(gradient.pose), check);
    test::check_gradient(loss, numbers(chain.pose.coefficients), test::scalars(gradient.coefficients), check);
    test::check_gradient(loss, numbers(chain.pose.transl), test::scalars(gradient.transl), check);
}

} // namespace

TEST_CASE_TEMPLATE("the whole chain's adjoint is the gradient of the loss", B, cpu::Serial, cpu::Threads) {
    using enum ParameterGroup;
    SUBCASE("fields apart, as the baseline has them") {
        check_chain<B>({.heads = Heads::separate}, false,
                       {joints, quats, log_scales, opacity_logits, displacement_table, displacement_network, sh_table,
                        sh_network});
    }
    SUBCASE("one head, regions, priors, shadows that know the time") {
        check_chain<B>({.ao = AmbientOcclusion::time}, true,
                       {joints, quats, log_scales, opacity_logits, joint_table, joint_network, ao_table, ao_network});
    }
    SUBCASE("a table each for coarse and fine, heads that know the time") {
        check_chain<B>({.head_time = true, .separate_tables = true}, true, {joint_table, joint_network});
    }
    SUBCASE("nothing from fields, shadows that know the pose") {
        check_chain<B>({.hash_displacement = false, .hash_sh = false, .ao = AmbientOcclusion::pose, .largest_ao = 1.7},
                       false, {displacements, sh, ao_table, ao_network});
    }
    SUBCASE("colours from a field alone, polar blending") {
        check_chain<B>({.hash_displacement = false, .deformation = Deformation::polar}, true,
                       {displacements, sh_table, sh_network});
    }
    SUBCASE("displacements from a field alone, dual quaternions") {
        check_chain<B>({.hash_sh = false, .deformation = Deformation::dual_quaternion}, true,
                       {sh, displacement_table, displacement_network});
    }
}

TEST_CASE("ambient occlusion starts the same everywhere, and as it was asked to") {
    using Model = Chain<cpu::Serial>::Model;
    const Chain<cpu::Serial> chain;
    cpu::Serial backend;
    auto config = Chain<cpu::Serial>::small({.ao = AmbientOcclusion::time, .initial_ao = 0.9});
    Model model(backend, chain.rig, chain.samples, 5, config);
    Model::Cache cache;
    const std::vector<double> code(model.ao_code_size(), 0.3);
    for (const double ao : model.occlusion(code, cache)) CHECK(ao == doctest::Approx(0.9));
}

TEST_CASE("the canonical body starts whole, whatever the priors say") {
    using Model = Chain<cpu::Serial>::Model;
    const Chain<cpu::Serial> chain;
    cpu::Serial backend;
    for (const Heads heads : {Heads::joint, Heads::separate}) {
        auto priors = Chain<cpu::Serial>::priors(chain.samples.size());
        for (double& feature : priors.features) feature *= 10;
        Model model(backend, chain.rig, chain.samples, 5, Chain<cpu::Serial>::small({.heads = heads}), priors);
        Model::Cache cache;
        model.update_canonical(cache);
        const auto means = model.canonical_gaussians().means;
        for (std::size_t i = 0; i < means.size(); ++i) CHECK(length(means[i] - chain.samples.positions[i]) < 1e-3);
    }
}

TEST_CASE("Gaussians start flat on the surface, or round") {
    using Model = Chain<cpu::Serial>::Model;
    const Chain<cpu::Serial> chain;
    cpu::Serial backend;
    auto samples = chain.samples;
    samples.normals[0] = vec3<double>(0); // unknown
    const auto start = [&](double thickness) {
        Model model(backend, chain.rig, samples, 5, Chain<cpu::Serial>::small({.initial_thickness = thickness}));
        Model::Cache cache;
        model.update_canonical(cache);
        return model.canonical_gaussians();
    };
    const auto flat = start(0.25), round = start(1);
    for (std::size_t i = 0; i < flat.size(); ++i) {
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
    using Model = Chain<cpu::Serial>::Model;
    const Chain<cpu::Serial> chain;
    cpu::Serial backend;
    const auto config = Chain<cpu::Serial>::small({});
    const std::size_t N = chain.samples.size();
    const Model everywhere(backend, chain.rig, chain.samples, 5, config);
    const Model nowhere(backend, chain.rig, chain.samples, 5, config, {std::vector<double>(N, 0.0), {}});
    CHECK(everywhere.lookups() == N * 3 * 8);
    CHECK(nowhere.lookups() == N * 8); // levels 1 and 2 are fine
}

TEST_CASE("a box about a slim body has more of its cells on the body than a cube") {
    using Model = Chain<cpu::Serial>::Model;
    const Chain<cpu::Serial> chain;
    cpu::Serial backend;
    auto config = Chain<cpu::Serial>::small({.heads = Heads::separate});
    config.hash_table_size = 1u << 16; // no collisions
    const auto touched = [&](FieldBounds bounds) {
        config.bounds = bounds;
        return Model(backend, chain.rig, chain.samples, 5, config).touched_entries(ParameterGroup::sh_table)->size();
    };
    CAPTURE(touched(FieldBounds::cube));
    CHECK(touched(FieldBounds::box) > 3 * touched(FieldBounds::cube) / 2);
}

TEST_CASE("the chain's gradient of a Gaussian's mean") {
    Chain<cpu::Serial> chain;
    const auto gradient = chain.gradient();
    const GaussianCloud<double> cloud = chain.model.canonical_gaussians();
    std::vector<vec3<double>> means(chain.cache.means.begin(), chain.cache.means.end()); // x̂₀(t)
    const auto loss = [&] {
        skinned_splats_forward<2>(
            chain.backend,
            {means, cloud.quats, cloud.log_scales, cloud.opacity_logits, cloud.sh, {}, chain.model.rig().skin()},
            chain.cache.rig.bones, chain.camera.center(), chain.splats.view());
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
    const auto gradient = chain.gradient();
    const auto& touched = *chain.model.touched_entries(ParameterGroup::sh_table);
    std::vector<bool> is_touched(gradient.parameters[ParameterGroup::sh_table].size() / 2, false);
    for (const std::uint32_t entry : touched) is_touched[entry] = true;
    std::size_t with_gradient = 0;
    for (std::size_t i = 0; i < gradient.parameters[ParameterGroup::sh_table].size(); ++i) {
        const double value = gradient.parameters[ParameterGroup::sh_table][i];
        with_gradient += value != 0;
        CHECK((value == 0 || is_touched[i / 2]));
    }
    CHECK(with_gradient > 0);
}

TEST_CASE("the model refuses what does not fit") {
    Chain<cpu::Serial> chain;
    auto fewer = chain.samples;
    fewer.positions.pop_back();
    using Model = Chain<cpu::Serial>::Model;
    CHECK_THROWS_AS(Model(chain.backend, chain.rig, fewer, 1), ShapeError);
    CHECK_THROWS_AS(Model(chain.backend, chain.rig, chain.samples, 1, {.initial_opacity = 1}), ValueError);
    CHECK_THROWS_AS(Model(chain.backend, chain.rig, chain.samples, 1, {.initial_ao = 0}), ValueError);
    CHECK_THROWS_AS(Model(chain.backend, chain.rig, chain.samples, 1, {.initial_thickness = 0}), ValueError);
    CHECK_THROWS_AS(Model(chain.backend, chain.rig, chain.samples, 1, {.initial_thickness = 1.5}), ValueError);
    CHECK_THROWS_AS(Model(chain.backend, chain.rig, chain.samples, 1, {.bounds_margin = 0}), ValueError);
    CHECK_THROWS_AS(Model(chain.backend, chain.rig, chain.samples, 1, {.prior_scale = 0}), ValueError);
    CHECK_THROWS_AS(
        Model(chain.backend, chain.rig, chain.samples, 1, {}, {std::vector<double>(chain.samples.size(), 0.5), {}}),
        ValueError); // level 12 of 3
    CHECK_THROWS_AS(Model(chain.backend, chain.rig, chain.samples, 1,
                          {.hash_displacement = false, .hash_sh = false, .head_time = true}),
                    ValueError);
    CHECK_THROWS_AS(Model(chain.backend, chain.rig, chain.samples, 1, {}, {{0.5}, {}}), ShapeError);
    CHECK_THROWS_AS(Model(chain.backend, chain.rig, chain.samples, 1, {}, {{}, {0.5}}), ValueError);
}

TEST_CASE("a pose's gradient through its shadows, the avatar being what it is") {
    using B = cpu::Serial;
    Chain<B> chain({.ao = AmbientOcclusion::pose, .largest_ao = 1.7});
    test::Rng rng(12);
    Splats<B, double> weights;
    weights.resize(chain.model.size());
    fill_zero(chain.backend, weights.view());
    for (auto& v : weights.colors) v = rng.vec();
    chain.model.update_canonical(chain.cache, chain.code());
    const auto loss = [&] {
        chain.model.pose(chain.pose, chain.camera.center(), chain.splats.view(), chain.cache, chain.code());
        double sum = 0;
        for (std::size_t i = 0; i < chain.model.size(); ++i) sum += dot(chain.splats.colors[i], weights.colors[i]);
        return sum;
    };
    std::vector<vec3<double>> dL_dpose(4, vec3<double>(0.0));
    const auto backward = [&] {
        loss();
        chain.model.pose_backward(chain.pose, chain.camera.center(), std::as_const(weights).view(), chain.cache,
                                  {dL_dpose, {}, {}});
    };
    backward();
    const auto once = dL_dpose;
    test::check_gradient(loss, numbers(chain.pose.pose), test::scalars(dL_dpose));
    backward();
    for (std::size_t j = 0; j < 4; ++j) CHECK(length(dL_dpose[j] - 2.0 * once[j]) < 1e-12);

    // The same shadows when the model is asked for them alone.
    const std::vector<double> shadows(chain.cache.occlusion.begin(), chain.cache.occlusion.end());
    const auto alone = chain.model.occlusion(chain.pose, chain.ao_code, chain.cache);
    CHECK(std::equal(alone.begin(), alone.end(), shadows.begin(), shadows.end()));
}
