// SPDX-License-Identifier: Apache-2.0
#include <gsh/body/joint_error.hpp>
#include <gsh/cpu.hpp>
#include <gsh/image/color.hpp>
#include <gsh/loss/photometric.hpp>
#include <gsh/refine/refinement.hpp>
#include <gsh/render/rasterizer.hpp>

#include "support/posed_scene.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

using namespace gsh;
using test::PosedScene;

namespace {

/// Everything on, from the first step.
RefinementParams everything() {
    RefinementParams config;
    config.pose = {.rate = 4e-3, .terms = {.pull = 0.01, .drift = 0.02, .acceleration = 0.03}};
    config.transl = {.rate = 1e-3, .terms = {.pull = 0.01, .drift = 0.02, .acceleration = 0.03}};
    config.expression = {.rate = 1e-2, .terms = {.pull = 0.01, .drift = 0.02, .acceleration = 0.03}};
    config.betas = {.rate = 1e-2, .terms = {.pull = 0.04}};
    config.pose_bias = {.rate = 3e-3, .terms = {.pull = 0.02}};
    config.transl_bias = {.rate = 1e-3, .terms = {.pull = 0.03}};
    config.camera_rotation = {.rate = 1e-3, .terms = {.pull = 0.05}};
    config.camera_translation = {.rate = 1e-3, .terms = {.pull = 0.06}};
    config.camera_focal = {.rate = 1e-3, .terms = {.pull = 0.07}};
    config.camera_principal_point = {.rate = 1e-2, .terms = {.pull = 0.08}};
    return config;
}

/// Steps of training with a fixed avatar. Each step has one photograph.
template <class B>
struct Training {
    const PosedScene* scene;
    B* backend;
    Avatar<B> avatar;
    Rasterizer<B> rasterizer;
    PhotometricLoss<B> loss;
    RigPose<B> pose;
    typename Avatar<B>::Cache cache;
    Splats<B> splats, dL_dsplats;
    typename Rasterizer<B>::Cache raster;
    PhotometricCache<B> loss_cache;
    Image<float> color{3, PosedScene::size, PosedScene::size}, truth = color, dL_dcolor = color;

    Training(B& where, const PosedScene& posed_scene)
        : scene(&posed_scene), backend(&where), avatar(where, posed_scene.avatar),
          rasterizer(where, raster_params<float>(posed_scene.avatar.filter)), loss(where) {
        splats.resize(avatar.size()), dL_dsplats.resize(avatar.size());
    }

    void step(MotionRefinement<B>& refinement, std::size_t frame, std::size_t c, double progress) {
        refinement.set_progress(progress);
        const Background<float> white{.color = vec3<float>(1.0f)};
        const Camera<float> camera = refinement.camera(c);
        composite_rgba8(*backend, scene->observe(frame, c).rgba, PosedScene::size, PosedScene::size, white.color,
                        truth.view());
        refinement.pose(frame, pose);
        avatar.pose(pose, camera.center(), splats.view(), cache);
        rasterizer.forward(camera, std::as_const(splats).view(), white, {.color = color.view()}, raster);
        loss.forward(std::as_const(color).view(), std::as_const(truth).view(), loss_cache);
        std::fill(dL_dcolor.data.begin(), dL_dcolor.data.end(), 0.0f);
        loss.backward(std::as_const(color).view(), std::as_const(truth).view(), 1, loss_cache, dL_dcolor.view());
        fill_zero(*backend, dL_dsplats.view());
        CameraGradient<float> dL_dcamera;
        vec3<float> dL_dcenter(0.0f);
        const Span<CameraGradient<float>> camera_gradient =
            refinement.learns_camera(c) ? Span<CameraGradient<float>>(&dL_dcamera, 1) : Span<CameraGradient<float>>();
        const Span<vec3<float>> center_gradient =
            refinement.learns_camera(c) ? Span<vec3<float>>(&dL_dcenter, 1) : Span<vec3<float>>();
        rasterizer.backward(camera, std::as_const(splats).view(), white, {.color = std::as_const(dL_dcolor).view()},
                            raster, dL_dsplats.view(), camera_gradient);
        if (refinement.learns_motion(frame) || refinement.learns_camera(c)) {
            const auto dL_dpose = refinement.pose_gradient();
            avatar.backward_to_pose(pose, camera.center(), std::as_const(dL_dsplats).view(), cache, dL_dpose,
                                 center_gradient);
            if (refinement.learns_motion(frame)) refinement.accumulate(frame, dL_dpose);
            if (refinement.learns_camera(c))
                refinement.accumulate_camera(c, Span<const CameraGradient<float>>(&dL_dcamera, 1),
                                             Span<const vec3<float>>(&dL_dcenter, 1));
        }
        refinement.step();
    }

