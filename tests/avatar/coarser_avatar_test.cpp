// SPDX-License-Identifier: Apache-2.0
/// @file  A coarser avatar has the means of its members in every array, and nearly the pictures of the finer one.
#include <gsh/avatar/avatar_part.hpp>
#include <gsh/avatar/coarser_avatar.hpp>
#include <gsh/cpu.hpp>
#include <gsh/gaussian/cloud_edits.hpp>
#include <gsh/image/image.hpp>
#include <gsh/light/light.hpp>
#include <gsh/loss/metrics.hpp>
#include <gsh/render/rasterizer.hpp>

#include "support/bodies.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

/// Smooth colours on a tube, with everything that an avatar may have. Colours depend on the view.
AvatarData smooth_avatar(double density = 120) {
    const BodyModel body = test::tube(4, 8, 8);
    const std::vector<double> betas{0.3, -0.1};
    const auto samples =
        sample_surface(body, shaped_vertices(body, betas), std::vector<double>(body.vertex_count(), density), 3);
    AvatarData avatar{make_rig(body, betas, samples), GaussianCloud<float>(samples.size(), 1)};
    OcclusionFieldData& field = avatar.occlusion_field.emplace();
    field.width = 3;
    test::Rng rng(8);
    const auto fill = [&](std::vector<float>& values, std::size_t count) {
        while (values.size() < count) values.push_back(static_cast<float>(rng.uniform(-0.3, 0.3)));
    };
    fill(field.pose_weights, 3 * 9 * 3);
    fill(field.weights, field.network().parameter_count());
    for (std::size_t i = 0; i < samples.size(); ++i) {
        const vec3<double>& p = samples.positions[i];
        const vec3<double> out = normalize(vec3<double>(p.x, 0, p.z));
        avatar.gaussians.means[i] = vec3<float>(p + out * (0.01 + 0.001 * rng.normal()));
        avatar.gaussians.quats[i] = {static_cast<float>(rng.normal()), 0.3f, -0.5f, 0.2f};
        const double scale = std::log(samples.scales[i]);
        avatar.gaussians.log_scales[i] = vec3<float>(rng.vec(scale - 0.3, scale + 0.3));
        avatar.gaussians.opacity_logits[i] = static_cast<float>(rng.uniform(0, 3));
        avatar.gaussians.sh[4 * i] =
            sh_of_color(vec3<float>(vec3<double>(0.5 + 0.3 * std::sin(6 * p.y), 0.5 + p.x, 0.5 - p.z)));
        for (std::size_t k = 1; k < 4; ++k) avatar.gaussians.sh[4 * i + k] = vec3<float>(static_cast<float>(0.2 * p.x));
        avatar.ao.push_back(static_cast<float>(0.8 + 0.1 * std::sin(3 * p.y)));
        avatar.mean_irradiance.push_back(static_cast<float>(1 + p.x));
        for (int w = 0; w < 3; ++w) field.neurons.push_back(static_cast<float>(std::sin(p.y + w)));
    }
    return avatar;
}

/// A picture of a posed avatar with a face.
Image<float> picture_of(const AvatarData& data, int size = 100) {
    cpu::Serial backend;
    Motion motion = rest_motion(data.rig);
    for (std::size_t j = 0; j < 4; ++j) motion.pose[j] = vec3<double>(0.3, 0.2, 0.1 * static_cast<double>(j));
    motion.expression_count = 2, motion.expression = {1.5, -1};
    Avatar<cpu::Serial> avatar(backend, data);
    RigPose<cpu::Serial, float> pose;
    avatar.rig().upload_pose(motion, 0, pose);
    Splats<cpu::Serial, float> splats;
    splats.resize(avatar.size());
    Avatar<cpu::Serial>::Cache cache;
    const auto camera =
        look_at<double>({0.5, 1, 3}, {0.2, 0.8, 0.2}, {0, 1, 0}, 0.6, size, size).template cast<float>();
    avatar.pose(pose, camera.center(), splats.view(), cache);
    const Rasterizer<cpu::Serial> rasterizer(backend, raster_params<float>(data.filter));
    Rasterizer<cpu::Serial>::Cache raster_cache;
    Image<float> picture(3, size, size);
    rasterizer.forward(camera, std::as_const(splats).view(), {.color = vec3<float>(1)}, {.color = picture.view()},
                       raster_cache);
    return picture;
}

/// PSNR of the coarser avatar's picture against that of the avatar.
double likeness(const AvatarData& avatar, const AvatarData& coarser) {
    return psnr(picture_of(coarser).view(), picture_of(avatar).view());
}

} // namespace

