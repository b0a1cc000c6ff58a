// SPDX-License-Identifier: Apache-2.0
/// @file  The runs of a call of gsh-evaluate, and the folder that stores their results.
#pragma once

#include "common/figures.hpp"
#include "evaluate/evaluation_result.hpp"
#include "reconstruct/reconstruct_options.hpp"

#include <gsh/io/file/folder_lock.hpp>
#include <gsh/setup/configuration.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace gsh::programs {

struct EvaluateOptions {
    ReconstructOptions common; ///< shared by all runs; each run sets its own steps and seconds
    std::vector<std::string> configs;
    std::vector<std::uint64_t> steps; ///< marks in one run; the largest is its length
    std::vector<std::string> budgets; ///< "5s", "0.5min": one run for each
    std::size_t views = 4;            ///< number of test views that are shown as pictures
};

/// One training, evaluated at its end and optionally at earlier marks.
struct Run {
    std::string name;   ///< in tables: "paper", "paper, refined"
    std::string key;    ///< name of the folder: "paper-3000-steps"
    std::string config; ///< the name of the configuration, without --set
    Configuration configuration;
    bool scene = false;               ///< `static`: one frame, no body
    ReconstructOptions options;       ///< out is the run's folder
    std::vector<std::uint64_t> marks; ///< steps after which to evaluate, ascending; empty for a run by seconds
    Json settings;                    ///< names and values, as text

    [[nodiscard]] std::filesystem::path file(const std::string& file_name) const { return options.out / file_name; }
};

/// Whether settings are the same, in whatever order they are listed.
[[nodiscard]] bool same_settings(const Json& a, const Json& b);

/// The runs that the options request, in their order, without repetitions.
/// Errors  ValueError for an unknown configuration or setting, an invalid budget, or options that exclude each other.
[[nodiscard]] std::vector<Run> planned_runs(const EvaluateOptions& o);

/// The folder of an evaluation. evaluation.json lists the input and the runs in their order. runs/KEY/ belongs to one
/// run; for a finished one it has result.json and one row picture per shown view.
class EvaluationFolder {
public:
    /// Errors  ValueError if the folder belongs to another input; IoError if another process writes to it.
    explicit EvaluationFolder(const EvaluateOptions& o);

    /// Appends a run to the list.
    void add(const Run& run);

    /// True if a run is finished with its present settings and all its marks.
    [[nodiscard]] bool has(const Run& run) const;

    /// True if a run has a result with other settings or marks.
    [[nodiscard]] bool has_outdated(const Run& run) const { return !has(run) && read(run.key); }

    /// The finished results of this call and of earlier ones, in the order in which their runs were first requested.
    [[nodiscard]] std::vector<RunResult> results() const;
    [[nodiscard]] std::filesystem::path path(const std::string& name) const { return folder_ / name; }

private:
    [[nodiscard]] std::filesystem::path index() const { return folder_ / "evaluation.json"; }
    [[nodiscard]] std::optional<RunResult> read(const std::string& key) const;

    LockedFolder locked_;
    std::filesystem::path folder_;
    std::vector<std::pair<std::string, std::string>> input_;
    std::vector<std::string> keys_;
};

} // namespace gsh::programs
