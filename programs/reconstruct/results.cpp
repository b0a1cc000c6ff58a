// SPDX-License-Identifier: Apache-2.0
#include "reconstruct/results.hpp"

#include "common/figures.hpp"
#include "common/help.hpp"
#include "common/interrupts.hpp"
#include "common/machine.hpp"
#include "common/messages.hpp"
#include "common/pictures.hpp"
#include "common/progress.hpp"
#include "common/report.hpp"
#include "common/shown_progress.hpp"
#include "reconstruct/load_input.hpp"
#include "reconstruct/verdict.hpp"
#include "show/renderer.hpp"
#include "show/shown_people.hpp"
#include "show/turn.hpp"

#include <gsh/body/joint_error.hpp>
#include <gsh/core/ordered_indices.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/model/avatar_file.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/io/splat/ply.hpp>
#include <gsh/loss/cpu/lpips.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <sstream>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh::programs {

namespace {

/// The name of a result file: "avatar" for one person, "avatar-NAME" for one of several.
std::string result_name(const ReconstructionSetup& setup, const std::string& what, std::size_t person) {
    return setup.people.size() == 1 ? what : what + "-" + setup.people[person].name;
}

/// The protocol's sentences on seen and new motion.
std::string hold_out_protocol(const Capture& capture, const MotionSplit& split) {
    const auto images = [](const std::vector<std::size_t>& photos) { return std::to_string(photos.size()); };
    return " Frames " + frames_text(capture.held_out_frames) + " of " + std::to_string(capture.frame_count()) +
           " are left out of training in every camera: new motion is judged on their " + images(split.unseen) +
           " test images, seen motion on " +
           (split.seen.empty() ? "none: no other test image is of a frame in training, or between such frames."
            : split.between    ? images(split.seen) + " test images between frames in training."
                               : images(split.seen) + " test images of frames in training.");
}

} // namespace

std::filesystem::path checkpoint_path(const ReconstructOptions& o) {
    return o.out / "checkpoint.gsh";
}

void check_resumable(const ReconstructOptions& o) {
    if (!has_checkpoint(checkpoint_path(o)))
        throw IoError(checkpoint_path(o).string() + ": there is nothing to resume; leave out --resume to begin");
}

std::string measures_of(const Judge<cpu::Threads>& judge) {
    return "full image, range 1, unquantised; SSIM 11x11 Gaussian, sigma 1.5, borders cropped; the person "
           "is where the true alpha exceeds 1/2; regions are where the body shows them in the poses as given or "
           "registered, images with 50 pixels or more." +
           judge.lpips_protocol();
}

std::string protocol_of(const ReconstructOptions& o, const ReconstructionInput& input, const ReconstructionSetup& setup,
                        const Judge<cpu::Threads>& judge) {
    const Configuration& configuration = setup.configuration;
    const std::string background = !input.capture.backgrounds.empty() ? "the capture's backgrounds in training and test"
                                   : configuration.train.random_background
                                       ? "a random background each step in training, white in test"
                                       : "white background in training and test";
    return "Test views of " + input.capture.name + " (" + std::to_string(setup.test_photos.size()) +
           " images), poses of " + poses_text(o) +
           (input.registration ? ", registered to the training images before training" : "") +
           (!o.refine                      ? ", as given, not refined"
            : configuration.test_fit.steps ? ", refined in training and fitted to the test images at test time"
                                           : ", refined in training, not fitted to the test images") +
           (o.priors.empty() ? "" : ", geometric priors of " + o.priors.filename().string()) + ", " + background +
           ", " + measures_of(judge) +
           (input.people.size() > 1
                ? " People are judged apart where person_masks show them, else where their body is in front "
                  "(clothes and hair go to the nearest)."
                : "") +
           (setup.motion_split ? hold_out_protocol(input.capture, *setup.motion_split) : "");
}

