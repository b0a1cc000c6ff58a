// SPDX-License-Identifier: Apache-2.0
/// Many poses and pictures of an avatar: memory must not grow.
#include "load/load.hpp"

#include "programs/view_scenes.hpp"

#include <gsh/avatar/avatar.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/cpu.hpp>
#include <gsh/render/rasterizer.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>

namespace gsh::load {

void pose_and_draw(std::size_t frames, Verdict& verdict) {
    using B = cpu::Threads;
    const std::size_t warm_up = std::min<std::size_t>(1000, frames / 2);
    constexpr int size = 64;
    B backend;
    const AvatarData data = test::lit_actor(3000);
    const Motion motion = actor_motion(ActorMotion::stride, 50);
    const Avatar<B> avatar(backend, data);
    const Rasterizer<B> rasterizer(backend);
    Splats<B> splats;
    splats.resize(avatar.size());
    typename Avatar<B>::Cache cache;
    typename Rasterizer<B>::Cache raster;
    RigPose<B, float> pose;
    Image<float> color(3, size, size);
    std::size_t warm = 0, largest = 0;
    for (std::size_t frame = 0; frame < frames; ++frame) {
        // The camera goes round, so that lists of tiles grow and shrink.
        const double angle = 0.01 * static_cast<double>(frame), far = 2.5 + std::sin(0.37 * angle);
        const auto camera = look_at<float>(vec3<float>(vec3<double>(far * std::sin(angle), 1, far * std::cos(angle))),
                                           {0, 1, 0}, {0, 1, 0}, 0.8f, size, size);
        avatar.rig().upload_pose(motion, frame % motion.frame_count(), pose);
        avatar.pose(pose, camera.center(), splats.view(), cache);
        rasterizer.forward(camera, std::as_const(splats).view(), {}, {.color = color.view()}, raster);
        if (frame == warm_up) warm = resident();
        if (frame > warm_up && frame % 100 == 0) largest = std::max(largest, resident());
    }
    const auto growth = static_cast<double>(largest) - static_cast<double>(warm);
    verdict.line(growth <= 1e6, std::to_string(frames) + " poses and pictures: memory of " +
                                    megabytes(static_cast<double>(warm)) + " grows by " + megabytes(growth) +
                                    " after " + std::to_string(warm_up) + ", allowed 1 MB");
}

} // namespace gsh::load
