// SPDX-License-Identifier: Apache-2.0
#include <gsh/avatar/avatar.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/cpu.hpp>
#include <gsh/light/light.hpp>
#include <gsh/render/rasterizer.hpp>

#include "support/bodies.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <initializer_list>
#include <thread>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

/// Gaussians on a tube, with colours that lie within (0, 1) from everywhere, and ambient occlusion of all strengths.
AvatarData shaded_avatar(int degree = 2) {
    const BodyModel body = test::tube(4, 6, 6);
    const std::vector<double> betas{0.3, -0.1};
    const auto samples =
        sample_surface(body, shaped_vertices(body, betas), std::vector<double>(body.vertex_count(), 3.0), 3);
    AvatarData avatar{make_rig(body, betas, samples), GaussianCloud<float>(samples.size(), degree), ColorClamp::both};
    const auto basis = static_cast<std::size_t>(sh_basis_count(degree));
    test::Rng rng(6);
    for (std::size_t i = 0; i < samples.size(); ++i) {
        avatar.gaussians.means[i] = vec3<float>(samples.positions[i]);
        avatar.gaussians.log_scales[i] = vec3<float>(rng.vec(-4, -3));
        for (std::size_t k = 0; k < basis; ++k)
            avatar.gaussians.sh[i * basis + k] =
                k ? vec3<float>(rng.vec(-0.04, 0.04)) : sh_of_color(vec3<float>(rng.vec(0.3, 0.7)));
        avatar.ao.push_back(static_cast<float>(rng.uniform(0, 1)));
    }
    return avatar;
}

std::vector<vec3<float>> colors_of(const AvatarData& data, const vec3<float>& center = {1, 1, 3}, bool shadows = true) {
    cpu::Serial backend;
    Motion motion = rest_motion(data.rig);
    test::Rng rng(2);
    motion.pose = rng.vecs(4, -0.7, 0.7);
    Avatar<cpu::Serial> avatar(backend, data);
    if (!shadows) avatar.set_shadows(false);
    RigPose<cpu::Serial, float> pose;
    avatar.rig().upload_pose(motion, 0, pose);
    Splats<cpu::Serial, float> splats;
    splats.resize(avatar.size());
    Avatar<cpu::Serial>::Cache cache;
    avatar.pose(pose, center, splats.view(), cache);
    return {splats.colors.begin(), splats.colors.end()};
}

/// The same Gaussians with ambient occlusion merged into their colours.
AvatarData baked(AvatarData avatar) {
    avatar.gaussians = shaded_cloud(avatar);
    avatar.ao.clear();
    return avatar;
}

float largest_difference(const std::vector<vec3<float>>& a, const std::vector<vec3<float>>& b) {
    REQUIRE(a.size() == b.size());
    float largest = 0;
    for (std::size_t i = 0; i < a.size(); ++i)
        for (int c = 0; c < 3; ++c) largest = std::max(largest, std::abs(a[i][c] - b[i][c]));
    return largest;
}

} // namespace

TEST_CASE("ambient occlusion is a factor on the colours of an avatar, in every pose") {
    const AvatarData avatar = shaded_avatar();
    AvatarData lit = avatar;
    lit.ao.clear();
    const auto dark = colors_of(avatar), bright = colors_of(lit);
    for (std::size_t i = 0; i < dark.size(); ++i)
        for (int c = 0; c < 3; ++c) CHECK(dark[i][c] == doctest::Approx(bright[i][c] * avatar.ao[i]).epsilon(1e-6));
    lit.ao.assign(lit.gaussians.size(), 1.0f);
    CHECK(colors_of(lit) == bright);
}

TEST_CASE("an avatar can be shown without its shadows") {
    AvatarData avatar = shaded_avatar(), plain = avatar;
    plain.ao.clear();
    CHECK(colors_of(avatar, {1, 1, 3}, false) == colors_of(plain));
    plain.light = even_light(2, 6, {0, 0.8, 0}, 2);
    AvatarData unshadowed = plain;
    unshadowed.light->shadows = false;
    CHECK(colors_of(plain, {1, 1, 3}, false) == colors_of(unshadowed));
    CHECK(colors_of(plain) != colors_of(unshadowed));
}

TEST_CASE("a shaded cloud shows what ambient occlusion shows, where colours lie within 0 and 1") {
    for (const int degree : {0, 1, 2}) {
        const AvatarData avatar = shaded_avatar(degree);
        for (const auto& center : {vec3<float>{1, 1, 3}, vec3<float>{-4, 0, 1}})
            CHECK(largest_difference(colors_of(baked(avatar), center), colors_of(avatar, center)) < 1e-6f);
    }
    // An avatar clamps a colour at 1 before ao multiplies it. A file without ao clamps the product.
    AvatarData bright = shaded_avatar(0);
    bright.ao.assign(bright.gaussians.size(), 0.5f);
    bright.gaussians.sh.assign(bright.gaussians.size(), sh_of_color(vec3<float>(1.5f)));
    CHECK(colors_of(bright)[0].x == doctest::Approx(0.5f));
    CHECK(colors_of(baked(bright))[0].x == doctest::Approx(0.75f));
}

