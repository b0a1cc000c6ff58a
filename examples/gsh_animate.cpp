// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-animate: an avatar in a motion that it was not trained on, frame by frame.

#include "support/framing.hpp"
#include "support/output_folder.hpp"
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

/// A camera in front of the body that sees all of it in every frame, and as large as that allows.
Camera<double> frame_motion(const RigData& rig, const Motion& motion, int size) {
    // Joints as training left them, moved on to the motion's shape.
    const auto regressed = [&](const std::vector<double>& betas) {
        return regress_joints(rig.body, shaped_vertices(rig.body, betas));
    };
    std::vector<vec3<double>> joints = rig.joints, from = regressed(rig.betas), to = regressed(motion.betas);
    for (std::size_t j = 0; j < joints.size(); ++j) joints[j] += to[j] - from[j];

    constexpr double field_of_view = 30 * std::numbers::pi / 180;
    Framing framing(look_at<double>({0, 0.1, 1}, {0, 0, 0}, {0, 1, 0}, field_of_view, size, size));
    for (std::size_t f = 0; f < motion.frame_count(); ++f)
        framing.add(pose_body(rig.body, motion.pose_at(f), motion.transl[f], motion.betas, motion.expression_at(f), joints).vertices);
    return framing.camera();
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
    Renderer renderer(backend, data.filter);
    OutputFolder out(options.out);
    watch_interrupts();
    Progress progress("animating");
    const vec3<float> background(options.background[0], options.background[1], options.background[2]);
    std::size_t done = 0;
    for (; done < motion.frame_count() && !interrupted; ++done) {
        char name[32];
        std::snprintf(name, sizeof name, "%04zu.png", done);
        write_png(out.file(name), renderer.render(avatar, motion, done, camera, background));
        progress.show(static_cast<double>(done + 1) / static_cast<double>(motion.frame_count()), "frame " + std::to_string(done));
    }
    progress.finish();
    out.commit();
    std::printf("%zu of %zu frames in %s\n", done, motion.frame_count(), options.out.c_str());
    return done < motion.frame_count() ? exit_interrupted : exit_done;
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
    add_background(app, options.background, "white");
    add_threads(app, options.threads);
    return run_program(app, argc, argv, [&] { return animate(options); });
}