    void steps(MotionRefinement<B>& refinement, std::size_t count, std::size_t whole) {
        for (std::size_t i = 0; i < count; ++i) {
            const std::uint64_t step = refinement.step_count();
            const auto order =
                shuffled_indices(static_cast<std::uint32_t>(PosedScene::frames * PosedScene::camera_count), step / 15);
            const std::size_t photo = order[step % 15];
            this->step(refinement, photo / PosedScene::camera_count, photo % PosedScene::camera_count,
                       static_cast<double>(step) / static_cast<double>(whole));
        }
    }
};

bool same(const RefinementState<float>& a, const RefinementState<float>& b) {
    return a.steps == b.steps && a.updates == b.updates && a.increments == b.increments &&
           a.first_moment == b.first_moment && a.second_moment == b.second_moment;
}

} // namespace

TEST_CASE("nothing has moved at first: poses, cameras and the motion keep their bits") {
    const PosedScene scene;
    cpu::Serial backend;
    MotionRefinement<cpu::Serial> refinement(backend, scene.avatar.rig, scene.truth, scene.cameras);
    const Rig<cpu::Serial> rig(backend, scene.avatar.rig);
    RigPose<cpu::Serial> expected, found;
    for (std::size_t t = 0; t < PosedScene::frames; ++t) {
        rig.upload_pose(scene.truth, t, expected);
        refinement.pose(t, found);
        CHECK(std::equal(expected.pose.begin(), expected.pose.end(), found.pose.begin()));
        CHECK(std::equal(expected.coefficients.begin(), expected.coefficients.end(), found.coefficients.begin()));
        CHECK(expected.transl[0] == found.transl[0]);
    }
    const Motion motion = refinement.motion();
    CHECK(motion.pose == scene.truth.pose);
    CHECK(motion.transl == scene.truth.transl);
    CHECK(motion.expression == scene.truth.expression);
    CHECK(motion.betas == scene.truth.betas);
    for (std::size_t c = 0; c < scene.cameras.size(); ++c) {
        CHECK(refinement.cameras()[c].R == scene.cameras[c].R);
        CHECK(refinement.cameras()[c].t == scene.cameras[c].t);
        CHECK(refinement.camera(c).t == scene.cameras[c].cast<float>().t);
    }
    CHECK(refinement.terms() == 0);
    CHECK(!refinement.learns(RefinementGroup::pose)); // starts at step 300
}

TEST_CASE("a motion that knows less than the rig comes back complete") {
    const PosedScene scene;
    Motion bare = scene.truth;
    bare.betas.clear(), bare.expression.clear(), bare.expression_count = 0;
    bare.pose[0] = {0, 4, 0}; // beyond half a turn
    cpu::Serial backend;
    MotionRefinement<cpu::Serial> refinement(backend, scene.avatar.rig, bare, {});
    const Motion motion = refinement.motion();
    CHECK(motion.betas == scene.avatar.rig.betas);
    CHECK(motion.expression == std::vector<double>(10, 0.0));
    CHECK(length(motion.pose[0] - bare.pose[0]) < 1e-12);
    RigPose<cpu::Serial> pose;
    refinement.pose(0, pose);
    CHECK(pose.pose[0].y == doctest::Approx(4 - 2 * 3.141592653589793));
}

