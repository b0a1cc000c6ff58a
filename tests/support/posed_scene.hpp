// SPDX-License-Identifier: Apache-2.0
/// @file  An avatar of a patterned tube, and photographs of it by gsh's own renderer, for tests of pose fitting.
#pragma once

#include <gsh/avatar/avatar.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/photo/photo.hpp>

#include "support/bodies.hpp"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace gsh::test {

struct PosedScene {
    static constexpr int size = 48;
    static constexpr std::size_t frames = 5, camera_count = 3;

    BodyModel body = tube(4, 8, 6);
    AvatarData avatar;
    Motion truth;
    std::vector<Camera<double>> cameras;
    std::vector<std::vector<std::uint8_t>> images; // [frame, camera]

    /// In posed_scene.cpp, because it draws on cpu::Serial, whose kernels nvcc does not compile.
    PosedScene();

    [[nodiscard]] Photo observe(std::size_t frame, std::size_t camera) const {
        return {"photo", cameras[camera], frame, images[frame * camera_count + camera], camera};
    }
    [[nodiscard]] std::vector<Photo> observe(std::size_t frame) const {
        std::vector<Photo> all;
        for (std::size_t c = 0; c < camera_count; ++c) all.push_back(observe(frame, c));
        return all;
    }

    /// The true motion with errors as of an estimator.
    [[nodiscard]] Motion estimate(double angle = 0.06, double distance = 0.015, std::uint64_t seed = 8) const {
        Rng rng(seed);
        Motion motion = truth;
        for (auto& v : motion.pose) v += rng.vec(-angle, angle);
        for (auto& t : motion.transl) t += rng.vec(-distance, distance);
        return motion;
    }
};

} // namespace gsh::test
