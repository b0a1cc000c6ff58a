// SPDX-License-Identifier: Apache-2.0
/// @file  Functions of vector registers: roots, exponentials, logarithms, powers, multiply_add.
///
/// The square root, multiply_add, and the exponentials and logarithms of floats are vector code, by intrinsics where a
/// machine has an instruction. The others run lane by lane through std.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/math/wide_register.hpp>

#include <bit>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <type_traits>

#if defined(__FMA__)
#include <immintrin.h>
#elif defined(__ARM_NEON)
#include <arm_neon.h>
#endif

namespace gsh::inline GSH_ISA {

// For AVX-512, square root and multiply_add are intrinsics. GCC would make two halves of a loop over the lanes, and the
// load of a register right after the stores of its halves waits for them: a lit frame took 4% longer.

template <std::floating_point S>
[[nodiscard]] GSH_INLINE Wide<S> sqrt(Wide<S> x) {
#if defined(__AVX512F__)
    // With a full mask: GCC 12 warns of an uninitialised variable in the plain ones.
    if constexpr (sizeof(S) == 4) return Wide<S>(typename Wide<S>::Vector(_mm512_maskz_sqrt_ps(0xffff, x.v)));
    else return Wide<S>(typename Wide<S>::Vector(_mm512_maskz_sqrt_pd(0xff, x.v)));
#else
    return LaneTraits<Wide<S>>::template per_lane<Wide<S>>(x, [](S v) { return std::sqrt(v); });
#endif
}
template <std::floating_point S>
[[nodiscard]] Wide<S> log(Wide<S> x) {
    return LaneTraits<Wide<S>>::template per_lane<Wide<S>>(x, [](S v) { return std::log(v); });
}
template <std::floating_point S>
[[nodiscard]] Wide<S> sin(Wide<S> x) {
    return LaneTraits<Wide<S>>::template per_lane<Wide<S>>(x, [](S v) { return std::sin(v); });
}
template <std::floating_point S>
[[nodiscard]] Wide<S> cos(Wide<S> x) {
    return LaneTraits<Wide<S>>::template per_lane<Wide<S>>(x, [](S v) { return std::cos(v); });
}
template <std::floating_point S>
[[nodiscard]] Wide<S> floor(Wide<S> x) {
    return LaneTraits<Wide<S>>::template per_lane<Wide<S>>(x, [](S v) { return std::floor(v); });
}

/// e^x within two units in the last place, from 0 through the subnormals to infinity; NaN stays NaN.
///
/// x = n log 2 + r with |r| <= log(2)/2, e^r by its Taylor series (the rest is below a tenth of a unit), and 2^n in two
/// factors, since n may lie beyond the exponents of normal numbers.
[[nodiscard]] GSH_INLINE Wide<float> exp(Wide<float> x) {
    using W = Wide<float>;
    using Ints = Wide<std::int32_t>;
    x = select(x > W(89.0f), W(89.0f), x), x = select(x < W(-104.0f), W(-104.0f), x);
    const W shift(12582912.0f); // 1.5 · 2²³: a sum with it is rounded to an integer, which is in its lowest bits
    const W shifted = x * W(1.44269504f) + shift, n = shifted - shift;
    const W r = (x - n * W(0.693359375f)) + n * W(2.12194440e-4f); // log 2 in two parts, the first times n is exact
    W series(1.0f / 5040);
    for (const float factor : {1.0f / 720, 1.0f / 120, 1.0f / 24, 1.0f / 6, 0.5f, 1.0f, 1.0f})
        series = series * r + W(factor);
    const Ints whole = bits_as<Ints>(shifted) - Ints(0x4b400000); // the bit pattern of shift
    const Ints half = whole >> 1;
    const W first = bits_as<W>((half + Ints(127)) << 23), second = bits_as<W>((whole - half + Ints(127)) << 23);
    return series * first * second;
}
[[nodiscard]] inline Wide<double> exp(Wide<double> x) {
    return LaneTraits<Wide<double>>::per_lane<Wide<double>>(x, [](double v) { return std::exp(v); });
}

/// a b + c, rounded once where the machine has an instruction for it.
template <std::floating_point S>
[[nodiscard]] GSH_INLINE Wide<S> multiply_add(Wide<S> a, Wide<S> b, Wide<S> c) {
    using Vector [[maybe_unused]] = typename Wide<S>::Vector;
#if defined(__AVX512F__)
    if constexpr (sizeof(S) == 4) return Wide<S>(Vector(_mm512_fmadd_ps(a.v, b.v, c.v)));
    else return Wide<S>(Vector(_mm512_fmadd_pd(a.v, b.v, c.v)));
#elif defined(__FMA__)
    if constexpr (sizeof(S) == 4) return Wide<S>(Vector(_mm256_fmadd_ps(a.v, b.v, c.v)));
    else return Wide<S>(Vector(_mm256_fmadd_pd(a.v, b.v, c.v)));
#elif defined(__ARM_NEON) && defined(__aarch64__)
    if constexpr (sizeof(S) == 4) return Wide<S>(Vector(vfmaq_f32(c.v, a.v, b.v)));
    else return Wide<S>(Vector(vfmaq_f64(c.v, a.v, b.v)));
#else
    return a * b + c;
#endif
}

/// 1 / sqrt(x) within two units in the last place, for a positive normal x. Newton's iteration from the exponent
/// halved, or from a machine's approximation, is faster than a root and a division.
[[nodiscard]] GSH_INLINE Wide<double> inverse_sqrt(Wide<double> x) {
    using W = Wide<double>;
#if defined(__AVX512F__)
    constexpr int iterations = 2; // from 14 bits
    W y(W::Vector(_mm512_maskz_rsqrt14_pd(0xff, x.v)));
#else
    constexpr int iterations = 4;
    using Bits = Wide<std::uint64_t>;
    W y = bits_as<W>(Bits(0x5FE6EB50C7B537A9ull) - (bits_as<Bits>(x) >> 1));
#endif
    for (int i = 0; i < iterations; ++i) y = y * (W(1.5) - W(0.5) * (x * y) * y);
    return y;
}

/// About 1 / sqrt(x) for a positive normal x, to a relative error of 10⁻⁴ or less.
[[nodiscard]] GSH_INLINE Wide<float> rough_inverse_sqrt(Wide<float> x) {
    using W = Wide<float>;
#if defined(__AVX512F__)
    return W(W::Vector(_mm512_maskz_rsqrt14_ps(0xffff, x.v)));
#else
    using Bits = Wide<std::uint32_t>;
    W y = bits_as<W>(Bits(0x5F3759DFu) - (bits_as<Bits>(x) >> 1));
    for (int i = 0; i < 2; ++i) y = y * (W(1.5f) - W(0.5f) * x * y * y);
    return y;
#endif
}

template <std::floating_point S>
struct MantissaAndExponent {
    Wide<S> mantissa, exponent;
};

/// x = 2^exponent mantissa with a mantissa in [√½, √2), for a positive normal x.
template <std::floating_point S>
[[nodiscard]] GSH_INLINE MantissaAndExponent<S> split_number(Wide<S> x) {
    using Int = std::conditional_t<sizeof(S) == 4, std::int32_t, std::int64_t>;
    using Ints = Wide<Int>;
    constexpr int digits = std::numeric_limits<S>::digits - 1;
    const Ints root_half(std::bit_cast<Int>(static_cast<S>(0.707106781186547524)));
    const Ints bits = bits_as<Ints>(x) - root_half;
    const Ints mantissa = (bits & Ints((Int(1) << digits) - 1)) + root_half;
    return {bits_as<Wide<S>>(mantissa), Wide<S>(bits >> digits)};
}

/// log x within two units in the last place, for subnormal numbers, too: -∞ at 0, NaN below, ∞ at ∞; NaN stays NaN.
///
/// x = 2^n (1 + f) with 1 + f in [√½, √2). With s = f / (2 + f), log(1 + f) = 2 atanh(s) = f - s (f - R), where
/// R = 2 (s²/3 + s⁴/5 + …) is summed to s⁸/9 (the rest is below a tenth of a unit). f is exact, and the rounding of s
/// is multiplied by f.
[[nodiscard]] GSH_INLINE Wide<float> log(Wide<float> x) {
    using W = Wide<float>;
    constexpr float infinity = std::numeric_limits<float>::infinity();
    const auto ordinary = (x > W(0.0f)) & (x < W(infinity));
    const auto subnormal = x < W(std::numeric_limits<float>::min());
    const W scaled = select(subnormal, x * W(33554432.0f), x); // 2²⁵
    const auto [m, exponent] = split_number(select(ordinary, scaled, W(1.0f)));
    const W n = exponent - select(subnormal, W(25.0f), W(0.0f));
    const W f = m - W(1.0f), s = f / (W(2.0f) + f), z = s * s;
    const W R = z * horner(z, 2.0f / 3, 2.0f / 5, 2.0f / 7, 2.0f / 9);
    const W result = n * W(0.693359375f) + (f - (s * (f - R) + n * W(2.12194440e-4f))); // log 2 in two parts
    return select(ordinary, result,
                  select(x == W(0.0f), W(-infinity),
                         select(x > W(0.0f), x, W(std::numeric_limits<float>::quiet_NaN()))));
}

/// The same in double: log x within two units in the last place for a positive normal x; unspecified elsewhere.
[[nodiscard]] GSH_INLINE Wide<double> log_normal(Wide<double> x) {
    using W = Wide<double>;
    const auto [m, n] = split_number(x);
    const W f = m - W(1.0), s = f / (W(2.0) + f), z = s * s; // z below 0.03: the rest of the series is below 10⁻¹⁷
    W R(2.0 / 21);
    for (const double k : {19, 17, 15, 13, 11, 9, 7, 5, 3}) R = multiply_add(R, z, W(2 / k));
    R = R * z;
    return n * W(0.693147180369123816490) + (f - (s * (f - R) + n * W(-1.90821492927058770002e-10)));
}

/// 2^x for |x| <= 126, to a relative error of 10⁻⁷: the polynomial of degree 6 with the least relative error on
/// [-½, ½], 2·10⁻⁹, and the integer part in the exponent.
[[nodiscard]] GSH_INLINE Wide<float> exp2_normal(Wide<float> x) {
    using W = Wide<float>;
    using Ints = Wide<std::int32_t>;
    const W shift(12582912.0f), shifted = x + shift, f = x - (shifted - shift); // as in exp
    const W value = horner(f, 1.0f, 0.69314720574f, 0.24022646891f, 0.05550328777f, 0.0096184889565f, 0.0013399931209f,
                           0.00015345812159f);
    return bits_as<W>(bits_as<Ints>(value) + (bits_as<Ints>(shifted) << 23)); // its lowest bits are the integer part
}

/// e^x for |x| <= 87, to a relative error of 10⁻⁷ (1 + |x|).
[[nodiscard]] GSH_INLINE Wide<float> exp_normal(Wide<float> x) { return exp2_normal(x * Wide<float>(1.44269504f)); }

/// x^exponent = 2^(exponent log₂ x), to a relative error of 10⁻⁷ (1 + |exponent log₂ x|), for a positive normal x,
/// where the result is a normal number, too. The logarithm's series is that of log.
[[nodiscard]] GSH_INLINE Wide<float> power(Wide<float> x, Wide<float> exponent) {
    using W = Wide<float>;
    const auto [m, n] = split_number(x);
    const W s = (m - W(1.0f)) / (m + W(1.0f)), z = s * s;
    constexpr float a = 2.88539008f; // 2 / log 2
    const W log2 = horner(z, a, a / 3, a / 5, a / 7, a / 9);
    return exp2_normal(exponent * multiply_add(log2, s, n));
}

} // namespace gsh::inline GSH_ISA
