// SPDX-License-Identifier: Apache-2.0
/// @file  The configuration `static`: one moment of a capture, or a reconstruction of COLMAP, as a 3DGS scene.
#pragma once

#include "support/output_folder.hpp"
#include "support/pictures.hpp"
#include "support/program.hpp"
#include "support/progress.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/io/camera_file.hpp>
#include <gsh/io/capture.hpp>
#include <gsh/io/colmap.hpp>
#include <gsh/io/image_file.hpp>
#include <gsh/io/ply.hpp>
#include <gsh/train/evaluation.hpp>
#include <gsh/train/static_start.hpp>
#include <gsh/train/static_trainer.hpp>

#include <nlohmann/json.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace gsh::examples {

/// Photographs of one moment, and what the scene may start from.
struct StaticSource {
    std::string name;
    std::vector<PixelImage> images;        ///< what the photographs point into
    std::vector<Photo> training, test;
    std::optional<ColoredPoints> points;   ///< of structure from motion; else the masks' visual hull is filled

    StaticSource() = default;
    StaticSource(StaticSource&&) = default; // pixels stay where they are; in a copy they would not
    StaticSource& operator=(StaticSource&&) = default;
};

struct StaticOptions {
    std::uint64_t steps = 3000;
    std::size_t points = 20'000;           ///< to start from, where the source brings none
    std::size_t max_gaussians = 500'000;
    int sh_degree = 3;
    std::uint64_t seed = 0;
};

/// What was made, and how good it is.
struct StaticResult {
    GaussianCloud<float> scene;
    std::vector<ImageScore> scores;        ///< of the test photographs
    ImageScore mean;                       ///< NaN without test photographs
    std::vector<Image<float>> pictures;    ///< render, truth and error of each
    std::uint64_t steps = 0;               ///< fewer than asked for if somebody interrupted
    double seconds = 0;                    ///< of training alone
    DensityChange change;
};

namespace detail {

inline void add_photo(StaticSource& source, const std::string& name, const Camera<double>& camera, PixelImage image,
                      bool test, std::size_t frame = 0) {
    source.images.push_back(std::move(image)); // the pixels stay where they are when the list grows
    (test ? source.test : source.training).push_back({name, camera, frame, source.images.back().data});
}

} // namespace detail

/// One frame of a capture in memory; cameras with the role test are left out of training.
inline StaticSource static_source(const Capture& capture, std::size_t frame) {
    check_value(frame < capture.frame_count(), capture.name,
                "has " + std::to_string(capture.frame_count()) + " frames, expected frame " + std::to_string(frame) +
                    " among them");
    StaticSource source;
    source.name = capture.name + ", frame " + std::to_string(frame);
    for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
        const NamedCamera& camera = capture.cameras[c];
        detail::add_photo(source, camera.name, camera.camera, capture.image({c, frame}),
                          camera.role == NamedCamera::Role::test, frame);
    }
    return source;
}

/// One frame of a capture on the disk, by its cameras and images alone: no body and no poses are needed.
inline StaticSource load_capture_frame(const std::filesystem::path& folder, std::size_t frame) {
    StaticSource source;
    source.name = std::filesystem::weakly_canonical(folder).filename().string() + ", frame " + std::to_string(frame);
    for (const NamedCamera& camera : read_cameras(folder / "cameras.json").cameras) {
        const auto read = [&](const char* kind) {
            const auto files = gsh::detail::list_images(folder / kind / camera.name);
            check_value(frame < files.size(), (folder / kind / camera.name).string(),
                        "holds " + std::to_string(files.size()) + " images, expected frame " + std::to_string(frame) +
                            " among them");
            PixelImage image = read_image(files[frame]);
            gsh::detail::check_image_size(files[frame], image, camera);
            return image;
        };
        PixelImage image = read("images");
        if (std::filesystem::is_directory(folder / "masks")) gsh::detail::apply_mask(read("masks"), image);
        if (camera.distortion) image = gsh::detail::straighten(image, camera);
        detail::add_photo(source, camera.name, camera.camera, std::move(image), camera.role == NamedCamera::Role::test, frame);
    }
    return source;
}

/// A reconstruction of COLMAP: FOLDER/sparse/0 (or FOLDER itself), FOLDER/images, and FOLDER/masks if it is there.
/// Every `hold`-th image by name, the first one included, is left out of training and judged by; 0: none.
inline StaticSource load_colmap_source(const std::filesystem::path& folder, std::size_t hold = 8) {
    ColmapScene scene = read_colmap(folder);
    StaticSource source;
    source.name = std::filesystem::weakly_canonical(folder).filename().string();
    const std::filesystem::path masks = std::filesystem::is_directory(folder / "masks") ? folder / "masks" : "";
    for (std::size_t i = 0; i < scene.images.size(); ++i) {
        StraightImage straight = read_colmap_image(scene.images[i], folder / "images", masks);
        std::string name = std::filesystem::path(scene.images[i].name).replace_extension().string();
        std::replace(name.begin(), name.end(), '/', '_');
        detail::add_photo(source, name, straight.camera, std::move(straight.image), hold != 0 && i % hold == 0);
    }
    if (!scene.points.empty()) source.points = ColoredPoints{std::move(scene.points), std::move(scene.colors)};
    return source;
}

