// SPDX-License-Identifier: Apache-2.0
/// @file  Scalar arithmetic without branches or library calls, so that loops over pixels are vectorised.
#pragma once

#include <gsh/core/config.hpp>

#include <bit>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <type_traits>

namespace gsh::cpu::inline GSH_ISA {

/// a * b + c, rounded once where the machine has an instruction for it. Elsewhere it is rounded twice, since a fused
/// operation would be a library call.
template <std::floating_point T>
[[nodiscard]] inline T multiply_add(T a, T b, T c) {
#if defined(FP_FAST_FMA) || defined(__FMA__) || defined(__ARM_FEATURE_FMA)
    return std::fma(a, b, c);
#else
    return a * b + c;
#endif
}

/// c0 + c1 x + c2 x² + …
template <std::floating_point T>
[[nodiscard]] inline T horner(T, T c0) {
    return c0;
}
template <std::floating_point T, std::same_as<T>... Rest>
[[nodiscard]] inline T horner(T x, T c0, Rest... rest) {
    return multiply_add(x, horner(x, rest...), c0);
}

/// 2^-x for 0 <= x < 126 (float) or 1022 (double), to 2 units in the last place; unspecified for a larger x.
template <std::floating_point T>
[[nodiscard]] inline T exp2_minus(T x) {
    constexpr bool single = std::is_same_v<T, float>;
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
    const Bits exponent = std::bit_cast<Bits>(shifted) << mantissa; // its low bits hold the integer part
    return std::bit_cast<T>(static_cast<Bits>(std::bit_cast<Bits>(value) + exponent));
}

/// The larger and the smaller of two non-negative numbers, compared as integers. This is one instruction, where the
/// rules for NaN and signed zeros would need two and a mask.
template <std::floating_point T>
[[nodiscard]] inline T max_positive(T a, T b) {
    using Bits = std::conditional_t<std::is_same_v<T, float>, std::int32_t, std::int64_t>;
    const Bits i = std::bit_cast<Bits>(a), j = std::bit_cast<Bits>(b);
    return std::bit_cast<T>(i < j ? j : i);
}
template <std::floating_point T>
[[nodiscard]] inline T min_positive(T a, T b) {
    using Bits = std::conditional_t<std::is_same_v<T, float>, std::int32_t, std::int64_t>;
    const Bits i = std::bit_cast<Bits>(a), j = std::bit_cast<Bits>(b);
    return std::bit_cast<T>(j < i ? j : i);
}

/// sqrt(x) for 0 <= x < 1e30, to a relative error of 1e-5: Newton's iteration from the exponent halved.
[[nodiscard]] inline float rough_sqrt(float x) {
    const float y0 = std::bit_cast<float>(0x5F3759DFu - (std::bit_cast<std::uint32_t>(x) >> 1)); // about 1 / sqrt(x)
    const float y1 = y0 * (1.5f - 0.5f * x * y0 * y0);
    const float y2 = y1 * (1.5f - 0.5f * x * y1 * y1);
    return x * y2;
}

/// 1 / sqrt(x) for a normal x > 0, to 2 units in the last place: Newton's iteration without a library call. std::sqrt
/// may set errno, which keeps a loop from being vectorised.
[[nodiscard]] inline double inverse_sqrt(double x) {
    double y = std::bit_cast<double>(0x5FE6EB50C7B537A9ull - (std::bit_cast<std::uint64_t>(x) >> 1));
    for (int i = 0; i < 4; ++i) y = y * (1.5 - 0.5 * (x * y) * y);
    return y;
}

} // namespace gsh::cpu
