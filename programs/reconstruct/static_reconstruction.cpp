// SPDX-License-Identifier: Apache-2.0
#include "reconstruct/static_reconstruction.hpp"

#include "common/figures.hpp"
#include "common/gpu.hpp"
#include "common/input_files.hpp"
#include "common/interrupts.hpp"
#include "common/machine.hpp"
#include "common/pictures.hpp"
#include "common/progress.hpp"
#include "common/rasterizer.hpp"
#include "reconstruct/static_reconstruction_on.hpp"

#include <gsh/core/error.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/cpu.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/capture/capture_photos.hpp>
#include <gsh/io/capture/colmap.hpp>
#include <gsh/io/capture/colmap_image.hpp>
#include <gsh/io/splat/ply.hpp>
#include <gsh/reconstruct/train.hpp>
#include <gsh/setup/static_configuration.hpp>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <system_error>
#include <utility>

namespace gsh::programs {

namespace {

void add_photo(StaticSource& source, const std::string& name, const Camera<double>& camera, PixelImage image, bool test,
               std::size_t frame = 0) {
    source.images.push_back(std::move(image)); // the addresses of the pixels do not change when the list grows
    (test ? source.test : source.training).push_back({name, camera, frame, source.images.back().data});
}

/// Leaves out photographs whose mask is empty: they show nothing of the scene.
void leave_out(StaticSource& source, const std::string& folder, const std::vector<std::string>& empty) {
    check_value(!source.training.empty(), folder, "no photograph for training has a mask that shows something");
    if (!empty.empty())
        source.warnings.push_back(folder + ": " + std::to_string(empty.size()) +
                                  " photographs have an empty mask and are left out: " +
                                  gsh::detail::listing(empty.size(), 6, [&](std::size_t i) { return empty[i]; }));
}

/// Loads the cameras and images of one frame of a capture. It needs neither a body nor poses.
StaticSource load_capture_frame(const std::filesystem::path& folder, std::size_t frame) {
    StaticSource source;
    source.name = std::filesystem::weakly_canonical(folder).filename().string() + ", frame " + std::to_string(frame);
    Capture capture; // its frames are this one
    capture.cameras = cameras_of_file(folder / "cameras.json").cameras;
    capture.motion.transl.resize(1);
    const gsh::detail::PhotoFiles all =
        gsh::detail::list_photos(folder, capture.cameras, std::filesystem::is_directory(folder / "masks"), 0,
                                 "as many as the other cameras have");
    const std::size_t frames = all.images.size() / std::max<std::size_t>(1, capture.cameras.size());
    check_value(frame < frames, (folder / "images").string(),
                "has images of " + std::to_string(frames) + " frames, expected frame " + std::to_string(frame) +
                    " among them");
    gsh::detail::PhotoFiles files; // of this frame
    for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
        files.images.push_back(all.images[c * frames + frame]);
        if (!all.masks.empty()) files.masks.push_back(all.masks[c * frames + frame]);
    }
    cpu::Threads backend;
    gsh::detail::load_photos(backend, files, 1, {}, folder, capture, &source.warnings);
    for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
        const NamedCamera& camera = capture.cameras[c];
        if (capture.is_taken({c, 0}))
            add_photo(source, camera.name, camera.camera, std::move(capture.images[c]),
                      camera.role == NamedCamera::Role::test, frame);
    }
    return source;
}

/// Loads a reconstruction of COLMAP: FOLDER/sparse/0 (or FOLDER itself), FOLDER/images, and FOLDER/masks if it exists.
/// Every `hold`-th image by name, beginning with the first one, is a test image; 0: none.
StaticSource load_colmap_source(const std::filesystem::path& folder, std::size_t hold = 8) {
    ColmapScene scene = read_colmap(folder);
    StaticSource source;
    source.name = std::filesystem::weakly_canonical(folder).filename().string();
    const std::filesystem::path masks = std::filesystem::is_directory(folder / "masks") ? folder / "masks" : "";
    std::vector<std::string> empty;
    for (std::size_t i = 0; i < scene.images.size(); ++i) {
        StraightImage straight = read_colmap_image(scene.images[i], folder / "images", masks);
        std::string name = std::filesystem::path(scene.images[i].name).replace_extension().string();
        std::replace(name.begin(), name.end(), '/', '_');
        if (gsh::detail::shows_person(straight.image))
            add_photo(source, name, straight.camera, std::move(straight.image), hold != 0 && i % hold == 0);
        else
            empty.push_back(scene.images[i].name);
    }
    leave_out(source, folder.string(), empty);
    if (!scene.points.empty()) source.points = ColoredPoints{std::move(scene.points), std::move(scene.colors)};
    return source;
}

GaussianCloud<float> start_of(const StaticSource& source, const StaticOptions& options) {
    return initial_gaussians<float>(source.points ? *source.points
                                                  : visual_hull_points(source.training, hull_box(source.training),
                                                                       options.points, mix_bits(options.seed)));
}

} // namespace

StaticOptions static_options(const ReconstructOptions& o) {
    constexpr std::size_t points = 20'000;
    return {.config = scene_configuration_of(o), .points = std::min(points, o.gaussians), .seed = o.seed};
}

