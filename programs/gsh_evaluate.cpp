// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-evaluate: compares configurations on a capture: quality, contribution of each part, cost.
///
/// 1. List the runs: one per configuration, or one per configuration and budget in seconds.
/// 2. Load the capture and check that it has test views.
/// 3. Train and evaluate each run that is not finished. Continue a run that was interrupted.
/// 4. After each run, write tables, picture grids and a page with all finished results.

#include "common/figures.hpp"
#include "common/machine.hpp"
#include "common/program.hpp"
#include "evaluate/evaluation_report.hpp"
#include "evaluate/evaluation_runs.hpp"
#include "evaluate/evaluation_tables.hpp"
#include "evaluate/evaluator.hpp"
#include "reconstruct/load_input.hpp"
#include "reconstruct/reconstruct_command.hpp"
#include "reconstruct/reconstruct_options.hpp"
#include "reconstruct/reconstruction.hpp"

#include <cstddef>
#include <cstdio>
#include <new>
#include <string>
#include <vector>

using namespace gsh;
using namespace gsh::programs;

namespace {

void add_options(CLI::App& app, EvaluateOptions& o) {
    ReconstructOptions& common = o.common;
    common.gaussians = 170000, common.checkpoint_interval = 60;
    app.add_option("--capture", common.capture, "folder with images/, cameras.json and poses")->required();
    add_people(app, common);
    app.add_option("--configs", o.configs,
                   "configurations by name or as JSON files, separated by commas; static: one frame, no body")
        ->required()
        ->delimiter(',');
    app.add_option("--out", common.out, "folder for the results; finished runs in it are kept")->required();
    auto* steps = app.add_option("--steps", o.steps,
                                 "number of steps after which to evaluate (default 3000); of several numbers, "
                                 "separated by commas, the largest is the length of the run");
    steps->delimiter(',')->check(above_zero());
    app.add_option("--budgets", o.budgets, "duration of training instead of --steps, one run for each: 5s,30s,2min")
        ->delimiter(',')
        ->excludes(steps);
    app.add_option("--gaussians", common.gaussians, "number of Gaussians (default 170000)")
        ->check(CLI::Range(1, 100'000'000));
    app.add_option("--seed", common.seed, "seed of all random choices (default 0)")->check(not_negative());
    add_backend(app, common.machine);
    add_image_memory(app, common);
    add_refine(app, common);
    add_hold_out(app, common);
    add_lpips(app, common);
    app.add_option("--regions", common.regions, "JSON lists of face and hand vertices, or importance per vertex");
    app.add_option("--priors", common.priors,
                   "JSON list of an estimator's normal and depth maps, for configurations with priors");
    app.add_option("--set", common.set, "change a setting of all these configurations, key=value; may be repeated");
    app.add_option("--frame", common.frame, "frame for the configuration static (default 0)");
    app.add_option("--views", o.views, "number of test views in the pictures (default 4)")->check(CLI::Range(0, 1000));
    app.add_option("--checkpoint-interval", common.checkpoint_interval, "seconds between checkpoints (default 60)")
        ->check(above_zero());
}

/// One line with the figures of a run's last mark.
std::string summary(const RunResult& result) {
    const ImageScore& mean = result.marks.back().mean;
    std::string text = result.name + ", " + result.marks.back().after + ": PSNR " + fixed(mean.psnr, 2) + " dB, SSIM " +
                       fixed(mean.ssim, 4);
    for (std::size_t r = 0; r < result.marks.back().regions.size(); ++r)
        text += ", " + region_names()[r] + " " + fixed(result.marks.back().regions[r], 2);
    return text;
}

int evaluate(const EvaluateOptions& o) {
    check_companions(o.common);
    check_body(o.common);
    Machine machine(o.common.machine);
    const std::vector<Run> runs = planned_runs(o);
    EvaluationFolder folder(o);
    ReconstructionInput input = load_input(machine.host(), o.common);
    const bool registers =
        o.common.refine && !o.common.no_registration &&
        std::any_of(runs.begin(), runs.end(), [&](const Run& run) { return !run.scene && !folder.has(run); });
    if (registers) register_shown(machine, input, recipe_of(o.common, {}));
    Evaluator evaluator(machine, input, o);
    for (const Run& run : runs) evaluator.check(run);
    for (const std::string& warning : input.warnings) warn(warning);
    watch_interrupts();

    std::vector<RunResult> results; // those that are written
    const auto write = [&] {
        results = folder.results();
        write_evaluation(folder, input.capture.name, evaluator.views(), evaluator.test_photos(), results);
    };
    for (std::size_t i = 0; i < runs.size(); ++i) {
        const Run& run = runs[i];
        if (folder.has(run)) {
            Evaluator::discard_rest(run);
            std::printf("%s: is finished already\n", run.name.c_str());
            continue;
        }
        if (folder.has_outdated(run))
            std::printf("%s: was judged with other settings or after other steps; it runs again\n", run.name.c_str());
        std::fflush(stdout);
        if (!evaluator.evaluate(run, folder,
                                run.name + " (" + std::to_string(i + 1) + " of " + std::to_string(runs.size()) + ")")) {
            std::fprintf(stderr, "stopped; the same command continues from there\n");
            return exit_interrupted;
        }
        for (const RunResult& result : folder.results())
            if (result.folder == run.options.out) std::printf("%s\n", summary(result).c_str());
        write();
    }
    if (results.empty()) write(); // all were finished already
    std::printf("\n%sresults in %s\n", markdown_tables(results).c_str(), o.common.out.c_str());
    return exit_done;
}

} // namespace

int main(int argc, char** argv) try {
    EvaluateOptions options;
    CLI::App app("Compares configurations on a capture and writes tables, pictures and a page.", "gsh-evaluate");
    add_options(app, options);
    return run_program(app, argc, argv, [&] {
        complete_poses(options.common);
        return evaluate(options);
    });
} catch (const std::bad_alloc&) {
    return refuse_without_memory("gsh-evaluate");
}
