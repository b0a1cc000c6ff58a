// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-video: from a video to an avatar: detects, fits, checks and reconstructs, each stage's files kept.

#include "support/fit_command.hpp"
#include "support/fitting.hpp"
#include "support/messages.hpp"
#include "support/program.hpp"
#include "support/stage_process.hpp"
#include "support/video_report.hpp"

#include <gsh/core/error.hpp>
#include <gsh/io/file/atomic_file.hpp>

#include <csignal>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

using namespace gsh;
using namespace gsh::examples;
namespace fs = std::filesystem;

namespace {

struct VideoOptions {
    std::vector<std::string> videos;
    fs::path out, detector, calibration;
    FitOptions fit;
    double fps = 10;
    int size = 540;
    std::size_t steps = 0, threads = 0;
    bool preview = false;
};

/// scripts/detect of the source tree in which this program was built, or gsh-detect beside it or in the search path.
std::string detector_of(const VideoOptions& options) {
    if (!options.detector.empty()) return options.detector.string();
    if (const char* named = std::getenv("GSH_DETECTOR"); named && *named) return named;
    const fs::path programs = folder_of_programs();
    std::error_code error;
    for (const fs::path& place : {programs / "gsh-detect", programs / "../../../scripts/detect"})
        if (fs::exists(place, error)) return fs::weakly_canonical(place, error).string();
    return "gsh-detect";
}

/// Announces a stage and runs it; anything but `accepted` ends this program.
void stage(const char* title, const std::vector<std::string>& words, std::vector<int> accepted = {0}) {
    std::printf("== %s\n", title);
    const int code = run_stage(words);
    for (const int good : accepted)
        if (code == good) return;
    if (code == exit_interrupted || code == 128 + SIGINT || code == 128 + SIGTERM) std::exit(exit_interrupted);
    throw Error(std::string("the stage '") + title + "' ended with code " + std::to_string(code) +
                "; its message stands above. The same command goes on from here");
}

int make(VideoOptions options) {
    const fs::path capture = options.out / "capture", check = options.out / "check", avatar = options.out / "avatar";
    const std::string programs = folder_of_programs().string() + "/";
    fs::create_directories(options.out);
    if (options.preview && options.steps == 0) options.steps = 400;

    std::vector<std::string> detect{detector_of(options), capture.string()};
    detect.insert(detect.end(), options.videos.begin(), options.videos.end());
    detect.insert(detect.end(), {"--fps", std::to_string(options.fps), "--size", std::to_string(options.size)});
    if (!options.calibration.empty()) detect.insert(detect.end(), {"--calibration", options.calibration.string()});
    stage("finding the person", detect);

    std::printf("== fitting the body\n");
    options.fit.detections = capture;
    const auto fitted = [&] {
        std::error_code error;
        const fs::path poses = capture / "poses.npz";
        return fs::exists(poses, error) ? read_file(poses) : std::string();
    };
    const std::string before = fitted(); // the same fit gives the same bytes
    const std::vector<std::string> notes = fit_capture(options.fit, {});
    const bool same_fit = fitted() == before;
    for (const std::string& note : notes) std::printf("note: %s\n", note.c_str());

    stage("checking the capture",
          {programs + "gsh-check", capture.string(), "--body", options.fit.body.string(), "--out", check.string()},
          {0, 1}); // doubts are no errors

    std::vector<std::string> reconstruct{programs + "gsh-reconstruct",
                                         "--capture",
                                         capture.string(),
                                         "--body",
                                         options.fit.body.string(),
                                         "--out",
                                         avatar.string(),
                                         "--refine",
                                         "--fine-registration",
                                         "--keypoints",
                                         (capture / "keypoints.json").string()};
    std::error_code error;
    if (same_fit && fs::exists(avatar / "checkpoint.gsh", error)) reconstruct.push_back("--resume");
    if (options.steps > 0) reconstruct.insert(reconstruct.end(), {"--steps", std::to_string(options.steps)});
    if (options.preview) reconstruct.insert(reconstruct.end(), {"--gaussians", "30000"});
    if (options.threads > 0) reconstruct.insert(reconstruct.end(), {"--threads", std::to_string(options.threads)});
    stage("reconstructing the avatar", reconstruct);

    write_video_report(options.out, options.fit.body, notes);
    std::printf("see   %s\nnext: %sgsh-view %s\n", (options.out / "report.html").c_str(), programs.c_str(),
                shell_word((avatar / "avatar.gsh").string()).c_str());
    return exit_done;
}

} // namespace

int main(int argc, char** argv) {
    VideoOptions options;
    CLI::App app("From a video of a person to an avatar: finds the person, fits the body, checks, reconstructs.",
                 "gsh-video");
    app.add_option("videos", options.videos, "a video, or one of each camera; or folders of images")->required();
    app.add_option("--out", options.out, "folder for capture/, check/, avatar/ and report.html")->required();
    add_fit(app, options.fit);
    app.add_option("--calibration", options.calibration, "cameras of several videos: any file that the detector reads");
    app.add_option("--fps", options.fps, "images per second that are taken from the video (default 10)")
        ->check(above_zero());
    app.add_option("--size", options.size, "longer side of the images, pixels (default 540)")
        ->check(CLI::Range(64, 8192));
    app.add_option("--steps", options.steps, "training steps (default: those of gsh-reconstruct)");
    app.add_flag("--preview", options.preview, "a rough avatar in a third of the time: 400 steps, 30,000 Gaussians");
    app.add_option("--detector", options.detector,
                   "program that finds the person, called as PROGRAM OUT VIDEO… --fps F --size S [--calibration FILE] "
                   "(default: scripts/detect, which uses MediaPipe)");
    add_threads(app, options.threads);
    return run_program(app, argc, argv, [&] { return make(std::move(options)); });
}
