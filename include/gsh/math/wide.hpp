// SPDX-License-Identifier: Apache-2.0
/// @file  A vector register as a lane type, from compiler extensions alone, for per-element code on the CPU.
///
/// Arithmetic, the square root, and the exponential and logarithm of floats are vector code. The other functions run
/// lane by lane through std.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>

#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <limits>
#include <type_traits>

#if defined(__AVX512F__) || defined(__FMA__)
#include <immintrin.h>
#elif defined(__ARM_NEON)
#include <arm_neon.h>
#endif

namespace gsh {

namespace detail {
template <class S, std::size_t Bytes>
struct VectorRegister {
    typedef S type __attribute__((vector_size(Bytes)));
};
} // namespace detail

inline namespace GSH_ISA { // registers of different instruction sets are different types

/// Result of comparing Wides whose numbers have sizeof(Bits) bytes: all bits are set in each true lane.
template <std::signed_integral Bits>
struct WideMask {
    using Vector = typename detail::VectorRegister<Bits, GSH_VECTOR_BYTES>::type;
    Vector bits;

    [[nodiscard]] GSH_INLINE friend WideMask operator&(WideMask a, WideMask b) { return {a.bits & b.bits}; }
    [[nodiscard]] GSH_INLINE friend WideMask operator|(WideMask a, WideMask b) { return {a.bits | b.bits}; }
    [[nodiscard]] GSH_INLINE friend WideMask operator&&(WideMask a, WideMask b) { return a & b; }
    [[nodiscard]] GSH_INLINE friend WideMask operator||(WideMask a, WideMask b) { return a | b; }
    [[nodiscard]] GSH_INLINE friend WideMask operator!(WideMask a) { return {~a.bits}; }
    [[nodiscard]] GSH_INLINE bool operator[](std::size_t lane) const { return bits[lane] != 0; }
};

/// As many numbers as one vector register of the target machine holds; arithmetic acts on all of them at once.
template <class S>
    requires(std::is_arithmetic_v<S> && sizeof(S) >= 4 && sizeof(S) <= 8)
struct Wide {
    using Vector = typename detail::VectorRegister<S, GSH_VECTOR_BYTES>::type;
    using Mask = WideMask<std::conditional_t<sizeof(S) == 4, std::int32_t, std::int64_t>>;
    static constexpr std::size_t width = GSH_VECTOR_BYTES / sizeof(S);

    Vector v;

    Wide() = default;
    GSH_INLINE Wide(S number) : v(number - Vector{}) {} // all lanes; minus a zero keeps a -0
    GSH_INLINE explicit Wide(Vector v_) : v(v_) {}

    [[nodiscard]] GSH_INLINE static Wide load(const S* numbers) {
        Wide wide;
        std::memcpy(&wide.v, numbers, sizeof(Vector));
        return wide;
    }
    GSH_INLINE void store(S* numbers) const { std::memcpy(numbers, &v, sizeof(Vector)); }
    /// Writes the numbers of the first `Count` lanes.
    template <std::size_t Count>
        requires(Count <= width)
    GSH_INLINE void store_first(S* numbers) const {
#if defined(__AVX512F__)
        if constexpr (std::is_same_v<S, float>) {
            _mm512_mask_storeu_ps(numbers, static_cast<__mmask16>((1u << Count) - 1), v);
            return;
        }
#endif
        std::memcpy(numbers, &v, Count * sizeof(S));
    }
    [[nodiscard]] GSH_INLINE S operator[](std::size_t lane) const { return v[lane]; }
    GSH_INLINE void set(std::size_t lane, S number) { v[lane] = number; }

    [[nodiscard]] GSH_INLINE friend Wide operator+(Wide a, Wide b) { return Wide(a.v + b.v); }
    [[nodiscard]] GSH_INLINE friend Wide operator-(Wide a, Wide b) { return Wide(a.v - b.v); }
    [[nodiscard]] GSH_INLINE friend Wide operator*(Wide a, Wide b) { return Wide(a.v * b.v); }
    [[nodiscard]] GSH_INLINE friend Wide operator/(Wide a, Wide b) { return Wide(a.v / b.v); }
    [[nodiscard]] GSH_INLINE friend Wide operator&(Wide a, Wide b) { return Wide(a.v & b.v); }
    [[nodiscard]] GSH_INLINE friend Wide operator|(Wide a, Wide b) { return Wide(a.v | b.v); }
    [[nodiscard]] GSH_INLINE friend Wide operator^(Wide a, Wide b) { return Wide(a.v ^ b.v); }
    [[nodiscard]] GSH_INLINE friend Wide operator<<(Wide a, int bits)
        requires std::unsigned_integral<S>
    {
        return Wide(a.v << bits);
    }
    [[nodiscard]] GSH_INLINE friend Wide operator>>(Wide a, int bits)
        requires std::unsigned_integral<S>
    {
        return Wide(a.v >> bits);
    }
    [[nodiscard]] GSH_INLINE Wide operator-() const { return Wide(-v); }
    GSH_INLINE Wide& operator+=(Wide o) { return v += o.v, *this; }
    GSH_INLINE Wide& operator-=(Wide o) { return v -= o.v, *this; }
    GSH_INLINE Wide& operator*=(Wide o) { return v *= o.v, *this; }
    GSH_INLINE Wide& operator/=(Wide o) { return v /= o.v, *this; }

    [[nodiscard]] GSH_INLINE friend Mask operator<(Wide a, Wide b) { return {a.v < b.v}; }
    [[nodiscard]] GSH_INLINE friend Mask operator<=(Wide a, Wide b) { return {a.v <= b.v}; }
    [[nodiscard]] GSH_INLINE friend Mask operator>(Wide a, Wide b) { return {a.v > b.v}; }
    [[nodiscard]] GSH_INLINE friend Mask operator>=(Wide a, Wide b) { return {a.v >= b.v}; }
    [[nodiscard]] GSH_INLINE friend Mask operator==(Wide a, Wide b) { return {a.v == b.v}; }
    [[nodiscard]] GSH_INLINE friend Mask operator!=(Wide a, Wide b) { return {a.v != b.v}; }

    [[nodiscard]] GSH_INLINE friend Wide select(Mask mask, Wide if_true, Wide if_false) {
        return Wide(mask.bits ? if_true.v : if_false.v);
    }
    [[nodiscard]] GSH_INLINE friend Wide min(Wide a, Wide b) { // b < a ? b : a
#if defined(__AVX512F__) // GCC 12 would compare and select; with a full mask, as for sqrt below
        if constexpr (std::is_same_v<S, float>) return Wide(Vector(_mm512_maskz_min_ps(0xffff, b.v, a.v)));
        else if constexpr (std::is_same_v<S, double>) return Wide(Vector(_mm512_maskz_min_pd(0xff, b.v, a.v)));
        else if constexpr (std::is_same_v<S, std::uint32_t>)
            return Wide(Vector(_mm512_maskz_min_epu32(0xffff, __m512i(a.v), __m512i(b.v))));
        else
#endif
        return select(b < a, b, a);
    }
    [[nodiscard]] GSH_INLINE friend Wide max(Wide a, Wide b) { // a < b ? b : a
#if defined(__AVX512F__)
        if constexpr (std::is_same_v<S, float>) return Wide(Vector(_mm512_maskz_max_ps(0xffff, b.v, a.v)));
        else if constexpr (std::is_same_v<S, double>) return Wide(Vector(_mm512_maskz_max_pd(0xff, b.v, a.v)));
        else if constexpr (std::is_same_v<S, std::uint32_t>)
            return Wide(Vector(_mm512_maskz_max_epu32(0xffff, __m512i(a.v), __m512i(b.v))));
        else
#endif
        return select(a < b, b, a);
    }
    [[nodiscard]] GSH_INLINE friend Wide abs(Wide x) { return select(x > S(0), x, S(0) - x); }
};

/// The same bits as numbers of another type of the same size.
template <class To, class From>
    requires(sizeof(To) == sizeof(Wide<From>))
[[nodiscard]] GSH_INLINE To bits_as(Wide<From> from) {
    To to;
    std::memcpy(&to.v, &from.v, sizeof to.v);
    return to;
}

/// Bit i is set if lane i is true.
template <std::signed_integral Bits>
[[nodiscard]] GSH_INLINE std::uint32_t lane_bits(WideMask<Bits> mask) {
#if defined(__AVX512F__)
    if constexpr (sizeof(Bits) == 4) return _mm512_test_epi32_mask(__m512i(mask.bits), __m512i(mask.bits));
    else return _mm512_test_epi64_mask(__m512i(mask.bits), __m512i(mask.bits));
#else
    std::uint32_t bits = 0;
    for (std::size_t lane = 0; lane < GSH_VECTOR_BYTES / sizeof(Bits); ++lane)
        bits |= (mask.bits[lane] != 0 ? 1u : 0u) << lane;
    return bits;
#endif
}
template <std::signed_integral Bits>
[[nodiscard]] GSH_INLINE bool any(WideMask<Bits> mask) {
#if defined(__AVX512F__)
    return lane_bits(mask) != 0;
#else
    Bits seen = 0;
    for (std::size_t lane = 0; lane < GSH_VECTOR_BYTES / sizeof(Bits); ++lane) seen |= mask.bits[lane];
    return seen != 0;
#endif
}

} // namespace GSH_ISA

template <class S>
struct LaneTraits<Wide<S>> {
    using Scalar = S;
    using Mask = typename Wide<S>::Mask;
    using Index = Wide<std::conditional_t<sizeof(S) == 4, std::uint32_t, std::uint64_t>>; ///< as wide as S
    static constexpr std::size_t width = Wide<S>::width;

