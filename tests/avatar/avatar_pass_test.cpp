// SPDX-License-Identifier: Apache-2.0
#include <gsh/avatar/avatar_pass.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/cpu.hpp>

#include "support/bodies.hpp"
#include "support/gradient.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

/// Gaussians on a tube that is posed, and a random weight of every number of their splats.
template <class B>
struct PosedTube {
    B backend;
    BodyModel body = test::tube(4, 6, 6);
    SurfaceSamples samples = sample_surface(body, body.v_template, std::vector<double>(body.vertex_count(), 0.6), 3);
    RigData data = make_rig(body, std::vector<double>(2, 0.0), samples);
    AvatarPass<B, double> pass;
    typename AvatarPass<B, double>::Cache cache;
    RigPose<B, double> pose;
    std::vector<vec3<double>> means = samples.positions, log_scales, sh, joints = data.joints;
    std::vector<quat<double>> quats;
    std::vector<double> opacity_logits, ao;
    vec3<double> center{0.4, 1.1, 3};
    Splats<B, double> splats, weights;

    // Gradients.
    std::vector<vec3<double>> dL_dmeans, dL_dlog_scales, dL_dsh, dL_djoints, dL_dpose, dL_dtransl, dL_dcenter;
    std::vector<quat<double>> dL_dquats;
    std::vector<double> dL_dopacity_logits, dL_dao, dL_dcoefficients;

    explicit PosedTube(Deformation deformation = Deformation::linear, B where = B())
        : backend(std::move(where)), pass(backend, data, {.deformation = deformation}) {
        test::Rng rng(9);
        const std::size_t N = pass.size();
        for (std::size_t i = 0; i < N; ++i) {
            log_scales.push_back(rng.vec(-3, -2));
            quats.push_back(rng.quat());
            opacity_logits.push_back(rng.uniform(-1, 1));
            ao.push_back(rng.uniform(0.4, 1));
        }
        sh = rng.vecs(4 * N, -0.05, 0.05); // colours within (0, 1)
        Motion motion = rest_motion(data);
        motion.pose = rng.vecs(4, -0.5, 0.5);
        motion.expression_count = 2;
        motion.expression = {0.7, -0.5};
        motion.betas = {0.1, 0.3};
        motion.transl = {rng.vec(-0.1, 0.1)};
        pass.rig().upload_pose(motion, 0, pose);
        splats.resize(N), weights.resize(N);
        fill_zero(backend, weights.view());
        for (std::size_t i = 0; i < N; ++i) {
            weights.means[i] = rng.vec(), weights.colors[i] = rng.vec(), weights.opacities[i] = rng.uniform(-1, 1);
            for (double& w : test::scalars(weights.covariances[i])) w = rng.uniform(-1, 1);
        }
        dL_dlog_scales.assign(N, vec3<double>(0)), dL_dsh.assign(4 * N, vec3<double>(0));
        dL_dquats.assign(N, {0, 0, 0, 0}), dL_dopacity_logits.assign(N, 0), dL_dao.assign(N, 0);
        dL_djoints.assign(4, vec3<double>(0)), dL_dpose.assign(4, vec3<double>(0));
        dL_dtransl.assign(1, vec3<double>(0)), dL_dcenter.assign(1, vec3<double>(0));
        dL_dcoefficients.assign(pass.rig().coefficient_count(), 0);
    }
    [[nodiscard]] SkinnedView<const double> gaussians() const {
        return {.quats = quats,
                .log_scales = log_scales,
                .opacity_logits = opacity_logits,
                .sh = sh,
                .ao = ao,
                .sh_stride = 4};
    }
    void forward() {
        pass.move(pose, joints, cache);
        const auto displace = [&](Span<vec3<double>> to) { backend.copy(Span<const vec3<double>>(means), to); };
        pass.template forward<1>(
            gaussians(), displace, [&] { return Span<const double>(ao); }, center, splats.view(), cache);
    }
    double loss() {
        forward();
        double sum = 0;
        for (std::size_t i = 0; i < pass.size(); ++i) {
            sum += dot(splats.means[i], weights.means[i]) + dot(splats.colors[i], weights.colors[i]) +
                   splats.opacities[i] * weights.opacities[i];
            const auto a = test::scalars(splats.covariances[i]), b = test::scalars(weights.covariances[i]);
            for (std::size_t k = 0; k < a.size(); ++k) sum += a[k] * b[k];
        }
        return sum;
    }
    void backward(bool with_joints = true) {
        forward();
        const AvatarGradient<double> dL_dall{.gaussians = {.quats = dL_dquats,
                                                           .log_scales = dL_dlog_scales,
                                                           .opacity_logits = dL_dopacity_logits,
                                                           .sh = dL_dsh,
                                                           .ao = dL_dao,
                                                           .sh_stride = 4},
                                             .joints =
                                                 with_joints ? Span<vec3<double>>(dL_djoints) : Span<vec3<double>>(),
                                             .pose = {dL_dpose, dL_dcoefficients, dL_dtransl},
                                             .center = dL_dcenter};
        bool went_on = false;
        const auto displaced = [&](Span<vec3<double>> of_means) { dL_dmeans.assign(of_means.begin(), of_means.end()); };
        pass.template backward<1>(
            pose, gaussians(), displaced, [&] { went_on = true; }, center, std::as_const(weights).view(), cache,
            dL_dall);
        CHECK(went_on);
    }
    /// All gradients that a pass adds to, number after number.
    std::vector<double> gradients() {
        std::vector<double> all;
        const auto add = [&](auto& values) {
            const auto numbers = test::scalars(values);
            all.insert(all.end(), numbers.begin(), numbers.end());
        };
        add(dL_dquats), add(dL_dlog_scales), add(dL_dopacity_logits), add(dL_dsh), add(dL_dao), add(dL_djoints);
        add(dL_dpose), add(dL_dcoefficients), add(dL_dtransl), add(dL_dcenter);
        return all;
    }
};