TEST_CASE("without ambient occlusion a shaded cloud is the cloud") {
    AvatarData avatar = shaded_avatar();
    avatar.ao.clear();
    const GaussianCloud<float> cloud = shaded_cloud(avatar);
    CHECK(cloud.sh == avatar.gaussians.sh);
    CHECK(cloud.means == avatar.gaussians.means);
    CHECK(cloud.opacity_logits == avatar.gaussians.opacity_logits);
}

TEST_CASE("a shaded cloud has the mean light of training in its colours") {
    AvatarData avatar = shaded_avatar(0);
    test::Rng rng(9);
    for (std::size_t i = 0; i < avatar.gaussians.size(); ++i)
        avatar.mean_irradiance.push_back(static_cast<float>(i % 9 ? rng.uniform(0, 2) : 0));
    AvatarData unlit = avatar;
    unlit.mean_irradiance.clear();
    const auto base = colors_of(baked(unlit)), lit = colors_of(baked(avatar));
    for (std::size_t i = 0; i < lit.size(); ++i)
        for (int c = 0; c < 3; ++c) // the viewer clamps at 1
            CHECK(lit[i][c] == doctest::Approx(std::min(1.0f, linear_to_srgb(srgb_to_linear(base[i][c]) *
                                                                             avatar.mean_irradiance[i])))
                                   .epsilon(1e-4));
    // With an irradiance of 1 it is the cloud as it was, in the bands that depend on the view, too.
    avatar = shaded_avatar(2);
    unlit = avatar;
    avatar.mean_irradiance.assign(avatar.gaussians.size(), 1.0f);
    CHECK(largest_difference(colors_of(baked(avatar)), colors_of(baked(unlit))) < 2e-5f);
    // Those bands follow the slope of the curve.
    avatar.mean_irradiance.assign(avatar.gaussians.size(), 0.5f);
    const auto whole = colors_of(baked(unlit)), half = colors_of(baked(avatar));
    for (std::size_t i = 0; i < half.size(); ++i)
        for (int c = 0; c < 3; ++c)
            CHECK(std::abs(half[i][c] - linear_to_srgb(srgb_to_linear(whole[i][c]) * 0.5f)) < 5e-3f);
    avatar.mean_irradiance.pop_back();
    CHECK_THROWS_AS((void)shaded_cloud(avatar), ShapeError);
}

TEST_CASE("an avatar whose parts differ in number is refused") {
    cpu::Serial backend;
    AvatarData avatar = shaded_avatar();
    avatar.ao.pop_back();
    CHECK_THROWS_AS(Avatar<cpu::Serial>(backend, avatar), ShapeError);
    avatar = shaded_avatar();
    avatar.gaussians.resize(avatar.gaussians.size() - 1, 2);
    CHECK_THROWS_AS(Avatar<cpu::Serial>(backend, avatar), ShapeError);
}

TEST_CASE("several threads pose and draw one avatar, each with caches of its own, as one thread does") {
    using B = cpu::Threads;
    constexpr std::size_t thread_count = 8, frames = 12;
    constexpr int size = 32;
    B backend(4);
    AvatarData data = shaded_avatar();
    data.light = even_light(0, 6, {0, 0, 0}, 1);
    data.light->points = {{1.5, 1.6, 1.5}};
    data.light->log_intensities.insert(data.light->log_intensities.begin(), 0.8);
    const Avatar<B> avatar(backend, data);
    const Rasterizer<B> rasterizer(backend);
    test::Rng rng(7);
    Motion motion = rest_motion(data.rig);
    motion.pose = rng.vecs(4, -0.6, 0.6);
    const auto draw = [&](std::size_t thread) {
        Splats<B> splats;
        splats.resize(avatar.size());
        Avatar<B>::Cache cache;
        Rasterizer<B>::Cache raster;
        RigPose<B, float> pose;
        std::vector<float> pictures;
        Motion moved = motion; // each thread has poses and cameras of its own
        for (std::size_t frame = 0; frame < frames; ++frame) {
            moved.pose[2] = motion.pose[2] + vec3<double>(0, 0.05 * static_cast<double>(frame + 3 * thread), 0);
            const auto camera = look_at<float>({0.2f * static_cast<float>(thread), 0.5f, 3.0f}, {0, 0.5f, 0}, {0, 1, 0},
                                               0.7f, size, size);
            Image<float> color(3, size, size);
            avatar.rig().upload_pose(moved, 0, pose);
            avatar.pose(pose, camera.center(), splats.view(), cache);
            rasterizer.forward(camera, std::as_const(splats).view(), {}, {.color = color.view()}, raster);
            pictures.insert(pictures.end(), color.data.begin(), color.data.end());
        }
        return pictures;
    };
    std::vector<std::vector<float>> together(thread_count);
    std::vector<std::thread> threads;
    for (std::size_t thread = 0; thread < thread_count; ++thread)
        threads.emplace_back([&, thread] { together[thread] = draw(thread); });
    for (std::thread& thread : threads) thread.join();
    for (std::size_t thread = 0; thread < thread_count; ++thread) {
        CAPTURE(thread);
        const std::vector<float> alone = draw(thread);
        CHECK(*std::max_element(alone.begin(), alone.end()) > 0.1f);
        CHECK(together[thread] == alone);
    }
    CHECK(together[0] != together[1]);
}
