// SPDX-License-Identifier: Apache-2.0
#include "common/gpu.hpp"
#include "reconstruct/static_reconstruction_on.hpp"

#include <gsh/cuda.cuh>

#include <utility>

namespace gsh::programs {

std::unique_ptr<StaticReconstruction> static_reconstruction_on(cuda::Device& gpu, StaticSetup&& setup) {
    return std::make_unique<StaticReconstructionOn<cuda::Device>>(gpu, std::move(setup));
}

} // namespace gsh::programs
