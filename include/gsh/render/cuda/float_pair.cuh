// SPDX-License-Identifier: Apache-2.0
/// @file  Numbers of about 48 bits as sums of two floats, a lane type for GPUs that are slow in double.
///
/// Per-element code such as project (render/projection.hpp) then computes in twice the precision of float, at 7 to 11
/// operations for a product or a sum. Consumer GPUs have one double unit for 64 float units.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/render/arithmetic.hpp>

#include <cmath>
#include <cstdint>
#include <type_traits>

namespace gsh::cuda::detail {

/// 1 / x to two units in the last place.
[[nodiscard]] GSH_HD inline float quick_reciprocal(float x) {
#if defined(__CUDA_ARCH__)
    return __fdividef(1.0f, x);
#else
    return 1.0f / x;
#endif
}
[[nodiscard]] GSH_HD inline double quick_reciprocal(double x) {
    return 1.0 / x;
}

/// high + low, where high is the sum rounded to float. Sums and products are right to a few units of 2⁻⁴⁸ relative to
/// the operands. Numbers must be far from the limits of float: squares of low must not vanish, products not overflow.
///
/// Source  Dekker, "A floating-point technique for extending the available precision", 1971; Knuth, TAOCP 2, 4.2.2.
struct FloatPair {
    float high, low;

    FloatPair() = default;
    GSH_HD constexpr FloatPair(float x) : high(x), low(0) {}
    GSH_HD constexpr FloatPair(float h, float l) : high(h), low(l) {}

    [[nodiscard]] GSH_HD explicit operator float() const { return high; }

    /// a + b exactly, where |a| >= |b|.
    [[nodiscard]] GSH_HD static FloatPair ordered_sum(float a, float b) {
        const float sum = a + b;
        return {sum, b - (sum - a)};
    }
    /// a + b exactly.
    [[nodiscard]] GSH_HD static FloatPair sum(float a, float b) {
        const float sum = a + b, of_b = sum - a;
        return {sum, (a - (sum - of_b)) + (b - of_b)};
    }
    /// a * b exactly.
    [[nodiscard]] GSH_HD static FloatPair product(float a, float b) {
        const float p = gsh::detail::product(a, b);
        return {p, fused(a, b, -p)};
    }

    [[nodiscard]] GSH_HD FloatPair operator-() const { return {-high, -low}; }
    [[nodiscard]] GSH_HD friend FloatPair operator+(FloatPair a, FloatPair b) {
        const FloatPair s = sum(a.high, b.high);
        return ordered_sum(s.high, s.low + (a.low + b.low));
    }
    [[nodiscard]] GSH_HD friend FloatPair operator-(FloatPair a, FloatPair b) { return a + -b; }
    [[nodiscard]] GSH_HD friend FloatPair operator*(FloatPair a, FloatPair b) {
        const FloatPair p = product(a.high, b.high);
        return ordered_sum(p.high, fused(a.high, b.low, fused(a.low, b.high, p.low)));
    }
    [[nodiscard]] GSH_HD friend FloatPair operator/(FloatPair a, FloatPair b) {
        const float inverse = quick_reciprocal(b.high), quotient = gsh::detail::product(a.high, inverse);
        const FloatPair rest = a - b * FloatPair(quotient);
        return ordered_sum(quotient, gsh::detail::product(rest.high, inverse));
    }
    GSH_HD FloatPair& operator+=(FloatPair o) { return *this = *this + o; }
    GSH_HD FloatPair& operator-=(FloatPair o) { return *this = *this - o; }
    GSH_HD FloatPair& operator*=(FloatPair o) { return *this = *this * o; }
    GSH_HD FloatPair& operator/=(FloatPair o) { return *this = *this / o; }

    [[nodiscard]] GSH_HD friend bool operator<(FloatPair a, FloatPair b) {
        return a.high < b.high || (a.high == b.high && a.low < b.low);
    }
    [[nodiscard]] GSH_HD friend bool operator>(FloatPair a, FloatPair b) { return b < a; }
    [[nodiscard]] GSH_HD friend bool operator<=(FloatPair a, FloatPair b) {
        return a.high < b.high || (a.high == b.high && a.low <= b.low);
    }
    [[nodiscard]] GSH_HD friend bool operator>=(FloatPair a, FloatPair b) { return b <= a; }

    [[nodiscard]] GSH_HD friend FloatPair select(bool mask, FloatPair if_true, FloatPair if_false) {
        return {mask ? if_true.high : if_false.high, mask ? if_true.low : if_false.low};
    }
    [[nodiscard]] GSH_HD friend FloatPair min(FloatPair a, FloatPair b) { return select(b < a, b, a); }
    [[nodiscard]] GSH_HD friend FloatPair max(FloatPair a, FloatPair b) { return select(a < b, b, a); }
    [[nodiscard]] GSH_HD friend FloatPair sqrt(FloatPair a) {
        const float root = std::sqrt(a.high);
        const FloatPair rest = a - product(root, root);
        return root > 0 ? ordered_sum(root, rest.high / (2 * root)) : FloatPair(root);
    }

private:
    /// a * b + c, rounded once on every machine.
    [[nodiscard]] GSH_HD static float fused(float a, float b, float c) {
#if defined(__CUDA_ARCH__)
        return __fmaf_rn(a, b, c);
#else
        return std::fma(a, b, c);
#endif
    }
};

/// The number type in which positions are computed: wider than float, but not double on a GPU.
template <class T>
using Wider = std::conditional_t<std::is_same_v<T, float>, FloatPair, T>;

/// A wide number as a number and the rest.
[[nodiscard]] GSH_HD inline float rounded(FloatPair x) {
    return x.high;
}
[[nodiscard]] GSH_HD inline double rounded(double x) {
    return x;
}
[[nodiscard]] GSH_HD inline float rest_of(FloatPair x) {
    return x.low;
}
[[nodiscard]] GSH_HD inline double rest_of(double) {
    return 0;
}

} // namespace gsh::cuda::detail

template <>
struct gsh::LaneTraits<gsh::cuda::detail::FloatPair> {
    using Scalar = float;
    using Mask = bool;
    using Index = std::uint32_t;
    static constexpr std::size_t width = 1;
};