TEST_CASE("gradients of poses, cameras and terms reach every increment") {
    const PosedScene scene;
    test::Rng rng(17);
    RefinementParams config = everything();
    config.adam = {.beta1 = 0, .beta2 = 0.5}; // the first moment is then the gradient
    config.fixed_cameras = {};
    Motion estimate = scene.estimate();
    estimate.timestamps = {0, 0.1, 0.25, 0.3, 0.4};
    cpu::Serial backend;
    using Refinement = MotionRefinement<cpu::Serial, double>;
    Refinement refinement(backend, scene.avatar.rig, estimate, scene.cameras, config);
    RefinementState<double> state = refinement.state();
    for (double& w : state.increments) w = rng.uniform(-0.2, 0.2);

    struct Direction {
        std::vector<vec3<double>> pose, transl;
        std::vector<double> coefficients;
    };
    std::vector<Direction> dL_dposes;
    for (std::size_t t = 0; t < PosedScene::frames; ++t)
        dL_dposes.push_back({rng.vecs(4), rng.vecs(1), rng.numbers(4)});
    std::vector<CameraGradient<double>> dL_dcameras(3);
    for (auto& g : dL_dcameras)
        g = {mat3<double>(rng.vec(), rng.vec(), rng.vec()),
             rng.vec(),
             rng.uniform(),
             rng.uniform(),
             rng.uniform(),
             rng.uniform()};
    const auto dL_dcenters = rng.vecs(3);

    const auto loss = [&] {
        refinement.set_state(state);
        double sum = refinement.terms();
        RigPose<cpu::Serial, double> pose;
        for (std::size_t t = 0; t < PosedScene::frames; ++t) {
            refinement.pose(t, pose);
            for (std::size_t j = 0; j < 4; ++j) sum += dot(pose.pose[j], dL_dposes[t].pose[j]);
            for (std::size_t k = 0; k < 4; ++k) sum += pose.coefficients[k] * dL_dposes[t].coefficients[k];
            sum += dot(pose.transl[0], dL_dposes[t].transl[0]);
        }
        for (std::size_t c = 0; c < 3; ++c) {
            const Camera<double> camera = refinement.camera(c);
            const auto& g = dL_dcameras[c];
            for (int i = 0; i < 3; ++i) sum += dot(camera.R[i], g.dL_dR[i]);
            sum += dot(camera.t, g.dL_dt) + camera.fx * g.dL_dfx + camera.fy * g.dL_dfy + camera.cx * g.dL_dcx +
                   camera.cy * g.dL_dcy;
            sum += dot(camera.center(), dL_dcenters[c]);
        }
        return sum;
    };
    const auto gradient = [&](int times) {
        refinement.set_state(state);
        for (int n = 0; n < times; ++n) {
            for (std::size_t t = 0; t < PosedScene::frames; ++t)
                refinement.accumulate(t, {dL_dposes[t].pose, dL_dposes[t].coefficients, dL_dposes[t].transl});
            for (std::size_t c = 0; c < 3; ++c)
                refinement.accumulate_camera(c, Span<const CameraGradient<double>>(&dL_dcameras[c], 1),
                                             Span<const vec3<double>>(&dL_dcenters[c], 1));
        }
        refinement.step();
        return refinement.state().first_moment;
    };
    const auto once = gradient(1), twice = gradient(2);
    test::check_gradient(loss, state.increments, once);
    // accumulate adds. The terms are added once per step.
    for (auto& d : dL_dposes) {
        for (auto& v : d.pose) v *= 2.0;
        for (auto& v : d.transl) v *= 2.0;
        for (auto& v : d.coefficients) v *= 2.0;
    }
    const auto frame_numbers = PosedScene::frames * (12 + 3 + 2) + 2 + 12 + 3; // betas, biases
    const auto doubled = gradient(1);
    for (std::size_t i = 0; i < frame_numbers; ++i) CHECK(twice[i] == doctest::Approx(doubled[i]).epsilon(1e-12));
}