TEST_CASE("every attribute is the mean of a group's members, weighted by what they cover") {
    const AvatarData avatar = smooth_avatar(6);
    cpu::Serial backend;
    const CoarserParams params{.skin_length = 0}; // the groups are then those of the cloud alone
    const std::size_t N = avatar.gaussians.size(), G = N / 3, K = avatar.rig.skin.influences;
    const AvatarData coarser = coarser_avatar(backend, avatar, G, params);
    const GaussianGroups groups = gaussian_groups(backend, avatar.gaussians, G, params.groups);
    REQUIRE(coarser.gaussians.size() == G);
    REQUIRE(coarser.rig.point_count() == G);
    REQUIRE(coarser.rig.skin.size() == G);
    CHECK(coarser.rig.skin.influences <= K);
    for (std::size_t g = 0; g < G; ++g) {
        double mass = 0, ao = 0, irradiance = 0, neuron = 0;
        vec3<double> mean(0), sh(0);
        std::vector<double> weights(4);
        for (std::size_t i = 0; i < N; ++i) {
            if (groups.group[i] != g) continue;
            const vec3<double> scale = glm::exp(vec3<double>(avatar.gaussians.log_scales[i]));
            const double shortest = std::min({scale.x, scale.y, scale.z}),
                         m = scale.x * scale.y * scale.z / shortest /
                             (1 + std::exp(-static_cast<double>(avatar.gaussians.opacity_logits[i])));
            mass += m, ao += m * avatar.ao[i], irradiance += m * avatar.mean_irradiance[i];
            neuron += m * avatar.occlusion_field->neurons[3 * i + 1];
            mean += vec3<double>(avatar.gaussians.means[i]) * m, sh += vec3<double>(avatar.gaussians.sh[4 * i + 2]) * m;
            for (std::size_t k = i * K; k < (i + 1) * K; ++k)
                weights[avatar.rig.skin.joints[k]] += m * avatar.rig.skin.weights[k];
        }
        CHECK(length(vec3<double>(coarser.gaussians.means[g]) - mean * (1 / mass)) < 1e-6);
        CHECK(length(vec3<double>(coarser.gaussians.sh[4 * g + 2]) - sh * (1 / mass)) < 1e-6);
        CHECK(coarser.ao[g] == doctest::Approx(ao / mass));
        CHECK(coarser.mean_irradiance[g] == doctest::Approx(irradiance / mass));
        CHECK(coarser.occlusion_field->neurons[3 * g + 1] == doctest::Approx(neuron / mass));
        double sum = 0;
        for (std::size_t k = g * K; k < (g + 1) * K; ++k) {
            sum += coarser.rig.skin.weights[k];
            if (coarser.rig.skin.weights[k] > 0 && K == 4) // all bones have a place
                CHECK(coarser.rig.skin.weights[k] == doctest::Approx(weights[coarser.rig.skin.joints[k]] / mass));
            if (k > g * K) CHECK(coarser.rig.skin.weights[k] <= coarser.rig.skin.weights[k - 1]);
        }
        CHECK(sum == doctest::Approx(1));
        CHECK(coarser.rig.triangles[g] == avatar.rig.triangles[groups.leads[g]]);
        CHECK(coarser.rig.barycentric[g] == avatar.rig.barycentric[groups.leads[g]]);
    }
    CHECK(coarser.rig.joints == avatar.rig.joints);
    CHECK(coarser.occlusion_field->pose_weights == avatar.occlusion_field->pose_weights);
}

TEST_CASE("weights of more bones than fit are the largest, and sum to 1") {
    AvatarData avatar = smooth_avatar(2);
    const std::size_t N = avatar.gaussians.size();
    avatar.rig.skin = {std::vector<std::uint16_t>(N), std::vector<double>(N, 1.0), 1};
    for (std::size_t i = 0; i < N; ++i) avatar.rig.skin.joints[i] = static_cast<std::uint16_t>(i % 4);
    cpu::Serial backend;
    const AvatarData coarser = coarser_avatar(backend, avatar, 3);
    CHECK(coarser.rig.skin.influences == 1);
    CHECK(coarser.rig.skin.weights == std::vector<double>{1, 1, 1});
}

TEST_CASE("Gaussians of different bones are kept apart") {
    AvatarData avatar = smooth_avatar(2);
    const std::size_t N = avatar.gaussians.size();
    avatar.rig.skin = {std::vector<std::uint16_t>(N), std::vector<double>(N, 1.0), 1};
    for (std::size_t i = 0; i < N; ++i) avatar.rig.skin.joints[i] = static_cast<std::uint16_t>(i % 2);
    const auto mixed_bones = [&](double skin_length) {
        cpu::Serial backend;
        AvatarData marked = avatar; // the sum of the members' bones is in an array that is averaged
        for (std::size_t i = 0; i < N; ++i) marked.ao[i] = static_cast<float>(i % 2);
        const AvatarData coarser = coarser_avatar(backend, marked, N / 2, {.skin_length = skin_length});
        return std::count_if(coarser.ao.begin(), coarser.ao.end(), [](float ao) { return ao > 0 && ao < 1; });
    };
    CHECK(mixed_bones(0) > static_cast<long>(N / 10));
    CHECK(mixed_bones(100) == 0);
}

