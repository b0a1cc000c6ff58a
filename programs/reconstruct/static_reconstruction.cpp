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

#include <gsh/cpu.hpp>
#include <gsh/io/splat/ply.hpp>
#include <gsh/reconstruct/train.hpp>

#include <algorithm>
#include <cstdio>
#include <utility>

namespace gsh::programs {

std::unique_ptr<AnyStaticReconstruction> make_static_reconstruction(Machine& machine, const StaticPhotos& input,
                                                                    const StaticRecipe& recipe) {
    const Progress shown("preparing the scene");
    StaticSetup setup = static_setup(input, recipe);
    if (machine.has_gpu()) return static_reconstruction_on(*machine.gpu(), std::move(setup));
    return std::make_unique<StaticReconstruction<cpu::Threads>>(machine.host(), std::move(setup));
}

void train_shown(AnyStaticReconstruction& reconstruction, const StaticRecipe& recipe, TrainingRecord& record,
                 const std::string& title, std::uint64_t until) {
    const double seconds_before = record.seconds;
    const std::uint64_t steps_before = reconstruction.step_count();
    Progress progress(title);
    TrainingEvents events;
    events.progress = [&](double share) {
        char text[96];
        std::snprintf(text, sizeof text, "step %llu  %zu Gaussians  %.1f steps/s",
                      static_cast<unsigned long long>(record.steps), reconstruction.size(),
                      static_cast<double>(record.steps - steps_before) / (record.seconds - seconds_before));
        progress.show(share, text);
    };
    events.stop = [] { return interrupted.load(); };
    train(reconstruction, recipe.length(), record, events, until);
}

StaticResult reconstruct_static(Machine& machine, const StaticPhotos& input, const StaticRecipe& recipe) {
    const auto reconstruction = make_static_reconstruction(machine, input, recipe);
    StaticResult result;
    train_shown(*reconstruction, recipe, result.record);
    result.change = reconstruction->total_change();
    Progress shown("judging test images");
    for (const Photo& photo : input.test) {
        shown.show(static_cast<double>(result.scores.size()) / static_cast<double>(input.test.size()), photo.name);
        const auto comparison = reconstruction->compare(photo);
        result.scores.push_back(comparison.score);
        result.pictures.push_back(comparison_picture(comparison.render, comparison.truth));
    }
    result.mean = mean_score(result.scores);
    result.scene = reconstruction->cloud();
    return result;
}

void write_static_result(OutputFolder& out, const Machine& machine, const StaticPhotos& input,
                         const StaticRecipe& recipe, const StaticResult& result) {
    write_gaussian_ply(out.file("scene.ply"), result.scene, {.filter = recipe.config.filter});
    for (std::size_t i = 0; i < result.scores.size(); ++i)
        write_png(out.file("test/" + result.scores[i].name + ".png"), result.pictures[i]);
    Json json;
    json["psnr"] = number_or_null(result.mean.psnr);
    json["ssim"] = number_or_null(result.mean.ssim);
    json["psnr_person"] = number_or_null(result.mean.psnr_person);
    json["steps"] = result.record.steps;
    json["seconds"] = result.record.seconds;
    json["gaussians"] = result.scene.size();
    json["cloned"] = result.change.cloned;
    json["split"] = result.change.split;
    json["pruned"] = result.change.pruned;
    add_memory(json, machine);
    json["seed"] = recipe.seed;
    add_machine(json, machine.computed_on());
    json["configuration"] = "static";
    for (const auto& [key, value] : settings_of(recipe.config)) json["settings"][key] = value;
    json["ms_per_stage"]["all"] =
        1e3 * result.record.seconds / static_cast<double>(std::max<std::uint64_t>(1, result.record.steps));
    json["protocol"] =
        "Test views of " + input.name + " (" + std::to_string(result.scores.size()) + " images, " +
        std::to_string(input.training.size()) +
        " in training), white background in training and test, full "
        "image, range 1, unquantised; SSIM 11x11 Gaussian, sigma 1.5, borders cropped; the person is where the "
        "true alpha exceeds 1/2.";
    json["images"] = Json::array();
    for (const ImageScore& score : result.scores) json["images"].push_back(score_json(score));
    write_json(out.file("metrics.json"), json);
    out.commit();
}

} // namespace gsh::programs
