// SPDX-License-Identifier: Apache-2.0
#include "evaluate/evaluation_runs.hpp"

#include "common/input_files.hpp"

#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/io/file/full_path.hpp>
#include <gsh/io/file/named_path.hpp>
#include <gsh/reconstruct/static_reconstruction.hpp>
#include <gsh/train/static_model.hpp>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <system_error>

namespace gsh::programs {

namespace {

/// The seconds of a budget such as "5s", "5", "0.5min" or "2m".
double seconds_of(const std::string& budget) {
    double number = 0;
    const auto end = std::from_chars(budget.data(), budget.data() + budget.size(), number);
    const std::string unit(static_cast<const char*>(end.ptr), budget.data() + budget.size());
    const bool minutes = unit == "m" || unit == "min";
    if (end.ec != std::errc() || !(number > 0) || !std::isfinite(number) || !(minutes || unit.empty() || unit == "s"))
        throw ValueError("--budgets: '" + budget + "' is not a duration, expected one like 5s, 30s or 2min");
    return minutes ? 60 * number : number;
}

/// A name in the form in which it can be part of a file name.
std::string file_word(const std::string& name) {
    std::string word;
    for (const char c : name) {
        const bool kept = std::isalnum(static_cast<unsigned char>(c)) || c == '.' || c == '-' || c == '_' || c == '=';
        if (kept)
            word += c;
        else if (!word.empty() && word.back() != '+')
            word += '+';
    }
    return word;
}

Json settings_json(const Run& run) {
    Json json = Json::object();
    if (run.scene) {
        const StaticRecipe scene = static_recipe(run.options);
        json["frame"] = std::to_string(run.options.frame);
        json["points"] = std::to_string(scene.points);
        for (const auto& [key, value] : settings_of(scene.config)) json[key] = value;
    } else {
        for (const auto& [key, value] : stated_settings_of(run.configuration)) json[key] = value;
        if (!run.options.priors.empty())
            json["priors"] = run.options.priors.filename().string() + " " + priors_checksum(run.options.priors);
    }
    return json;
}

/// True if all configurations are static scenes. These have the same settings.
bool is_scene_only(const EvaluateOptions& o) {
    return std::all_of(o.configs.begin(), o.configs.end(),
                       [](const std::string& config) { return is_scene_configuration(config); });
}

} // namespace

std::vector<Run> planned_runs(const EvaluateOptions& o) {
    std::vector<std::uint64_t> marks = o.steps.empty() ? std::vector<std::uint64_t>{3000} : o.steps;
    std::sort(marks.begin(), marks.end());
    marks.erase(std::unique(marks.begin(), marks.end()), marks.end());
    std::vector<double> budgets;
    for (const std::string& budget : o.budgets) budgets.push_back(seconds_of(budget));
    if (budgets.empty()) budgets.push_back(0); // a run by steps

    (void)held_out_span(o.common); // reports an invalid one before anything is loaded

    std::vector<Run> runs;
    for (const std::string& config : o.configs)
        for (const double seconds : budgets) {
            Run run;
            run.name = run.config = config;
            run.scene = is_scene_configuration(config);
            run.options = o.common;
            run.options.config = config;
            run.options.seconds = seconds;
            if (seconds == 0) run.marks = marks, run.options.steps = marks.back();
            if (run.scene) {
                check_value(seconds == 0, "static", "has no time budget; use --steps instead of --budgets");
                check_value(o.common.set.empty() || is_scene_only(o), "static",
                            "does not have the settings of the others; with --set, evaluate it in a call of its own");
                check_value(!o.common.hold_out_motion, "static",
                            "has one frame and no motion; with --hold-out-motion, evaluate it in a call of its own");
                // a static scene has no poses
                run.options.refine = run.options.refine_cameras = false;
                run.options.no_registration = false, run.options.fine_registration = 0;
                run.options.keypoints.clear();
                run.config = "static";
                run.name = std::filesystem::path(config).stem().string() + set_words(run.options);
                run.options.priors.clear();
            } else {
                run.config = configuration_called(config, "--configs").name;
                run.configuration = configuration_of(run.options);
                run.name = run.configuration.name;
                if (!run.configuration.has_priors()) run.options.priors.clear();
                if (!run.options.priors.empty()) run.name += ", priors of " + run.options.priors.stem().string();
                if (run.options.refine) run.name += run.options.refine_cameras ? ", refined with cameras" : ", refined";
                if (run.options.no_registration) run.name += " without registration";
                if (run.options.fine_registration > 0) run.name += " by fine registration";
                if (o.common.machine.precision == "mixed") run.name += ", mixed precision";
            }
            if (o.common.machine.backend != "threads") run.name += ", " + o.common.machine.backend;
            run.settings = settings_json(run);
            run.key = file_word(run.name) + "-" +
                      (seconds > 0 ? gsh::detail::setting_text(seconds) + "-s"
                                   : std::to_string(run.options.steps) + "-steps");
            run.options.out = o.common.out / "runs" / run.key;
            const auto same =
                std::find_if(runs.begin(), runs.end(), [&](const Run& other) { return other.key == run.key; });
            if (same == runs.end()) {
                runs.push_back(std::move(run));
                continue;
            }
            check_value(same_settings(same->settings, run.settings), "--configs",
                        "two configurations are called '" + run.name + "'; rename one of the files");
        }
    check_value(o.common.priors.empty() ||
                    std::any_of(runs.begin(), runs.end(), [](const Run& run) { return !run.options.priors.empty(); }),
                "--priors", "has no effect: none of --configs has prior.depth or prior.normals");
    return runs;
}

EvaluationFolder::EvaluationFolder(const EvaluateOptions& o) : locked_(o.common.out), folder_(locked_.path()) {
    const auto path = [](const std::filesystem::path& p) { return p.empty() ? "" : full_path(p).string(); };
    const auto file = [&](const std::filesystem::path& p) { // the path and the content
        return p.empty() ? "" : path(p) + " " + file_checksum(p);
    };
    std::string bodies;
    for (const auto& body : o.common.bodies) bodies += (bodies.empty() ? "" : ", ") + path(body);
    input_ = {{"--capture", path(o.common.capture)},
              {"--body", bodies},
              {"--poses", poses_text(o.common)},
              {"--gaussians", std::to_string(o.common.gaussians)},
              {"--seed", std::to_string(o.common.seed)},
              {"--regions", file(o.common.regions)},
              {"--lpips", file(o.common.lpips) + (o.common.lpips_table ? ", as in tables" : "")},
              {"--hold-out-motion", span_text(held_out_span(o.common))},
              {"--keypoints", path(o.common.keypoints)}};
    std::error_code ignored;
    if (!std::filesystem::exists(index(), ignored)) return;
    const auto said = read_own_json(index(), [](const Json& json) {
        return std::pair(json.at("input").get<std::vector<std::pair<std::string, std::string>>>(),
                         json.at("runs").get<std::vector<std::string>>());
    });
    for (std::size_t i = 0; i < input_.size(); ++i) {
        const auto [option, value] = i < said.first.size() ? said.first[i] : std::pair(input_[i].first, std::string());
        check_value(std::pair(option, value) == input_[i], index().string(),
                    "was begun with " + option + " '" + value + "', not '" + input_[i].second +
                        "'; use another --out for another input");
    }
    keys_ = said.second;
    for (const std::string& key : keys_)
        check_value(gsh::detail::is_plain_name(key), index().string(),
                    "has the run '" + gsh::detail::shortened(key) + "', expected the name of a folder");
}

void EvaluationFolder::add(const Run& run) {
    if (std::find(keys_.begin(), keys_.end(), run.key) != keys_.end()) return;
    keys_.push_back(run.key);
    write_json(index(), {{"input", input_}, {"runs", keys_}});
}

bool same_settings(const Json& a, const Json& b) {
    return nlohmann::json(a) == nlohmann::json(b); // Json keeps the order of members, and compares it
}

bool EvaluationFolder::has(const Run& run) const {
    const std::optional<RunResult> result = read(run.key);
    if (!result || !same_settings(result->settings, run.settings)) return false;
    return std::all_of(run.marks.begin(), run.marks.end(), [&](std::uint64_t steps) {
        return std::any_of(result->marks.begin(), result->marks.end(),
                           [&](const Mark& mark) { return mark.steps == steps; });
    });
}

std::vector<RunResult> EvaluationFolder::results() const {
    std::vector<RunResult> all;
    for (const std::string& key : keys_)
        if (auto result = read(key)) all.push_back(std::move(*result));
    return all;
}

std::optional<RunResult> EvaluationFolder::read(const std::string& key) const {
    const auto file = folder_ / "runs" / key / "result.json";
    std::error_code ignored;
    if (!std::filesystem::exists(file, ignored)) return std::nullopt;
    RunResult result = read_own_json(file, [](const Json& json) { return result_of(json); });
    result.folder = file.parent_path();
    return result;
}

} // namespace gsh::programs
