// SPDX-License-Identifier: Apache-2.0
/// @file  The course of a training: its length so far, its curves, and the time of its stages.
#pragma once

#include <gsh/train/stage.hpp>
#include <gsh/train/step_history.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace gsh {

/// The course of a training, for reports and for resuming.
struct TrainingRecord {
    std::uint64_t steps = 0;
    std::uint64_t saved = 0;                                ///< step of the last checkpoint; 0: there is none
    double seconds = 0;                                     ///< of training only
    std::uint64_t interval = 10;                            ///< steps between samples
    std::vector<std::pair<double, double>> loss, psnr;      ///< (step, value) of the step's training view
    std::array<double, stage_names.size()> stage_seconds{}; ///< in the order of Stage
    std::uint64_t timed_steps = 0;                          ///< number of steps in stage_seconds

    /// Adds the figures of a step if a sample is due: at the first step and at multiples of the interval. When a curve
    /// becomes long, every second sample but the first is removed, so that it has at most a few hundred points.
    void add(const StepValues& values) {
        if (values.step != 1 && values.step % interval != 0) return;
        loss.emplace_back(static_cast<double>(values.step), values.loss);
        psnr.emplace_back(static_cast<double>(values.step), values.psnr);
        constexpr std::size_t most = 600;
        if (loss.size() < most) return;
        interval *= 2;
        for (auto* curve : {&loss, &psnr})
            std::erase_if(*curve, [&](const auto& point) {
                return point.first != 1 && static_cast<std::uint64_t>(point.first) % interval != 0;
            });
    }
};

} // namespace gsh