TEST_CASE("a picture of an avatar with a third of its Gaussians differs little, however it moves") {
    AvatarData avatar = smooth_avatar();
    const std::size_t third = avatar.gaussians.size() / 3;
    REQUIRE(third > 2500);
    cpu::Threads backend(2);
    for (const Deformation deformation : {Deformation::linear, Deformation::polar, Deformation::dual_quaternion}) {
        avatar.deformation = deformation;
        const AvatarData coarser = coarser_avatar(backend, avatar, third);
        CHECK(coarser.deformation == deformation);
        CHECK(likeness(avatar, coarser) > 35);
    }
    const std::vector<std::uint32_t> largest = largest_gaussians(avatar.gaussians, third);
    CHECK(likeness(avatar, avatar_part(avatar, Span<const std::uint32_t>(largest))) < 31); // without merging
    avatar.light = even_light(2, 6, {0, 0.8, 0}, 2);
    avatar.normal_offsets.assign(avatar.rig.body.vertex_count(), vec3<float>(0.01f));
    const AvatarData lit = coarser_avatar(backend, avatar, third);
    CHECK(lit.normal_offsets == avatar.normal_offsets);
    CHECK(likeness(avatar, lit) > 35);
    // A level made of a finer level is a level, too.
    CHECK(likeness(avatar, coarser_avatar(backend, coarser_avatar(backend, avatar, 2 * third), third)) > 35);
}

TEST_CASE("an avatar with enough room, and Gaussians that stay alone, keep every bit") {
    const AvatarData avatar = smooth_avatar(6);
    cpu::Serial backend;
    const std::size_t N = avatar.gaussians.size();
    const AvatarData same = coarser_avatar(backend, avatar, N);
    CHECK(same.gaussians.means == avatar.gaussians.means);
    CHECK(same.rig.skin.weights == avatar.rig.skin.weights);
    const AvatarData coarser = coarser_avatar(backend, avatar, N - 1);
    std::size_t equal = 0;
    for (std::size_t g = 0, i = 0; g < N - 1; ++g) { // both are in one order
        while (i < N && coarser.gaussians.means[g] != avatar.gaussians.means[i]) ++i;
        if (i == N) break;
        CHECK(coarser.gaussians.log_scales[g] == avatar.gaussians.log_scales[i]);
        CHECK(coarser.gaussians.opacity_logits[g] == avatar.gaussians.opacity_logits[i]);
        CHECK(coarser.gaussians.sh[4 * g] == avatar.gaussians.sh[4 * i]);
        CHECK(coarser.ao[g] == avatar.ao[i]);
        ++equal;
        if (equal == 40) break;
    }
    CHECK(equal > 0);
}

TEST_CASE("arrays that an avatar does not have stay empty, and a cloud alone can be coarser") {
    AvatarData avatar = smooth_avatar(4);
    avatar.ao.clear(), avatar.mean_irradiance.clear(), avatar.occlusion_field.reset();
    cpu::Serial backend;
    const AvatarData coarser = coarser_avatar(backend, avatar, 50, {.skin_length = 0});
    CHECK(coarser.ao.empty());
    CHECK(coarser.mean_irradiance.empty());
    CHECK(!coarser.occlusion_field);
    const GaussianCloud<float> cloud = coarser_cloud(backend, avatar.gaussians, 50);
    CHECK(cloud.means == coarser.gaussians.means);
    CHECK(cloud.sh == coarser.gaussians.sh);
    CHECK(coarser_cloud(backend, avatar.gaussians, 1 << 20).means == avatar.gaussians.means);
}

TEST_CASE("an avatar whose arrays do not fit is refused") {
    const AvatarData avatar = smooth_avatar(2);
    cpu::Serial backend;
    const auto coarser = [&](const auto& change) {
        AvatarData wrong = avatar;
        change(wrong);
        (void)coarser_avatar(backend, wrong, 10);
    };
    CHECK_THROWS_WITH_AS((void)coarser_avatar(backend, avatar, 0), "coarser_avatar: count is 0, expected at least 1",
                         ValueError);
    CHECK_THROWS_AS((void)coarser_avatar(backend, avatar, 10, {.skin_length = -1}), ValueError);
    CHECK_THROWS_AS(coarser([](AvatarData& a) { a.ao.pop_back(); }), ShapeError);
    CHECK_THROWS_AS(coarser([](AvatarData& a) { a.mean_irradiance.pop_back(); }), ShapeError);
    CHECK_THROWS_AS(coarser([](AvatarData& a) { a.rig.triangles.pop_back(); }), ShapeError);
    CHECK_THROWS_AS(coarser([](AvatarData& a) { a.rig.skin.weights.pop_back(); }), ShapeError);
    CHECK_THROWS_AS(coarser([](AvatarData& a) { a.occlusion_field->neurons.pop_back(); }), ShapeError);
    CHECK_THROWS_AS(coarser([](AvatarData& a) { a.gaussians.means[1].x = std::numeric_limits<float>::infinity(); }),
                    ValueError);
}
