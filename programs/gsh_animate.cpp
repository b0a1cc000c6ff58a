// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-animate: renders avatars in new motions, together in one scene, one image per frame.

#include "common/input_files.hpp"
#include "common/interrupts.hpp"
#include "common/machine.hpp"
#include "common/messages.hpp"
#include "common/output_folder.hpp"
#include "common/program.hpp"
#include "common/progress.hpp"
#include "show/detail_option.hpp"
#include "show/framing.hpp"
#include "show/light_command.hpp"
#include "show/light_option.hpp"
#include "show/renderer.hpp"
#include "show/shown_people.hpp"

#include <gsh/body/posed_body.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/image/image_file.hpp>

#include <array>
#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <new>
#include <numbers>
#include <string>
#include <system_error>
#include <vector>

using namespace gsh;
using namespace gsh::programs;

namespace {

struct AnimateOptions {
    std::vector<std::filesystem::path> avatars, poses;
    std::filesystem::path camera, out;
    std::string camera_name;
    int size = 540;
    bool upright = false, as_stored = false; ///< at most one of them is set
    RigOption rig;
    LightOption light;
    DetailOption detail;
    std::array<double, 3> background{1, 1, 1};
    BackendOption machine;
};

std::string frame_name(std::size_t frame) {
    char name[32];
    std::snprintf(name, sizeof name, "%04zu.png", frame);
    return name;
}

/// Adds the vertices of a body in every frame that is shown.
void add_motion(Framing& framing, const RigData& rig, const Motion& motion, std::size_t frames) {
    // The joints are those after training, plus the difference that the motion's betas make to the regressed joints.
    const auto regressed = [&](const std::vector<double>& betas) {
        return regress_joints(rig.body, shaped_vertices(rig.body, betas));
    };
    std::vector<vec3<double>> joints = rig.joints, from = regressed(rig.betas), to = regressed(motion.betas);
    for (std::size_t j = 0; j < joints.size(); ++j) joints[j] += to[j] - from[j];

    for (std::size_t f = 0; f < frames; ++f)
        framing.add(
            pose_body(rig.body, motion.pose_at(f), motion.transl[f], motion.betas, motion.expression_at(f), joints)
                .vertices);
}

/// A camera in front of all people, as near as possible while every frame shows all of them completely.
Camera<double> frame_people(const ShownPeople& people, int size) {
    constexpr double field_of_view = 30 * std::numbers::pi / 180;
    const Progress shown("placing the camera");
    Framing framing(look_at<double>({0, 0.1, 1}, {0, 0, 0}, {0, 1, 0}, field_of_view, size, size));
    for (std::size_t p = 0; p < people.data.size(); ++p)
        add_motion(framing, people.data[p].rig, people.motions[p], people.frame_count());
    return framing.camera();
}

/// The number of consecutive pictures in a folder from frame `first` on.
std::size_t frames_from(const std::filesystem::path& folder, std::size_t first) {
    std::size_t count = 0;
    std::error_code ignored;
    while (std::filesystem::exists(folder / frame_name(first + count), ignored)) ++count;
    return count;
}

int animate(const AnimateOptions& options) {
    Machine machine(options.machine);
    OutputFolder out(options.out);
    // Estimated poses match the given camera as they are. With the framing camera, bodies are turned upright.
    const bool upright = options.upright || (options.camera.empty() && !options.as_stored);
    ShownPeople people(options.avatars, options.poses, options.light, upright, options.rig);
    people.share_clock();
    const std::size_t frames = people.frame_count();
    for (std::size_t p = 0; p < people.motions.size(); ++p)
        if (people.motions[p].frame_count() > frames)
            warn(options.poses[p].string() + ": only the first " + std::to_string(frames) + " of " +
                 std::to_string(people.motions[p].frame_count()) +
                 " frames are shown, as many as the shortest motion has");
    const Camera<double> camera = options.camera.empty() ? frame_people(people, options.size)
                                                         : camera_of_file(options.camera, options.camera_name).camera;
    if (frames > 0) coarsen(machine.host(), people, options.detail, camera, 0, frames - 1);
    const auto renderer = make_renderer(machine, people);
    watch_interrupts();
    Progress progress("animating");
    const vec3<float> background(options.background[0], options.background[1], options.background[2]);
    std::size_t done = 0;
    for (; done < frames && !interrupted; ++done) {
        write_png(out.file(frame_name(done)), renderer->render(done, camera, background));
        progress.show(static_cast<double>(done + 1) / static_cast<double>(frames), "frame " + std::to_string(done));
    }
    progress.finish();
    out.commit();
    if (const std::size_t others = frames_from(options.out, done))
        warn(options.out.string() + ": " + std::to_string(others) +
             " pictures of a longer motion remain after these; remove them before you make a video");
    std::printf("%zu of %zu frames in %s\n", done, frames, options.out.c_str());
    return done < frames ? exit_interrupted : exit_done;
}

} // namespace

int main(int argc, char** argv) try {
    AnimateOptions options;
    CLI::App app("Renders avatars in motions.", "gsh-animate");
    app.add_option("avatars", options.avatars, "AVATAR.gsh, one or several in one scene")->required();
    app.add_option(
           "--poses", options.poses,
           "one motion per avatar, in the same order: --poses A --poses B; any layout that gsh reads (.npz, .bvh, "
           ".glb, folder)")
        ->required()
        ->allow_extra_args(false);
    app.add_option("--camera", options.camera, "CAMERA.json; without it, a camera is placed to show the whole motion");
    app.add_option("--camera-name", options.camera_name, "name of the entry, if the file has several cameras");
    app.add_option("--size", options.size, "side of the square image in pixels, without --camera (default 540)")
        ->check(CLI::Range(16, 8192));
    auto* upright =
        app.add_flag("--upright", options.upright,
                     "rotate the world of each motion so that the body stands along +y (default without --camera)");
    app.add_flag("--as-stored", options.as_stored, "keep the world of each motion as it is (default with --camera)")
        ->excludes(upright);
    app.add_option("--out", options.out, "folder for the frames")->required();
    add_rig(app, options.rig);
    add_light(app, options.light);
    add_detail(app, options.detail);
    add_background(app, options.background, "white");
    add_backend(app, options.machine);
    return run_program(app, argc, argv, [&] { return animate(options); });
} catch (const std::bad_alloc&) {
    return refuse_without_memory("gsh-animate");
}
