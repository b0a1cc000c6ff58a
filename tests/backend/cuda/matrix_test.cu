// SPDX-License-Identifier: Apache-2.0
/// @file  Products of small matrices by a warp, and transposes, by tensor cores or what stands in for them.
#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/matrix.cuh>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"
#include "support/gradient.hpp"

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

namespace cuda_matrix { // joined builds: other tests have helpers of the same names

using namespace gsh;
using cuda::Device;

/// A bf16 number that has few bits, so that sums of products are exact.
float small_number(test::Rng& rng) {
    return static_cast<float>(static_cast<int>(rng.uniform(-8, 8))) / 4;
}
std::uint32_t bf16_bits(float value) {
    std::uint32_t bits;
    std::memcpy(&bits, &value, sizeof bits);
    return bits >> 16;
}

/// One warp multiplies matrices stored by rows: a [16, 16], b [16, 8], c [16, 8].
struct MultiplyAdd {
    static constexpr unsigned block_size = 32;
    Span<const std::uint32_t> a, b; // bits of bf16, one number each
    Span<float> c;
    bool by_shuffles;

    __device__ void operator()() const {
        const unsigned g = threadIdx.x / 4, t = threadIdx.x % 4;
        const auto of_a = [&](unsigned row, unsigned column) {
            return a[16 * row + column] | a[16 * row + column + 1] << 16;
        };
        const auto of_b = [&](unsigned row) { return b[8 * row + g] | b[8 * (row + 1) + g] << 16; };
        const cuda::MatrixA left{{of_a(g, 2 * t), of_a(g + 8, 2 * t), of_a(g, 2 * t + 8), of_a(g + 8, 2 * t + 8)}};
        const cuda::MatrixB right{{of_b(2 * t), of_b(2 * t + 8)}};
        const unsigned first = 8 * g + 2 * t, second = first + 64;
        cuda::MatrixC sum{{c[first], c[first + 1], c[second], c[second + 1]}};
        if (by_shuffles)
            cuda::detail::multiply_add_by_shuffles(sum, left, right);
        else
            cuda::multiply_add(sum, left, right);
        c[first] = sum.values[0], c[first + 1] = sum.values[1];
        c[second] = sum.values[2], c[second + 1] = sum.values[3];
    }
};

/// words [32] of an 8 x 8 matrix, a word of lane 4 g + t has (row g, columns 2 t and 2 t + 1).
struct Transpose {
    static constexpr unsigned block_size = 32;
    Span<std::uint32_t> words;
    __device__ void operator()() const { words[threadIdx.x] = cuda::transposed(words[threadIdx.x]); }
};

TEST_CASE("a warp multiplies matrices of bf16 and adds, by its instruction and by shuffles") {
    if (test::skip_without_device()) return;
    Device device;
    test::Rng rng(12);
    std::vector<std::uint32_t> a, b;
    std::vector<float> c, expected(16 * 8);
    std::vector<float> left, right;
    for (int i = 0; i < 16 * 16; ++i) left.push_back(small_number(rng)), a.push_back(bf16_bits(left.back()));
    for (int i = 0; i < 16 * 8; ++i) right.push_back(small_number(rng)), b.push_back(bf16_bits(right.back()));
    for (int i = 0; i < 16 * 8; ++i) c.push_back(small_number(rng));
    for (std::size_t row = 0; row < 16; ++row)
        for (std::size_t column = 0; column < 8; ++column) {
            float& sum = expected[8 * row + column];
            sum = c[8 * row + column];
            for (std::size_t k = 0; k < 16; ++k) sum += left[16 * row + k] * right[8 * k + column];
        }
    Device::Buffer<std::uint32_t> device_a(a.size()), device_b(b.size());
    Device::Buffer<float> device_c(c.size());
    device.upload(Span<const std::uint32_t>(a), Span<std::uint32_t>(device_a));
    device.upload(Span<const std::uint32_t>(b), Span<std::uint32_t>(device_b));
    for (const bool by_shuffles : {false, true}) {
        CAPTURE(by_shuffles);
        device.upload(Span<const float>(c), Span<float>(device_c));
        device.launch(1, MultiplyAdd{device_a, device_b, device_c, by_shuffles});
        std::vector<float> found(c.size());
        device.download(Span<const float>(device_c), Span<float>(found));
        CHECK(found == expected);
    }
}

TEST_CASE("a warp transposes a matrix of 16-bit numbers") {
    if (test::skip_without_device()) return;
    Device device;
    std::vector<std::uint32_t> words(32);
    for (std::uint32_t row = 0; row < 8; ++row)
        for (std::uint32_t pair = 0; pair < 4; ++pair) {
            const std::uint32_t number = 8 * row + 2 * pair;
            words[4 * row + pair] = number | (number + 1) << 16;
        }
    Device::Buffer<std::uint32_t> buffer(32);
    device.upload(Span<const std::uint32_t>(words), Span<std::uint32_t>(buffer));
    device.launch(1, Transpose{buffer});
    device.download(Span<const std::uint32_t>(buffer), Span<std::uint32_t>(words));
    for (std::uint32_t row = 0; row < 8; ++row)
        for (std::uint32_t column = 0; column < 8; ++column)
            CHECK((words[4 * row + column / 2] >> (16 * (column % 2)) & 0xFFFF) == 8 * column + row);
}

} // namespace cuda_matrix
