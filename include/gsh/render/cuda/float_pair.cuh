// SPDX-License-Identifier: Apache-2.0
/// @file  Numbers of about 48 bits as sums of two floats, a lane type for GPUs that are slow in double.
///
/// Per-element code such as project (render/projection.hpp) then computes in twice the precision of float, at four
/// operations for a product and eight for a sum. Consumer GPUs have one double unit for 64 float units.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/render/arithmetic.hpp>

#include <cmath>
#include <cstdint>
#include <type_traits>

namespace gsh::cuda::detail {

/// 1 / x, in float to two units in the last place.
[[nodiscard]] GSH_HD inline float quick_reciprocal(float x) {
    return gsh::detail::rough_ratio(1.0f, x);
}
[[nodiscard]] GSH_HD inline double quick_reciprocal(double x) {
    return 1.0 / x;
}

/// high + low. Sums and products are right to a few units of 2⁻⁴⁶ relative to the operands. The parts may overlap by a
/// few bits; `rounded` and `rest_of` separate them. Numbers must be far from the limits of float: products must not
/// overflow, and the errors of products not vanish.
///
/// Source  Dekker, "A floating-point technique for extending the available precision", 1971; Knuth, TAOCP 2, 4.2.2.
struct FloatPair {
    float high, low;

    FloatPair() = default;
    GSH_HD constexpr FloatPair(float x) : high(x), low(0) {}
    GSH_HD constexpr FloatPair(float h, float l) : high(h), low(l) {}

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
        return {s.high, s.low + (a.low + b.low)};
    }
    [[nodiscard]] GSH_HD friend FloatPair operator-(FloatPair a, FloatPair b) { return a + -b; }
    [[nodiscard]] GSH_HD friend FloatPair operator*(FloatPair a, FloatPair b) {
        const FloatPair p = product(a.high, b.high);
        return {p.high, fused(a.high, b.low, fused(a.low, b.high, p.low))};
    }
    [[nodiscard]] GSH_HD friend FloatPair operator/(FloatPair a, FloatPair b) {
        const float inverse = quick_reciprocal(b.high), quotient = gsh::detail::product(a.high, inverse);
        const FloatPair rest = a - b * FloatPair(quotient);
        return {quotient, gsh::detail::product(rest.high + rest.low, inverse)};
    }
    GSH_HD FloatPair& operator+=(FloatPair o) { return *this = *this + o; }
    GSH_HD FloatPair& operator-=(FloatPair o) { return *this = *this - o; }
    GSH_HD FloatPair& operator*=(FloatPair o) { return *this = *this * o; }
    GSH_HD FloatPair& operator/=(FloatPair o) { return *this = *this / o; }

    [[nodiscard]] GSH_HD friend bool operator<(FloatPair a, FloatPair b) {
        return (a.high - b.high) + (a.low - b.low) < 0;
    }
    [[nodiscard]] GSH_HD friend bool operator>(FloatPair a, FloatPair b) { return b < a; }
    [[nodiscard]] GSH_HD friend bool operator<=(FloatPair a, FloatPair b) {
        return (a.high - b.high) + (a.low - b.low) <= 0;
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
        return root > 0 ? FloatPair(root, (rest.high + rest.low) / (2 * root)) : FloatPair(root);
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

/// A wide number as a number and what is left.
[[nodiscard]] GSH_HD inline float rounded(FloatPair x) {
    return x.high + x.low;
}
[[nodiscard]] GSH_HD inline double rounded(double x) {
    return x;
}
[[nodiscard]] GSH_HD inline float rest_of(FloatPair x) {
    return x.low - (rounded(x) - x.high);
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