/// A folder of either kind: with cameras.json it is a capture, else a reconstruction of COLMAP.
inline StaticSource load_static_source(const std::filesystem::path& folder, std::size_t frame = 0) {
    std::error_code ignored;
    return std::filesystem::exists(folder / "cameras.json", ignored) ? load_capture_frame(folder, frame)
                                                                     : load_colmap_source(folder);
}

/// A scene in training.
class StaticReconstruction {
public:
    StaticTrainer<cpu::Threads> trainer;
    double seconds = 0; ///< of training alone

    /// Errors  ValueError for a source that cannot be trained on; source must outlive this.
    StaticReconstruction(cpu::Threads& backend, const StaticSource& source, const StaticOptions& options)
        : trainer(backend, start(source, options), source.training, options.seed, config(options)), steps_(options.steps) {}

    /// Trains until step `until`, at most all of them, or until somebody interrupts; shows how far it is.
    void train(std::uint64_t until, const std::string& title = "training") {
        using Clock = std::chrono::steady_clock;
        Progress progress(title);
        const double seconds_before = seconds;
        const std::uint64_t steps_before = trainer.step_count();
        const auto begin = Clock::now();
        while (trainer.step_count() < std::min(until, steps_) && !interrupted) {
            trainer.step();
            const double spent = std::chrono::duration<double>(Clock::now() - begin).count();
            seconds = seconds_before + spent;
            char text[96];
            std::snprintf(text, sizeof text, "step %llu  %zu Gaussians  %.1f steps/s",
                          static_cast<unsigned long long>(trainer.step_count()), trainer.size(),
                          static_cast<double>(trainer.step_count() - steps_before) / spent);
            progress.show(static_cast<double>(trainer.step_count()) / static_cast<double>(steps_), text);
        }
    }

private:
    static StaticConfig config(const StaticOptions& options) {
        StaticConfig result = static_config(static_cast<std::int64_t>(options.steps));
        result.sh_degree = options.sh_degree;
        result.density.max_gaussians = options.max_gaussians;
        return result;
    }
    static GaussianCloud<float> start(const StaticSource& source, const StaticOptions& options) {
        return initial_gaussians<float>(source.points ? *source.points
                                                      : visual_hull_points(source.training, hull_box(source.training),
                                                                           options.points, mix_bits(options.seed)));
    }

    std::uint64_t steps_;
};

/// Trains, showing how far it is, and judges on the test photographs.
inline StaticResult reconstruct_static(cpu::Threads& backend, const StaticSource& source,
                                       const StaticOptions& options) {
    StaticReconstruction reconstruction(backend, source, options);
    reconstruction.train(options.steps);
    auto& trainer = reconstruction.trainer;
    StaticResult result;
    result.seconds = reconstruction.seconds;
    result.steps = trainer.step_count();
    result.change = trainer.total_change();
    for (const Photo& photo : source.test) {
        const auto comparison = compare(trainer, photo);
        result.scores.push_back(comparison.score);
        result.pictures.push_back(comparison_picture(comparison.render, comparison.truth));
    }
    result.mean = mean_score(result.scores);
    result.scene = trainer.cloud();
    return result;
}

/// scene.ply, test/NAME.png (render, truth, error) and, last, metrics.json.
inline void write_static_result(OutputFolder& out, const StaticSource& source, const StaticOptions& options,
                                const StaticResult& result) {
    const auto number = [](double value) {
        return std::isfinite(value) ? nlohmann::ordered_json(value) : nlohmann::ordered_json(nullptr);
    };
    write_gaussian_ply(out.file("scene.ply"), result.scene);
    for (std::size_t i = 0; i < result.scores.size(); ++i)
        write_png(out.file("test/" + result.scores[i].name + ".png"), result.pictures[i]);
    nlohmann::ordered_json json;
    json["psnr"] = number(result.mean.psnr);
    json["ssim"] = number(result.mean.ssim);
    json["psnr_person"] = number(result.mean.psnr_person);
    json["steps"] = result.steps;
    json["seconds"] = result.seconds;
    json["gaussians"] = result.scene.size();
    json["cloned"] = result.change.cloned;
    json["split"] = result.change.split;
    json["pruned"] = result.change.pruned;
    json["seed"] = options.seed;
    json["configuration"] = "static";
    json["protocol"] =
        "Test views of " + source.name + " (" + std::to_string(result.scores.size()) + " images, " +
        std::to_string(source.training.size()) +
        " in training), white background in training and test, full "
        "image, range 1, unquantised; SSIM 11x11 Gaussian, sigma 1.5, borders cropped; the person is where the "
        "true alpha exceeds 1/2.";
    json["images"] = nlohmann::ordered_json::array();
    for (const ImageScore& score : result.scores)
        json["images"].push_back({{"name", score.name}, {"psnr", number(score.psnr)}, {"ssim", number(score.ssim)},
                                  {"psnr_person", number(score.psnr_person)}});
    write_file(out.file("metrics.json"), json.dump(2) + "\n");
    out.commit();
}

} // namespace gsh::examples
