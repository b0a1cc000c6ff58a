// SPDX-License-Identifier: Apache-2.0
/// @file  Gradients of several trainings of one model, each with its own photographs, added up before a step.
#pragma once

#include <gsh/core/span.hpp>
#include <gsh/learn/learned_array.hpp>
#include <gsh/optim/adam.hpp>

#include <concepts>
#include <cstdint>

namespace gsh {

/// What connects ranks: the processes or threads that train copies of one model. add_up(numbers) replaces each number
/// of an array by its sum over all ranks, and returns when the result is there. All ranks call it for the same arrays
/// in the same order. The sum must have the same bits on every rank, or the copies part. The array is in the memory of
/// the ranks' backend.
template <class C, class T>
concept Communicator = requires(C& ranks, Span<T> numbers) { ranks.add_up(numbers); };

/// An optimiser (ArrayOptimizer) that takes a step with the sum of all ranks' gradients: Trainer's argument `optimizer`
/// for data-parallel training. The ranks begin with the same model, and have the same number of Gaussians at each step.
/// The rows of a table that can receive a gradient follow from the Gaussians, so they are the same, too. Each rank has
/// photographs of its own, whose gains (PhotoGains) it learns alone.
///
/// A backend that records its steps needs a communicator whose work can be recorded.
template <class Ranks, class Optimizer = Adam>
struct SummedGradients {
    Ranks* ranks = nullptr; ///< must outlive the training
    Optimizer optimizer = {};
};

/// Adds up the gradients, array by array in their order, then takes the step of each array.
template <Backend B, class Ranks, class Optimizer, class T>
    requires Communicator<Ranks, T> && ArrayOptimizer<Optimizer, B, T>
void take_steps(B& backend, const SummedGradients<Ranks, Optimizer>& summed, const LearnedArrays<T>& arrays,
                double factor, std::int64_t step_number) {
    for (const LearnedArray<T>& array : arrays)
        if (!array.gradient.empty()) summed.ranks->add_up(array.gradient);
    take_steps(backend, summed.optimizer, arrays, factor, step_number);
}

} // namespace gsh
