// SPDX-License-Identifier: Apache-2.0
/// @file  The number types of per-element code: a scalar, or a SIMD pack of scalars.
#pragma once

#include <gsh/core/config.hpp>

#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace gsh {

/// Names the scalar, mask and index types of a lane type. The primary template covers float and double;
/// math/wide.hpp adds vector registers.
template <class T>
struct LaneTraits {};

template <std::floating_point T>
struct LaneTraits<T> {
    using Scalar = T;            ///< one lane's number
    using Mask = bool;           ///< result of a comparison
    using Index = std::uint32_t; ///< integer lane as wide as a cell or table index
    static constexpr std::size_t width = 1;

    /// Integer part of a non-negative number.
    [[nodiscard]] GSH_HD static Index to_index(T x) { return static_cast<Index>(x); }
    [[nodiscard]] GSH_HD static T from_index(Index i) { return static_cast<T>(i); }
    /// table[index], lane by lane.
    [[nodiscard]] GSH_HD static T gather(const T* table, Index index) { return table[index]; }
};

/// A number type for which per-element code is written. Branches become `select`, so that one source runs in a device
/// thread, in a vector register of a CPU, and in a gradient test in double.
template <class T>
concept Lane = requires { typename LaneTraits<T>::Scalar; } && std::is_trivially_copyable_v<T>;

template <class T>
using ScalarOf = typename LaneTraits<T>::Scalar;
template <class T>
using MaskOf = typename LaneTraits<T>::Mask;
template <class T>
using IndexOf = typename LaneTraits<T>::Index;

template <std::floating_point T>
[[nodiscard]] GSH_HD constexpr T select(bool mask, T if_true, T if_false) {
    return mask ? if_true : if_false;
}
[[nodiscard]] GSH_HD constexpr std::uint32_t select(bool mask, std::uint32_t if_true, std::uint32_t if_false) {
    return mask ? if_true : if_false;
}
/// True when at least one lane of the mask is set.
[[nodiscard]] GSH_HD constexpr bool any(bool mask) { return mask; }

template <std::floating_point T>
[[nodiscard]] GSH_HD constexpr T min(T a, T b) {
    return b < a ? b : a;
}
template <std::floating_point T>
[[nodiscard]] GSH_HD constexpr T max(T a, T b) {
    return a < b ? b : a;
}
template <std::floating_point T>
[[nodiscard]] GSH_HD T abs(T x) {
    return std::fabs(x);
}
template <std::floating_point T>
[[nodiscard]] GSH_HD T sqrt(T x) {
    return std::sqrt(x);
}
template <std::floating_point T>
[[nodiscard]] GSH_HD T exp(T x) {
    return std::exp(x);
}
template <std::floating_point T>
[[nodiscard]] GSH_HD T log(T x) {
    return std::log(x);
}
template <std::floating_point T>
[[nodiscard]] GSH_HD T sin(T x) {
    return std::sin(x);
}
template <std::floating_point T>
[[nodiscard]] GSH_HD T cos(T x) {
    return std::cos(x);
}
template <std::floating_point T>
[[nodiscard]] GSH_HD T floor(T x) {
    return std::floor(x);
}

/// The same bits as another type of the same size. The overload for registers is in math/wide_register.hpp, since nvcc
/// refuses registers in functions of the device.
template <class To, class From>
    requires(std::is_arithmetic_v<From> && sizeof(To) == sizeof(From))
[[nodiscard]] GSH_INLINE GSH_HD To bits_as(From from) {
    return __builtin_bit_cast(To, from); // std::bit_cast is a host function
}

inline namespace GSH_ISA { // what is fused depends on the instruction set

/// a b + c, rounded once where the machine has an instruction for it. Elsewhere it is rounded twice, since a fused
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

/// c0 + c1 x + c2 x² + …, by Horner's scheme.
#if defined(__NVCC__)
#pragma nv_exec_check_disable // a register's operations are host functions
#endif
template <Lane T, std::same_as<ScalarOf<T>>... Rest>
[[nodiscard]] GSH_INLINE GSH_HD T horner(T x, ScalarOf<T> c0, Rest... rest) {
    if constexpr (sizeof...(rest) == 0) return T(c0);
    else return multiply_add(x, horner(x, rest...), T(c0));
}

} // namespace GSH_ISA

/// x^exponent for a positive normal x, where the result is a normal number, too. Lane types may have overloads that are
/// faster than exp and log.
template <Lane T>
[[nodiscard]] GSH_HD T power(T x, T exponent) {
    return exp(exponent * log(x));
}
/// e^x where the result is a normal number of float, |x| <= 87. Lane types may have overloads that are faster than exp.
template <Lane T>
[[nodiscard]] GSH_HD T exp_normal(T x) {
    return exp(x);
}
/// x clamped to [low, high].
template <Lane T>
[[nodiscard]] GSH_HD T clamp(T x, T low, T high) {
    return min(max(x, low), high);
}

} // namespace gsh
