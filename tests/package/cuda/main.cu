// SPDX-License-Identifier: Apache-2.0
/// @file  A user's program: numbers are doubled on a GPU, if there is one.
#include <gsh/cuda.cuh>

#include <cstdio>
#include <vector>

std::vector<float> doubled_in_second_source(gsh::cuda::Device& device, const std::vector<float>& values);

int main() {
    if (!gsh::cuda::Device::available()) {
        std::puts("no GPU answers");
        return 0;
    }
    gsh::cuda::Device device;
    const std::vector<float> result = doubled_in_second_source(device, std::vector<float>(1000, 1.5f));
    return result == std::vector<float>(1000, 3.0f) ? 0 : 1;
}
