// SPDX-License-Identifier: Apache-2.0
/// @file  Minimises the energy of a motion over all of its frames at once.
#pragma once

#include <gsh/fit/motion_problem.hpp>
#include <gsh/math/bordered_band.hpp>

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <utility>

namespace gsh {

/// The course of a minimisation.
struct MotionDescent {
    double energy = 0; ///< at the end, per frame
    int steps = 0;     ///< that lowered it
    int solves = 0;    ///< of the normal equations
};

/// Minimises E by Levenberg-Marquardt steps, until one lowers it by less than the share `tolerance`.
///
/// Source  Levenberg, "A method for the solution of certain non-linear problems in least squares", 1944; the damping
///         multiplies the diagonal, as Marquardt, 1963.
template <std::same_as<double> Real = double> // see fit_motion
MotionDescent descend(MotionProblem& problem, MotionState& state, const MotionTerms& terms, int most_steps,
                      double tolerance) {
    problem.set_reference(state);
    BorderedBand system = problem.make_system(terms);
    double damping = 1e-2, energy = problem.evaluate(state, terms, &system);
    MotionDescent result;
    while (result.steps < most_steps) {
        bool accepted = false, done = false;
        for (int attempt = 0; attempt < 6 && !accepted; ++attempt) {
            ++result.solves;
            constexpr double floor = 1e-6; // of the diagonal: a number that nothing sees keeps its value
            MotionState next = problem.stepped(state, system.solve(damping, floor));
            const double next_energy = problem.evaluate(next, terms);
            if (!(next_energy < energy)) {
                damping *= 8;
                continue;
            }
            accepted = true;
            done = energy - next_energy < tolerance * energy;
            state = std::move(next), energy = next_energy;
            if (attempt == 0) damping = std::max(damping / 4, 1e-5); // else it has just been found
        }
        if (!accepted) break;
        ++result.steps;
        if (done || result.steps == most_steps) break;
        energy = problem.evaluate(state, terms, &system);
    }
    result.energy = energy / static_cast<double>(problem.frame_count());
    return result;
}

} // namespace gsh
