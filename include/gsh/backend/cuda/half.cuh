// SPDX-License-Identifier: Apache-2.0
/// @file  Numbers of 16 bits, two to a word: bf16, which is the upper half of a float, and fp16.
///
/// bf16 has the range of float and 8 bits of mantissa. fp16 has 11 bits from 2^-14 = 6.1e-5 on; below, its numbers are
/// multiples of 2^-24 = 6e-8, and the largest is 65,504.
#pragma once

#include <gsh/backend/cuda/kernel.cuh>

#include <cstdint>

namespace gsh::cuda {

[[nodiscard]] __device__ inline float low_bf16(std::uint32_t word) {
    return __uint_as_float(word << 16);
}
[[nodiscard]] __device__ inline float high_bf16(std::uint32_t word) {
    return __uint_as_float(word & 0xFFFF0000u);
}
/// Two numbers as bf16, rounded to the nearest, ties to even.
[[nodiscard]] __device__ inline std::uint32_t pack_bf16(float low, float high) {
#if !defined(GSH_CUDA_EMULATION) && defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
    std::uint32_t word;
    asm("cvt.rn.bf16x2.f32 %0, %1, %2;" : "=r"(word) : "f"(high), "f"(low));
    return word;
#else
    const auto rounded = [](float value) {
        const std::uint32_t bits = __float_as_uint(value);
        if ((bits & 0x7FFFFFFFu) > 0x7F800000u) return std::uint32_t(0x7FFF); // not a number
        return (bits + 0x7FFFu + (bits >> 16 & 1u)) >> 16;
    };
    return rounded(low) | rounded(high) << 16;
#endif
}
/// All bits of those of two bf16 numbers that are positive, none of those that are +0. The numbers are not negative.
[[nodiscard]] __device__ inline std::uint32_t mask_of_positive_bf16(std::uint32_t word) {
    return ((word + 0x7FFF7FFFu) >> 15 & 0x00010001u) * 0xFFFFu;
}

namespace detail {

[[nodiscard]] __device__ inline std::uint32_t fp16_bits(float value) {
    constexpr float largest = 65504.0f;
    value = value > largest ? largest : value < -largest ? -largest : value; // not a number stays that
#if !defined(GSH_CUDA_EMULATION) && defined(__CUDA_ARCH__)
    std::uint16_t bits;
    asm("cvt.rn.f16.f32 %0, %1;" : "=h"(bits) : "f"(value));
    return bits;
#else
    const std::uint32_t bits = __float_as_uint(value), sign = bits >> 16 & 0x8000u, size = bits & 0x7FFFFFFFu;
    if (size > 0x7F800000u) return 0x7FFFu;
    constexpr std::uint32_t bias = 112u << 10;                                                   // of the exponents
    if (size >= 0x38800000u) return sign | (((size + 0xFFFu + (size >> 13 & 1u)) >> 13) - bias); // from 2^-14 on
    const float half = 0.5f; // a float of this size ends at 2^-24, and the sum is rounded there
    return sign | (__float_as_uint(__uint_as_float(size) + half) - __float_as_uint(half));
#endif
}
[[nodiscard]] __device__ inline float from_fp16_bits(std::uint32_t half) {
#if !defined(GSH_CUDA_EMULATION) && defined(__CUDA_ARCH__)
    float value;
    asm("cvt.f32.f16 %0, %1;" : "=f"(value) : "h"(static_cast<std::uint16_t>(half)));
    return value;
#else
    const std::uint32_t sign = (half & 0x8000u) << 16, size = half & 0x7FFFu;
    if (size > 0x7C00u) return __uint_as_float(0x7FFFFFFFu);
    const float scale = __uint_as_float((127u + 112u) << 23); // 2^112, between the biases of the exponents
    return __uint_as_float(sign | __float_as_uint(__uint_as_float(size << 13) * scale));
#endif
}

} // namespace detail

[[nodiscard]] __device__ inline float low_fp16(std::uint32_t word) {
    return detail::from_fp16_bits(word & 0xFFFFu);
}
[[nodiscard]] __device__ inline float high_fp16(std::uint32_t word) {
    return detail::from_fp16_bits(word >> 16);
}
/// Two numbers as fp16, rounded to the nearest, ties to even; those beyond its range become the largest.
[[nodiscard]] __device__ inline std::uint32_t pack_fp16(float low, float high) {
    return detail::fp16_bits(low) | detail::fp16_bits(high) << 16;
}

} // namespace gsh::cuda
