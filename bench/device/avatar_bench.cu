// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of a posed render on a GPU: from a pose to splats, and from a pose to pixels.
#include "load.hpp"
#include "measure.cuh"

#include "../render/capsule_load.hpp"

#include <gsh/avatar/avatar.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/cuda.cuh>
#include <gsh/gaussian/splats.hpp>
#include <gsh/render/rasterizer.hpp>

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

namespace gsh::bench {
namespace {

using cuda::Device;

/// An avatar in 16 poses, which are on the device before the first run.
struct Shown {
    static constexpr std::size_t pose_count = 16;

    Avatar<Device> avatar;
    std::vector<RigPose<Device, float>> poses{pose_count};
    Splats<Device, float> splats;
    Avatar<Device>::Cache cache;
    Rasterizer<Device> rasterizer;
    Rasterizer<Device>::Cache raster;
    cuda::Buffer<float> color;
    int size;

    Shown(Device& device, const AvatarData& data, int image_size)
        : avatar(device, data), rasterizer(device),
          color(3 * static_cast<std::size_t>(image_size) * static_cast<std::size_t>(image_size)), size(image_size) {
        Rng rng(3);
        for (RigPose<Device, float>& pose : poses) {
            Motion motion = rest_motion(data.rig);
            for (auto& angle : motion.pose)
                angle = {rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2)};
            avatar.rig().upload_pose(motion, 0, pose);
        }
        splats.resize(avatar.size());
    }
    void pose(int k) {
        avatar.pose(poses[static_cast<std::size_t>(k) % pose_count], make_camera(size, k).center(), splats.view(),
                    cache);
    }
    void draw(int k) {
        rasterizer.forward(make_camera(size, k), std::as_const(splats).view(), {.color = vec3<float>(1)},
                           {.color = ImageView<float>{color, 3, size, size}}, raster);
    }
};

void cases(Bench& bench) {
    const Arguments& options = bench.arguments();
    // What a Gaussian is, its skinning weights, and the splat that it becomes.
    const double gaussian = (3 + 4 + 3 + 1 + 27) * sizeof(float) + 8 * (sizeof(float) + 2), splat = 13 * sizeof(float);
    const double image = 3.0 * sizeof(float) * options.size * options.size;
    const std::pair<const char*, AvatarKind> kinds[] = {{"avatar/plain", AvatarKind::plain},
                                                        {"avatar/pose-directions", AvatarKind::pose_directions},
                                                        {"avatar/light", AvatarKind::light}};
    for (const auto& [kind_name, kind] : kinds) {
        const std::string name = kind_name;
        const bool pose = bench.wants(name + "/pose"), render = bench.wants(name + "/pose+render");
        if (!pose && !render) continue;
        const AvatarData data = make_avatar_load(options.gaussians, kind);
        Shown shown(bench.device(), data, options.size);
        const double n = static_cast<double>(shown.avatar.size());
        // What else a pose reads: directions, and for light its intensities, and the mesh that hides it.
        double more = 3.0 * sizeof(float) * static_cast<double>(data.rig.body.posedirs.size());
        if (data.light)
            more += sizeof(float) * (4.0 * static_cast<double>(data.light->size()) +
                                     3.0 * static_cast<double>(data.rig.body.vertex_count() + data.rig.body.faces.size()));
        if (pose) bench.measure(name + "/pose", {n * (gaussian + splat) + more}, [&](int k) { shown.pose(k); });
        if (render)
            bench.measure(name + "/pose+render", {n * (gaussian + 2 * splat) + image + more}, [&](int k) {
                shown.pose(k);
                shown.draw(k);
            });
    }
}

} // namespace
} // namespace gsh::bench

int main(int argc, char** argv) {
    return gsh::bench::run_cases(argc, argv, gsh::bench::cases);
}
