// SPDX-License-Identifier: Apache-2.0
#include "support/gpu.hpp"

#include <gsh/backend/cuda/device.cuh>

namespace gsh::examples {

std::shared_ptr<cuda::Device> open_gpu(int number) {
    return std::make_shared<cuda::Device>(number);
}
std::string name_of(const cuda::Device& gpu) {
    return gpu.gpu();
}

} // namespace gsh::examples
