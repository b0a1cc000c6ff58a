// SPDX-License-Identifier: Apache-2.0
/// @file  Scalar arithmetic of the rasterizer with the same roundings in every pass and on every backend.
///
/// A compiler may fuse a product and a sum, in one copy of a function and not in another. Forward and backward pass
/// must agree on which splats a pixel blends, so wherever that is decided, these functions state what is fused. They
/// have neither branches nor library calls, so that a CPU's loops over pixels are vectorised.
#pragma once

#include <gsh/core/config.hpp>

#include <cmath>
#include <concepts>
#include <cstdint>
#include <type_traits>

namespace gsh::detail {

/// The same bits as another type.
template <class To, class From>
    requires(sizeof(To) == sizeof(From))
[[nodiscard]] GSH_HD inline To bits_as(From x) {
    return __builtin_bit_cast(To, x); // std::bit_cast is a host function
}

/// a * b, rounded, which nvcc does not fuse with a sum.
template <std::floating_point T>
[[nodiscard]] GSH_HD inline T product(T a, T b) {
#if defined(__CUDA_ARCH__)
    if constexpr (sizeof(T) == 4)
        return __fmul_rn(a, b);
    else
        return __dmul_rn(a, b);
#else
    return a * b;
#endif
}

inline namespace GSH_ISA { // what is fused depends on the instruction set

/// a * b + c, rounded once where the machine has an instruction for it. Elsewhere it is rounded twice, since a fused
/// operation would be a library call.
template <std::floating_point T>
[[nodiscard]] GSH_HD inline T multiply_add(T a, T b, T c) {
#if defined(__CUDA_ARCH__)
    if constexpr (sizeof(T) == 4)
        return __fmaf_rn(a, b, c);
    else
        return __fma_rn(a, b, c);
#elif defined(FP_FAST_FMA) || defined(__FMA__) || defined(__ARM_FEATURE_FMA)
    return std::fma(a, b, c);
#else
    return a * b + c;
#endif
}

/// c0 + c1 x + c2 x² + …
template <std::floating_point T>
[[nodiscard]] GSH_HD inline T horner(T, T c0) {
    return c0;
}
template <std::floating_point T, std::same_as<T>... Rest>
[[nodiscard]] GSH_HD inline T horner(T x, T c0, Rest... rest) {
    return multiply_add(x, horner(x, rest...), c0);
}

/// 2^-x for 0 <= x < 126 (float) or 1022 (double), to 2 units in the last place; unspecified for a larger x. In float,
/// a GPU has an instruction for it.
template <std::floating_point T>
[[nodiscard]] GSH_HD inline T exp2_minus(T x) {
    constexpr bool single = std::is_same_v<T, float>;
#if defined(__CUDA_ARCH__)
    if constexpr (single) {
        float power;
        asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(power) : "f"(-x));
        return power;
    }
#endif
    using Bits = std::conditional_t<single, std::uint32_t, std::uint64_t>;
    constexpr int mantissa = single ? 23 : 52;
    constexpr T shift = single ? T(12582912) : T(6755399441055744); // 1.5 * 2^mantissa: adding it rounds to integer

    const T shifted = shift - x;
    const T f = (shift - shifted) - x; // in [-1/2, 1/2]
    T value;
    if constexpr (single) // least relative error for degree 6 on [-1/2, 1/2], 2e-9
        value = horner(f, T(1), T(0.69314720574), T(0.24022646891), T(0.05550328777), T(0.0096184889565),
                       T(0.0013399931209), T(0.00015345812159));
    else // Taylor series, ln(2)^k / k!; the remainder is below 1e-17
        value = horner(f, T(1), T(0.6931471805599453094), T(0.2402265069591007123), T(0.05550410866482157995),
                       T(0.009618129107628477162), T(0.001333355814642844342), T(0.0001540353039338160995),
                       T(0.00001525273380405984028), T(1.321548679014430949e-6), T(1.017808600923969973e-7),
                       T(7.05491162080112333e-9), T(4.445538271870811498e-10), T(2.567843599348820514e-11),
                       T(1.369148885390412888e-12));
    const Bits exponent = bits_as<Bits>(shifted) << mantissa; // its low bits hold the integer part
    return bits_as<T>(static_cast<Bits>(bits_as<Bits>(value) + exponent));
}

/// sqrt(x) for 0 <= x < 1e30, to a relative error of 1e-5: Newton's iteration from the exponent halved, or a GPU's own
/// approximation.
[[nodiscard]] GSH_HD inline float rough_sqrt(float x) {
#if defined(__CUDA_ARCH__)
    float root;
    asm("sqrt.approx.ftz.f32 %0, %1;" : "=f"(root) : "f"(x));
    return root;
#else
    const float y0 = bits_as<float>(0x5F3759DFu - (bits_as<std::uint32_t>(x) >> 1)); // about 1 / sqrt(x)
    const float y1 = y0 * (1.5f - 0.5f * x * y0 * y0);
    const float y2 = y1 * (1.5f - 0.5f * x * y1 * y1);
    return x * y2;
#endif
}

/// a / b, on a GPU to a few units in the last place and with one instruction for 1 / b.
[[nodiscard]] GSH_HD inline float rough_ratio(float a, float b) {
#if defined(__CUDA_ARCH__)
    float inverse;
    asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(inverse) : "f"(b));
    return a * inverse;
#else
    return a / b;
#endif
}

} // namespace GSH_ISA

/// The larger and the smaller of two non-negative numbers, compared as integers. This is one instruction, where the
/// rules for NaN and signed zeros would need two and a mask.
template <std::floating_point T>
[[nodiscard]] GSH_HD inline T max_positive(T a, T b) {
    using Bits = std::conditional_t<std::is_same_v<T, float>, std::int32_t, std::int64_t>;
    const Bits i = bits_as<Bits>(a), j = bits_as<Bits>(b);
    return bits_as<T>(i < j ? j : i);
}
template <std::floating_point T>
[[nodiscard]] GSH_HD inline T min_positive(T a, T b) {
    using Bits = std::conditional_t<std::is_same_v<T, float>, std::int32_t, std::int64_t>;
    const Bits i = bits_as<Bits>(a), j = bits_as<Bits>(b);
    return bits_as<T>(j < i ? j : i);
}

} // namespace gsh::detail
