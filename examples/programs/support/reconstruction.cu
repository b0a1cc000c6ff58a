// SPDX-License-Identifier: Apache-2.0
#include "support/gpu.hpp"
#include "support/reconstruction_on.hpp"

#include <gsh/cuda.cuh>

#include <utility>

namespace gsh::examples {

std::unique_ptr<Reconstruction> reconstruction_on(cuda::Device& gpu, ReconstructionSetup&& setup) {
    return std::make_unique<ReconstructionOn<cuda::Device>>(gpu, std::move(setup));
}

} // namespace gsh::examples
