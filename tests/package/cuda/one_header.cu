// SPDX-License-Identifier: Apache-2.0
/// @file  A user's program with a single header of the CUDA backend, which compiles quickly.
#include <gsh/backend/cuda/device.cuh>

#include <cstdio>
#include <vector>

int main() {
    if (!gsh::cuda::Device::available()) {
        std::puts("no GPU answers");
        return 0;
    }
    gsh::cuda::Device device;
    const std::vector<float> values{1, 2, 3};
    gsh::cuda::Buffer<float> buffer(values.size());
    device.upload(gsh::Span<const float>(values), gsh::Span<float>(buffer));
    std::vector<float> result(values.size());
    device.download(gsh::Span<const float>(buffer), gsh::Span<float>(result));
    return result == values ? 0 : 1;
}
