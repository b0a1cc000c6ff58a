// SPDX-License-Identifier: Apache-2.0
/// @file  The work of gsh-evaluate: which runs there are, training and judging each, and the folder that keeps them.
#pragma once

#include "support/evaluation_pictures.hpp"
#include "support/evaluation_result.hpp"
#include "support/evaluation_tables.hpp"
#include "support/judgement.hpp"
#include "support/output_folder.hpp"
#include "support/program.hpp"
#include "support/reconstruction.hpp"
#include "support/results.hpp"
#include "support/static_reconstruction.hpp"
#include "support/training.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/train/configuration.hpp>
#include <gsh/train/configuration_file.hpp>
#include <gsh/train/parameters.hpp>

#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh::examples {

struct EvaluateOptions {
    ReconstructOptions common; ///< of every run; steps and seconds are the run's own
    std::vector<std::string> configs;
    std::vector<std::uint64_t> steps; ///< marks within one run of the largest number
    std::vector<std::string> budgets; ///< "5s", "0.5min": a run each
    std::size_t views = 4;            ///< test views to make pictures of
};

/// One training, judged at its end and perhaps on the way there.
struct Run {
    std::string name;   ///< in tables: "paper", "paper, refined"
    std::string key;    ///< of its folder: "paper-3000-steps"
    std::string config; ///< the configuration's own name, without --set
    Configuration configuration;
    bool scene = false;               ///< `static`: one frame, no body
    ReconstructOptions options;       ///< out is the run's folder
    std::vector<std::uint64_t> marks; ///< steps after which to judge, ascending; empty where seconds are counted
    Json settings;                    ///< names and values, as text

    [[nodiscard]] std::filesystem::path file(const std::string& file_name) const { return options.out / file_name; }
};

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Seconds of "5s", "5", "0.5min" or "2m".
inline double seconds_of(const std::string& budget) {
    double number = 0;
    const auto end = std::from_chars(budget.data(), budget.data() + budget.size(), number);
    const std::string unit(static_cast<const char*>(end.ptr), budget.data() + budget.size());
    const bool minutes = unit == "m" || unit == "min";
    if (end.ec != std::errc() || !(number > 0) || !std::isfinite(number) || !(minutes || unit.empty() || unit == "s"))
        throw ValueError("--budgets: '" + budget + "' is no time, expected one like 5s, 30s or 2min");
    return minutes ? 60 * number : number;
}

/// A name as part of a file's.
inline std::string file_word(const std::string& name) {
    std::string word;
    for (const char c : name) {
        const bool kept = std::isalnum(static_cast<unsigned char>(c)) || c == '.' || c == '-' || c == '_' || c == '=';
        if (kept) word += c;
        else if (!word.empty() && word.back() != '+') word += '+';
    }
    return word;
}

inline StaticOptions static_options(const ReconstructOptions& o) {
    return {.steps = o.steps, .points = std::min<std::size_t>(StaticOptions().points, o.gaussians), .max_gaussians = o.gaussians, .seed = o.seed};
}

inline Json settings_json(const Run& run) {
    Json json = Json::object();
    if (run.scene) {
        const StaticOptions scene = static_options(run.options);
        json["frame"] = std::to_string(run.options.frame);
        json["points"] = std::to_string(scene.points);
        json["sh_degree"] = std::to_string(scene.sh_degree);
    } else {
        for (const auto& [key, value] : settings_of(run.configuration)) json[key] = value;
    }
    return json;
}

/// Bytes of this process that are in memory now.
inline std::uint64_t resident_bytes() {
    std::ifstream file("/proc/self/statm");
    std::uint64_t total = 0, resident = 0;
    file >> total >> resident;
    return resident * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
}

/// What the machine calls its processor.
inline std::string processor_name() {
    std::ifstream file("/proc/cpuinfo");
    for (std::string line; std::getline(file, line);)
        if (const auto colon = line.find(": "); line.starts_with("model name") && colon != std::string::npos) return line.substr(colon + 2);
    return "an unknown processor";
}

} // namespace detail

