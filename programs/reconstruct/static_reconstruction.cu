// SPDX-License-Identifier: Apache-2.0
#include "common/gpu.hpp"

#include <gsh/cuda.cuh>
#include <gsh/reconstruct/static_reconstruction.hpp>

#include <utility>

namespace gsh::programs {

std::unique_ptr<AnyStaticReconstruction> static_reconstruction_on(cuda::Device& gpu, StaticSetup&& setup) {
    return std::make_unique<StaticReconstruction<cuda::Device>>(gpu, std::move(setup));
}

} // namespace gsh::programs
