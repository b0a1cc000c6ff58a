// SPDX-License-Identifier: Apache-2.0
/// @file  Which runs gsh-evaluate is asked for, and the folder that keeps what is done of them.
#pragma once

#include "support/evaluation_result.hpp"
#include "support/figures.hpp"
#include "support/reconstruct_options.hpp"

#include <gsh/train/configuration.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
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

/// The runs that the options ask for, in their order; the same one is asked for once.
/// Errors  ValueError for a configuration, a setting or a budget that there is not, or options that exclude each other.
[[nodiscard]] std::vector<Run> planned_runs(const EvaluateOptions& o);

/// The folder of an evaluation: evaluation.json says of what input it is and which runs there were, in their order;
/// runs/KEY/ keeps each, a finished one as result.json with a row picture per shown view.
class EvaluationFolder {
public:
    /// Errors  ValueError if the folder is of another input.
    explicit EvaluationFolder(const EvaluateOptions& o);

    /// Puts a run on the list.
    void add(const Run& run);

    /// Whether a run is finished, with its present settings and all its marks.
    [[nodiscard]] bool has(const Run& run) const;

    /// Whether there is a result of a run, with whatever settings and marks.
    [[nodiscard]] bool has_outdated(const Run& run) const { return !has(run) && read(run.key); }

    /// What is finished, of this call and of earlier ones, in the order in which it was first asked for.
    [[nodiscard]] std::vector<RunResult> results() const;
    [[nodiscard]] std::filesystem::path path(const std::string& name) const { return folder_ / name; }

private:
    [[nodiscard]] std::filesystem::path index() const { return folder_ / "evaluation.json"; }
    [[nodiscard]] std::optional<RunResult> read(const std::string& key) const;

    std::filesystem::path folder_;
    std::vector<std::pair<std::string, std::string>> input_;
    std::vector<std::string> keys_;
};

} // namespace gsh::examples