TEST_CASE("an avatar's backward_to_pose is the gradient of its splats, and adds") {
    const PosedScene scene;
    cpu::Serial backend;
    AvatarData data = scene.avatar; // with view-dependent colours
    data.gaussians.sh_degree = 1;
    test::Rng colors(3);
    data.gaussians.sh.clear();
    for (const auto& constant : scene.avatar.gaussians.sh) {
        data.gaussians.sh.push_back(constant);
        for (int k = 1; k < 4; ++k) data.gaussians.sh.push_back(vec3<float>(colors.vec(-0.02, 0.02)));
    }
    Avatar<cpu::Serial, double> avatar(backend, data);
    RigPose<cpu::Serial, double> pose, dL_dpose, dL_dcenter;
    avatar.rig().upload_pose(scene.truth, 1, pose);
    test::Rng rng(2);
    vec3<double> center{0.2, 0.9, 3};
    Splats<cpu::Serial, double> splats, weights;
    splats.resize(avatar.size()), weights.resize(avatar.size());
    for (auto& v : weights.means) v = rng.vec();
    for (auto& v : weights.covariances)
        v = {rng.uniform(), rng.uniform(), rng.uniform(), rng.uniform(), rng.uniform(), rng.uniform()};
    for (auto& v : weights.opacities) v = rng.uniform();
    for (auto& v : weights.colors) v = rng.vec();
    Avatar<cpu::Serial, double>::Cache cache;
    const auto loss = [&] {
        avatar.pose(pose, center, splats.view(), cache);
        double sum = 0;
        for (std::size_t i = 0; i < avatar.size(); ++i) {
            const auto &s = splats.covariances[i], &w = weights.covariances[i];
            sum += dot(splats.means[i], weights.means[i]) + dot(splats.colors[i], weights.colors[i]) +
                   splats.opacities[i] * weights.opacities[i] + s.xx * w.xx + s.xy * w.xy + s.xz * w.xz + s.yy * w.yy +
                   s.yz * w.yz + s.zz * w.zz;
        }
        return sum;
    };
    avatar.rig().upload_pose(scene.truth, 1, dL_dpose); // sets the sizes of the arrays
    const auto zero = [&] {
        backend.fill(Span<vec3<double>>(dL_dpose.pose), vec3<double>(0.0));
        backend.fill(Span<vec3<double>>(dL_dpose.transl), vec3<double>(0.0));
        backend.fill(Span<double>(dL_dpose.coefficients), 0.0);
    };
    vec3<double> dL_dcentre(0.0);
    const auto backward = [&] {
        (void)loss();
        avatar.backward_to_pose(pose, center, std::as_const(weights).view(), cache,
                             {dL_dpose.pose, dL_dpose.coefficients, dL_dpose.transl},
                             Span<vec3<double>>(&dL_dcentre, 1));
    };
    zero();
    backward();
    const test::GradientCheck close{.tolerance = 1e-5}; // sums over hundreds of splats
    test::check_gradient(loss, view_as<double>(Span<vec3<double>>(pose.pose)),
                         view_as<const double>(Span<const vec3<double>>(dL_dpose.pose)), close);
    test::check_gradient(loss, view_as<double>(Span<vec3<double>>(pose.transl)),
                         view_as<const double>(Span<const vec3<double>>(dL_dpose.transl)), close);
    test::check_gradient(loss, pose.coefficients, dL_dpose.coefficients, close);
    test::check_gradient(loss, test::scalars(center), test::scalars(dL_dcentre), close);
    const std::vector<double> first(dL_dpose.coefficients.begin(), dL_dpose.coefficients.end());
    backward();
    for (std::size_t k = 0; k < first.size(); ++k) CHECK(dL_dpose.coefficients[k] == 2 * first[k]);
}

TEST_CASE("photographs bring noisy poses back, cameras too") {
    const PosedScene scene;
    cpu::Serial backend;
    RefinementParams config;
    config.pose = {.rate = 1e-2, .terms = {.pull = 1e-3}};
    config.transl = {.rate = 3e-3, .terms = {.pull = 1e-3}};
    config.expression = {};
    const Motion estimate = scene.estimate();
    const double before = joint_errors(scene.body, estimate, scene.truth, RootAlignment::none).mean_mm;
    Training<cpu::Serial> training(backend, scene);
    SUBCASE("poses") {
        MotionRefinement<cpu::Serial> refinement(backend, scene.avatar.rig, estimate, scene.cameras, config);
        training.steps(refinement, 150, 150);
        const double after = joint_errors(scene.body, refinement.motion(), scene.truth, RootAlignment::none).mean_mm;
        MESSAGE("joints " << before << " mm before, " << after << " mm after");
        CHECK(after < 0.25 * before);
    }
    SUBCASE("cameras") {
        auto cameras = scene.cameras;
        const CameraIncrement<double> error{{0.02, -0.03, 0.01}, {0.02, -0.01, 0.03}, 0.01, {0.3, -0.4}};
        cameras[1] = moved_camera(cameras[1], vec3<double>(0, 0.3, 0), error);
        config.pose = config.transl = {};
        config.camera_rotation = {.rate = 3e-3}, config.camera_translation = {.rate = 3e-3};
        config.camera_focal = {.rate = 1e-3}, config.camera_principal_point = {.rate = 0.03};
        config.fixed_cameras = {0, 2};
        MotionRefinement<cpu::Serial> refinement(backend, scene.avatar.rig, scene.truth, cameras, config);
        const auto distance = [&](const Camera<double>& camera) { // in pixels, at points around the body
            double sum = 0;
            for (const vec3<double> p : {vec3<double>(0, 0.1, 0.2), {0.2, 0.8, 0}, {-0.2, 1.2, 0}, {0, 1.5, -0.2}}) {
                const auto d =
                    to_pixel(camera, to_camera(camera, p)) - to_pixel(scene.cameras[1], to_camera(scene.cameras[1], p));
                sum += std::sqrt(d.x * d.x + d.y * d.y) / 4;
            }
            return sum;
        };
        training.steps(refinement, 120, 120);
        const auto refined = refinement.cameras();
        MESSAGE("camera " << distance(cameras[1]) << " px before, " << distance(refined[1]) << " px after");
        CHECK(distance(refined[1]) < 0.25 * distance(cameras[1]));
        CHECK(refined[0].t == cameras[0].t);
        CHECK(refined[2].R == cameras[2].R);
        CHECK(refinement.motion().pose == scene.truth.pose);
    }
}

