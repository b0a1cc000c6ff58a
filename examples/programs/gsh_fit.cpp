// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-fit: fits a body's motion and shape to what a detector found in a video, and so makes it a capture.

#include "support/fit_command.hpp"
#include "support/fitting.hpp"
#include "support/messages.hpp"
#include "support/program.hpp"

#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

using namespace gsh::examples;

int main(int argc, char** argv) {
    FitOptions options;
    std::vector<std::filesystem::path> to;
    CLI::App app("Fits a body to keypoints and masks of a video. DETECTIONS becomes a capture for gsh-reconstruct.",
                 "gsh-fit");
    app.add_option("detections", options.detections,
                   "folder that scripts/detect wrote: video.json, keypoints.json, masks/, and calibration.json for "
                   "several cameras")
        ->required();
    add_fit(app, options);
    app.add_option("--betas", options.betas, "shape coefficients to fit (default: those of the body, at most 30)")
        ->check(CLI::Range(1, 400));
    app.add_option("--to", to, "also write the motion alone: OUT.bvh, OUT.glb or OUT.npz, any number of times");
    return run_program(app, argc, argv, [&] {
        const FittedCapture fitted = fit_capture(options, to);
        for (const std::string& note : fitted.notes) std::printf("note: %s\n", note.c_str());
        std::string next =
            "gsh-check " + shell_word(options.detections.string()) + " --body " + shell_word(options.body.string());
        for (const std::string& word : fitted.poses_option()) next += " " + shell_word(word);
        std::printf("next: %s\n", next.c_str());
        return exit_done;
    });
}