/// The runs that the options ask for, in their order; the same one is asked for once.
/// Errors  ValueError for a configuration, a setting or a budget that there is not, or options that exclude each other.
[[nodiscard]] inline std::vector<Run> planned_runs(const EvaluateOptions& o) {
    std::vector<std::uint64_t> marks = o.steps.empty() ? std::vector<std::uint64_t>{3000} : o.steps;
    std::sort(marks.begin(), marks.end());
    marks.erase(std::unique(marks.begin(), marks.end()), marks.end());
    std::vector<double> budgets;
    for (const std::string& budget : o.budgets) budgets.push_back(detail::seconds_of(budget));
    if (budgets.empty()) budgets.push_back(0); // count steps

    std::vector<Run> runs;
    for (const std::string& config : o.configs)
        for (const double seconds : budgets) {
            Run run;
            run.name = run.config = config;
            run.scene = config == "static";
            run.options = o.common;
            run.options.config = config;
            run.options.seconds = seconds;
            if (seconds == 0) run.marks = marks, run.options.steps = marks.back();
            if (run.scene) {
                check_value(seconds == 0, "static", "counts steps; use --steps in place of --budgets");
                check_value(o.common.set.empty(), "static", "has none of the settings of --set; evaluate it in a call of its own");
                run.options.refine = run.options.refine_cameras = false; // it has no poses
            } else {
                run.config = find_configuration(config).name;
                run.configuration = configuration_of(run.options);
                run.name = run.configuration.name;
                if (run.options.refine) run.name += run.options.refine_cameras ? ", refined with cameras" : ", refined";
            }
            run.settings = detail::settings_json(run);
            run.key = detail::file_word(run.name) + "-" +
                      (seconds > 0 ? gsh::detail::setting_text(seconds) + "-s" : std::to_string(run.options.steps) + "-steps");
            run.options.out = o.common.out / "runs" / run.key;
            const auto same = std::find_if(runs.begin(), runs.end(), [&](const Run& other) { return other.key == run.key; });
            if (same == runs.end()) {
                runs.push_back(std::move(run));
                continue;
            }
            check_value(same->settings == run.settings, "--configs", "two configurations are called '" + run.name + "'; rename one of the files");
        }
    return runs;
}

/// The folder of an evaluation: evaluation.json says of what input it is and which runs there were, in their order;
/// runs/KEY/ keeps each, a finished one as result.json with a row picture per shown view.
class EvaluationFolder {
public:
    /// Errors  ValueError if the folder is of another input.
    explicit EvaluationFolder(const EvaluateOptions& o) : folder_(o.common.out) {
        const auto path = [](const std::filesystem::path& p) { return p.empty() ? "" : std::filesystem::weakly_canonical(p).string(); };
        input_ = {{"--capture", path(o.common.capture)}, {"--body", path(o.common.body)}, {"--poses", o.common.poses},
                  {"--gaussians", std::to_string(o.common.gaussians)}, {"--seed", std::to_string(o.common.seed)},
                  {"--regions", path(o.common.regions)}, {"--lpips", path(o.common.lpips)}};
        std::error_code ignored;
        if (!std::filesystem::exists(index(), ignored)) return;
        const auto said = read_own_json(index(), [](const Json& json) {
            return std::pair(json.at("input").get<std::vector<std::pair<std::string, std::string>>>(), json.at("runs").get<std::vector<std::string>>());
        });
        for (std::size_t i = 0; i < input_.size() && i < said.first.size(); ++i)
            check_value(said.first[i] == input_[i], index().string(),
                        "was begun with " + said.first[i].first + " '" + said.first[i].second + "', not '" + input_[i].second +
                            "'; give another input another --out");
        keys_ = said.second;
    }

    /// Puts a run on the list.
    void add(const Run& run) {
        if (std::find(keys_.begin(), keys_.end(), run.key) != keys_.end()) return;
        keys_.push_back(run.key);
        std::error_code ignored; // writing says what is wrong
        std::filesystem::create_directories(folder_, ignored);
        write_json(index(), {{"input", input_}, {"runs", keys_}});
    }

    /// Whether a run is finished, with its present settings and all its marks.
    [[nodiscard]] bool has(const Run& run) const {
        const std::optional<RunResult> result = read(run.key);
        if (!result || result->settings != run.settings) return false;
        return std::all_of(run.marks.begin(), run.marks.end(), [&](std::uint64_t steps) {
            return std::any_of(result->marks.begin(), result->marks.end(), [&](const Mark& mark) { return mark.steps == steps; });
        });
    }

    /// Whether there is a result of a run, with whatever settings and marks.
    [[nodiscard]] bool has_outdated(const Run& run) const { return !has(run) && read(run.key); }

