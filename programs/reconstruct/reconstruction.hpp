// SPDX-License-Identifier: Apache-2.0
/// @file  The stages of a reconstruction on the machine, compiled once for all programs.
#pragma once

#include <gsh/reconstruct/any_reconstruction.hpp>
#include <gsh/reconstruct/input.hpp>
#include <gsh/reconstruct/recipe.hpp>
#include <gsh/reconstruct/setup.hpp>

#include <memory>

namespace gsh::programs {

class Machine;

/// register_people on the machine, shown as a line of progress.
void register_shown(Machine& machine, ReconstructionInput& input, const Recipe& recipe);

/// make_setup for the machine, shown as a line of progress.
ReconstructionSetup make_setup(Machine& machine, const ReconstructionInput& input, const Recipe& recipe);

/// A reconstruction on the machine's backend, initialised for the first step. The machine must outlive it.
std::unique_ptr<AnyReconstruction> make_reconstruction(Machine& machine, ReconstructionSetup setup);

} // namespace gsh::programs
