// SPDX-License-Identifier: Apache-2.0
/// @file  Writes avatar.gsh, motion.npz and camera.json for the tests of the Python package: the built-in actor with
///        Gaussians on the skin, in a colour of their place.
#include <gsh/avatar/rig.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/model/avatar_file.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>

#include <cmath>
#include <cstddef>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <vector>

using namespace gsh;

namespace {

void write(const std::filesystem::path& folder) {
    const BodyModel body = make_actor({.edge_scale = 1.4});
    const std::vector<double> betas(static_cast<std::size_t>(body.shape_count), 0.2);
    const std::vector<double> one_each(body.vertex_count(), 1.0);
    const SurfaceSamples skin = sample_surface(body, shaped_vertices(body, betas), one_each, 4, {.total = 5000});
    GaussianCloud<float> cloud(skin.size(), 1);
    for (std::size_t i = 0; i < skin.size(); ++i) {
        const vec3<float> place(skin.positions[i]);
        cloud.means[i] = place;
        cloud.quats[i] = {1, 0, 0, 0};
        cloud.log_scales[i] = vec3<float>(std::log(static_cast<float>(skin.scales[i])));
        cloud.opacity_logits[i] = logit(0.9f);
        cloud.sh[4 * i] = sh_of_color(vec3<float>(0.5f) + 0.4f * place);
        cloud.sh[4 * i + 2] = vec3<float>(0.1f); // brighter from one side
    }
    save_avatar(folder / "avatar.gsh", {make_rig(body, betas, skin), cloud});
    save_motion(folder / "motion.npz", actor_motion(ActorMotion::stride, 8));
    const Camera<double> camera = frame_sphere(vec3<double>(0, -0.08, 0), 0.95, vec3<double>(0.45, 0.15, 1),
                                               vec3<double>(0, 1, 0), 0.5, 120, 160);
    write_camera(folder / "camera.json", {.name = "front", .camera = camera, .distortion = {}});
}

} // namespace

int main(int argc, char** argv) {
    try {
        if (argc != 2) throw ValueError("expected one argument, the folder to write to");
        write(argv[1]);
        return 0;
    } catch (const std::exception& error) {
        std::fprintf(stderr, "%s: %s\n", argv[0], error.what());
        return 2;
    }
}
