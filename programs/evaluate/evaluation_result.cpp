// SPDX-License-Identifier: Apache-2.0
#include "evaluate/evaluation_result.hpp"

#include <cmath>

namespace gsh::programs {

namespace {

/// The inverse of number_or_null, except that infinity also becomes NaN.
double number_of(const Json& json) {
    return json.is_null() ? std::nan("") : json.get<double>();
}

std::vector<double> regions_of(const Json& json) {
    std::vector<double> regions;
    for (const std::string& region : region_names()) regions.push_back(number_of(json.at(region)));
    return regions;
}

MotionFigures motion_of(const Json& json) {
    MotionFigures figures{.images = json.at("images"), .mean = {.name = "mean"}};
    figures.mean.psnr = number_of(json.at("psnr"));
    figures.mean.ssim = number_of(json.at("ssim"));
    figures.mean.psnr_person = number_of(json.at("psnr_person"));
    if (json.contains("lpips")) figures.mean.lpips = number_of(json.at("lpips"));
    figures.regions = regions_of(json.at("psnr_regions"));
    return figures;
}

/// The inverse of add_machine. Files of older versions have no `backend`, and `threads` is in their cost.
ComputedOn computed_on(const Json& json) {
    const Json& threads = json.contains("threads") ? json.at("threads") : json.at("cost").at("threads");
    return {json.value("backend", "threads"), json.value("device", ""), json.value("precision", "fp32"), threads,
            json.value("instruction_set", "")};
}

RunCost cost_of(const Json& json) {
    RunCost cost{.gaussians = json.at("gaussians"),
                 .memory = json.at("memory_bytes"),
                 .lookups = json.at("lookups"),
                 .entries = json.at("entries"),
                 .touched = json.at("touched_entries"),
                 .ao_entries = json.at("ao_entries"),
                 .ao_touched = json.at("ao_touched_entries"),
                 .ms_per_step = number_of(json.at("ms_per_step"))};
    for (const auto& [stage, ms] : json.at("ms_per_stage").items())
        cost.ms_per_stage.emplace_back(stage, number_of(ms));
    return cost;
}

} // namespace

Json mark_json(const Mark& mark) {
    Json json{{"after", mark.after},
              {"steps", mark.steps},
              {"seconds", mark.seconds},
              {"psnr", number_or_null(mark.mean.psnr)},
              {"ssim", number_or_null(mark.mean.ssim)},
              {"psnr_person", number_or_null(mark.mean.psnr_person)}};
    for (std::size_t r = 0; r < mark.regions.size(); ++r)
        json["psnr_regions"][region_names()[r]] = number_or_null(mark.regions[r]);
    if (mark.mean.lpips) json["lpips"] = number_or_null(*mark.mean.lpips);
    for (const PersonFigures& person : mark.people) {
        Json one{{"name", person.name}};
        one.update(person_json(person.mean.whole, person.mean.regions));
        json["people"].push_back(std::move(one));
    }
    if (mark.motion) {
        json["seen_motion"] = motion_json(mark.motion->seen);
        json["new_motion"] = motion_json(mark.motion->unseen);
    }
    json["protocol"] = mark.protocol;
    json["images"] = mark.images;
    return json;
}

Mark mark_of(const Json& json) {
    Mark mark{.steps = json.at("steps"),
              .seconds = json.at("seconds"),
              .after = json.at("after"),
              .protocol = json.at("protocol"),
              .mean = {.name = "mean"},
              .images = json.at("images")};
    mark.mean.psnr = number_of(json.at("psnr"));
    mark.mean.ssim = number_of(json.at("ssim"));
    mark.mean.psnr_person = number_of(json.at("psnr_person"));
    mark.regions = regions_of(json.at("psnr_regions"));
    for (const Json& person : json.value("people", Json::array())) {
        PersonFigures figures{person.at("name"), {}};
        figures.mean.whole.psnr = number_of(person.at("psnr_person"));
        figures.mean.whole.ssim = number_of(person.at("ssim_person"));
        for (const double psnr : regions_of(person.at("psnr_regions"))) figures.mean.regions.push_back({.psnr = psnr});
        mark.people.push_back(std::move(figures));
    }
    if (json.contains("lpips")) mark.mean.lpips = number_of(json.at("lpips"));
    if (json.contains("seen_motion"))
        mark.motion = SeenAndNew{motion_of(json.at("seen_motion")), motion_of(json.at("new_motion"))};
    return mark;
}

Json cost_json(const RunCost& cost) {
    Json json{{"gaussians", cost.gaussians},
              {"memory_bytes", cost.memory},
              {"lookups", cost.lookups},
              {"entries", cost.entries},
              {"touched_entries", cost.touched},
              {"ao_entries", cost.ao_entries},
              {"ao_touched_entries", cost.ao_touched},
              {"ms_per_step", number_or_null(cost.ms_per_step)}};
    json["ms_per_stage"] = Json::object();
    for (const auto& [stage, ms] : cost.ms_per_stage) json["ms_per_stage"][stage] = number_or_null(ms);
    return json;
}

Json result_json(const RunResult& result) {
    Json json{{"name", result.name}, {"configuration", result.config}};
    add_machine(json, result.computed_on);
    json["cost"] = cost_json(result.cost);
    json["marks"] = Json::array();
    for (const Mark& mark : result.marks) json["marks"].push_back(mark_json(mark));
    json["shown"] = result.shown;
    json["settings"] = result.settings;
    return json;
}

RunResult result_of(const Json& json) {
    RunResult result{.name = json.at("name"),
                     .config = json.at("configuration"),
                     .settings = json.at("settings"),
                     .computed_on = computed_on(json),
                     .cost = cost_of(json.at("cost")),
                     .shown = json.at("shown")};
    for (const Json& mark : json.at("marks")) result.marks.push_back(mark_of(mark));
    return result;
}

} // namespace gsh::programs