    /// What is finished, of this call and of earlier ones, in the order in which it was first asked for.
    [[nodiscard]] std::vector<RunResult> results() const {
        std::vector<RunResult> all;
        for (const std::string& key : keys_)
            if (auto result = read(key)) all.push_back(std::move(*result));
        return all;
    }
    [[nodiscard]] std::filesystem::path path(const std::string& name) const { return folder_ / name; }

private:
    [[nodiscard]] std::filesystem::path index() const { return folder_ / "evaluation.json"; }
    [[nodiscard]] std::optional<RunResult> read(const std::string& key) const {
        const auto file = folder_ / "runs" / key / "result.json";
        std::error_code ignored;
        if (!std::filesystem::exists(file, ignored)) return std::nullopt;
        RunResult result = read_own_json(file, [](const Json& json) { return result_of(json); });
        result.folder = file.parent_path();
        return result;
    }

    std::filesystem::path folder_;
    std::vector<std::pair<std::string, std::string>> input_;
    std::vector<std::string> keys_;
};

/// Trains and judges runs on one source.
class Evaluator {
public:
    /// Errors  ValueError for a capture without test views.
    Evaluator(cpu::Threads& backend, const Source& source, const EvaluateOptions& o)
        : backend_(backend), source_(source), judge_(backend, source, o.common.lpips), test_photos_(test_photos_of(source.capture)),
          views_(shown_views(source, test_photos_, o.views)) {
        check_value(!test_photos_.empty(), source.capture.name, "has no test views to judge by; give a camera the role test, or name test_frames");
    }

    [[nodiscard]] const std::vector<Photo>& test_photos() const { return test_photos_; }
    [[nodiscard]] const std::vector<ShownView>& views() const { return views_; }

    /// Frames of `static` must have cameras on all sides.
    void check(const Run& run) const {
        if (!run.scene) return;
        const StaticSource scene = scene_of(run);
        check_value(scene.training.size() > 1 && !scene.test.empty(), "static",
                    "needs two training cameras and a test camera; " + source_.capture.name + " has " + std::to_string(scene.training.size()) +
                        " and " + std::to_string(scene.test.size()));
    }

    /// Trains, or goes on training, and leaves result.json with its pictures. False if somebody interrupted; what is done
    /// until then is kept, but for `static`.
    bool evaluate(const Run& run, EvaluationFolder& folder, const std::string& title) {
        malloc_trim(0); // memory that an earlier run gave back does not count as this one's
        return run.scene ? evaluate_scene(run, folder, title) : evaluate_avatar(run, folder, title);
    }

private:
    bool evaluate_avatar(const Run& run, EvaluationFolder& folder, const std::string& title) {
        Reconstruction reconstruction(backend_, source_, run.configuration, run.options);
        folder.add(run);
        TrainingRecord record;
        RunResult result{.name = run.name, .config = run.config, .settings = run.settings, .cost = {}, .marks = {}, .shown = {}, .folder = {}};
        resume(run, reconstruction, record, result.marks);
        const bool timed = run.options.seconds > 0;
        const std::vector<std::uint64_t> goals = timed ? std::vector<std::uint64_t>{0} : run.marks;
        OutputFolder out(run.options.out);
        for (const std::uint64_t goal : goals) {
            if (std::any_of(result.marks.begin(), result.marks.end(), [&](const Mark& mark) { return mark.steps == goal; })) continue;
            if (timed || record.steps < goal) train(reconstruction, run.options, record, title, goal);
            if (interrupted) return false;
            const bool last = goal == goals.back();
            if (last) result.cost = cost_of_run(reconstruction, record);
            if (run.options.refine) reconstruction.refine_test_poses(backend_);
            Mark mark{.steps = record.steps, .seconds = record.seconds, .after = after(run, record.steps), .protocol = {}, .mean = {}, .regions = {}};
            mark.protocol = protocol_of(run.options, source_, judge_, test_photos_.size()) + " " + training_protocol(run, record.steps);
            const bool judged = judge(reconstruction.trainer, test_photos_, mark, last ? &out : nullptr, result);
            if (run.options.refine) reconstruction.trainer.refine(*reconstruction.refinement);
            if (!judged) return false;
            result.marks.push_back(std::move(mark));
            if (!last) write_progress(run, result.marks);
        }
        finish(run, out, result);
        return true;
    }

