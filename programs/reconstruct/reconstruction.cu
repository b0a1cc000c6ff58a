// SPDX-License-Identifier: Apache-2.0
#include "common/gpu.hpp"

#include <gsh/cuda.cuh>
#include <gsh/reconstruct/reconstruction.hpp>
#include <gsh/reconstruct/register_people.hpp>

#include <utility>

namespace gsh::programs {

void register_on(cuda::Device& gpu, cpu::Threads& host, ReconstructionInput& input, const Recipe& recipe,
                 const Observer& observer) {
    register_people(gpu, host, input, recipe, observer);
}

std::unique_ptr<AnyReconstruction> reconstruction_on(cuda::Device& gpu, ReconstructionSetup&& setup) {
    return std::make_unique<Reconstruction<cuda::Device>>(gpu, std::move(setup));
}

} // namespace gsh::programs
