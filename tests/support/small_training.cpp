// SPDX-License-Identifier: Apache-2.0
/// @file  The photographs of small trainings.
#include "support/small_training.hpp"

#include <gsh/body/surface_samples.hpp>
#include <gsh/cpu.hpp>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace gsh::test {

namespace {

/// A picture of points in the world, with stripes along the body's height at rest.
std::vector<std::uint8_t> photograph_of_stripes(const Camera<double>& camera, const std::vector<vec3<double>>& points,
                                                const std::vector<vec3<double>>& at_rest) {
    constexpr int size = SmallScene::size;
    std::vector<std::uint8_t> rgba(4 * size * size);
    std::vector<double> depth(size * size, 1e9);
    for (std::size_t i = 0; i < points.size(); ++i) {
        const auto p = to_camera(camera, points[i]);
        const auto at = to_pixel(camera, p);
        const int x = static_cast<int>(std::floor(at.x)), y = static_cast<int>(std::floor(at.y));
        if (x < 0 || y < 0 || x >= size || y >= size) continue;
        const auto index = static_cast<std::size_t>(y * size + x);
        if (p.z >= depth[index]) continue;
        depth[index] = p.z;
        const double stripe = 0.5 + 0.4 * std::sin(20 * at_rest[i].y);
        std::uint8_t* pixel = rgba.data() + 4 * index;
        pixel[0] = static_cast<std::uint8_t>(255 * stripe);
        pixel[1] = static_cast<std::uint8_t>(120);
        pixel[2] = static_cast<std::uint8_t>(255 * (1 - stripe));
        pixel[3] = 255;
    }
    return rgba;
}

} // namespace

SmallScene::SmallScene() {
    Rng rng(21);
    motion.joint_count = 4;
    motion.expression_count = 2;
    motion.betas = betas;
    for (int frame = 0; frame < 2; ++frame) {
        for (const auto& angle : rng.vecs(4, -0.4, 0.4)) motion.pose.push_back(angle);
        motion.expression.insert(motion.expression.end(), {0.2 * frame, 0.5});
        motion.transl.push_back(vec3<double>(0.0));
        motion.timestamps.push_back(frame);
    }
    for (const double side : {-0.7, 0.8})
        cameras.push_back(look_at<double>({side, 1.0, 3.5}, {0, 0.8, 0}, {0, 1, 0}, 0.5, size, size));
    const auto samples =
        sample_surface(body, shaped_vertices(body, betas), std::vector<double>(body.vertex_count(), 400.0), 4);
    const RigData rig = make_rig(body, betas, samples);
    cpu::Serial backend;
    Rig<cpu::Serial, double> mover(backend, rig);
    RigPose<cpu::Serial, double> pose;
    Rig<cpu::Serial, double>::Cache cache;
    for (const Camera<double>& camera : cameras)
        for (std::size_t f = 0; f < 2; ++f) {
            mover.upload_pose(motion, f, pose);
            mover.forward(pose, rig.joints, cache);
            auto points = samples.positions;
            mover.add_offsets(cache, points);
            for (std::size_t i = 0; i < points.size(); ++i)
                points[i] = blend(mover.skin(), i, Span<const Affine<double>>(cache.bones))(points[i]);
            images.push_back(photograph_of_stripes(camera, points, samples.positions));
        }
    for (std::size_t c = 0; c < cameras.size(); ++c)
        for (std::size_t f = 0; f < 2; ++f)
            photos.push_back({"cam" + std::to_string(c) + "_" + std::to_string(f), cameras[c], f, images[2 * c + f], c});
}

} // namespace gsh::test
