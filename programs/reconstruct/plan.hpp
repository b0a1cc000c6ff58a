// SPDX-License-Identifier: Apache-2.0
/// @file  --plan: what a reconstruction will take, as JSON, for schedulers that ask for memory and time in advance.
#pragma once

#include "common/figures.hpp"
#include "reconstruct/reconstruct_options.hpp"

#include <gsh/reconstruct/plan.hpp>
#include <gsh/reconstruct/recipe.hpp>

#include <cstddef>

namespace gsh::programs {

/// Expected seconds of the stages of a run.
struct StageSeconds {
    double load = 0;         ///< of the capture
    double registration = 0; ///< of poses, with --refine
    double training = 0;
    double results = 0; ///< test images and files; with --refine also the fit of test poses

    [[nodiscard]] double total() const { return load + registration + training + results; }
};

/// The seconds that a plan takes on `threads` threads, or with a GPU. `load_seconds` is what loading took here. Costs
/// per Gaussian, pixel and image were measured on two cores of an AMD EPYC (Zen 5), and on an H100; docs/programs.md
/// states how near the result comes.
[[nodiscard]] StageSeconds expected_seconds(const ReconstructionPlan& plan, const Recipe& recipe, std::size_t threads,
                                            bool on_gpu, double load_seconds);

/// Loads the input of the options, and prints its plan as JSON. Nothing is written.
/// Errors  those of load_input and of plan_reconstruction.
int print_plan(const ReconstructOptions& options);

} // namespace gsh::programs
