// SPDX-License-Identifier: Apache-2.0
/// @file  The stored result of a run of gsh-evaluate: figures at one or more marks, and cost, as structs and as JSON.
#pragma once

#include "common/backend_option.hpp"
#include "common/figures.hpp"
#include "common/input_files.hpp"

#include <gsh/core/error.hpp>
#include <gsh/train/evaluation.hpp>

#include <nlohmann/json.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace gsh::programs {

/// Means of one of several people, over the images that show enough of that person.
struct PersonFigures {
    std::string name;
    PersonMean mean;
};

/// Figures at one point of a run.
struct Mark {
    std::uint64_t steps = 0;
    double seconds = 0;               ///< of training up to this point
    std::string after;                ///< "1,500 of 3,000 steps", "5 s"
    std::string protocol = {};        ///< how the figures were obtained
    ImageScore mean = {};             ///< over the test images
    std::vector<double> regions = {}; ///< mean PSNR in the order of region_names(), dB; NaN where no image shows one
    std::vector<PersonFigures> people = {}; ///< of each person, if there are several
    std::optional<SeenAndNew> motion = {};  ///< with --hold-out-motion
    Json images = Json::array();            ///< figures of each image
};

/// The cost of a run. Counts refer to one pass over all Gaussians. A table entry is one row of features.
struct RunCost {
    std::size_t gaussians = 0;
    std::uint64_t memory = 0;             ///< bytes resident at the end of training, including the capture
    std::size_t lookups = 0;              ///< table rows that the fields of colour and displacement read
    std::size_t entries = 0, touched = 0; ///< rows of these fields' tables; touched: read by at least one Gaussian
    std::size_t ao_entries = 0, ao_touched = 0;
    double ms_per_step = 0;
    std::vector<std::pair<std::string, double>> ms_per_stage = {}; ///< empty if stages are not timed
};

struct RunResult {
    std::string name;   ///< in tables: "paper", "paper, refined"
    std::string config; ///< the name of the configuration
    Json settings;      ///< names and values, as text
    ComputedOn computed_on = {};
    RunCost cost = {};
    std::vector<Mark> marks = {};
    std::vector<std::string> shown = {}; ///< names of the views that have pictures
    std::filesystem::path folder = {};   ///< folder of these pictures; not stored in the file
};

// -------------------------------------------------------------------------------------------------------------

Json mark_json(const Mark& mark);
Mark mark_of(const Json& json);

Json cost_json(const RunCost& cost);

Json result_json(const RunResult& result);
RunResult result_of(const Json& json);

/// Reads a file that gsh-evaluate wrote, with `parse`.
/// Errors  IoError naming the file, if its content is different.
template <class Parse>
auto read_own_json(const std::filesystem::path& path, const Parse& parse) {
    const Json json = json_of_file(path);
    try {
        return parse(json);
    } catch (const nlohmann::json::exception& error) {
        throw IoError(path.string() + ": is not in the form that gsh-evaluate writes: " + error.what() +
                      "; delete its folder to repeat this run");
    }
}

} // namespace gsh::programs
