// SPDX-License-Identifier: Apache-2.0
/// @file  Learning rates over time.
#pragma once

#include <cmath>
#include <cstdint>

namespace gsh {

/// A learning rate that is zero until `start`, then `initial`, decaying geometrically to `final` over `decay_steps`.
///
/// Units   steps count from 0; decay_steps = 0 keeps the rate constant.
struct Schedule {
    double initial = 0;
    double final = initial;       ///< reached decay_steps after start, and kept
    std::int64_t decay_steps = 0; ///< 0: constant
    std::int64_t start = 0;       ///< before this step the rate is zero

    [[nodiscard]] static Schedule constant(double rate, std::int64_t start = 0) { return {rate, rate, 0, start}; }
    [[nodiscard]] static Schedule exponential(double initial, double final, std::int64_t decay_steps,
                                              std::int64_t start = 0) {
        return {initial, final, decay_steps, start};
    }

    [[nodiscard]] bool active(std::int64_t step) const { return step >= start; }

    [[nodiscard]] double rate(std::int64_t step) const {
        if (!active(step)) return 0;
        if (decay_steps <= 0 || initial <= 0 || final <= 0) return initial;
        if (step - start >= decay_steps) return final;
        const double fraction = static_cast<double>(step - start) / static_cast<double>(decay_steps);
        return initial * std::pow(final / initial, fraction);
    }

    /// Number of updates up to and including this step, as the bias correction of Adam requires it.
    [[nodiscard]] std::int64_t update_number(std::int64_t step) const { return active(step) ? step - start + 1 : 0; }
};

} // namespace gsh
