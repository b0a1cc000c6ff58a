// SPDX-License-Identifier: Apache-2.0
/// @file  The avatar of the patterned tube, and its photographs.
#include "support/posed_scene.hpp"

#include <gsh/body/surface_samples.hpp>
#include <gsh/cpu.hpp>
#include <gsh/image/image.hpp>
#include <gsh/render/rasterizer.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace gsh::test {

namespace {

/// Red, green, blue and alpha of a picture of the avatar in a frame.
std::vector<std::uint8_t> photograph(const AvatarData& avatar, const Motion& motion, std::size_t frame,
                                     const Camera<double>& camera) {
    constexpr int size = PosedScene::size;
    cpu::Serial backend;
    Avatar<cpu::Serial> shown(backend, avatar);
    const Rasterizer<cpu::Serial> rasterizer(backend, raster_params<float>(avatar.filter));
    RigPose<cpu::Serial> pose;
    Avatar<cpu::Serial>::Cache cache;
    Splats<cpu::Serial> splats;
    Rasterizer<cpu::Serial>::Cache raster;
    Image<float> color(3, size, size), alpha(1, size, size);
    const auto view = camera.cast<float>();
    shown.rig().upload_pose(motion, frame, pose);
    splats.resize(shown.size());
    shown.pose(pose, view.center(), splats.view(), cache);
    rasterizer.forward(view, std::as_const(splats).view(), {}, {.color = color.view(), .alpha = alpha.view()}, raster);
    std::vector<std::uint8_t> rgba;
    const auto byte = [](float x) { return static_cast<std::uint8_t>(std::lround(255 * std::clamp(x, 0.0f, 1.0f))); };
    for (int y = 0; y < size; ++y)
        for (int x = 0; x < size; ++x) {
            const float a = alpha.at(0, y, x);
            for (int c = 0; c < 3; ++c) rgba.push_back(a > 0 ? byte(color.at(c, y, x) / a) : std::uint8_t(0));
            rgba.push_back(byte(a));
        }
    return rgba;
}

} // namespace

PosedScene::PosedScene() {
    const std::vector<double> betas{0.2, -0.3};
    const auto samples =
        sample_surface(body, shaped_vertices(body, betas), std::vector<double>(body.vertex_count(), 12.0), 4);
    avatar.rig = make_rig(body, betas, samples);
    avatar.filter = {.dilation = 0.1, .compensate_opacity = true};
    avatar.gaussians.sh_degree = 0;
    for (std::size_t i = 0; i < samples.size(); ++i) {
        const auto& p = samples.positions[i];
        avatar.gaussians.means.push_back(vec3<float>(p));
        avatar.gaussians.quats.push_back({1, 0, 0, 0});
        avatar.gaussians.log_scales.push_back(vec3<float>(static_cast<float>(std::log(1.2 * samples.scales[i]))));
        avatar.gaussians.opacity_logits.push_back(3);
        avatar.gaussians.sh.push_back(sh_of_color(
            vec3<float>(static_cast<float>(0.5 + 0.4 * std::sin(9 * p.y)), static_cast<float>(0.5 + 1.8 * p.x),
                        static_cast<float>(0.5 + 0.4 * std::sin(5 * p.y + 12 * p.z)))));
    }
    Rng rng(31);
    truth.joint_count = 4;
    truth.expression_count = 2;
    truth.betas = betas;
    const auto start = rng.vecs(4, -0.3, 0.3), speed = rng.vecs(4, -0.1, 0.1);
    for (std::size_t t = 0; t < frames; ++t) {
        for (std::size_t j = 0; j < 4; ++j) truth.pose.push_back(start[j] + speed[j] * static_cast<double>(t));
        truth.expression.insert(truth.expression.end(), {0.2 * static_cast<double>(t), 0.5});
        truth.transl.push_back({0.02 * static_cast<double>(t), 0, 0});
        truth.timestamps.push_back(0.1 * static_cast<double>(t));
    }
    for (const double side : {-0.9, 0.0, 0.9})
        cameras.push_back(look_at<double>({3.5 * std::sin(side), 1.0, 3.5 * std::cos(side)}, {0, 0.8, 0}, {0, 1, 0},
                                          0.55, size, size));
    for (std::size_t t = 0; t < frames; ++t)
        for (const auto& camera : cameras) images.push_back(photograph(avatar, truth, t, camera));
}

} // namespace gsh::test