template <class Buffer>
Span<double> buffer_numbers(Buffer& buffer) {
    return view_as<double>(Span(buffer.data(), buffer.size()));
}

} // namespace

TEST_CASE("posing's adjoint is the gradient of the splats, and adds") {
    for (const Deformation deformation : {Deformation::linear, Deformation::polar, Deformation::dual_quaternion}) {
        PosedTube<cpu::Serial> tube(deformation);
        tube.backward();
        const auto loss = [&] { return tube.loss(); };
        const test::GradientCheck some{.tolerance = 2e-6, .stride = 7}, all{.tolerance = 2e-6};
        test::check_gradient(loss, test::scalars(tube.means), test::scalars(tube.dL_dmeans), some);
        test::check_gradient(loss, test::scalars(tube.quats), test::scalars(tube.dL_dquats), some);
        test::check_gradient(loss, test::scalars(tube.log_scales), test::scalars(tube.dL_dlog_scales), some);
        test::check_gradient(loss, test::scalars(tube.opacity_logits), test::scalars(tube.dL_dopacity_logits), some);
        test::check_gradient(loss, test::scalars(tube.sh), test::scalars(tube.dL_dsh), some);
        test::check_gradient(loss, test::scalars(tube.ao), test::scalars(tube.dL_dao), some);
        test::check_gradient(loss, test::scalars(tube.joints), test::scalars(tube.dL_djoints), all);
        test::check_gradient(loss, buffer_numbers(tube.pose.pose), test::scalars(tube.dL_dpose), all);
        test::check_gradient(loss, buffer_numbers(tube.pose.coefficients), test::scalars(tube.dL_dcoefficients), all);
        test::check_gradient(loss, buffer_numbers(tube.pose.transl), test::scalars(tube.dL_dtransl), all);
        test::check_gradient(loss, test::scalars(tube.center), test::scalars(tube.dL_dcenter), all);
        const auto once = tube.gradients();
        const auto once_means = tube.dL_dmeans;
        tube.backward();
        const auto twice = tube.gradients();
        for (std::size_t i = 0; i < once.size(); ++i)
            CHECK(std::abs(twice[i] - 2 * once[i]) <= 1e-12 * std::max(1.0, std::abs(once[i])));
        CHECK(tube.dL_dmeans == once_means); // these are overwritten
    }
}

TEST_CASE("where the joints' gradient is not asked for, the others are what they were") {
    PosedTube<cpu::Serial> with, without;
    with.backward(), without.backward(false);
    for (const auto& g : without.dL_djoints) CHECK(g == vec3<double>(0));
    for (auto& g : with.dL_djoints) g = vec3<double>(0);
    CHECK(without.gradients() == with.gradients());
    without.backward(false); // scratch of an earlier pass has no effect
    CHECK(without.dL_dmeans == with.dL_dmeans);
}

TEST_CASE("the identity pose moves nothing") {
    PosedTube<cpu::Serial> tube;
    tube.pass.rig().upload_pose(rest_motion(tube.data), 0, tube.pose);
    tube.forward();
    for (std::size_t i = 0; i < tube.pass.size(); ++i) CHECK(length(tube.splats.means[i] - tube.means[i]) < 1e-12);
}

TEST_CASE("posing is the same on threads bit for bit") {
    PosedTube<cpu::Serial> serial;
    serial.backward();
    for (const std::size_t count : {1, 2, 5}) {
        PosedTube<cpu::Threads> threaded(Deformation::linear, cpu::Threads(count));
        threaded.backward();
        CHECK(threaded.gradients() == serial.gradients());
        CHECK(threaded.dL_dmeans == serial.dL_dmeans);
        for (std::size_t i = 0; i < serial.pass.size(); ++i) {
            CHECK(threaded.splats.means[i] == serial.splats.means[i]);
            CHECK(threaded.splats.colors[i] == serial.splats.colors[i]);
            CHECK(threaded.splats.opacities[i] == serial.splats.opacities[i]);
        }
    }
}
