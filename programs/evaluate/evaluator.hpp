// SPDX-License-Identifier: Apache-2.0
/// @file  Training and evaluation of the runs of gsh-evaluate; they can be interrupted and continued.
#pragma once

#include "common/output_folder.hpp"
#include "evaluate/evaluation_pictures.hpp"
#include "evaluate/evaluation_result.hpp"
#include "reconstruct/load_input.hpp"

#include <gsh/photo/photo.hpp>
#include <gsh/train/evaluation.hpp>

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace gsh {
struct StaticPhotos;
} // namespace gsh

namespace gsh::programs {

class EvaluationFolder;
class Machine;
struct EvaluateOptions;
struct Run;

/// Trains and evaluates runs on one input. Input and machine must outlive it.
class Evaluator {
public:
    /// Errors  ValueError for a capture without test views.
    Evaluator(Machine& machine, const ReconstructionInput& input, const EvaluateOptions& o);

    [[nodiscard]] const std::vector<Photo>& test_photos() const { return test_photos_; }
    [[nodiscard]] const std::vector<ShownView>& views() const { return views_; }

    /// Checks the frame of a `static` run.
    /// Errors  ValueError if it does not have at least two training cameras and one test camera.
    void check(const Run& run) const;

    /// Trains, or continues training, then writes result.json with its pictures. Returns false after an interrupt. The
    /// progress up to then is kept, except for `static`.
    bool evaluate(const Run& run, EvaluationFolder& folder, const std::string& title);

    /// Removes what a call left that was killed after it had written the run's result: checkpoints, for instance.
    static void discard_rest(const Run& run);

private:
    bool evaluate_avatar(const Run& run, EvaluationFolder& folder, const std::string& title);
    bool evaluate_scene(const Run& run, EvaluationFolder& folder, const std::string& title);

    /// Computes the figures of a mark, and writes pictures if `out` is not null. Returns false after an interrupt.
    template <class Trained>
    bool judge(Trained& trained, const std::vector<Photo>& photos, const std::optional<MotionSplit>& split, Mark& mark,
               OutputFolder* out, RunResult& result);

    [[nodiscard]] StaticPhotos scene_of(const Run& run) const;

    Machine& machine_;
    const ReconstructionInput& input_;
    Judge<cpu::Threads> judge_;
    std::vector<Photo> test_photos_;
    std::vector<ShownView> views_;
};

} // namespace gsh::programs
