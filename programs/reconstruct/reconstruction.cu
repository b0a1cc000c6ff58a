// SPDX-License-Identifier: Apache-2.0
#include "common/gpu.hpp"

#include <gsh/cuda.cuh>
#include <gsh/reconstruct/reconstruction.hpp>

#include <utility>

namespace gsh::programs {

std::unique_ptr<AnyReconstruction> reconstruction_on(cuda::Device& gpu, ReconstructionSetup&& setup) {
    return std::make_unique<Reconstruction<cuda::Device>>(gpu, std::move(setup));
}

} // namespace gsh::programs
