// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-check: whether a capture's images, cameras, poses and body belong together; pictures and likely faults.

#include "support/figures.hpp"
#include "support/input_files.hpp"
#include "support/output_folder.hpp"
#include "support/overlay.hpp"
#include "support/program.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/io/any_capture.hpp>
#include <gsh/io/image_file.hpp>
#include <gsh/train/capture_check.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

using namespace gsh;
using namespace gsh::examples;

namespace {

constexpr int exit_findings = 1;

struct CheckOptions {
    std::filesystem::path capture, body, out = "check";
    std::vector<std::string> poses;
    std::size_t frames = 30, threads = 0;
    int person = 0;
};

/// The files' word: the capture, its body, and what their readers found suspicious.
struct Input {
    AnyCapture any;
    BodyModel body;
    std::vector<std::string> warnings;

    Input(cpu::Threads& backend, const CheckOptions& options) {
        std::optional<BodyModel> given;
        if (!options.body.empty()) given = body_of_file(options.body);
        CaptureOptions how;
        how.empty_masks = true; // they are findings
        how.person = options.person;
        check_value(options.poses.size() <= 1, "--poses",
                    "was given more than once; gsh-check looks at one person at a time: call it once for each pose file");
        if (!options.poses.empty()) how.poses = options.poses[0];
        any = capture_of_folder(backend, options.capture, given ? &*given : nullptr, how, warnings);
        body = any.rig ? any.rig->body : std::move(*given);
        // The check says with figures what a glance at three frames suspects.
        for (const std::string& text : warnings_of(any.capture, body))
            std::erase(warnings, options.capture.string() + ": " + text);
    }
};

std::string overlay_name(const Capture& capture, CaptureView view) {
    char frame[16];
    std::snprintf(frame, sizeof frame, "_%04zu.png", view.frame);
    return "overlays/" + capture.cameras[view.camera].name + frame;
}

/// Above 0 for joints at the left, below for those at the right, 0 in the middle.
std::vector<int> joint_sides(const BodyModel& body) {
    const auto joints = regress_joints(body, body.v_template);
    const auto counterparts = joint_counterparts(body);
    std::vector<int> sides;
    for (std::size_t j = 0; j < joints.size(); ++j) {
        const double other = joints[static_cast<std::size_t>(counterparts[j])].x;
        sides.push_back((joints[j].x > other) - (joints[j].x < other));
    }
    return sides;
}

PixelImage overlay(const PixelImage& image, const Camera<double>& camera, const BodyModel& body, const PosedBody& posed,
                   const std::vector<int>& sides) {
    const OverlayColors colors;
    PixelImage canvas = overlay_canvas(image);
    draw_outline(canvas, mask_silhouette(image), colors.mask);
    draw_outline(canvas, mesh_silhouette(posed.vertices, body.faces, camera), colors.body);
    draw_skeleton(canvas, camera, posed.joints, body.parents, sides, colors);
    return canvas;
}

/// False if somebody interrupts.
bool write_overlays(cpu::Threads& backend, OutputFolder& out, const Input& input, const CaptureCheck& check) {
    const Capture& capture = input.any.capture;
    const std::vector<int> sides = joint_sides(input.body), counterparts = joint_counterparts(input.body);
    std::vector<std::filesystem::path> paths;
    for (const ViewCheck& v : check.views) paths.push_back(out.file(overlay_name(capture, v.view)));
    gsh::detail::load_all(backend, check.views.size(), [&](std::size_t i) {
        if (interrupted) return;
        const CaptureView view = check.views[i].view;
        const PosedBody posed = pose_as(input.body, capture.motion, view.frame, {}, counterparts);
        write_png(paths[i],
                  overlay(capture.image(view), capture.cameras[view.camera].camera, input.body, posed, sides));
    });
    return !interrupted;
}

const char* mask_text(ViewCheck::Mask mask) {
    return mask == ViewCheck::Mask::usable ? "usable" : mask == ViewCheck::Mask::empty ? "empty" : "opaque";
}

void write_json(const std::filesystem::path& path, const Input& input, const CaptureCheck& check) {
    const Capture& capture = input.any.capture;
    const auto image = [&](CaptureView view) {
        return Json{{"camera", capture.cameras[view.camera].name}, {"frame", view.frame}};
    };
    Json json{{"capture", capture.name},
              {"protocol",
               "intersection over union of the mask (alpha at least 1/2) with the pixels whose centres the posed "
               "body covers, poses as given; images of more than 1080 pixels reduced"},
              {"mean_iou", check.mean_iou()},
              {"findings", Json::array()},
              {"warnings", input.warnings},
              {"images", Json::array()}};
    for (const CaptureFinding& finding : check.findings) {
        Json one{{"fault", finding.fault},
                 {"measure", finding.measure},
                 {"given", finding.given},
                 {"mended", finding.mended},
                 {"text", finding.text}};
        for (const std::size_t c : finding.cameras) one["cameras"].push_back(capture.cameras[c].name);
        for (const CaptureView& view : finding.views) one["images"].push_back(image(view));
        json["findings"].push_back(one);
    }
    for (const ViewCheck& v : check.views) {
        Json one = image(v.view);
        one["iou"] = v.mask == ViewCheck::Mask::usable ? Json(v.iou) : Json(nullptr);
        one["mask"] = mask_text(v.mask);
        one["inside"] = v.inside;
        one["overlay"] = overlay_name(capture, v.view);
        json["images"].push_back(one);
    }
    examples::write_json(path, json);
}

/// One screen: the cameras' means, the worst images, the findings.
void print(const Input& input, const CaptureCheck& check, const std::filesystem::path& out) {
    const Capture& capture = input.any.capture;
    constexpr std::size_t most_cameras = 8, most_images = 8;
    std::printf("%zu images of %zu cameras, mean IoU of mask and posed body %.3f\n", check.views.size(),
                capture.cameras.size(), check.mean_iou());
    struct Row {
        std::string name;
        double mean = 0, least = 1, count = 0;
    };
    std::vector<Row> cameras;
    for (const NamedCamera& camera : capture.cameras) cameras.push_back({camera.name});
    std::vector<ViewCheck> worst;
    for (const ViewCheck& v : check.views) {
        if (v.mask != ViewCheck::Mask::usable) continue;
        Row& row = cameras[v.view.camera];
        row.mean += v.iou, row.least = std::min(row.least, v.iou), row.count += 1;
        worst.push_back(v);
    }
    std::erase_if(cameras, [](const Row& row) { return row.count == 0; });
    const auto mean = [](const Row& row) { return row.mean / row.count; };
    std::sort(cameras.begin(), cameras.end(), [&](const Row& a, const Row& b) {
        return std::make_pair(mean(a), a.name) < std::make_pair(mean(b), b.name);
    });
    std::sort(worst.begin(), worst.end(), [](const ViewCheck& a, const ViewCheck& b) {
        return std::make_tuple(a.iou, a.view.camera, a.view.frame) <
               std::make_tuple(b.iou, b.view.camera, b.view.frame);
    });
    if (!cameras.empty()) std::printf("\n%-20s %8s %8s\n", "camera", "IoU", "least");
    for (std::size_t i = 0; i < std::min(most_cameras, cameras.size()); ++i)
        std::printf("%-20s %8.3f %8.3f\n", cameras[i].name.c_str(), mean(cameras[i]), cameras[i].least);
    if (!worst.empty()) std::printf("\n%-20s %8s %8s %8s\n", "worst images", "frame", "IoU", "inside");
    for (std::size_t i = 0; i < std::min(most_images, worst.size()); ++i)
        std::printf("%-20s %8zu %8.3f %7.0f%%\n", capture.cameras[worst[i].view.camera].name.c_str(),
                    worst[i].view.frame, worst[i].iou, 100 * worst[i].inside);
    std::printf("\n");
    for (const CaptureFinding& finding : check.findings) std::printf("%s\n", one_line(finding.text).c_str());
    if (check.findings.empty()) std::printf("nothing suspicious\n");
    std::printf("pictures in %s\n", (out / "overlays").string().c_str());
}

int check(const CheckOptions& options) {
    watch_interrupts();
    cpu::Threads backend(options.threads);
    const Input input(backend, options);
    for (const std::string& warning : input.warnings) warn(warning);
    OutputFolder out(options.out);
    CaptureCheckParams params;
    params.frames = options.frames;
    const CaptureCheck result = check_capture(backend, input.any.capture, input.body, params);
    if (interrupted || !write_overlays(backend, out, input, result)) return exit_interrupted;
    write_json(out.file("check.json"), input, result); // last: who finds it finds all
    out.commit();
    print(input, result, options.out);
    return result.findings.empty() ? int(exit_done) : exit_findings;
}

} // namespace

int main(int argc, char** argv) {
    CheckOptions options;
    CLI::App app("Checks whether images, cameras, poses and body of a capture belong together.", "gsh-check");
    app.add_option("capture", options.capture, "folder, in any layout that we read")->required();
    app.add_option("--body", options.body, "body model (.npz), unless the capture brings its own");
    app.add_option("--poses", options.poses, "another pose file in the capture's folder, or a path; of several people one at a time")
        ->allow_extra_args(false);
    app.add_option("--person", options.person, "whose poses, where there are several people (default 0)")
        ->check(not_negative());
    app.add_option("--out", options.out, "folder for pictures and check.json (default ./check)");
    app.add_option("--frames", options.frames, "how many frames to look at, evenly spaced (default 30; 0: all)")
        ->check(not_negative());
    add_threads(app, options.threads);
    return run_program(app, argc, argv, [&] { return check(options); });
}