StaticSource static_source(const Capture& capture, std::size_t frame) {
    check_value(frame < capture.frame_count(), capture.name,
                "has " + std::to_string(capture.frame_count()) + " frames, expected frame " + std::to_string(frame) +
                    " among them");
    StaticSource source;
    source.name = capture.name + ", frame " + std::to_string(frame);
    for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
        const NamedCamera& camera = capture.cameras[c];
        if (capture.is_taken({c, frame}))
            add_photo(source, camera.name, camera.camera, capture.image({c, frame}),
                      camera.role == NamedCamera::Role::test, frame);
    }
    return source;
}

StaticSource load_static_source(const std::filesystem::path& folder, std::size_t frame) {
    std::error_code ignored;
    return std::filesystem::exists(folder / "cameras.json", ignored) ? load_capture_frame(folder, frame)
                                                                     : load_colmap_source(folder);
}

StaticSetup static_setup(const StaticSource& source, const StaticOptions& options) {
    const StaticConfig& config = options.config;
    return {.start = start_of(source, options),
            .extent = config.extent != 0 ? config.extent : scene_extent(source.training),
            .photos = source.training,
            .seed = options.seed,
            .config = config};
}

std::unique_ptr<StaticReconstruction> make_static_reconstruction(Machine& machine, const StaticSource& source,
                                                                 const StaticOptions& options) {
    const Progress shown("preparing the scene");
    StaticSetup setup = static_setup(source, options);
    if (machine.has_gpu()) return static_reconstruction_on(*machine.gpu(), std::move(setup));
    return std::make_unique<StaticReconstructionOn<cpu::Threads>>(machine.host(), std::move(setup));
}

void StaticReconstruction::train(std::uint64_t until, const std::string& title) {
    using Clock = std::chrono::steady_clock;
    Progress progress(title);
    const double seconds_before = seconds;
    const std::uint64_t steps_before = step_count();
    const auto begin = Clock::now();
    const auto goes_on = [&] { return step_count() < std::min(until, steps_) && !interrupted; };
    while (goes_on()) {
        step();
        if (step_count() % most_queued_steps == 0 || !goes_on()) settle(); // may go back to a step that failed
        const double spent = std::chrono::duration<double>(Clock::now() - begin).count();
        seconds = seconds_before + spent;
        char text[96];
        std::snprintf(text, sizeof text, "step %llu  %zu Gaussians  %.1f steps/s",
                      static_cast<unsigned long long>(step_count()), size(),
                      static_cast<double>(step_count() - steps_before) / spent);
        progress.show(static_cast<double>(step_count()) / static_cast<double>(steps_), text);
    }
}

StaticResult reconstruct_static(Machine& machine, const StaticSource& source, const StaticOptions& options) {
    const auto reconstruction = make_static_reconstruction(machine, source, options);
    reconstruction->train(static_cast<std::uint64_t>(options.config.steps));
    StaticResult result;
    result.seconds = reconstruction->seconds;
    result.steps = reconstruction->step_count();
    result.change = reconstruction->total_change();
    Progress shown("judging test images");
    for (const Photo& photo : source.test) {
        shown.show(static_cast<double>(result.scores.size()) / static_cast<double>(source.test.size()), photo.name);
        const auto comparison = reconstruction->compare(photo);
        result.scores.push_back(comparison.score);
        result.pictures.push_back(comparison_picture(comparison.render, comparison.truth));
    }
    result.mean = mean_score(result.scores);
    result.scene = reconstruction->cloud();
    return result;
}

void write_static_result(OutputFolder& out, const Machine& machine, const StaticSource& source,
                         const StaticOptions& options, const StaticResult& result) {
    write_gaussian_ply(out.file("scene.ply"), result.scene, {.filter = options.config.filter});
    for (std::size_t i = 0; i < result.scores.size(); ++i)
        write_png(out.file("test/" + result.scores[i].name + ".png"), result.pictures[i]);
    Json json;
    json["psnr"] = number_or_null(result.mean.psnr);
    json["ssim"] = number_or_null(result.mean.ssim);
    json["psnr_person"] = number_or_null(result.mean.psnr_person);
    json["steps"] = result.steps;
    json["seconds"] = result.seconds;
    json["gaussians"] = result.scene.size();
    json["cloned"] = result.change.cloned;
    json["split"] = result.change.split;
    json["pruned"] = result.change.pruned;
    add_memory(json, machine);
    json["seed"] = options.seed;
    add_machine(json, machine.computed_on());
    json["configuration"] = "static";
    for (const auto& [key, value] : settings_of(options.config)) json["settings"][key] = value;
    json["ms_per_stage"]["all"] = 1e3 * result.seconds / static_cast<double>(std::max<std::uint64_t>(1, result.steps));
    json["protocol"] =
        "Test views of " + source.name + " (" + std::to_string(result.scores.size()) + " images, " +
        std::to_string(source.training.size()) +
        " in training), white background in training and test, full "
        "image, range 1, unquantised; SSIM 11x11 Gaussian, sigma 1.5, borders cropped; the person is where the "
        "true alpha exceeds 1/2.";
    json["images"] = Json::array();
    for (const ImageScore& score : result.scores) json["images"].push_back(score_json(score));
    write_json(out.file("metrics.json"), json);
    out.commit();
}

} // namespace gsh::programs