namespace {

/// Writes each person's avatar, for gsh and for viewers of splats, and returns them.
std::vector<AvatarData> write_avatars(OutputFolder& out, AnyReconstruction& reconstruction) {
    std::vector<AvatarData> avatars = reconstruction.avatars();
    for (std::size_t p = 0; p < avatars.size(); ++p) {
        const std::string name = result_name(reconstruction.setup, "avatar", p);
        save_avatar(out.file(name + ".gsh"), avatars[p]);
        write_gaussian_ply(out.file(name + ".ply"), shaded_cloud(avatars[p]),
                           {.up = UpAxis::minus_y, .filter = avatars[p].filter});
    }
    return avatars;
}

/// A picture as it is on a page.
Picture shown_picture(const std::string& caption, const Image<float>& picture) {
    const std::string png = encode_png(quantise(picture.view()));
    return {caption, {png.begin(), png.end()}};
}

/// The avatars from all around, in the pose of the first photograph.
Picture turn_of(Machine& machine, const AnyReconstruction& reconstruction, std::vector<AvatarData> avatars) {
    const ReconstructionSetup& setup = reconstruction.setup;
    std::vector<Motion> motions;
    for (std::size_t p = 0; p < setup.people.size(); ++p)
        motions.push_back(setup.refinement ? reconstruction.refined_motion(p) : setup.people[p].motion);
    const ShownPeople people(std::move(avatars), std::move(motions));
    const std::size_t frame = setup.photos.front().frame;
    const auto renderer = make_renderer(machine, people);
    return shown_picture("The avatar from all around",
                         turn_picture(*renderer, frame, cameras_around(people, frame, 8, 200, 320)));
}

/// The test image that is as good as the mean: the one to look at first.
std::size_t typical_image(const std::vector<ImageScore>& scores, double psnr_person) {
    std::size_t best = 0;
    const auto away = [&](std::size_t i) { return std::abs(scores[i].psnr_person - psnr_person); };
    for (std::size_t i = 1; i < scores.size(); ++i)
        if (!(away(i) >= away(best))) best = i; // also in place of NaN
    return best;
}

/// Adds the gains that photographs have learned to the figures, the page and the findings.
void add_gains(const AnyReconstruction& reconstruction, Json& json, Report& report,
               std::vector<std::string>& findings) {
    if (reconstruction.setup.configuration.train.gain.rate == 0) return;
    const std::vector<std::array<double, 3>> gains = reconstruction.photo_gains();
    Curve exposure{
        "Exposure of training photographs, camera after camera", "stops, 0 in the mean of a camera", {}, "photographs"};
    const std::vector<Photo>& photos = reconstruction.setup.photos;
    const std::vector<std::uint32_t> order = ordered_indices(gains.size(), [&](std::uint32_t a, std::uint32_t b) {
        return photos[a].camera_index < photos[b].camera_index;
    });
    double darkest = 0, brightest = 0, balance = 0;
    for (const std::size_t p : order) {
        const auto [red, green, blue] = gains[p];
        const double stops = std::log2(green);
        exposure.points.emplace_back(static_cast<double>(exposure.points.size()), stops);
        darkest = std::min(darkest, stops), brightest = std::max(brightest, stops);
        balance = std::max({balance, std::abs(red / green - 1), std::abs(blue / green - 1)});
        json["photographs"].push_back({{"name", photos[p].name}, {"gain", {red, green, blue}}});
    }
    const std::string range = "exposure from " + fixed(darkest, 2) + " to " + fixed(brightest, 2) +
                              " stops, white balance within " + fixed(100 * balance, 1) + "%";
    report.facts.push_back({"Photographs", range,
                            "What training found out about exposure and colour; a camera with "
                            "locked exposure has nearly none."});
    report.curves.push_back(std::move(exposure));
    findings.push_back("photographs: " + range);
}

/// Adds how far each person's joints moved while the avatar learned.
void add_moved_poses(const AnyReconstruction& reconstruction, Json& json, Report& report,
                     std::vector<std::string>& findings) {
    const std::vector<ReconstructionSetup::Person>& people = reconstruction.setup.people;
    for (std::size_t p = 0; p < people.size(); ++p) {
        const JointErrors moved =
            joint_errors(people[p].rig.body, reconstruction.refined_motion(p), people[p].motion, RootAlignment::none);
        const std::string of = people.size() > 1 ? " of " + people[p].name : "";
        const std::string text =
            "joints" + of + " moved by " + fixed(moved.mean_mm, 1) + " mm, at most " + fixed(moved.worst_mm, 1) + " mm";
        json["refinement"].push_back({{"name", people[p].name},
                                      {"joints_mm", moved.mean_mm},
                                      {"worst_mm", moved.worst_mm},
                                      {"frame_mm", moved.per_frame_mm}});
        Curve curve{"How far training moved the joints" + of + ", mean of a frame", "mm", {}, "frame"};
        for (std::size_t t = 0; t < moved.per_frame_mm.size(); ++t)
            curve.points.emplace_back(static_cast<double>(t), moved.per_frame_mm[t]);
        report.facts.push_back({"Refinement", text, "How wrong the poses were when training began."});
        report.curves.push_back(std::move(curve));
        findings.push_back("training: " + text);
    }
}

/// Adds how many Gaussians no photograph has seen.
void add_unseen(const ReconstructionSetup& setup, const std::vector<std::size_t>& counts, Json& json, Report& report,
                std::vector<std::string>& findings) {
    if (!setup.configuration.fill_unseen) return;
    const std::size_t unseen = std::accumulate(counts.begin(), counts.end(), std::size_t(0));
    json["unseen_gaussians"] = unseen;
    report.facts.push_back({"Seen by no photograph", std::to_string(unseen) + " Gaussians",
                            "They have the colours of their surroundings or of the body's other side."});
    if (unseen > 0)
        findings.push_back(std::to_string(unseen) + " of " + std::to_string(setup.gaussian_count()) +
                           " Gaussians were seen by no photograph; they have the colours of their surroundings or of "
                           "the body's other side");
}

/// Adds what the registration did to the figures, the page and the findings.
void add_registration(const RegistrationSummary& registration, Json& json, Report& report,
                      std::vector<std::string>& findings) {
    Json& into = json["registration"];
    into["psnr"] = number_or_null(registration.psnr);
    into["focal"] = registration.focal ? Json(*registration.focal) : Json();
    for (const auto& person : registration.people)
        into["people"].push_back({{"name", person.name},
                                  {"joints_mm", person.joints_mm},
                                  {"root_aligned_mm", person.root_aligned_mm},
                                  {"betas", person.betas}});
    Curve curve{"How well the registered bodies explain the photographs of each frame", "dB", {}, "frame"};
    for (std::size_t t = 0; t < registration.frame_fit.size(); ++t) {
        into["frame_fit"].push_back(number_or_null(registration.frame_fit[t]));
        if (std::isfinite(registration.frame_fit[t]))
            curve.points.emplace_back(static_cast<double>(t), registration.frame_fit[t]);
    }
    into["frame_weights"] = registration.frame_weights;
    into["doubtful_frames"] = registration.doubtful_frames;
    report.facts.push_back({"Registration", registration.text(), "How wrong the given poses were."});
    report.curves.push_back(std::move(curve));
    Curve weights{"How much each frame was believed in training", "weight", {}, "frame"};
    for (std::size_t t = 0; t < registration.frame_weights.size(); ++t)
        weights.points.emplace_back(static_cast<double>(t), registration.frame_weights[t]);
    report.curves.push_back(std::move(weights));
    findings.push_back("registration: " + registration.text());
    const auto lighter = std::count_if(registration.frame_weights.begin(), registration.frame_weights.end(),
                                       [](double weight) { return weight < 1; });
    findings.push_back(lighter == 0 ? "all frames were believed"
                                    : std::to_string(lighter) + " frames weighed less than the others" +
                                          (registration.doubtful_frames.empty()
                                               ? ""
                                               : ", below a quarter: " + frames_text(registration.doubtful_frames)));
}

} // namespace