TEST_CASE("the same steps give the same numbers at any thread count, and after a stop") {
    const PosedScene scene;
    const RefinementParams config = everything();
    const auto run = [&](auto&& backend, std::size_t stop) {
        using B = std::remove_cvref_t<decltype(backend)>;
        Training<B> training(backend, scene);
        MotionRefinement<B> refinement(backend, scene.avatar.rig, scene.estimate(), scene.cameras, config);
        training.steps(refinement, stop, 12);
        MotionRefinement<B> resumed(backend, scene.avatar.rig, scene.estimate(), scene.cameras, config);
        resumed.set_state(refinement.state());
        Training<B> again(backend, scene);
        again.steps(resumed, 12 - stop, 12);
        return resumed.state();
    };
    const auto expected = run(cpu::Serial(), 12);
    CHECK(expected.steps == 12);
    CHECK(
        std::all_of(expected.increments.begin(), expected.increments.end(), [](float w) { return std::isfinite(w); }));
    CHECK(same(run(cpu::Serial(), 5), expected));
    for (const std::size_t threads : {1, 2, 7}) CHECK(same(run(cpu::Threads(threads), 12), expected));
}

TEST_CASE("groups wait for their start, joints move at their rates, rows at their own visits") {
    const PosedScene scene;
    cpu::Serial backend;
    RefinementParams config;
    config.pose = {.rate = 1e-2, .start = 0.5};
    config.final_rate = 1;
    config.transl = {.rate = 1e-3, .start = 0};
    config.expression = {};
    config.joint_rates = {1, 0.5, 0, 1};
    config.left_out = {4};
    MotionRefinement<cpu::Serial> refinement(backend, scene.avatar.rig, scene.truth, {}, config);
    const std::vector<vec3<float>> ones(4, vec3<float>(1.0f)), one(1, vec3<float>(1.0f));
    std::vector<vec3<float>> pose = ones, transl = one;
    const auto step = [&](std::size_t frame) {
        refinement.accumulate(frame, {pose, {}, transl});
        refinement.step();
    };
    CHECK(refinement.pose_gradient().pose.empty());
    CHECK(refinement.pose_gradient().transl.size() == 1);
    CHECK(refinement.pose_gradient().coefficients.empty());
    step(0), step(0);
    refinement.set_progress(0.5);
    CHECK(refinement.increments(RefinementGroup::pose, 0)[0] == 0);
    CHECK(refinement.increments(RefinementGroup::transl, 0)[0] == doctest::Approx(-2e-3));
    step(0);
    const auto w = refinement.increments(RefinementGroup::pose, 0);
    CHECK(w[0] == doctest::Approx(-1e-2));
    CHECK(w[3] == doctest::Approx(-0.5e-2));
    CHECK(w[6] == 0);
    step(3); // the first visit of another frame is a full step
    CHECK(refinement.increments(RefinementGroup::pose, 3)[0] == doctest::Approx(-1e-2));
    CHECK(refinement.increments(RefinementGroup::pose, 1)[0] == 0);
    CHECK(!refinement.learns_motion(4));
    CHECK_THROWS_AS(step(4), ValueError);
    refinement.carry_to_left_out();
    CHECK(refinement.increments(RefinementGroup::pose, 4)[0] == refinement.increments(RefinementGroup::pose, 3)[0]);
    CHECK(refinement.increments(RefinementGroup::pose, 1)[0] == 0);
}

