// SPDX-License-Identifier: Apache-2.0
/// @file  Loads the input of a reconstruction or a check, and makes the recipe, from options.
#pragma once

#include "reconstruct/reconstruct_options.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/loss/lpips_network.hpp>
#include <gsh/reconstruct/input.hpp>
#include <gsh/reconstruct/judge.hpp>
#include <gsh/reconstruct/recipe.hpp>
#include <gsh/setup/configuration.hpp>

#include <optional>

namespace gsh::programs {

/// Loads the files that the options name. Without --image-memory, images take at most half of the machine's memory, and
/// at most how.image_memory.
/// Errors  those of the files.
ReconstructionInput load_people(cpu::Threads& backend, const PeopleOptions& o, const CaptureOptions& how = {});

/// The same with regions and estimated priors; or films the built-in actor.
ReconstructionInput load_input(cpu::Threads& backend, const ReconstructOptions& o);

/// The recipe of a run: its configuration, its length, refinement, limits. Light falls on triangles: if a person's body
/// has none, and neither --config nor --set requests light, the configuration is `paper` instead of the default, and the
/// input has a warning that states this.
Recipe recipe_for(const ReconstructOptions& o, ReconstructionInput& input);

/// The same with a configuration that is known.
Recipe recipe_of(const ReconstructOptions& o, Configuration configuration);

/// The weights of --lpips; nothing without the option.
std::optional<LpipsNetwork> lpips_of(const ReconstructOptions& o);

/// Judges by the measures that the options name.
Judge<cpu::Threads> judge_for(cpu::Threads& backend, const ReconstructionInput& input, const ReconstructOptions& o);

} // namespace gsh::programs
