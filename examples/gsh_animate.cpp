// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-animate: an avatar in a motion that it was not trained on, frame by frame.

#include "support/program.hpp"
#include "support/progress.hpp"
#include "support/renderer.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/io/avatar_file.hpp>
#include <gsh/io/camera_file.hpp>
#include <gsh/io/image_file.hpp>
#include <gsh/io/motion_file.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <numbers>
#include <string>
#include <vector>

using namespace gsh;
using namespace gsh::examples;

namespace {

struct AnimateOptions {
    std::filesystem::path avatar, poses, camera, out;
    std::string camera_name;
    int size = 540;
    std::array<double, 3> background{1, 1, 1};
    std::size_t threads = 0;
};

/// A camera in front of the body that sees all of it in every frame.
Camera<double> frame_motion(const RigData& rig, const Motion& motion, int size) {
    vec3<double> low(1e30), high(-1e30);
    for (std::size_t f = 0; f < motion.frame_count(); ++f) {
        const PosedBody posed = pose_body(rig.body, motion.pose_at(f), motion.transl[f], rig.betas, motion.expression_at(f), rig.joints);
        for (const vec3<double>& vertex : posed.vertices)
            for (int axis = 0; axis < 3; ++axis) {
                low[axis] = std::min(low[axis], vertex[axis]);
                high[axis] = std::max(high[axis], vertex[axis]);
            }
    }
    constexpr double margin = 1.05; // for hair and cloth that stand off the body
    const double radius = margin * 0.5 * length(high - low);
    return frame_sphere<double>((low + high) * 0.5, radius, {0, 0.1, 1}, {0, 1, 0}, 30 * std::numbers::pi / 180, size, size);
}

int animate(const AnimateOptions& options) {
    const AvatarData data = load_avatar(options.avatar);
    std::vector<std::string> warnings;
    const Motion motion = load_motion(options.poses, data.rig.body, {}, &warnings);
    const Camera<double> camera = options.camera.empty() ? frame_motion(data.rig, motion, options.size)
                                                         : read_camera(options.camera, options.camera_name).camera;
    for (const std::string& warning : warnings) warn(warning);
    cpu::Threads backend(options.threads);
    const Avatar<cpu::Threads> avatar(backend, data);
    Renderer renderer(backend);
    make_folder(options.out);
    watch_interrupts();
    Progress progress("animating");
    const vec3<float> background(options.background[0], options.background[1], options.background[2]);
    for (std::size_t f = 0; f < motion.frame_count() && !interrupted; ++f) {
        char name[32];
        std::snprintf(name, sizeof name, "%04zu.png", f);
        write_png(options.out / name, renderer.render(avatar, motion, f, camera, background));
        progress.show(static_cast<double>(f + 1) / static_cast<double>(motion.frame_count()), "frame " + std::to_string(f));
    }
    progress.finish();
    std::printf("%zu frames in %s\n", motion.frame_count(), options.out.c_str());
    return interrupted ? exit_interrupted : exit_done;
}

} // namespace

int main(int argc, char** argv) {
    AnimateOptions options;
    CLI::App app("Renders an avatar in a motion.", "gsh-animate");
    app.add_option("avatar", options.avatar, "AVATAR.gsh")->required();
    app.add_option("--poses", options.poses, "motion (.npz)")->required();
    app.add_option("--camera", options.camera, "CAMERA.json; without it a camera frames the whole motion");
    app.add_option("--camera-name", options.camera_name, "which entry, if the file holds several cameras");
    app.add_option("--size", options.size, "pixels of the square image without --camera (default 540)")->check(CLI::Range(16, 8192));
    app.add_option("--out", options.out, "folder for the frames")->required();
    app.add_option("--background", options.background, "red green blue in [0, 1] (default white)");
    app.add_option("--threads", options.threads, "CPU threads (default: all)");
    return run_program(app, argc, argv, [&] { return animate(options); });
}
