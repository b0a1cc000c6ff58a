// SPDX-License-Identifier: Apache-2.0
#include "common/gpu.hpp"

#include <gsh/backend/cuda/device.cuh>

namespace gsh::programs {

bool has_cuda() {
    return true;
}

std::shared_ptr<cuda::Device> open_gpu(int number, bool mixed) {
    const auto gpu = std::make_shared<cuda::Device>(number);
    gpu->set_precision(mixed ? Precision::mixed : Precision::fp32);
    return gpu;
}
std::string name_of(const cuda::Device& gpu) {
    return gpu.gpu();
}
std::uint64_t peak_memory_of(const cuda::Device& gpu) {
    return gpu.peak_memory();
}

} // namespace gsh::programs
