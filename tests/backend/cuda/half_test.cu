// SPDX-License-Identifier: Apache-2.0
/// @file  Numbers of 16 bits on the CUDA backend: each of them, and the rounding of numbers between them.
#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/half.cuh>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

using namespace gsh;

namespace {

/// Words to their two numbers, or two numbers to a word.
template <bool Bf16>
struct UnpackHalves {
    Span<const std::uint32_t> words;
    Span<float> numbers;
    __device__ void operator()(std::size_t i) const {
        numbers[2 * i] = Bf16 ? cuda::low_bf16(words[i]) : cuda::low_fp16(words[i]);
        numbers[2 * i + 1] = Bf16 ? cuda::high_bf16(words[i]) : cuda::high_fp16(words[i]);
    }
};
template <bool Bf16>
struct PackHalves {
    Span<const float> numbers;
    Span<std::uint32_t> words;
    __device__ void operator()(std::size_t i) const {
        const float low = numbers[2 * i], high = numbers[2 * i + 1];
        words[i] = Bf16 ? cuda::pack_bf16(low, high) : cuda::pack_fp16(low, high);
    }
};

template <bool Bf16>
std::vector<float> unpacked(const std::vector<std::uint16_t>& halves) {
    cuda::Device device;
    std::vector<std::uint32_t> words;
    for (std::size_t i = 0; i < halves.size(); i += 2) words.push_back(halves[i] | std::uint32_t(halves[i + 1]) << 16);
    cuda::Buffer<std::uint32_t> from(words.size());
    cuda::Buffer<float> to(halves.size());
    device.upload(Span<const std::uint32_t>(words), Span<std::uint32_t>(from));
    device.for_each(words.size(), UnpackHalves<Bf16>{from, to});
    return downloaded(device, Span<const float>(to));
}
template <bool Bf16>
std::vector<std::uint16_t> packed(const std::vector<float>& numbers) {
    cuda::Device device;
    cuda::Buffer<float> from(numbers.size());
    cuda::Buffer<std::uint32_t> to(numbers.size() / 2);
    device.upload(Span<const float>(numbers), Span<float>(from));
    device.for_each(to.size(), PackHalves<Bf16>{from, to});
    std::vector<std::uint32_t> words = downloaded(device, Span<const std::uint32_t>(to));
    std::vector<std::uint16_t> halves;
    for (const std::uint32_t word : words) {
        halves.push_back(static_cast<std::uint16_t>(word));
        halves.push_back(static_cast<std::uint16_t>(word >> 16));
    }
    return halves;
}

/// From the definition: sign, exponent, mantissa.
template <bool Bf16>
double value_of(std::uint16_t half) {
    constexpr int mantissa_bits = Bf16 ? 7 : 10, bias = Bf16 ? 127 : 15;
    const int mantissa = half & ((1 << mantissa_bits) - 1), exponent = (half & 0x7FFF) >> mantissa_bits;
    const double size = exponent == 0 ? std::ldexp(mantissa, 1 - bias - mantissa_bits)
                                      : std::ldexp(mantissa + (1 << mantissa_bits), exponent - bias - mantissa_bits);
    return half & 0x8000 ? -size : size;
}

template <bool Bf16>
void check_numbers() {
    constexpr std::uint16_t end = Bf16 ? 0x7F80 : 0x7C00; // the first that is no finite number
    std::vector<std::uint16_t> halves;
    for (std::uint16_t half = 0; half < end; ++half)
        halves.push_back(half), halves.push_back(static_cast<std::uint16_t>(half | 0x8000));
    const std::vector<float> numbers = unpacked<Bf16>(halves);
    std::size_t wrong = 0;
    for (std::size_t i = 0; i < halves.size(); ++i) wrong += double(numbers[i]) != value_of<Bf16>(halves[i]);
    CHECK(wrong == 0);
    CHECK(packed<Bf16>(numbers) == halves);

    // Between neighbours: the middle goes to the even one, the floats beside it to the nearer one.
    std::vector<float> between;
    std::vector<std::uint16_t> expected;
    for (std::uint16_t half = 0; half + 1 < end; ++half) {
        const auto next = static_cast<std::uint16_t>(half + 1);
        const auto middle = static_cast<float>((value_of<Bf16>(half) + value_of<Bf16>(next)) / 2);
        const float sign = half % 3 == 0 ? -1.0f : 1.0f;
        for (const float x : {middle, std::nextafter(middle, 0.0f), std::nextafter(middle, 1e38f)}) {
            between.push_back(sign * x);
            const std::uint16_t nearest = x < middle ? half : x > middle ? next : half % 2 == 0 ? half : next;
            expected.push_back(static_cast<std::uint16_t>(nearest | (sign < 0 ? 0x8000 : 0)));
        }
    }
    if (between.size() % 2 != 0) between.push_back(0), expected.push_back(0);
    CHECK(packed<Bf16>(between) == expected);
}

} // namespace

TEST_CASE("every number of bf16 and fp16 is read and written, and numbers between are rounded to the nearest") {
    if (test::skip_without_device()) return;
    check_numbers<true>();
    check_numbers<false>();
}

TEST_CASE("fp16 ends at its largest number, and what is no number stays none") {
    if (test::skip_without_device()) return;
    constexpr float infinity = std::numeric_limits<float>::infinity(), none = std::numeric_limits<float>::quiet_NaN();
    CHECK(packed<false>({65504, 65519, 65520, 1e30f, -1e30f, infinity, -infinity, 1e-30f}) ==
          std::vector<std::uint16_t>{0x7BFF, 0x7BFF, 0x7BFF, 0x7BFF, 0xFBFF, 0x7BFF, 0xFBFF, 0});
    for (const float x : unpacked<false>(packed<false>({none, -none}))) CHECK(std::isnan(x));
    for (const float x : unpacked<true>(packed<true>({none, -none}))) CHECK(std::isnan(x));
    CHECK(unpacked<true>(packed<true>({infinity, -infinity})) == std::vector<float>{infinity, -infinity});
}

namespace {

struct MaskPositive {
    Span<std::uint32_t> words;
    __device__ void operator()(std::size_t i) const { words[i] = cuda::mask_of_positive_bf16(words[i]); }
};

} // namespace

TEST_CASE("the mask of two bf16 numbers has all bits of the positive ones") {
    if (test::skip_without_device()) return;
    std::vector<std::uint32_t> words, expected;
    for (std::uint32_t number = 0; number <= 0x7F80; ++number) { // up to infinity
        const std::uint32_t mask = number != 0 ? 0xFFFFu : 0;
        words.insert(words.end(), {number, number << 16, number | number << 16});
        expected.insert(expected.end(), {mask, mask << 16, mask | mask << 16});
    }
    cuda::Device device;
    cuda::Buffer<std::uint32_t> buffer(words.size());
    device.upload(Span<const std::uint32_t>(words), Span<std::uint32_t>(buffer));
    device.for_each(words.size(), MaskPositive{buffer});
    device.download(Span<const std::uint32_t>(buffer), Span<std::uint32_t>(words));
    CHECK(words == expected);
}