    bool evaluate_scene(const Run& run, EvaluationFolder& folder, const std::string& title) {
        const StaticSource scene = scene_of(run);
        StaticReconstruction reconstruction(backend_, scene, detail::static_options(run.options));
        folder.add(run);
        auto& trainer = reconstruction.trainer;
        RunResult result{.name = run.name, .config = run.config, .settings = run.settings, .cost = {}, .marks = {}, .shown = {}, .folder = {}};
        OutputFolder out(run.options.out);
        for (const std::uint64_t goal : run.marks) {
            reconstruction.train(goal, title);
            if (interrupted) return false;
            Mark mark{.steps = goal, .seconds = reconstruction.seconds, .after = after(run, goal), .protocol = {}, .mean = {}, .regions = {}};
            mark.protocol = "Test views of " + scene.name + " (" + std::to_string(scene.test.size()) + " images), the only frame in training: no body, no "
                            "poses, " + std::to_string(scene.training.size()) + " images; white background in training and test, " +
                            measures_of(judge_) + " " + training_protocol(run, goal);
            result.cost.gaussians = trainer.size();
            result.cost.memory = detail::resident_bytes();
            result.cost.ms_per_step = 1e3 * reconstruction.seconds / static_cast<double>(goal);
            result.cost.threads = backend_.thread_count();
            if (!judge(trainer, scene.test, mark, goal == run.marks.back() ? &out : nullptr, result)) return false;
            result.marks.push_back(std::move(mark));
        }
        finish(run, out, result);
        return true;
    }

    /// Figures of a mark, and pictures if there is where to put them. False if somebody interrupted.
    template <class TrainerType>
    bool judge(TrainerType& trainer, const std::vector<Photo>& photos, Mark& mark, OutputFolder* out, RunResult& result) {
        std::vector<ImageScore> scores;
        for (const Photo& photo : photos) {
            if (interrupted) return false;
            const auto comparison = judge_.judge(trainer, photo);
            scores.push_back(comparison.score);
            mark.images.push_back(score_json(comparison.score));
            const auto view = std::find_if(views_.begin(), views_.end(), [&](const ShownView& v) { return v.name == photo.name; });
            if (!out || view == views_.end()) continue;
            write_png(out->file(photo.name + ".png"), row_picture(*view, comparison.render, &comparison.truth));
            result.shown.push_back(photo.name);
        }
        mark.mean = mean_score(scores);
        for (const RegionMean& region : mean_regions(scores)) mark.regions.push_back(region.psnr);
        return !interrupted;
    }

    /// The result in its place, and nothing else: checkpoints are large.
    static void finish(const Run& run, OutputFolder& out, const RunResult& result) {
        write_json(out.file("result.json"), result_json(result));
        out.commit();
        discard_progress(run);
    }

    static void write_progress(const Run& run, const std::vector<Mark>& marks) {
        Json json{{"settings", run.settings}, {"marks", Json::array()}};
        for (const Mark& mark : marks) json["marks"].push_back(mark_json(mark));
        std::error_code ignored; // writing says what is wrong
        std::filesystem::create_directories(run.options.out, ignored);
        write_json(run.file("progress.json"), json);
    }
    static void discard_progress(const Run& run) {
        std::error_code ignored;
        std::filesystem::remove(run.file("progress.json"), ignored);
        std::filesystem::remove(checkpoint_path(run.options), ignored);
    }

    /// Brings a run to where an earlier call left it, or makes it begin anew: with other settings than now, or past a mark
    /// that nobody judged at, what there is of it is of no use.
    static void resume(const Run& run, Reconstruction& reconstruction, TrainingRecord& record, std::vector<Mark>& marks) {
        std::error_code ignored;
        if (std::filesystem::exists(checkpoint_path(run.options), ignored) && std::filesystem::exists(run.file("progress.json"), ignored)) {
            const auto said = read_own_json(run.file("progress.json"), [](const Json& json) {
                std::vector<Mark> kept;
                for (const Json& mark : json.at("marks")) kept.push_back(mark_of(mark));
                return std::pair(json.at("settings"), std::move(kept));
            });
            if (said.first == run.settings) {
                load_checkpoint(run.options, reconstruction, record);
                const bool passed = std::any_of(run.marks.begin(), run.marks.end(), [&](std::uint64_t steps) {
                    return steps < record.steps && std::none_of(said.second.begin(), said.second.end(), [&](const Mark& mark) { return mark.steps == steps; });
                });
                check_value(!passed, checkpoint_path(run.options).string(),
                            "is past a number of steps that was not judged; name the --steps of the first call, or delete the file to begin anew");
                marks = said.second;
                std::erase_if(marks, [&](const Mark& mark) { return std::find(run.marks.begin(), run.marks.end(), mark.steps) == run.marks.end(); });
                return;
            }
            std::printf("%s: settings are not what they were when it was interrupted; it begins anew\n", run.name.c_str());
        }
        discard_progress(run);
        write_progress(run, {});
    }