    [[nodiscard]] static Index to_index(Wide<S> x) {
        return per_lane<Index>(x, [](S v) { return v; });
    }
    [[nodiscard]] static Wide<S> from_index(Index i) {
        return per_lane<Wide<S>>(i, [](auto v) { return v; });
    }
    [[nodiscard]] static Wide<S> gather(const S* table, Index index) {
        return per_lane<Wide<S>>(index, [table](auto i) { return table[i]; });
    }

    /// f of each lane, through memory.
    template <class To, class From, class F>
    [[nodiscard]] GSH_INLINE static To per_lane(From from, F f) {
        using Number = std::remove_cvref_t<decltype(To()[0])>;
        std::remove_cvref_t<decltype(from[0])> in[width];
        Number out[width];
        from.store(in);
        for (std::size_t lane = 0; lane < width; ++lane) out[lane] = static_cast<Number>(f(in[lane]));
        return To::load(out);
    }
};

inline namespace GSH_ISA {

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
    using Bits = Wide<float>::Mask::Vector;
    x = select(x > W(89.0f), W(89.0f), x), x = select(x < W(-104.0f), W(-104.0f), x);
    const W shift(12582912.0f); // 1.5 · 2²³: a sum with it is rounded to an integer, which is in its lowest bits
    const W shifted = x * W(1.44269504f) + shift, n = shifted - shift;
    const W r = (x - n * W(0.693359375f)) + n * W(2.12194440e-4f); // log 2 in two parts, the first times n is exact
    W series(1.0f / 5040);
    for (const float factor : {1.0f / 720, 1.0f / 120, 1.0f / 24, 1.0f / 6, 0.5f, 1.0f, 1.0f})
        series = series * r + W(factor);
    Bits whole;
    std::memcpy(&whole, &shifted.v, sizeof whole);
    whole = whole - 0x4b400000; // the bit pattern of shift
    const Bits half = whole >> 1, first = (half + 127) << 23, second = (whole - half + 127) << 23;
    W a, b;
    std::memcpy(&a.v, &first, sizeof a.v), std::memcpy(&b.v, &second, sizeof b.v);
    return series * a * b;
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

/// c0 + c1 x + c2 x² + …
[[nodiscard]] GSH_INLINE Wide<float> power_series(Wide<float>, float c0) { return c0; }
template <std::same_as<float>... Rest>
[[nodiscard]] GSH_INLINE Wide<float> power_series(Wide<float> x, float c0, Rest... rest) {
    return multiply_add(x, power_series(x, rest...), Wide<float>(c0));
}

/// log x within two units in the last place, for subnormal numbers, too: -∞ at 0, NaN below, ∞ at ∞; NaN stays NaN.
///
/// x = 2^n (1 + f) with 1 + f in [√½, √2). With s = f / (2 + f), log(1 + f) = 2 atanh(s) = f - s (f - R), where
/// R = 2 (s²/3 + s⁴/5 + …) is summed to s⁸/9 (the rest is below a tenth of a unit). f is exact, and the rounding of s
/// is multiplied by f.
[[nodiscard]] GSH_INLINE Wide<float> log(Wide<float> x) {
    using W = Wide<float>;
    using Bits = Wide<float>::Mask::Vector;
    constexpr float infinity = std::numeric_limits<float>::infinity();
    const auto ordinary = (x > W(0.0f)) & (x < W(infinity));
    const auto subnormal = x < W(std::numeric_limits<float>::min());
    W scaled = select(subnormal, x * W(33554432.0f), x); // 2²⁵
    scaled = select(ordinary, scaled, W(1.0f));
    constexpr std::int32_t root_half = 0x3f3504f3; // the bit pattern of √½
    Bits bits;
    std::memcpy(&bits, &scaled.v, sizeof bits);
    bits = bits - root_half;
    const Bits mantissa = (bits & 0x007fffff) + root_half;
    W m;
    std::memcpy(&m.v, &mantissa, sizeof m.v);
    const W n = W(__builtin_convertvector(bits >> 23, W::Vector)) - select(subnormal, W(25.0f), W(0.0f));
    const W f = m - W(1.0f), s = f / (W(2.0f) + f), z = s * s;
    const W R = z * power_series(z, 2.0f / 3, 2.0f / 5, 2.0f / 7, 2.0f / 9);
    const W result = n * W(0.693359375f) + (f - (s * (f - R) + n * W(2.12194440e-4f))); // log 2 in two parts
    return select(ordinary, result,
                  select(x == W(0.0f), W(-infinity),
                         select(x > W(0.0f), x, W(std::numeric_limits<float>::quiet_NaN()))));
}

/// The same in double: log x within two units in the last place for a positive normal x; unspecified elsewhere.
[[nodiscard]] GSH_INLINE Wide<double> log_normal(Wide<double> x) {
    using W = Wide<double>;
    using Bits = W::Mask::Vector;
    constexpr std::int64_t root_half = 0x3fe6a09e667f3bcd; // the bit pattern of √½
    Bits bits;
    std::memcpy(&bits, &x.v, sizeof bits);
    bits = bits - root_half;
    const Bits mantissa = (bits & 0x000fffffffffffff) + root_half;
    W m;
    std::memcpy(&m.v, &mantissa, sizeof m.v);
    const W n(__builtin_convertvector(bits >> 52, W::Vector));
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
    Wide<float>::Mask::Vector whole, scaled;
    const W shift(12582912.0f), shifted = x + shift, f = x - (shifted - shift); // as in exp
    W value = power_series(f, 1.0f, 0.69314720574f, 0.24022646891f, 0.05550328777f, 0.0096184889565f,
                           0.0013399931209f, 0.00015345812159f);
    std::memcpy(&scaled, &value.v, sizeof scaled), std::memcpy(&whole, &shifted.v, sizeof whole);
    scaled = scaled + (whole << 23); // the lowest bits of `whole` are the integer part
    std::memcpy(&value.v, &scaled, sizeof scaled);
    return value;
}

/// e^x for |x| <= 87, to a relative error of 10⁻⁷ (1 + |x|).
[[nodiscard]] GSH_INLINE Wide<float> exp_normal(Wide<float> x) { return exp2_normal(x * Wide<float>(1.44269504f)); }

/// x^exponent = 2^(exponent log₂ x), to a relative error of 10⁻⁷ (1 + |exponent log₂ x|), for a positive normal x,
/// where the result is a normal number, too. The logarithm's series is that of log.
[[nodiscard]] GSH_INLINE Wide<float> power(Wide<float> x, Wide<float> exponent) {
    using W = Wide<float>;
    using Bits = Wide<float>::Mask::Vector;
    constexpr std::int32_t root_half = 0x3f3504f3; // the bit pattern of √½
    Bits bits;
    std::memcpy(&bits, &x.v, sizeof bits);
    bits = bits - root_half;
    const Bits mantissa = (bits & 0x007fffff) + root_half;
    W m;
    std::memcpy(&m.v, &mantissa, sizeof m.v);
    const W s = (m - W(1.0f)) / (m + W(1.0f)), z = s * s;
    constexpr float a = 2.88539008f; // 2 / log 2
    const W log2 = power_series(z, a, a / 3, a / 5, a / 7, a / 9);
    return exp2_normal(exponent * multiply_add(log2, s, W(__builtin_convertvector(bits >> 23, W::Vector))));
}

/// Writes a struct of S (a vector, a matrix, …) to each of the lanes [lane, lane + lanes_per_store) of the same struct
/// of Wide<S>; numbers(j) is the struct of lane + j. Several lanes share one store, since stores limit the speed of
/// such a transpose.
template <class S>
inline constexpr std::size_t lanes_per_store = 16 / sizeof(S);

template <class S, class Wides, class F>
GSH_INLINE void put_lanes(Wides& wides, std::size_t lane, const F& numbers) {
    typedef S Few __attribute__((vector_size(16)));
    constexpr std::size_t lanes = lanes_per_store<S>;
    constexpr std::size_t bytes = sizeof(numbers(0)), count = bytes / sizeof(S);
    static_assert(sizeof(Wides) == count * sizeof(Wide<S>) && Wide<S>::width % lanes == 0);
    const S* first[lanes];
    for (std::size_t j = 0; j < lanes; ++j) first[j] = reinterpret_cast<const S*>(&numbers(j));
    for (std::size_t k = 0; k < count; ++k) {
        Few few;
        for (std::size_t j = 0; j < lanes; ++j) few[j] = first[j][k];
        std::memcpy(reinterpret_cast<char*>(&wides) + k * sizeof(Wide<S>) + lane * sizeof(S), &few, sizeof few);
    }
}

/// Copies one lane of `wides` to `numbers`.
template <class S, class Wides, class Numbers>
GSH_INLINE void get_lane(const Wides& wides, std::size_t lane, Numbers& numbers) {
    constexpr std::size_t count = sizeof(Numbers) / sizeof(S);
    static_assert(sizeof(Wides) == count * sizeof(Wide<S>));
    for (std::size_t k = 0; k < count; ++k)
        reinterpret_cast<S*>(&numbers)[k] = reinterpret_cast<const Wide<S>*>(&wides)[k][lane];
}

/// Adds one lane of `wides` to `numbers`.
template <class S, class Wides, class Numbers>
GSH_INLINE void add_lane(const Wides& wides, std::size_t lane, Numbers& numbers) {
    constexpr std::size_t count = sizeof(Numbers) / sizeof(S);
    static_assert(sizeof(Wides) == count * sizeof(Wide<S>));
    for (std::size_t k = 0; k < count; ++k)
        reinterpret_cast<S*>(&numbers)[k] += reinterpret_cast<const Wide<S>*>(&wides)[k][lane];
}

} // namespace GSH_ISA

} // namespace gsh
