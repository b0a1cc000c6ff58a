// SPDX-License-Identifier: Apache-2.0
/// @file  The command line of a reconstruction.
#pragma once

#include "common/program.hpp"
#include "reconstruct/reconstruct_options.hpp"

#include <gsh/setup/configuration.hpp>

#include <CLI/CLI.hpp>

#include <string>

namespace gsh::programs {

/// The options --body, --poses and --input-fps.
inline void add_people(CLI::App& app, PeopleOptions& o) {
    app.add_option("--body", o.bodies,
                   "body model (.npz, SMPL / SMPL-H / SMPL-X layout); for several people one for all, or one for each")
        ->allow_extra_args(false);
    app.add_option("--poses", o.poses,
                   "poses in any layout that gsh reads: a file or folder in the capture's folder (default "
                   "poses.npz), or a path; for several people one for each, repeated or separated by commas")
        ->allow_extra_args(false);
    app.add_option("--input-fps", o.input_fps,
                   "frames per second of the poses, whatever their files state (default: as they state, else fps of "
                   "cameras.json, else 30)")
        ->check(above_zero());
}

/// The option --image-memory.
inline void add_image_memory(CLI::App& app, PeopleOptions& o,
                             const std::string& usual = "half of the machine's memory") {
    app.add_option("--image-memory", o.image_memory,
                   "bytes that the capture's images may take; those of larger captures are read when they are needed "
                   "(default: " +
                       usual + ")")
        ->check(above_zero());
}

/// The options --lpips and --lpips-table.
inline void add_lpips(CLI::App& app, ReconstructOptions& o) {
    app.add_option("--lpips", o.lpips, "LPIPS weights (.safetensors or .npz); the results then include LPIPS");
    app.add_flag("--lpips-table", o.lpips_table,
                 "with --lpips: the network receives images in [0, 1], as in most published avatar tables, instead of "
                 "its own range [-1, 1]");
}

/// The options --refine, --no-registration, --fine-registration, --keypoints and --refine-cameras.
inline void add_refine(CLI::App& app, ReconstructOptions& o) {
    app.add_flag("--refine", o.refine,
                 "fit poses and shape to the photographs before training, and refine the poses during training; test "
                 "poses are fitted to the test images, as the protocol states");
    app.add_flag("--no-registration", o.no_registration,
                 "with --refine: only refine the poses during training, because they are known to 2 cm");
    app.add_flag("--fine-registration{2}", o.fine_registration,
                 "with --refine: fit poses to photographs of the 2 finest of 4 sizes only and keep the shape, because "
                 "both are near, as after gsh-fit; =3 for a free motion before one camera")
        ->check(CLI::Range(1, 4));
    app.add_option("--keypoints", o.keypoints,
                   "with --refine: keypoints of the photographs, a folder of OpenPose's JSON files or a JSON file of "
                   "COCO-WholeBody; a path, or a name in the capture's folder");
    app.add_flag("--refine-cameras", o.refine_cameras,
                 "with --refine: refine all cameras but the first, too; of a single camera, its focal length");
}

/// The option --hold-out-motion.
inline void add_hold_out(CLI::App& app, ReconstructOptions& o) {
    app.add_option("--hold-out-motion", o.hold_out_motion,
                   "leave a span of the motion out of training in all cameras, and report seen and new motion "
                   "separately: SHARE, the last share of the motion (0.25), or A:B, frames A to B (20:29)");
}

inline void add_options(CLI::App& app, ReconstructOptions& o) {
    app.add_option("--capture", o.capture, "folder with images/, cameras.json and poses");
    add_people(app, o);
    app.add_flag("--synthetic", o.synthetic, "film the built-in actor and reconstruct it, instead of a capture");
    app.add_option("--out", o.out, "folder for the results (required, but for --plan)");
    app.add_option("--steps", o.steps,
                   "training steps (default 1500; without stages, as in --config paper, 3000; with "
                   "--synthetic 1000)")
        ->check(above_zero());
    app.add_option("--seconds", o.seconds, "duration of training, instead of a number of steps")->check(above_zero());
    app.add_option(
           "--gaussians", o.gaussians,
           "number of Gaussians for each person (default 170000; 60000 with --synthetic; fewer for short --seconds)")
        ->check(CLI::Range(1, 100'000'000));
    app.add_option("--seed", o.seed, "seed of all random choices (default 0)")->check(not_negative());
    add_backend(app, o.machine);
    app.add_option("--max-memory", o.max_memory,
                   "limit on memory in bytes (with --backend cuda: of the GPU); reduces the number of Gaussians if "
                   "needed")
        ->check(above_zero());
    add_image_memory(app, o, "half of the machine's memory, and half of --max-memory on a CPU");
    app.add_option("--checkpoint-interval", o.checkpoint_interval, "seconds between checkpoints (default 5)")
        ->check(above_zero());
    app.add_option("--config", o.config,
                   "configuration by name, or a JSON file of settings (default " + std::string(default_configuration) +
                       "); static: one frame, no body");
    app.add_option("--set", o.set, "change a setting of the configuration, key=value; may be repeated");
    add_refine(app, o);
    add_hold_out(app, o);
    app.add_option("--regions", o.regions, "JSON lists of face and hand vertices, or importance per vertex");
    app.add_option("--priors", o.priors,
                   "JSON list of an estimator's normal and depth maps, instead of those of the body's mesh");
    add_lpips(app, o);
    app.add_option("--frame", o.frame, "with --config static: frame of the capture (default 0)");
    app.add_flag("--resume", o.resume, "continue from the checkpoint in --out, with the options of its run");
    app.add_flag("--continue", o.go_on,
                 "continue from the checkpoint in --out if there is one of the same options, otherwise begin; for "
                 "schedulers, which run a command again");
    app.add_flag("--plan", o.plan,
                 "only print what the run will take, as JSON: bytes of memory, seconds, Gaussians, images");
}

} // namespace gsh::programs
