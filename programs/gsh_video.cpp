// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-video: from a video to an avatar: detects, fits, checks and reconstructs, each stage's files kept.

#include "common/default_body.hpp"
#include "common/help.hpp"
#include "common/input_files.hpp"
#include "common/messages.hpp"
#include "common/program.hpp"
#include "video/detecting.hpp"
#include "video/fit_command.hpp"
#include "video/fitting.hpp"
#include "video/stage_process.hpp"
#include "video/video_doubts.hpp"
#include "video/video_report.hpp"

#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/folder_lock.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/reconstruct/resume.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <new>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

using namespace gsh;
using namespace gsh::programs;
namespace fs = std::filesystem;

namespace {

struct VideoOptions {
    DetectOptions detect;
    FitOptions fit;
    fs::path out;
    std::size_t steps = 0, threads = 0;
    bool preview = false;
};

/// Fits the body. If the detector can, it then cuts the masks anew by the body, and the body is fitted to these.
FittedCapture fit_with_masks(const VideoOptions& options) {
    const fs::path masks = options.fit.detections / "masks_by_body", record = options.out / "masks.command";
    // Masks belong to the options of the fit by which they were cut.
    const FitOptions& fit = options.fit;
    std::string work = file_checksum(fit.body) + " " + fit.people + " " + fit.turn + " " + std::to_string(fit.betas);
    if (fit.focal) work += " focal " + std::to_string(*fit.focal);
    for (const double height : fit.heights) work += " " + std::to_string(height);
    std::error_code error;
    const bool recorded = fs::exists(masks, error) && fs::exists(record, error) && read_file(record) == work;
    if (!recorded || options.detect.restart) {
        fs::remove_all(masks, error);
        announce_stage("fitting the body");
        FittedCapture fitted = fit_capture(fit, {});
        if (!fitted.masks_by_body) return fitted;
        cut_masks_by_body(options.detect, fit.detections);
        write_file(record, work);
    }
    announce_stage("fitting the body to its masks");
    return fit_capture(fit, {});
}

int make(VideoOptions options) {
    const fs::path capture = options.out / "capture", check = options.out / "check", avatar = options.out / "avatar";
    const std::string programs = folder_of_programs().string() + "/";
    options.fit.body = body_or_default(options.fit.body); // before the detector, which takes minutes
    const LockedFolder locked(options.out), locked_capture(capture);
    if (options.preview && options.steps == 0) options.steps = 400;

    detect(options.detect, capture);

    options.fit.detections = capture;
    const FittedCapture fitted = fit_with_masks(options);
    for (const std::string& note : fitted.notes) std::printf("note: %s\n", note.c_str());
    const std::vector<std::string> poses = fitted.poses_option();

    std::vector<std::string> look{programs + "gsh-check",    capture.string(), "--body",
                                  options.fit.body.string(), "--out",          check.string()};
    look.insert(look.end(), poses.begin(), poses.end());
    run_stage("checking the capture", look, {0, 1}); // doubts are no errors

    std::vector<std::string> reconstruct{programs + "gsh-reconstruct",
                                         "--capture",
                                         capture.string(),
                                         "--body",
                                         options.fit.body.string(),
                                         "--out",
                                         avatar.string(),
                                         "--refine",
                                         fitted.free_before_one_camera ? "--fine-registration=3"
                                                                       : "--fine-registration",
                                         "--keypoints",
                                         (capture / "keypoints.json").string()};
    reconstruct.insert(reconstruct.end(), poses.begin(), poses.end());
    if (options.steps > 0) reconstruct.insert(reconstruct.end(), {"--steps", std::to_string(options.steps)});
    if (options.preview) reconstruct.insert(reconstruct.end(), {"--gaussians", "30000"});
    if (options.threads > 0) reconstruct.insert(reconstruct.end(), {"--threads", std::to_string(options.threads)});
    // A checkpoint belongs to one fit, body and command. The same fit gives the same bytes.
    std::string work = file_checksum(options.fit.body);
    for (const std::string& name : fitted.poses) work += " " + file_checksum(capture / name);
    for (const std::string& word : reconstruct) work += " " + shell_word(word);
    work += "\n";
    const fs::path record = options.out / "avatar.command";
    std::vector<fs::path> avatars;
    for (const std::string& motion : fitted.poses)
        avatars.push_back(
            avatar / (fitted.poses.size() == 1 ? "avatar.gsh" : "avatar-" + fs::path(motion).stem().string() + ".gsh"));
    std::error_code error;
    const bool made =
        std::all_of(avatars.begin(), avatars.end(), [&](const fs::path& file) { return fs::exists(file, error); });
    const std::string done = "done\n", earlier = fs::exists(record, error) ? read_file(record) : "";
    if (earlier == work + done && made) {
        announce_stage("the avatar is complete");
    } else {
        const fs::path checkpoint = avatar / "checkpoint.gsh";
        if (earlier == work && has_checkpoint(checkpoint)) {
            reconstruct.push_back("--resume");
        } else {
            remove_checkpoints(checkpoint); // of other work, if this is stopped before it has one of its own
            write_file(record, work);
        }
        run_stage("reconstructing the avatar", reconstruct);
        write_file(record, work + done);
    }

    const std::vector<VideoDoubt> doubts =
        doubts_of_video(options.out, options.fit.body, options.fit.heights, fitted.poses);
    write_video_report(options.out, options.fit.body, doubts, fitted);
    std::printf("== verdict on the video\n%s", doubts.empty() ? "nothing in it is in the way of a good avatar\n" : "");
    std::vector<std::string> names;
    for (const VideoDoubt& doubt : doubts) {
        std::printf("%s\n", doubt.text.c_str());
        names.push_back(doubt.doubt);
    }
    if (!names.empty()) std::printf("read  %s\n", help_text(names).c_str());
    std::string shown;
    for (const fs::path& file : avatars) shown += " " + shell_word(file.string());
    std::printf("see   %s\nnext: %sgsh-view%s\n", (options.out / "report.html").c_str(), programs.c_str(),
                shown.c_str());
    return exit_done;
}

} // namespace

int main(int argc, char** argv) try {
    VideoOptions options;
    CLI::App app("From a video of a person to an avatar: finds the person, fits the body, checks, reconstructs.",
                 "gsh-video");
    app.add_option("videos", options.detect.videos, "a video, or one of each camera; or folders of images")->required();
    app.add_option("--out", options.out, "folder for capture/, check/, avatar/ and report.html")->required();
    add_detection(app, options.detect);
    add_fit(app, options.fit);
    app.add_option("--steps", options.steps, "training steps (default: those of gsh-reconstruct)");
    app.add_flag("--preview", options.preview, "a rough avatar in a third of the time: 400 steps, 30,000 Gaussians");
    add_threads(app, options.threads);
    return run_program(app, argc, argv, [&] { return make(std::move(options)); });
} catch (const std::bad_alloc&) {
    return refuse_without_memory("gsh-video");
}