TEST_CASE("a frame left out takes what lies between its neighbours") {
    const PosedScene scene;
    cpu::Serial backend;
    RefinementParams config;
    config.left_out = {1, 2};
    MotionRefinement<cpu::Serial> refinement(backend, scene.avatar.rig, scene.truth, {}, config);
    refinement.increments(RefinementGroup::transl, 0)[1] = 0.3f;
    refinement.increments(RefinementGroup::transl, 3)[1] = 0.6f;
    refinement.carry_to_left_out();
    CHECK(refinement.increments(RefinementGroup::transl, 1)[1] == doctest::Approx(0.4));
    CHECK(refinement.increments(RefinementGroup::transl, 2)[1] == doctest::Approx(0.5));
    CHECK(refinement.motion().transl[2].y == doctest::Approx(0.5));
}

TEST_CASE("refinement refuses what does not fit") {
    const PosedScene scene;
    cpu::Serial backend;
    using Refinement = MotionRefinement<cpu::Serial>;
    const auto make = [&](const Motion& motion, RefinementParams config) {
        return Refinement(backend, scene.avatar.rig, motion, scene.cameras, config);
    };
    const auto with = [&](auto change) {
        RefinementParams config;
        change(config);
        return config;
    };
    CHECK_THROWS_AS(make(scene.truth, with([](auto& c) { c.pose.rate = -1; })), ValueError);
    CHECK_THROWS_AS(make(scene.truth, with([](auto& c) { c.transl.terms.pull = NAN; })), ValueError);
    CHECK_THROWS_AS(make(scene.truth, with([](auto& c) { c.betas.terms.drift = 1; })), ValueError);
    CHECK_THROWS_AS(make(scene.truth, with([](auto& c) { c.joint_rates = {1}; })), ShapeError);
    CHECK_THROWS_AS(make(scene.truth, with([](auto& c) { c.joint_rates = {1, 1, 1, -1}; })), ValueError);
    CHECK_THROWS_AS(make(scene.truth, with([](auto& c) { c.left_out = {5}; })), ValueError);
    CHECK_THROWS_AS(make(scene.truth, with([](auto& c) { c.fixed_cameras = {3}; })), ValueError);
    CHECK_THROWS_AS(make(scene.truth, with([](auto& c) { c.final_rate = 0; })), ValueError);
    Motion other = scene.truth;
    other.betas = {1, 2, 3};
    CHECK_THROWS_AS(make(other, {}), ValueError);
    other = scene.truth;
    other.transl[0].x = NAN;
    CHECK_THROWS_AS(make(other, {}), ValueError);
    CHECK_THROWS_AS(make(Motion{.joint_count = 4,
                                .expression_count = 0,
                                .betas = {},
                                .pose = {},
                                .expression = {},
                                .transl = {},
                                .timestamps = {}},
                         {}),
                    ValueError);

    Refinement refinement = make(scene.truth, {});
    RigPose<cpu::Serial> pose;
    CHECK_THROWS_AS(refinement.pose(5, pose), ValueError);
    CHECK_THROWS_AS((void)refinement.camera(3), ValueError);
    std::vector<vec3<float>> three(3);
    CHECK_THROWS_AS(refinement.accumulate(0, {three, {}, {}}), ShapeError);
    CHECK_THROWS_AS(refinement.accumulate(0, {{}, {}, three}), ShapeError);
    CHECK_THROWS_AS(refinement.accumulate(5, {}), ValueError);
    const std::vector<CameraGradient<float>> two(2);
    CHECK_THROWS_AS(refinement.accumulate_camera(0, two), ShapeError);
    auto state = refinement.state();
    state.increments.pop_back();
    CHECK_THROWS_AS(refinement.set_state(state), ShapeError);
    state = refinement.state();
    state.updates.push_back(0);
    CHECK_THROWS_AS(refinement.set_state(state), ShapeError);
}

TEST_CASE("rates for fingers and face") {
    CHECK(joint_rates(24, 0.5) == std::vector<double>(24, 1));
    const auto smpl_h = joint_rates(52, 0.5, 0.1), smpl_x = joint_rates(55, 0.5, 0.1);
    CHECK(smpl_h[21] == 1);
    CHECK(smpl_h[22] == 0.5);
    CHECK(smpl_x[24] == 0.1);
    CHECK(smpl_x[25] == 0.5);
    CHECK(smpl_x[54] == 0.5);
}
