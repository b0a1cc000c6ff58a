// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-motion: converts a motion in any layout that gsh reads to .npz, BVH or GLB, for a given body.

#include "common/input_files.hpp"
#include "common/messages.hpp"
#include "common/motion_output.hpp"
#include "common/program.hpp"
#include "common/rig_option.hpp"

#include <gsh/avatar/avatar.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/resampled_motion.hpp>
#include <gsh/synthetic/actor.hpp>

#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <new>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;
using namespace gsh::programs;

namespace {

struct MotionOptions {
    std::filesystem::path input, out, body;
    RigOption rig;
    double fps = 0;
    bool as_stored = false;
};

/// The body that moves, and its shape for motions without one: of a file, of an avatar, or the built-in actor.
std::pair<BodyModel, std::vector<double>> body_of(const std::filesystem::path& path) {
    if (path.empty()) return {make_actor(), {}};
    if (path.extension() != ".gsh") return {body_of_file(path), {}};
    AvatarData avatar = avatar_of_file(path);
    return {std::move(avatar.rig.body), std::move(avatar.rig.betas)};
}

int convert(const MotionOptions& options) {
    check_motion_output("--out", options.out);
    options.rig.check_rates(1);
    const auto [body, betas] = body_of(options.body);
    std::vector<std::string> warnings;
    Motion motion = motion_of_file(options.input, body, warnings, !options.as_stored, betas, options.rig);
    if (options.fps > 0) motion = resampled(motion, options.fps);
    write_motion(options.out, motion, body, warnings);
    for (const std::string& warning : warnings) warn(warning);
    const double seconds = motion.timestamps.back() - motion.timestamps.front();
    std::printf("%zu frames, %.2f s, of %zu joints in %s\n", motion.frame_count(), seconds, motion.joint_count,
                options.out.c_str());
    return exit_done;
}

} // namespace

int main(int argc, char** argv) try {
    MotionOptions options;
    CLI::App app("Converts motions between layouts and rigs.", "gsh-motion");
    app.add_option("input", options.input,
                   "motion: .bvh, .glb, .gltf, .vrm, .vrma, .npz (gsh, SMPL-X, AMASS, SAM 3D Body), or a folder")
        ->required();
    app.add_option("--out", options.out, "OUT.npz, OUT.bvh or OUT.glb")->required();
    app.add_option(
        "--body", options.body,
        "BODY.npz or AVATAR.gsh: whose motion it becomes (default: the built-in actor, 55 joints of SMPL-X)");
    add_rig(app, options.rig);
    app.add_option("--fps", options.fps, "frames per second of the result (default: those of the input)")
        ->check(above_zero());
    app.add_flag("--as-stored", options.as_stored,
                 "keep the world of poses as it is stored, instead of turning the body upright");
    return run_program(app, argc, argv, [&] { return convert(options); });
} catch (const std::bad_alloc&) {
    return refuse_without_memory("gsh-motion");
}
