// SPDX-License-Identifier: Apache-2.0
#include "reconstruct/reconstruct_options.hpp"

#include "common/input_files.hpp"

#include <gsh/core/error.hpp>
#include <gsh/reconstruct/any_training.hpp>
#include <gsh/reconstruct/static_reconstruction.hpp>
#include <gsh/setup/configuration.hpp>
#include <gsh/train/static_model.hpp>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <system_error>
#include <thread>

namespace gsh::programs {

namespace {

/// Splits words at commas. A word that is the name of a file in `folder` is not split.
std::vector<std::string> listed(const std::vector<std::string>& words, const std::filesystem::path& folder) {
    std::vector<std::string> result;
    for (const std::string& word : words) {
        std::error_code ignored;
        const bool whole = std::filesystem::exists(folder / word, ignored);
        for (std::size_t begin = 0, end = 0; end != std::string::npos; begin = end + 1) {
            end = whole ? std::string::npos : word.find(',', begin);
            result.push_back(word.substr(begin, end - begin));
            check_value(!result.back().empty(), "--poses " + word, "has an empty name between its commas");
        }
    }
    return result;
}

/// Applies the settings of --set to a configuration.
template <class C>
void set_all(C& configuration, const std::vector<std::string>& settings) {
    for (const std::string& setting : settings) {
        const auto equals = setting.find('=');
        check_value(equals != std::string::npos, "--set " + setting, "must be key=value");
        set_setting(configuration, setting.substr(0, equals), setting.substr(equals + 1), "--set");
    }
}

} // namespace

void complete_poses(PeopleOptions& o) {
    o.poses = o.poses.empty() ? std::vector<std::string>{"poses.npz"} : listed(o.poses, o.capture);
}

std::string poses_text(const PeopleOptions& o) {
    if (o.capture.empty()) return "the built-in actor";
    std::string text;
    for (const std::string& poses : o.poses) text += (text.empty() ? "" : ", ") + poses;
    return text;
}

void check_options(ReconstructOptions& o) {
    const auto expect = [](bool condition, const char* message) {
        if (!condition) throw ValueError(message);
    };
    const bool scene = is_scene(o); // has neither body nor poses
    expect(o.plan || !o.out.empty(), "needs --out, a folder for the results; --help lists all options");
    expect(!o.plan || !o.resume, "--plan and --resume exclude each other: name the options of the run");
    expect(!o.resume || !o.go_on, "--resume and --continue exclude each other");
    expect(o.synthetic || (!o.capture.empty() && (scene || has_body(o))),
           "needs --capture and --body, or --synthetic alone");
    for (const auto& [given, option] : {std::pair(o.synthetic, "--synthetic: it needs a capture"),
                                        {o.refine, "--refine"},
                                        {o.hold_out_motion.has_value(), "--hold-out-motion: it has no motion"},
                                        {o.machine.precision == "mixed", "--precision mixed: it has no field"},
                                        {o.resume, "--resume"},
                                        {o.go_on, "--continue"},
                                        {o.plan, "--plan"},
                                        {o.seconds > 0, "--seconds: use --steps"},
                                        {o.max_memory > 0, "--max-memory"},
                                        {o.image_memory > 0, "--image-memory"},
                                        {!o.poses.empty(), "--poses"},
                                        {o.input_fps > 0, "--input-fps"},
                                        {!o.regions.empty(), "--regions"},
                                        {!o.priors.empty(), "--priors"},
                                        {!o.lpips.empty(), "--lpips: gsh-evaluate computes LPIPS for it"}})
        if (scene && given) throw ValueError(std::string("--config static has no ") + option);
    expect(scene || o.frame == 0, "--frame needs --config static");
    expect(!o.synthetic || (o.capture.empty() && o.bodies.empty() && o.poses.empty() && o.input_fps == 0),
           "--synthetic has its own capture, body and poses; leave out --capture, --body and --poses");
    expect(o.steps == 0 || o.seconds == 0, "--steps and --seconds exclude each other");
    check_companions(o);
    (void)held_out_span(o); // reports an invalid one before anything is loaded
    complete_poses(o);
    if (o.gaussians == 0) o.gaussians = default_gaussians(o);
    if (scene) { // reports invalid settings before anything is loaded
        if (o.steps == 0) o.steps = TrainingLength().steps;
        (void)scene_configuration_of(o);
    } else {
        const Configuration configuration = configuration_of(o);
        expect(o.priors.empty() || configuration.has_priors(),
               "--priors has no effect: the configuration has neither prior.depth nor prior.normals");
    }
}

std::size_t default_gaussians(const ReconstructOptions& o) {
    const std::size_t most = o.synthetic ? 60000 : 170000;
    if (o.seconds == 0 || o.machine.backend == "cuda") return most;
    // As many as a training of this length can teach: all of them in half a minute on two threads of a Zen 5.
    const std::size_t threads = o.machine.threads ? o.machine.threads : std::thread::hardware_concurrency();
    const double people = static_cast<double>(std::max<std::size_t>(o.poses.size(), 1));
    const double share = o.seconds * static_cast<double>(std::max<std::size_t>(threads, 1)) / (60 * people);
    const double count = 170000 * std::pow(share, 0.75);
    return std::clamp(static_cast<std::size_t>(std::min(count, 1e6)) / 1000 * 1000, std::size_t(5000), most);
}

bool is_scene(const ReconstructOptions& o) {
    return o.config && is_scene_configuration(*o.config);
}

Configuration configuration_of(const ReconstructOptions& o) {
    const std::string name = o.config.value_or(std::string(default_configuration));
    Configuration configuration = configuration_called(name, "--config");
    check_part_names(configuration.avatar, name); // before --set, so that a message names the file
    set_all(configuration, o.set);
    check_settings(configuration, o.set.empty() ? name : "--set");
    configuration.name += set_words(o);
    return configuration;
}

StaticModelParams scene_configuration_of(const ReconstructOptions& o) {
    StaticModelParams config = scene_configuration_called(o.config.value(), static_cast<std::int64_t>(o.steps));
    set_all(config, o.set);
    config.density.max_gaussians = o.gaussians;
    return config;
}

StaticRecipe static_recipe(const ReconstructOptions& o) {
    StaticRecipe recipe{.config = scene_configuration_of(o), .seed = o.seed};
    recipe.points = std::min(recipe.points, o.gaussians);
    return recipe;
}

std::optional<MotionSpan> held_out_span(const ReconstructOptions& o) {
    if (!o.hold_out_motion) return std::nullopt;
    const std::string& text = *o.hold_out_motion;
    MotionSpan span{.name = "--hold-out-motion " + text};
    const auto read = [](const std::string& word, auto& number) {
        const char* end = word.data() + word.size();
        const auto read_to = std::from_chars(word.data(), end, number);
        return read_to.ec == std::errc() && read_to.ptr == end;
    };
    const auto colon = text.find(':');
    const bool valid = colon == std::string::npos
                           ? read(text, span.share) && span.share > 0 && span.share < 1
                           : read(text.substr(0, colon), span.first) && read(text.substr(colon + 1), span.last);
    check_value(valid, span.name,
                "is not a span, expected the last share of the motion, a number above 0 and below 1 such as 0.25, or "
                "its first and last frame, counted from 0, such as 20:29");
    return span;
}

std::string span_text(const std::optional<MotionSpan>& span) {
    if (!span) return "";
    return span->share > 0 ? gsh::detail::setting_text(span->share)
                           : std::to_string(span->first) + ":" + std::to_string(span->last);
}

std::string set_words(const ReconstructOptions& o) {
    std::string words;
    for (const std::string& setting : o.set) words += " " + setting;
    return words;
}

bool has_body(const PeopleOptions& o) {
    return !o.bodies.empty() || brings_own_body(o.capture);
}

void check_body(const PeopleOptions& o) {
    check_value(has_body(o), "--body", "is required: only GalaBasketball's captures include a body");
}

void check_companions(const ReconstructOptions& o) {
    if (o.refine_cameras && !o.refine) throw ValueError("--refine-cameras needs --refine");
    if (o.no_registration && !o.refine) throw ValueError("--no-registration needs --refine");
    if (o.fine_registration > 0 && (!o.refine || o.no_registration))
        throw ValueError("--fine-registration needs --refine, and no --no-registration");
    if (!o.keypoints.empty() && (!o.refine || o.no_registration))
        throw ValueError("--keypoints needs --refine, and no --no-registration");
    if (o.lpips_table && o.lpips.empty()) throw ValueError("--lpips-table needs --lpips");
}

} // namespace gsh::programs
