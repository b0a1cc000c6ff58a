// SPDX-License-Identifier: Apache-2.0
/// @file  Training and judging the runs of gsh-evaluate, with what it takes to be interrupted.
#pragma once

#include "support/evaluation_pictures.hpp"
#include "support/evaluation_result.hpp"
#include "support/judgement.hpp"
#include "support/output_folder.hpp"
#include "support/source.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/loss/cpu/lpips.hpp>
#include <gsh/pipeline/photo.hpp>

#include <cstddef>
#include <string>
#include <vector>

namespace gsh::examples {

class EvaluationFolder;
struct EvaluateOptions;
struct Run;
struct StaticSource;

/// Trains and judges runs on one source.
class Evaluator {
public:
    /// Errors  ValueError for a capture without test views.
    Evaluator(cpu::Threads& backend, const Source& source, const EvaluateOptions& o);

    [[nodiscard]] const std::vector<Photo>& test_photos() const { return test_photos_; }
    [[nodiscard]] const std::vector<ShownView>& views() const { return views_; }

    /// Frames of `static` must have cameras on all sides.
    void check(const Run& run) const;

    /// Trains, or goes on training, and leaves result.json with its pictures. False if somebody interrupted; what is
    /// done until then is kept, but for `static`.
    bool evaluate(const Run& run, EvaluationFolder& folder, const std::string& title);

private:
    bool evaluate_avatar(const Run& run, EvaluationFolder& folder, const std::string& title);
    bool evaluate_scene(const Run& run, EvaluationFolder& folder, const std::string& title);

    /// Figures of a mark, and pictures if there is where to put them. False if somebody interrupted.
    template <class Trained>
    bool judge(Trained& trained, const std::vector<Photo>& photos, Mark& mark, OutputFolder* out, RunResult& result);

    [[nodiscard]] StaticSource scene_of(const Run& run) const;

    cpu::Threads& backend_;
    const Source& source_;
    Judge judge_;
    std::vector<Photo> test_photos_;
    std::vector<ShownView> views_;
};

} // namespace gsh::examples
