// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-fit: fits a body's motion and shape to a video, or to what a detector found in one, and makes a capture.

#include "common/default_body.hpp"
#include "common/messages.hpp"
#include "common/motion_output.hpp"
#include "common/program.hpp"
#include "video/detecting.hpp"
#include "video/fit_command.hpp"
#include "video/fitting.hpp"

#include <gsh/core/error.hpp>
#include <gsh/io/file/folder_lock.hpp>

#include <cstdio>
#include <filesystem>
#include <new>
#include <string>
#include <vector>

using namespace gsh;
using namespace gsh::programs;

namespace {

struct FitCommand {
    std::vector<std::string> inputs;
    DetectOptions detect{.fps = 30, .frames = 600, .size = 960}; // a motion wants more frames than an avatar
    FitOptions fit;
    std::filesystem::path out;
    std::vector<std::filesystem::path> to;
};

/// The folder of detections: the one that was given, or that of the videos, which is to be made.
std::filesystem::path detections_of(FitCommand& command, const std::vector<CLI::Option*>& of_videos) {
    if (command.inputs.size() == 1 && is_detector_folder(command.inputs[0])) {
        for (const CLI::Option* option : of_videos)
            check_value(option->count() == 0, option->get_name(),
                        "is for videos, and " + command.inputs[0] + " is a detector's folder");
        return command.inputs[0];
    }
    std::filesystem::path folder = command.out;
    if (folder.empty()) {
        check_value(!command.to.empty(), "--out", "is required with a video, if there is no --to to place it beside");
        folder = command.to[0];
        folder.replace_extension(".detections");
    }
    command.detect.videos = command.inputs;
    return folder;
}

} // namespace

int main(int argc, char** argv) try {
    FitCommand command;
    CLI::App app("Fits a body to videos of a person: its motion, and its shape. The folder of what was found becomes a "
                 "capture for gsh-reconstruct.",
                 "gsh-fit");
    app.add_option("inputs", command.inputs,
                   "a video, or one of each camera; or the folder that a detector wrote: video.json, keypoints.json, "
                   "masks/, and calibration.json for several cameras")
        ->required();
    app.add_option("--to", command.to, "also write the motion alone: OUT.bvh, OUT.glb or OUT.npz, any number of times")
        ->allow_extra_args(false); // what follows the file is a video
    std::vector<CLI::Option*> of_videos = add_detection(app, command.detect);
    of_videos.push_back(app.add_option(
        "--out", command.out, "folder for what is found in videos (default: beside the first --to, X.detections)"));
    add_fit(app, command.fit);
    app.add_option("--betas", command.fit.betas, "shape coefficients to fit (default: those of the body, at most 30)")
        ->check(CLI::Range(1, 400));
    return run_program(app, argc, argv, [&] {
        for (const auto& path : command.to) check_motion_output("--to", path);
        command.fit.body = body_or_default(command.fit.body); // before the detector, which takes minutes
        command.fit.detections = detections_of(command, of_videos);
        const LockedFolder locked(command.fit.detections);
        if (!command.detect.videos.empty()) detect(command.detect, command.fit.detections);
        const FittedCapture fitted = fit_capture(command.fit, command.to);
        for (const std::string& note : fitted.notes) std::printf("note: %s\n", note.c_str());
        std::string next = "gsh-check " + shell_word(command.fit.detections.string()) + " --body " +
                           shell_word(command.fit.body.string());
        for (const std::string& word : fitted.poses_option()) next += " " + shell_word(word);
        std::printf("next: %s\n", next.c_str());
        return exit_done;
    });
} catch (const std::bad_alloc&) {
    return refuse_without_memory("gsh-fit");
}
