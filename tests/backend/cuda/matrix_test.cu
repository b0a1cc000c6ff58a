// SPDX-License-Identifier: Apache-2.0
/// @file  Products of small matrices of bf16 and float by a warp, and transposes.
#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/matrix.cuh>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"
#include "support/gradient.hpp"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

namespace cuda_matrix { // joined builds: other tests have helpers of the same names

using namespace gsh;
using cuda::Device;
using cuda::SharedArray;

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
        if (by_shuffles) cuda::detail::multiply_add_by_shuffles(sum, left, right);
        else cuda::multiply_add(sum, left, right);
        c[first] = sum.values[0], c[first + 1] = sum.values[1];
        c[second] = sum.values[2], c[second + 1] = sum.values[3];
    }
};

/// One warp multiplies matrices of floats stored by rows: a [32, 8], b [8, 16], c [32, 16].
struct MultiplyAddFloats {
    static constexpr unsigned block_size = 32;
    Span<const float> a, b;
    Span<float> c;
    bool by_shuffles;

    __device__ void operator()() const {
        const unsigned g = threadIdx.x / 4, t = threadIdx.x % 4;
        constexpr unsigned first = 2; // rows of the sums that are not the product's
        float left[2][4], right[2][2], sums[first + 4][4];
        for (unsigned m = 0; m < 2; ++m)
            for (unsigned i = 0; i < 4; ++i) left[m][i] = a[8 * (16 * m + g + i % 2 * 8) + t + i / 2 * 4];
        for (unsigned n = 0; n < 2; ++n)
            for (unsigned i = 0; i < 2; ++i) right[n][i] = b[16 * (t + 4 * i) + 8 * n + g];
        const auto place = [&](unsigned i, unsigned j) { return 16 * (8 * i + g) + j / 2 * 8 + 2 * t + j % 2; };
        for (unsigned i = 0; i < 4; ++i)
            for (unsigned j = 0; j < 4; ++j) sums[first + i][j] = c[place(i, j)];
        if (by_shuffles) cuda::detail::multiply_add_by_shuffles(sums, left, right, first);
        else cuda::multiply_add(sums, left, right, first);
        for (unsigned i = 0; i < 4; ++i)
            for (unsigned j = 0; j < 4; ++j) c[place(i, j)] = sums[first + i][j];
    }
};

/// Stores rows of 16 words in shared memory, and reads the transposes of four 8 x 8 matrices: rows from 8 m on, columns
/// from 8 (3 - m) on.
struct Transpose {
    static constexpr unsigned block_size = 32, stride = 20; // words
    struct Shared {
        alignas(16) SharedArray<std::uint32_t, 32 * stride> rows;
    };
    Span<const std::uint32_t> from; ///< [32][16]
    Span<std::uint32_t> to;         ///< [32 lanes][4]

    __device__ void operator()(Shared& shared) const {
        for (unsigned i = 0; i < 16; ++i) shared.rows[threadIdx.x * stride + i] = from[threadIdx.x * 16 + i];
        __syncthreads();
        const cuda::MatrixA result =
            cuda::load_transposed(shared.rows, threadIdx.x * stride + 4 * (3 - threadIdx.x / 8));
        for (unsigned m = 0; m < 4; ++m) to[threadIdx.x * 4 + m] = result.words[m];
    }
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
        std::vector<float> found = downloaded(device, Span<const float>(device_c));
        CHECK(found == expected);
    }
}

/// c + a b by one warp.
std::vector<float> product(Device& device, const std::vector<float>& a, const std::vector<float>& b,
                           const std::vector<float>& c, bool by_shuffles) {
    Device::Buffer<float> device_a(a.size()), device_b(b.size()), device_c(c.size());
    device.upload(Span<const float>(a), Span<float>(device_a));
    device.upload(Span<const float>(b), Span<float>(device_b));
    device.upload(Span<const float>(c), Span<float>(device_c));
    device.launch(1, MultiplyAddFloats{device_a, device_b, device_c, by_shuffles});
    return downloaded(device, Span<const float>(device_c));
}

