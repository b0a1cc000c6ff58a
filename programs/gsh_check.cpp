// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-check: tests whether the images, cameras, poses and body of a capture match; lists likely faults.

#include "common/figures.hpp"
#include "common/help.hpp"
#include "common/input_files.hpp"
#include "common/output_folder.hpp"
#include "common/overlay.hpp"
#include "common/program.hpp"
#include "common/progress.hpp"
#include "reconstruct/load_input.hpp"
#include "reconstruct/reconstruct_command.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/check/capture_check.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/capture/capture_images.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/image/image_file.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <new>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

using namespace gsh;
using namespace gsh::programs;

namespace {

constexpr int exit_findings = 1;

struct CheckOptions : PeopleOptions {
    std::filesystem::path out = "check";
    std::size_t frames = 30, threads = 0;
    std::optional<std::size_t> person;
};

/// Loads the capture and its people, with the warnings of the readers.
ReconstructionInput load(cpu::Threads& backend, const CheckOptions& options) {
    CaptureOptions how;
    how.empty_masks = true; // reported as findings
    how.person = static_cast<int>(options.person.value_or(0));
    ReconstructionInput input = load_people(backend, options, how);
    auto& people = input.people;
    // The reader's warnings are estimates from three frames. The check reports the same faults with figures.
    for (std::size_t p = 0; p < people.size(); ++p)
        for (const std::string& text : warnings_of(input.capture, input.body(p), people[p].motion))
            std::erase(input.warnings,
                       (people.size() > 1 ? people[p].name + ": " : "") + options.capture.string() + ": " + text);
    if (options.person && people.size() > 1) {
        check_value(*options.person < people.size(), "--person " + std::to_string(*options.person),
                    "there are " + std::to_string(people.size()) + " people, counted from 0");
        people = {people[*options.person]};
    }
    return input;
}

std::string overlay_name(const Capture& capture, CaptureView view) {
    char frame[16];
    std::snprintf(frame, sizeof frame, "_%04zu.png", view.frame);
    return "overlays/" + capture.cameras[view.camera].name + frame;
}

/// The side of each joint: positive on the left, negative on the right, 0 in the middle.
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

/// Draws the mask's outline and the bodies and skeletons of all people in a frame. `sides` has the joint sides of each
/// body.
PixelImage overlay(const ReconstructionInput& input, CaptureView view, const std::vector<std::vector<int>>& sides) {
    const OverlayColors colors;
    const PixelImage image = input.capture.read_image(view);
    const Camera<double>& camera = input.capture.cameras[view.camera].camera;
    std::vector<PosedBody> posed;
    for (std::size_t p = 0; p < input.people.size(); ++p) posed.push_back(input.posed(p, view.frame));
    PixelImage canvas = overlay_canvas(image);
    draw_outline(canvas, mask_silhouette(image), colors.mask);
    for (std::size_t p = 0; p < posed.size(); ++p)
        draw_outline(canvas, mesh_silhouette(posed[p].vertices, input.body(p).faces, camera), colors.body);
    for (std::size_t p = 0; p < posed.size(); ++p)
        draw_skeleton(canvas, camera, posed[p].joints, input.body(p).parents, sides[input.people[p].body], colors);
    return canvas;
}

/// Returns false after an interrupt.
bool write_overlays(cpu::Threads& backend, OutputFolder& out, const ReconstructionInput& input,
                    const CaptureCheck& check) {
    std::vector<std::vector<int>> sides;
    for (const BodyModel& body : input.bodies) sides.push_back(joint_sides(body));
    std::vector<std::filesystem::path> paths;
    out.own("overlays");
    for (const ViewCheck& v : check.views) paths.push_back(out.file(overlay_name(input.capture, v.view)));
    gsh::detail::load_all(backend, check.views.size(), [&](std::size_t i) {
        if (!interrupted) write_png(paths[i], overlay(input, check.views[i].view, sides));
    });
    return !interrupted;
}

const char* mask_text(ViewCheck::Mask mask) {
    return mask == ViewCheck::Mask::usable ? "usable" : mask == ViewCheck::Mask::empty ? "empty" : "opaque";
}

void write_json(const std::filesystem::path& path, const ReconstructionInput& input, const CaptureCheck& check) {
    const Capture& capture = input.capture;
    const std::optional<double> mean_iou = check.mean_iou();
    const auto image = [&](CaptureView view) {
        return Json{{"camera", capture.cameras[view.camera].name}, {"frame", view.frame}};
    };
    Json json{{"capture", capture.name},
              {"protocol",
               "intersection over union of the mask (alpha at least 1/2) with the pixels whose centres the posed "
               "body covers (with several people: any of their bodies), poses as given; images of more than 1080 "
               "pixels reduced"},
              {"mean_iou", mean_iou ? Json(*mean_iou) : Json(nullptr)},
              {"findings", Json::array()},
              {"advice", Json::array()},
              {"warnings", input.warnings},
              {"images", Json::array()}};
    for (const auto& [doubt, text] : advice(capture, check))
        json["advice"].push_back({{"doubt", doubt}, {"text", text}, {"help", help_link(doubt)}});
    for (const auto& [frame, iou] : frame_overlaps(check)) json["frames"].push_back({{"frame", frame}, {"iou", iou}});
    for (const CaptureFinding& finding : check.findings) {
        Json one{{"fault", finding.fault},   {"measure", finding.measure}, {"given", finding.given},
                 {"mended", finding.mended}, {"text", finding.text},       {"help", help_link(finding.fault)}};
        for (const std::size_t c : finding.cameras) one["cameras"].push_back(capture.cameras[c].name);
        for (const std::string& name : finding.people) one["people"].push_back(name);
        for (const CaptureView& view : finding.views) one["images"].push_back(image(view));
        json["findings"].push_back(one);
    }
    for (const ViewCheck& v : check.views) {
        Json one = image(v.view);
        one["iou"] = v.mask == ViewCheck::Mask::usable ? Json(v.iou) : Json(nullptr);
        one["mask"] = mask_text(v.mask);
        one["inside"] = v.inside;
        one["missing"] = v.missing ? Json(*v.missing) : Json(nullptr);
        one["exposure"] = v.stops ? Json{v.stops->x, v.stops->y, v.stops->z} : Json(nullptr);
        one["background_removed"] = v.background_removed;
        for (std::size_t p = 0; input.people.size() > 1 && p < v.people.size(); ++p) {
            const auto& [inside, covered] = v.people[p];
            one["people"].push_back({{"name", input.people[p].name},
                                     {"inside", inside},
                                     {"covered", covered ? Json(*covered) : Json(nullptr)}});
        }
        one["overlay"] = overlay_name(capture, v.view);
        json["images"].push_back(one);
    }
    programs::write_json(path, json);
}

/// Prints the means of each of several people over the images that show them.
void print_people(const ReconstructionInput& input, const CaptureCheck& check) {
    std::printf("\n%-20s %8s %8s\n", "person", "covered", "inside");
    for (std::size_t p = 0; p < input.people.size(); ++p) {
        double inside = 0, covered = 0, count = 0;
        for (const ViewCheck& v : check.views) {
            if (!v.people[p].covered) continue;
            inside += v.people[p].inside, covered += *v.people[p].covered, count += 1;
        }
        std::printf("%-20s", input.people[p].name.c_str());
        if (count > 0)
            std::printf(" %7.0f%% %7.0f%%\n", 100 * covered / count, 100 * inside / count);
        else
            std::printf(" %8s\n", "none");
    }
}

/// Prints one screen: means per camera, the worst images, the people, the findings.
void print(const ReconstructionInput& input, const CaptureCheck& check, const std::filesystem::path& out) {
    const Capture& capture = input.capture;
    constexpr std::size_t most_cameras = 8, most_images = 8;
    std::printf("%zu images of %zu cameras, ", check.views.size(), capture.cameras.size());
    if (const auto mean_iou = check.mean_iou())
        std::printf("mean IoU of mask and posed body %.3f\n", *mean_iou);
    else
        std::printf("none with a mask to compare the posed body with\n");
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
    if (input.people.size() > 1 && !check.views.empty()) print_people(input, check);
    std::printf("\n");
    std::vector<std::string> doubts;
    const auto print_line = [&](const std::string& doubt, const std::string& text) {
        std::printf("%s\n", one_line(text).c_str());
        doubts.push_back(doubt);
    };
    for (const CaptureFinding& finding : check.findings) print_line(finding.fault, finding.text);
    for (const auto& [doubt, text] : advice(capture, check)) print_line(doubt, text);
    std::printf("%s\n", doubts.empty() ? "nothing suspicious" : ("read " + help_text(doubts)).c_str());
    std::printf("pictures in %s\n", (out / "overlays").string().c_str());
}

int check(const CheckOptions& options) {
    watch_interrupts();
    cpu::Threads backend(options.threads);
    OutputFolder out(options.out);
    const ReconstructionInput input = load(backend, options);
    for (const std::string& warning : input.warnings) warn(warning);
    CaptureCheckParams params;
    params.frames = options.frames;
    std::vector<CheckedPerson> people;
    for (std::size_t p = 0; p < input.people.size(); ++p)
        people.push_back({input.people[p].name, &input.body(p), &input.people[p].motion});
    std::optional<Progress> shown(std::in_place, "comparing bodies and images");
    const CaptureCheck result = check_capture(backend, input.capture, people, params);
    shown.emplace("drawing overlays");
    if (interrupted || !write_overlays(backend, out, input, result)) return exit_interrupted;
    write_json(out.file("check.json"), input, result); // last: if it exists, all files are complete
    out.commit();
    shown.reset();
    print(input, result, options.out);
    return result.findings.empty() ? int(exit_done) : exit_findings;
}

} // namespace

int main(int argc, char** argv) try {
    CheckOptions options;
    CLI::App app("Checks whether the images, cameras, poses and body of a capture match.", "gsh-check");
    app.add_option("capture", options.capture, "folder, in any layout that gsh reads")->required();
    add_people(app, options);
    app.add_option("--person", options.person, "check only this one of several people, counted from 0 (default: all)")
        ->check(not_negative());
    app.add_option("--out", options.out, "folder for pictures and check.json (default ./check)");
    app.add_option("--frames", options.frames, "number of frames to check, evenly spaced (default 30; 0: all)")
        ->check(not_negative());
    add_image_memory(app, options);
    add_threads(app, options.threads);
    std::string ignored;
    const CLI::Option* backend = app.add_option("--backend", ignored)->group(""); // not listed by --help
    return run_program(app, argc, argv, [&] {
        check_value(backend->count() == 0, "--backend", "gsh-check computes on the CPU alone; leave the option out");
        if (InputFile(options.capture).is_folder()) check_body(options);
        complete_poses(options);
        return check(options);
    });
} catch (const std::bad_alloc&) {
    return refuse_without_memory("gsh-check");
}