std::optional<TestFigures> write_results(OutputFolder& out, const ReconstructOptions& o, Machine& machine,
                                         const ReconstructionInput& input, AnyReconstruction& reconstruction,
                                         const TrainingRecord& record) {
    if (interrupted) return std::nullopt; // training has written its checkpoint
    const ReconstructionSetup& setup = reconstruction.setup;
    Judge<cpu::Threads> judge = judge_for(machine.host(), input, o);
    reconstruction.release_memory();
    std::optional<Progress> work(std::in_place, "writing the avatar");
    const std::vector<std::size_t> unseen = reconstruction.fill_unseen();
    Report report;
    // before poses are fitted to test images
    report.turn = turn_of(machine, reconstruction, write_avatars(out, reconstruction));
    work.reset();
    if (interrupted) return std::nullopt;
    const std::size_t people = setup.people.size();
    if (o.refine && !reconstruction.refine_test_poses(shown_progress())) return std::nullopt;
    out.own("test");
    std::vector<ImageScore> scores;
    constexpr std::size_t shown = 6; // number of pictures on the page; test/ has all of them
    const std::size_t every = std::max<std::size_t>(1, setup.test_photos.size() / shown);
    const auto& split = setup.motion_split;
    report.images.push_back({"image", "PSNR", "SSIM", "PSNR on the person"});
    for (const std::string& name : region_names()) report.images.back().push_back(name);
    if (people > 1)
        for (const auto& person : setup.people) report.images.back().push_back(person.name);
    if (split) report.images.back().push_back("motion");
    work.emplace("judging test images");
    for (const Photo& photo : setup.test_photos) {
        if (interrupted) return std::nullopt;
        work->show(static_cast<double>(scores.size()) / static_cast<double>(setup.test_photos.size()), photo.name);
        const HeldPhoto held(photo); // read once
        const auto comparison = judge.judge(reconstruction.compare(*held), *held);
        const ImageScore& score = comparison.score;
        const std::string png = encode_png(quantise(comparison_picture(comparison.render, comparison.truth).view()));
        write_file(out.file("test/" + photo.name + ".png"), png, Sync::none);
        if (scores.size() % every == 0 && report.pictures.size() < shown)
            report.pictures.push_back(
                {photo.name + ": PSNR " + fixed(score.psnr, 2) + " dB; error times 5", {png.begin(), png.end()}});
        report.images.push_back({score.name, fixed(score.psnr, 2), fixed(score.ssim, 4), fixed(score.psnr_person, 2)});
        for (const RegionScore& region : score.regions) report.images.back().push_back(fixed(region.psnr, 2));
        for (const PersonScore& person : score.people) report.images.back().push_back(fixed(person.whole.psnr, 2));
        if (split) report.images.back().push_back(motion_word(*split, scores.size()));
        scores.push_back(score);
    }
    work.emplace("writing the report");
    TestFigures figures{.mean = mean_score(scores), .motion = {}, .findings = {}};
    const ImageScore& mean = figures.mean;
    const std::vector<RegionMean> regions = mean_regions(scores);
    const auto region = [&](std::size_t r) { return r < regions.size() ? regions[r].psnr : NAN; };
    if (!scores.empty()) {
        const std::size_t shown_first = typical_image(scores, mean.psnr_person);
        const auto comparison = reconstruction.compare(setup.test_photos[shown_first]);
        const PixelBox box = box_of_person(comparison.mask);
        const Image<float> render = cropped(comparison.render, box), photograph = cropped(comparison.truth, box);
        report.render = shown_picture("avatar", render);
        report.photograph = shown_picture("photograph " + scores[shown_first].name, photograph);
        constexpr int preview_height = 160; // pixels at least, of larger photographs
        write_png(out.file("preview.png"),
                  quantise(small_pair(render, photograph, std::max(1, box.height / preview_height)).view()));
    }
    if (split) figures.motion = seen_and_new(scores, *split);

    for (std::size_t p = 0; o.refine && p < people; ++p)
        save_motion(out.file(result_name(setup, "poses_refined", p) + ".npz"), reconstruction.refined_motion(p));

    const std::string protocol = protocol_of(o, input, setup, judge);
    Json json;
    json["psnr"] = number_or_null(mean.psnr);
    json["ssim"] = number_or_null(mean.ssim);
    json["psnr_person"] = number_or_null(mean.psnr_person);
    for (std::size_t r = 0; r < regions.size(); ++r)
        json["psnr_regions"][region_names()[r]] = number_or_null(regions[r].psnr);
    if (mean.lpips) json["lpips"] = number_or_null(*mean.lpips);
    if (figures.motion) {
        json["seen_motion"] = motion_json(figures.motion->seen);
        json["new_motion"] = motion_json(figures.motion->unseen);
        json["held_out_frames"] = setup.held_out_frames;
        report.motion = motion_rows(*figures.motion);
    }
    json["steps"] = record.steps;
    json["seconds"] = record.seconds;
    json["gaussians"] = setup.gaussian_count();
    std::vector<PersonMean> apart = mean_people(scores);
    apart.resize(people); // without test views the list is empty
    if (people > 1) report.people.push_back({"person", "PSNR", "SSIM", "face", "hands", "body", "Gaussians"});
    for (std::size_t p = 0; people > 1 && p < people; ++p) {
        const ReconstructionSetup::Person& person = setup.people[p];
        Json one{{"name", person.name}};
        one.update(person_json(apart[p].whole, apart[p].regions));
        one["gaussians"] = person.gaussian_count();
        json["people"].push_back(one);
        report.people.push_back({person.name, fixed(apart[p].whole.psnr, 2), fixed(apart[p].whole.ssim, 4)});
        for (std::size_t r = 0; r < region_names().size(); ++r)
            report.people.back().push_back(fixed(r < apart[p].regions.size() ? apart[p].regions[r].psnr : NAN, 2));
        report.people.back().push_back(std::to_string(person.gaussian_count()));
    }
    add_memory(json, machine);
    json["seed"] = o.seed;
    add_machine(json, machine.computed_on());
    json["configuration"] = setup.configuration.name;
    for (const auto& [key, value] : stated_settings_of(setup.configuration)) json["settings"][key] = value;
    json["protocol"] = protocol;
    report.stages.push_back({"stage", "ms per step"});
    const auto stage = [&](std::string_view name, double seconds, std::uint64_t steps) {
        const double ms = 1e3 * seconds / static_cast<double>(std::max<std::uint64_t>(1, steps));
        json["ms_per_stage"][std::string(name)] = ms;
        report.stages.push_back({std::string(name), fixed(ms, 2)});
    };
    double total = 0;
    for (std::size_t s = 0; s < stage_names.size(); ++s) {
        stage(stage_names[s], record.stage_seconds[s], record.timed_steps);
        total += record.stage_seconds[s];
    }
    stage("all", total, record.timed_steps);
    json["images"] = Json::array();
    for (std::size_t i = 0; i < scores.size(); ++i) {
        json["images"].push_back(score_json(scores[i]));
        if (split) json["images"].back()["motion"] = motion_word(*split, i);
    }

    VerdictInput known{.person = mean.psnr_person, .face = region(0), .hands = region(1)};
    known.gaussians = setup.gaussian_count();
    known.unseen = std::accumulate(unseen.begin(), unseen.end(), std::size_t(0));
    known.refined = o.refine, known.steps = record.steps;
    known.usual_steps = setup.configuration.usual_steps();
    if (figures.motion) {
        known.seen_motion = figures.motion->seen.mean.psnr_person;
        known.new_motion = figures.motion->unseen.mean.psnr_person;
    }
    if (input.registration) known.doubtful_frames = input.registration->doubtful_frames;
    const Verdict verdict = verdict_of(known);
    figures.findings.insert(figures.findings.begin(), verdict.headline);
    json["verdict"] = verdict.headline;
    json["advice"] = Json::array();
    report.verdict = verdict.headline;
    for (const auto& [doubt, text] : verdict.advice) {
        json["advice"].push_back({{"doubt", doubt}, {"text", text}, {"help", help_link(doubt)}});
        report.advice.emplace_back(text, help_text({doubt}));
    }
    std::string files;
    for (std::size_t p = 0; p < people; ++p)
        files += " " + shell_word((o.out / (result_name(setup, "avatar", p) + ".gsh")).string());
    report.next = {{"Turn it, pose it and play a motion, in the browser:", "gsh-view" + files + " --open"},
                   {"Render it in a motion of your own (BVH, glTF, VRM, AMASS, and others):",
                    "gsh-animate" + files + (people > 1 ? " --poses MOTION …" : " --poses MOTION") + " --out FRAMES"}};

    report.title = "Avatar of " + input.capture.name;
    report.protocol = protocol;
    report.facts = {
        {"PSNR on the person", fixed(mean.psnr_person, 2) + " dB",
         "Pixels that show the person. 3 dB more is half the squared error."},
        {"PSNR on face, hands, body",
         fixed(region(0), 2) + ", " + fixed(region(1), 2) + ", " + fixed(region(2), 2) + " dB",
         "The parts that one looks at first."},
        {"PSNR of the image", fixed(mean.psnr, 2) + " dB",
         "All pixels. Plain background raises it, however the person looks."},
        {"SSIM", fixed(mean.ssim, 4), "Likeness of structure in the whole image; 1 is the photograph itself."},
        {"Gaussians", std::to_string(setup.gaussian_count()), "More of them hold finer detail, and take longer."},
        {"Training",
         std::to_string(record.steps) + " steps in " + fixed(record.seconds, 1) + " s on " +
             machine.computed_on().text(),
         "Without loading and evaluation."},
        {"Configuration", setup.configuration.name, "The settings are in metrics.json."},
        {"Backend", machine.computed_on().backend, "What computed."},
        {"Peak memory", mebibytes(peak_memory_bytes()), "Of the whole run."}};
    if (const auto on_gpu = machine.peak_gpu_memory())
        report.facts.push_back({"Peak memory of the GPU", mebibytes(*on_gpu), "Of the whole run."});
    const double ssim_weight = setup.configuration.train.ssim_weight;
    report.curves = {{"Loss of the step's training view",
                      fixed(1 - ssim_weight, 2) + " L1 + " + fixed(ssim_weight, 2) + " (1 - SSIM)", record.loss},
                     {"PSNR of the step's training view", "dB", record.psnr}};
    add_gains(reconstruction, json, report, figures.findings);
    if (input.registration) add_registration(*input.registration, json, report, figures.findings);
    if (o.refine) add_moved_poses(reconstruction, json, report, figures.findings);
    add_unseen(setup, unseen, json, report, figures.findings);
    write_report(out.file("report.html"), report);
    write_json(out.file("metrics.json"), json);
    if (interrupted) return std::nullopt;
    out.commit();
    return figures;
}

} // namespace gsh::programs