TEST_CASE("a warp multiplies matrices of floats and adds, to 2^-20 of the products") {
    if (test::skip_without_device()) return;
    Device device;
    test::Rng rng(13);
    std::vector<float> a(32 * 8), b(8 * 16), c(32 * 16);
    for (auto* numbers : {&a, &b, &c})
        for (float& x : *numbers) x = static_cast<float>(rng.uniform(-2, 2));
    for (const bool by_shuffles : {false, true}) {
        CAPTURE(by_shuffles);
        const std::vector<float> found = product(device, a, b, c, by_shuffles);
        for (std::size_t row = 0; row < 32; ++row)
            for (std::size_t column = 0; column < 16; ++column) {
                double sum = double(c[16 * row + column]), size = std::abs(sum);
                for (std::size_t k = 0; k < 8; ++k) {
                    const double product = double(a[8 * row + k]) * double(b[16 * k + column]);
                    sum += product, size += std::abs(product);
                }
                CHECK(std::abs(double(found[16 * row + column]) - sum) <= std::ldexp(size, -20));
            }
    }
}

#if defined(GSH_CUDA_EMULATION)
TEST_CASE("the emulation multiplies floats as tensor cores do: three products, of 11 bits of each part") {
    // The first row of a has one number and the first column of b another, and no sum is rounded.
    const auto multiply = [](double x, double y, bool by_shuffles) {
        Device device;
        std::vector<float> a(32 * 8), b(8 * 16);
        a[0] = static_cast<float>(x), b[0] = static_cast<float>(y);
        return double(product(device, a, b, std::vector<float>(32 * 16), by_shuffles)[0]);
    };
    const double x = 1 + std::ldexp(3, -13); // as 1 and 3 2^-13
    CHECK(multiply(x, x, false) == 1 + std::ldexp(6, -13));
    CHECK(multiply(x, x, true) == 1 + std::ldexp(6, -13) + std::ldexp(1, -23)); // with 9 2^-26, rounded

    const double y = 1 + std::ldexp(1, -11) - std::ldexp(1, -23); // as 1 and 2^-11 - 2^-23, which has 12 bits
    CHECK(multiply(y, 1, false) == y - std::ldexp(1, -23));
    CHECK(multiply(1, y, false) == y - std::ldexp(1, -23));
    CHECK(multiply(y, 1, true) == y);

    const double z = 1 + std::ldexp(3, -12); // as 1 + 2^-10 and -2^-12: the large part is the nearest
    CHECK(multiply(z, z, false) == 1 + std::ldexp(6, -12) + std::ldexp(1, -21)); // without 2^-24
}
#endif

TEST_CASE("a warp transposes four matrices of 16-bit numbers in shared memory") {
    if (test::skip_without_device()) return;
    Device device;
    const auto number = [](std::uint32_t row, std::uint32_t column) { return 256 * row + column; };
    std::vector<std::uint32_t> words, found(32 * 4);
    for (std::uint32_t row = 0; row < 32; ++row)
        for (std::uint32_t column = 0; column < 32; column += 2)
            words.push_back(number(row, column) | number(row, column + 1) << 16);
    Device::Buffer<std::uint32_t> from(words.size()), to(found.size());
    device.upload(Span<const std::uint32_t>(words), Span<std::uint32_t>(from));
    device.launch(1, Transpose{from, to});
    device.download(Span<const std::uint32_t>(to), Span<std::uint32_t>(found));
    for (std::uint32_t lane = 0; lane < 32; ++lane)
        for (std::uint32_t m = 0; m < 4; ++m) {
            CAPTURE(lane);
            CAPTURE(m);
            const std::uint32_t g = lane / 4, t = lane % 4, column = 8 * (3 - m) + g, row = 8 * m + 2 * t;
            CHECK(found[4 * lane + m] == (number(row, column) | number(row + 1, column) << 16));
        }
}

} // namespace cuda_matrix
