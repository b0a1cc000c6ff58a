// SPDX-License-Identifier: Apache-2.0
/// @file  Arithmetic of the rasterizer with the same roundings in every pass and on every backend.
///
/// A compiler may fuse a product and a sum, in one copy of a function and not in another. Forward and backward pass
/// must agree on which splats a pixel blends, so wherever that is decided, these functions state what is fused.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>

#include <concepts>
#include <cstdint>
#include <type_traits>

namespace gsh::detail {

/// a * b, rounded, which nvcc does not fuse with a sum.
template <Lane T>
[[nodiscard]] GSH_INLINE GSH_HD T product(T a, T b) {
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

/// Unsigned integers of the size of the numbers of a lane type.
template <Lane T>
using BitsOf = std::conditional_t<LaneTraits<T>::width != 1, IndexOf<T>,
                                  std::conditional_t<sizeof(T) == 4, std::uint32_t, std::uint64_t>>;

/// 2^-x for 0 <= x < 126 (float) or 1022 (double), to 2 units in the last place; unspecified for a larger x. In float,
/// a GPU has an instruction for it.
template <Lane T>
[[nodiscard]] GSH_INLINE GSH_HD T exp2_minus(T x) {
    using S = ScalarOf<T>;
    constexpr bool single = sizeof(S) == 4;
#if defined(__CUDA_ARCH__)
    if constexpr (single) {
        float power;
        asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(power) : "f"(-x));
        return power;
    }
#endif
    using Bits = BitsOf<T>;
    constexpr int mantissa = single ? 23 : 52;
    constexpr S shift = single ? S(12582912) : S(6755399441055744); // 1.5 * 2^mantissa: adding it rounds to integer

    const T shifted = T(shift) - x;
    const T f = (T(shift) - shifted) - x; // in [-1/2, 1/2]
    T value;
    if constexpr (single) { // least relative error for degree 5 on [-1/2, 1/2], 9e-8; in pairs, for a short chain
        const T low = horner(f, S(1), S(0.6931469776)), middle = horner(f, S(0.24022242085), S(0.055507337433));
        const T high = horner(f, S(0.0096715126399), S(0.0013264727193)), square = product(f, f);
        value = multiply_add(multiply_add(high, square, middle), square, low);
    } else { // Taylor series, ln(2)^k / k!; the remainder is below 1e-17
        value = horner(f, S(1), S(0.6931471805599453094), S(0.2402265069591007123), S(0.05550410866482157995),
                       S(0.009618129107628477162), S(0.001333355814642844342), S(0.0001540353039338160995),
                       S(0.00001525273380405984028), S(1.321548679014430949e-6), S(1.017808600923969973e-7),
                       S(7.05491162080112333e-9), S(4.445538271870811498e-10), S(2.567843599348820514e-11),
                       S(1.369148885390412888e-12));
    }
    const Bits exponent = bits_as<Bits>(shifted) << mantissa; // its low bits hold the integer part
    return bits_as<T>(static_cast<Bits>(bits_as<Bits>(value) + exponent));
}

/// sqrt(x) for 0 <= x < 1e30, to a relative error of 1e-4: Newton's iteration from the exponent halved, or a machine's
/// own approximation.
template <Lane T>
    requires(std::same_as<ScalarOf<T>, float>)
[[nodiscard]] GSH_INLINE GSH_HD T rough_sqrt(T x) {
#if defined(__CUDA_ARCH__)
    float root;
    asm("sqrt.approx.ftz.f32 %0, %1;" : "=f"(root) : "f"(x));
    return root;
#else
    if constexpr (std::floating_point<T>) {
        const T y0 = bits_as<T>(0x5F3759DFu - (bits_as<std::uint32_t>(x) >> 1)); // about 1 / sqrt(x)
        const T y1 = y0 * (1.5f - 0.5f * x * y0 * y0);
        const T y2 = y1 * (1.5f - 0.5f * x * y1 * y1);
        return x * y2;
    } else {
        return x * rough_inverse_sqrt(max(x, T(1e-30f)));
    }
#endif
}

/// a / b, on a GPU to a few units in the last place and with one instruction for 1 / b.
template <Lane T>
    requires(std::same_as<ScalarOf<T>, float>)
[[nodiscard]] GSH_INLINE GSH_HD T rough_ratio(T a, T b) {
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
template <Lane T>
[[nodiscard]] GSH_INLINE GSH_HD T max_positive(T a, T b) {
    const BitsOf<T> i = bits_as<BitsOf<T>>(a), j = bits_as<BitsOf<T>>(b);
    if constexpr (std::floating_point<T>) return bits_as<T>(i < j ? j : i);
    else return bits_as<T>(max(i, j));
}
template <Lane T>
[[nodiscard]] GSH_INLINE GSH_HD T min_positive(T a, T b) {
    const BitsOf<T> i = bits_as<BitsOf<T>>(a), j = bits_as<BitsOf<T>>(b);
    if constexpr (std::floating_point<T>) return bits_as<T>(j < i ? j : i);
    else return bits_as<T>(min(i, j));
}

} // namespace gsh::detail
