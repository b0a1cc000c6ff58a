// SPDX-License-Identifier: Apache-2.0
#include "evaluate/evaluator.hpp"

#include "common/figures.hpp"
#include "common/interrupts.hpp"
#include "common/machine.hpp"
#include "common/messages.hpp"
#include "common/progress.hpp"
#include "common/shown_progress.hpp"
#include "evaluate/evaluation_runs.hpp"
#include "evaluate/evaluation_tables.hpp"
#include "reconstruct/reconstruction.hpp"
#include "reconstruct/results.hpp"
#include "reconstruct/static_reconstruction.hpp"
#include "reconstruct/training.hpp"

#include <gsh/core/error.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/loss/cpu/lpips.hpp>
#include <gsh/setup/configuration.hpp>

#include <malloc.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <system_error>
#include <utility>

namespace gsh::programs {

namespace {

void write_progress(const Run& run, const std::vector<Mark>& marks) {
    Json json{{"settings", run.settings}, {"marks", Json::array()}};
    for (const Mark& mark : marks) json["marks"].push_back(mark_json(mark));
    std::error_code ignored; // write_json reports the error
    std::filesystem::create_directories(run.options.out, ignored);
    write_json(run.file("progress.json"), json);
}

void discard_progress(const Run& run) {
    std::error_code ignored;
    std::filesystem::remove(run.file("progress.json"), ignored);
    remove_checkpoints(checkpoint_path(run.options));
}

/// Writes the result and removes the checkpoint, because checkpoints are large.
void finish(const Run& run, OutputFolder& out, const RunResult& result) {
    write_json(out.file("result.json"), result_json(result));
    out.commit();
    discard_progress(run);
}

/// Restores the state in which an earlier call left a run. If there is none, or if its settings were different, the run
/// starts from the beginning.
/// Errors  ValueError if the checkpoint is past a mark at which the run was not evaluated.
void resume(const Run& run, AnyReconstruction& reconstruction, TrainingRecord& record, std::vector<Mark>& marks) {
    std::error_code ignored;
    if (has_checkpoint(checkpoint_path(run.options)) &&
        std::filesystem::exists(run.file("progress.json"), ignored)) {
        const auto said = read_own_json(run.file("progress.json"), [](const Json& json) {
            std::vector<Mark> kept;
            for (const Json& mark : json.at("marks")) kept.push_back(mark_of(mark));
            return std::pair(json.at("settings"), std::move(kept));
        });
        if (same_settings(said.first, run.settings)) {
            std::string damage;
            const auto checkpoint = whole_checkpoint(checkpoint_path(run.options), damage);
            if (!damage.empty()) warn(damage);
            record = load_checkpoint(checkpoint, reconstruction, resume_advice);
            const bool passed = std::any_of(run.marks.begin(), run.marks.end(), [&](std::uint64_t steps) {
                return steps < record.steps && std::none_of(
                                                   said.second.begin(), said.second.end(),
                                                   [&](const Mark& mark) { return mark.steps == steps; });
            });
            check_value(!passed, checkpoint_path(run.options).string(),
                        "is past a number of steps at which the run was not evaluated; use the --steps of the first "
                        "call, or delete the file to start over");
            marks = said.second;
            std::erase_if(marks, [&](const Mark& mark) {
                return std::find(run.marks.begin(), run.marks.end(), mark.steps) == run.marks.end();
            });
            return;
        }
        std::printf("%s: the settings have changed since it was interrupted; it starts over\n", run.name.c_str());
    }
    discard_progress(run);
    write_progress(run, {});
}

RunCost cost_of_run(AnyReconstruction& reconstruction, const TrainingRecord& record) {
    const TableCounts tables = reconstruction.table_counts();
    RunCost cost{.gaussians = reconstruction.setup.gaussian_count(),
                 .memory = resident_bytes(),
                 .lookups = tables.lookups,
                 .entries = tables.entries,
                 .touched = tables.touched,
                 .ao_entries = tables.ao_entries,
                 .ao_touched = tables.ao_touched};
    cost.ms_per_step = 1e3 * record.seconds / static_cast<double>(std::max<std::uint64_t>(1, record.steps));
    for (std::size_t s = 0; s < stage_names.size(); ++s)
        cost.ms_per_stage.emplace_back(stage_names[s],
                                       1e3 * record.stage_seconds[s] /
                                           static_cast<double>(std::max<std::uint64_t>(1, record.timed_steps)));
    return cost;
}

/// "1,500 of 3,000 steps", "3,000 steps", "5 s"
std::string after(const Run& run, std::uint64_t steps) {
    if (run.options.seconds > 0) return gsh::detail::setting_text(run.options.seconds) + " s";
    return detail::grouped(steps) + (steps < run.options.steps ? " of " + detail::grouped(run.options.steps) : "") +
           " steps";
}

/// A text that describes the training up to a mark.
std::string training_protocol(const Run& run, std::uint64_t steps, const Machine& machine) {
    std::string text;
    if (run.options.seconds > 0)
        text = "Trained for " + after(run, steps) + " on " + machine.computed_on().text() +
               (machine.has_gpu() ? "" : " of " + processor_name()) +
               ", loading, sampling, checkpoints and judging not counted; learning rates fall over these seconds";
    else if (steps < run.options.steps)
        text = "Judged in the middle of a run, after " + after(run, steps) + ": learning rates fall over all " +
               detail::grouped(run.options.steps) + ", and a run of " + detail::grouped(steps) +
               " alone would end with lower ones";
    else
        text = "Trained for " + after(run, steps) + ", over which learning rates fall";
    const double share =
        static_cast<double>(steps - 1) / static_cast<double>(std::max<std::uint64_t>(1, run.options.steps));
    if (!run.scene && run.options.seconds == 0) {
        const ConfiguredAvatarParams& avatar = run.configuration.avatar;
        if (avatar.ao != AmbientOcclusion::none && share < avatar.model.occlusion_start)
            text += "; ambient occlusion, which joins later, is not part of it yet";
        if (share < avatar.model.sh_start) text += "; colours do not depend on the direction yet";
    }
    return text + "; " + (run.scene ? "at most " : "") + detail::grouped(run.options.gaussians) + " Gaussians, seed " +
           std::to_string(run.options.seed) + ".";
}

} // namespace

Evaluator::Evaluator(Machine& machine, const ReconstructionInput& input, const EvaluateOptions& o)
    : machine_(machine), input_(input), judge_(judge_for(machine.host(), input, o.common)),
      test_photos_(test_photos_of(input.capture)), views_(shown_views(input, test_photos_, o.views)) {
    check_value(!test_photos_.empty(), input.capture.name,
                "has no test views; give a camera the role test, or list test_frames");
}

void Evaluator::check(const Run& run) const {
    if (!run.scene) return;
    const StaticPhotos scene = scene_of(run);
    check_value(scene.training.size() > 1 && !scene.test.empty(), "static",
                "needs two training cameras and a test camera; " + input_.capture.name + " has " +
                    std::to_string(scene.training.size()) + " and " + std::to_string(scene.test.size()));
}

StaticPhotos Evaluator::scene_of(const Run& run) const {
    StaticPhotos scene = static_photos_of(input_.capture, run.options.frame);
    char frame[16];
    std::snprintf(frame, sizeof frame, "_%04zu", run.options.frame);
    for (auto* photos : {&scene.training, &scene.test})
        for (Photo& photo : *photos) photo.name += frame; // the same names as those of the capture's photographs
    return scene;
}

template <class Trained>
bool Evaluator::judge(Trained& trained, const std::vector<Photo>& photos, const std::optional<MotionSplit>& split,
                      Mark& mark, OutputFolder* out, RunResult& result) {
    std::vector<ImageScore> scores;
    Progress shown("judging test images");
    for (const Photo& photo : photos) {
        if (interrupted) return false;
        shown.show(static_cast<double>(scores.size()) / static_cast<double>(photos.size()), photo.name);
        const HeldPhoto held(photo); // read once
        const auto comparison = judge_.judge(trained.compare(*held), *held);
        mark.images.push_back(score_json(comparison.score));
        if (split) mark.images.back()["motion"] = motion_word(*split, scores.size());
        scores.push_back(comparison.score);
        const auto view =
            std::find_if(views_.begin(), views_.end(), [&](const ShownView& v) { return v.name == photo.name; });
        if (!out || view == views_.end()) continue;
        write_png(out->file(photo.name + ".png"), row_picture(*view, comparison.render, &comparison.truth));
        result.shown.push_back(photo.name);
    }
    mark.mean = mean_score(scores);
    for (const RegionMean& region : mean_regions(scores)) mark.regions.push_back(region.psnr);
    if (split) mark.motion = seen_and_new(scores, *split);
    const std::vector<PersonMean> people = mean_people(scores);
    for (std::size_t p = 0; p < people.size(); ++p) mark.people.push_back({input_.people[p].name, people[p]});
    return !interrupted;
}

bool Evaluator::evaluate_avatar(const Run& run, EvaluationFolder& folder, const std::string& title) {
    const Recipe recipe = recipe_of(run.options, run.configuration);
    const auto made = make_reconstruction(machine_, make_setup(machine_, input_, recipe));
    AnyReconstruction& reconstruction = *made;
    for (const std::string& warning : reconstruction.setup.warnings) warn(warning);
    const ReconstructionSetup& setup = reconstruction.setup;
    folder.add(run);
    TrainingRecord record;
    RunResult result{
        .name = run.name, .config = run.config, .settings = run.settings, .computed_on = machine_.computed_on()};
    resume(run, reconstruction, record, result.marks);
    const bool timed = run.options.seconds > 0;
    const std::vector<std::uint64_t> goals = timed ? std::vector<std::uint64_t>{0} : run.marks;
    OutputFolder out(run.options.out);
    for (const std::uint64_t goal : goals) {
        if (std::any_of(result.marks.begin(), result.marks.end(), [&](const Mark& mark) { return mark.steps == goal; }))
            continue;
        if (timed || record.steps < goal) train_shown(reconstruction, recipe, run.options, record, title, goal);
        if (interrupted) return false;
        const bool last = goal == goals.back();
        if (last) result.cost = cost_of_run(reconstruction, record);
        (void)reconstruction.fill_unseen();
        if (run.options.refine && !reconstruction.refine_test_poses(shown_progress())) return false;
        Mark mark{.steps = record.steps, .seconds = record.seconds, .after = after(run, record.steps)};
        mark.protocol =
            protocol_of(run.options, input_, setup, judge_) + " " + training_protocol(run, record.steps, machine_);
        const bool judged =
            judge(reconstruction, test_photos_, setup.motion_split, mark, last ? &out : nullptr, result);
        if (run.options.refine) reconstruction.end_test_refinement();
        reconstruction.end_fill();
        if (!judged) return false;
        result.marks.push_back(std::move(mark));
        if (!last) write_progress(run, result.marks);
    }
    finish(run, out, result);
    return true;
}

bool Evaluator::evaluate_scene(const Run& run, EvaluationFolder& folder, const std::string& title) {
    const StaticPhotos scene = scene_of(run);
    const StaticRecipe recipe = static_recipe(run.options);
    const auto made = make_static_reconstruction(machine_, scene, recipe);
    AnyStaticReconstruction& reconstruction = *made;
    TrainingRecord record;
    folder.add(run);
    RunResult result{
        .name = run.name, .config = run.config, .settings = run.settings, .computed_on = machine_.computed_on()};
    OutputFolder out(run.options.out);
    for (const std::uint64_t goal : run.marks) {
        train_shown(reconstruction, recipe, record, title, goal);
        if (interrupted) return false;
        Mark mark{.steps = goal, .seconds = record.seconds, .after = after(run, goal)};
        mark.protocol = "Test views of " + scene.name + " (" + std::to_string(scene.test.size()) +
                        " images), the only frame in training: no body, no poses, " +
                        std::to_string(scene.training.size()) + " images; white background in training and test, " +
                        measures_of(judge_) + " " + training_protocol(run, goal, machine_);
        result.cost.gaussians = reconstruction.size();
        result.cost.memory = resident_bytes();
        result.cost.ms_per_step = 1e3 * record.seconds / static_cast<double>(goal);
        if (!judge(reconstruction, scene.test, {}, mark, goal == run.marks.back() ? &out : nullptr, result))
            return false;
        result.marks.push_back(std::move(mark));
    }
    finish(run, out, result);
    return true;
}

void Evaluator::discard_rest(const Run& run) {
    const OutputFolder out(run.options.out); // which removes results that were not moved into place
    discard_progress(run);
}

bool Evaluator::evaluate(const Run& run, EvaluationFolder& folder, const std::string& title) {
    malloc_trim(0); // so that memory released by an earlier run is not counted for this one
    return run.scene ? evaluate_scene(run, folder, title) : evaluate_avatar(run, folder, title);
}

} // namespace gsh::programs
