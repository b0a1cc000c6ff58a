// SPDX-License-Identifier: Apache-2.0
#include "common/gpu.hpp"
#include "show/renderer_on.hpp"

#include <gsh/cuda.cuh>

namespace gsh::programs {

std::unique_ptr<Renderer> renderer_on(cuda::Device& gpu, const ShownPeople& people) {
    return std::make_unique<PeopleRenderer<cuda::Device>>(gpu, people);
}
std::unique_ptr<Renderer> renderer_on(cuda::Device& gpu, const GaussianCloud<float>& scene, const PixelFilter& filter) {
    return std::make_unique<CloudRenderer<cuda::Device>>(gpu, scene, filter);
}

} // namespace gsh::programs
