// SPDX-License-Identifier: Apache-2.0
/// @file  From coarse to fine: with how many Gaussians a training begins, and when its field has taught enough.
#pragma once

#include <gsh/core/setting.hpp>

#include <bit>
#include <cstddef>

namespace gsh {

/// What a training works with during a part of the run.
struct TrainingStage {
    std::size_t stride = 1; ///< every stride-th Gaussian takes part
    bool stored = false;    ///< whether colours and displacements are stored with each Gaussian, and no field is read

    friend bool operator==(const TrainingStage&, const TrainingStage&) = default;
    /// Whether a training goes from `other` to this stage, and not back.
    [[nodiscard]] bool comes_after(const TrainingStage& other) const {
        return stride < other.stride || (stride == other.stride && stored > other.stored);
    }
};

/// The settings of a schedule. The defaults are none: all of everything from the first step to the last.
struct ScheduleParams {
    unsigned stride = 1; ///< a run begins with every stride-th Gaussian
    /// But with no fewer Gaussians of a person, if the run has as many. A step with fewer takes as long.
    std::size_t least_points = 10000;
    /// Share of the run after which all Gaussians take part. Before, their number doubles in equal intervals.
    double all_points = 0.5;
    /// Share of the run after which colours and displacements, which came from a field, are attributes of each
    /// Gaussian. 1: never.
    double stored = 1;

    /// The stage of a run with `points` Gaussians of which the share `progress` is over.
    [[nodiscard]] TrainingStage at(double progress, std::size_t points) const {
        int doublings = std::bit_width(stride) - 1;
        while (doublings > 0 && points >> doublings < least_points) --doublings;
        int left = doublings;
        while (left > 0 && progress >= all_points * (doublings - left + 1) / doublings) --left;
        return {.stride = std::size_t(1) << left, .stored = left == 0 && stored < 1 && progress >= stored};
    }

    template <class Self, class F>
    static void for_each_setting(Self& self, const F& f) {
        f("schedule.stride", self.stride, SettingRange::power_of_two());
        f("schedule.least_points", self.least_points, SettingRange::at_least(1));
        f("schedule.all_points", self.all_points, SettingRange::share());
        f("schedule.stored", self.stored, SettingRange::share());
    }
};

} // namespace gsh
