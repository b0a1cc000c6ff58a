// SPDX-License-Identifier: Apache-2.0
#include <gsh/cuda.cuh>

#include <cstddef>
#include <vector>

namespace {

struct Double {
    gsh::Span<float> values;
    __device__ void operator()(std::size_t i) const { values[i] *= 2; }
};

} // namespace

std::vector<float> doubled_in_second_source(gsh::cuda::Device& device, const std::vector<float>& values) {
    gsh::cuda::Buffer<float> buffer(values.size());
    device.upload(gsh::Span<const float>(values), gsh::Span<float>(buffer));
    device.for_each(values.size(), Double{buffer});
    std::vector<float> result(values.size());
    device.download(gsh::Span<const float>(buffer), gsh::Span<float>(result));
    return result;
}