    [[nodiscard]] RunCost cost_of_run(Reconstruction& reconstruction, const TrainingRecord& record) const {
        auto& model = reconstruction.model;
        RunCost cost{.gaussians = model.size(), .memory = detail::resident_bytes(), .lookups = model.lookups(), .ms_per_stage = {}};
        for (std::size_t g = 0; g < parameter_group_count; ++g) {
            const auto group = static_cast<ParameterGroup>(g);
            const auto* touched = model.touched_entries(group);
            const std::size_t entries = model.parameters()[group].size() / Reconstruction::Model::Grid::feature_count;
            if (!touched || entries == 0) continue;
            const bool ao = group == ParameterGroup::ao_table;
            (ao ? cost.ao_entries : cost.entries) += entries;
            (ao ? cost.ao_touched : cost.touched) += touched->size();
        }
        cost.ms_per_step = 1e3 * record.seconds / static_cast<double>(std::max<std::uint64_t>(1, record.steps));
        for (std::size_t s = 0; s < stage_names.size(); ++s)
            cost.ms_per_stage.emplace_back(stage_names[s],
                                           1e3 * record.stage_seconds[s] / static_cast<double>(std::max<std::uint64_t>(1, record.timed_steps)));
        cost.threads = backend_.thread_count();
        return cost;
    }

    [[nodiscard]] StaticSource scene_of(const Run& run) const {
        StaticSource scene = static_source(source_.capture, run.options.frame);
        char frame[16];
        std::snprintf(frame, sizeof frame, "_%04zu", run.options.frame);
        for (auto* photos : {&scene.training, &scene.test})
            for (Photo& photo : *photos) photo.name += frame; // as the capture's photographs are called
        return scene;
    }

    /// "1,500 of 3,000 steps", "3,000 steps", "5 s"
    [[nodiscard]] static std::string after(const Run& run, std::uint64_t steps) {
        if (run.options.seconds > 0) return gsh::detail::setting_text(run.options.seconds) + " s";
        return detail::grouped(steps) + (steps < run.options.steps ? " of " + detail::grouped(run.options.steps) : "") + " steps";
    }

    /// How a mark's training went, in words.
    [[nodiscard]] std::string training_protocol(const Run& run, std::uint64_t steps) const {
        std::string text;
        if (run.options.seconds > 0)
            text = "Trained for " + after(run, steps) + " on " + std::to_string(backend_.thread_count()) + " threads of " + detail::processor_name() +
                   ", loading, sampling, checkpoints and judging not counted; learning rates fall over these seconds";
        else if (steps < run.options.steps)
            text = "Judged in the middle of a run, after " + after(run, steps) + ": learning rates fall over all " + detail::grouped(run.options.steps) +
                   ", and a run of " + detail::grouped(steps) + " alone would end with lower ones";
        else
            text = "Trained for " + after(run, steps) + ", over which learning rates fall";
        const double share = static_cast<double>(steps - 1) / static_cast<double>(std::max<std::uint64_t>(1, run.options.steps));
        if (!run.scene && run.options.seconds == 0 && run.configuration.avatar.ao != AmbientOcclusion::none && share < run.configuration.train.ao_start)
            text += "; ambient occlusion, which joins later, is not part of it yet";
        return text + "; " + (run.scene ? "at most " : "") + detail::grouped(run.options.gaussians) + " Gaussians, seed " + std::to_string(run.options.seed) + ".";
    }

    cpu::Threads& backend_;
    const Source& source_;
    Judge judge_;
    std::vector<Photo> test_photos_;
    std::vector<ShownView> views_;
};

} // namespace gsh::examples
