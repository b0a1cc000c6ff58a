// SPDX-License-Identifier: Apache-2.0
/// @file  What gsh-evaluate keeps of a run: its figures at one or more marks, and what they cost. Structs, and JSON.
#pragma once

#include "support/judgement.hpp"
#include "support/results.hpp"

#include <gsh/core/error.hpp>
#include <gsh/io/atomic_file.hpp>
#include <gsh/io/camera_file.hpp>
#include <gsh/train/evaluation.hpp>

#include <nlohmann/json.hpp>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace gsh::examples {

using Json = nlohmann::ordered_json;

/// Figures at one point of a run.
struct Mark {
    std::uint64_t steps = 0;
    double seconds = 0;               ///< of training until then
    std::string after;                ///< "1,500 of 3,000 steps", "5 s"
    std::string protocol = {};        ///< how the figures came about
    ImageScore mean = {};             ///< over the test images
    std::vector<double> regions = {}; ///< mean PSNR in the order of region_names(), dB; NaN where no image shows one
    Json images = Json::array();      ///< figures of each image
};

/// What a run took. Counts are of one pass over all Gaussians; a table's entry is one row of features.
struct RunCost {
    std::size_t gaussians = 0;
    std::uint64_t memory = 0;             ///< bytes resident at the end of training, the capture among them
    std::size_t lookups = 0;              ///< table rows that the fields of colour and displacement read
    std::size_t entries = 0, touched = 0; ///< of their tables; some Gaussian refers to the touched ones
    std::size_t ao_entries = 0, ao_touched = 0;
    double ms_per_step = 0;
    std::vector<std::pair<std::string, double>> ms_per_stage = {}; ///< empty where stages are not timed
    std::size_t threads = 0;
};

struct RunResult {
    std::string name;   ///< in tables: "paper", "paper, refined"
    std::string config; ///< the name of the configuration alone
    Json settings;      ///< names and values, as text
    RunCost cost = {};
    std::vector<Mark> marks = {};
    std::vector<std::string> shown = {}; ///< views there are pictures of
    std::filesystem::path folder = {};   ///< where they are; not in the file
};

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// JSON has no NaN and no infinity; number_or_null writes null for either.
inline double number_of(const Json& json) {
    return json.is_null() ? std::nan("") : json.get<double>();
}

} // namespace detail

inline Json mark_json(const Mark& mark) {
    Json json{{"after", mark.after},
              {"steps", mark.steps},
              {"seconds", mark.seconds},
              {"psnr", number_or_null(mark.mean.psnr)},
              {"ssim", number_or_null(mark.mean.ssim)},
              {"psnr_person", number_or_null(mark.mean.psnr_person)}};
    for (std::size_t r = 0; r < mark.regions.size(); ++r)
        json["psnr_regions"][region_names()[r]] = number_or_null(mark.regions[r]);
    if (mark.mean.lpips) json["lpips"] = number_or_null(*mark.mean.lpips);
    json["protocol"] = mark.protocol;
    json["images"] = mark.images;
    return json;
}

inline Mark mark_of(const Json& json) {
    Mark mark{.steps = json.at("steps"),
              .seconds = json.at("seconds"),
              .after = json.at("after"),
              .protocol = json.at("protocol"),
              .mean = {.name = "mean"},
              .images = json.at("images")};
    mark.mean.psnr = detail::number_of(json.at("psnr"));
    mark.mean.ssim = detail::number_of(json.at("ssim"));
    mark.mean.psnr_person = detail::number_of(json.at("psnr_person"));
    for (const std::string& region : region_names())
        mark.regions.push_back(detail::number_of(json.at("psnr_regions").at(region)));
    if (json.contains("lpips")) mark.mean.lpips = detail::number_of(json.at("lpips"));
    return mark;
}

inline Json cost_json(const RunCost& cost) {
    Json json{{"gaussians", cost.gaussians},
              {"memory_bytes", cost.memory},
              {"lookups", cost.lookups},
              {"entries", cost.entries},
              {"touched_entries", cost.touched},
              {"ao_entries", cost.ao_entries},
              {"ao_touched_entries", cost.ao_touched},
              {"ms_per_step", number_or_null(cost.ms_per_step)},
              {"threads", cost.threads}};
    json["ms_per_stage"] = Json::object();
    for (const auto& [stage, ms] : cost.ms_per_stage) json["ms_per_stage"][stage] = number_or_null(ms);
    return json;
}

inline RunCost cost_of(const Json& json) {
    RunCost cost{.gaussians = json.at("gaussians"),
                 .memory = json.at("memory_bytes"),
                 .lookups = json.at("lookups"),
                 .entries = json.at("entries"),
                 .touched = json.at("touched_entries"),
                 .ao_entries = json.at("ao_entries"),
                 .ao_touched = json.at("ao_touched_entries"),
                 .ms_per_step = detail::number_of(json.at("ms_per_step")),
                 .threads = json.at("threads")};
    for (const auto& [stage, ms] : json.at("ms_per_stage").items())
        cost.ms_per_stage.emplace_back(stage, detail::number_of(ms));
    return cost;
}

inline Json result_json(const RunResult& result) {
    Json json{{"name", result.name}, {"configuration", result.config}, {"cost", cost_json(result.cost)}};
    json["marks"] = Json::array();
    for (const Mark& mark : result.marks) json["marks"].push_back(mark_json(mark));
    json["shown"] = result.shown;
    json["settings"] = result.settings;
    return json;
}

inline RunResult result_of(const Json& json) {
    RunResult result{.name = json.at("name"),
                     .config = json.at("configuration"),
                     .settings = json.at("settings"),
                     .cost = cost_of(json.at("cost")),
                     .shown = json.at("shown")};
    for (const Json& mark : json.at("marks")) result.marks.push_back(mark_of(mark));
    return result;
}

/// Reads a file of ours with `parse`.
/// Errors  IoError naming the file, if it is not what gsh-evaluate wrote.
template <class Parse>
auto read_own_json(const std::filesystem::path& path, const Parse& parse) {
    const Json json = gsh::detail::read_json(path);
    try {
        return parse(json);
    } catch (const nlohmann::json::exception& error) {
        throw IoError(path.string() + ": is not as gsh-evaluate writes it: " + error.what() +
                      "; delete its folder to run that again");
    }
}

/// Names may come from files and folders, which may be called anything; JSON is UTF-8.
inline void write_json(const std::filesystem::path& path, const Json& json) {
    write_file(path, json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n");
}

} // namespace gsh::examples
