// SPDX-License-Identifier: Apache-2.0
#include "reconstruct/reconstruction.hpp"

#include "common/gpu.hpp"
#include "common/machine.hpp"
#include "common/rasterizer.hpp"
#include "common/shown_progress.hpp"

#include <gsh/cpu.hpp>
#include <gsh/reconstruct/reconstruction.hpp>
#include <gsh/reconstruct/register_people.hpp>

#include <utility>

namespace gsh::programs {

void register_shown(Machine& machine, ReconstructionInput& input, const Recipe& recipe) {
    const Observer progress = shown_progress();
    if (machine.has_gpu()) register_on(*machine.gpu(), machine.host(), input, recipe, progress);
    else register_people(machine.host(), input, recipe, progress);
}

ReconstructionSetup make_setup(Machine& machine, const ReconstructionInput& input, const Recipe& recipe) {
    return gsh::make_setup(machine.host(), input, recipe, shown_progress(), machine.has_gpu());
}

std::unique_ptr<AnyReconstruction> make_reconstruction(Machine& machine, ReconstructionSetup setup) {
    if (machine.has_gpu()) return reconstruction_on(*machine.gpu(), std::move(setup));
    return std::make_unique<Reconstruction<cpu::Threads>>(machine.host(), std::move(setup));
}

} // namespace gsh::programs
