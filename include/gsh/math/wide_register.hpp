// SPDX-License-Identifier: Apache-2.0
/// @file  Numbers in a vector register as a lane type, for per-element code on the CPU.
///
/// Arithmetic is that of the vector extensions of GCC and Clang. Intrinsics of a machine replace it where a compiler's
/// code for it is slow.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>

#include <bit>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>
#include <utility>

#if defined(__AVX512F__)
#include <immintrin.h>
#endif

namespace gsh {

namespace detail {
template <class S, std::size_t Lanes>
struct VectorRegister {
    typedef S type __attribute__((vector_size(Lanes * sizeof(S))));
};
} // namespace detail

inline namespace GSH_ISA { // registers of different instruction sets are different types

/// The number of lanes of the target machine's vector register.
template <class S>
inline constexpr std::size_t lanes_of_register = GSH_VECTOR_BYTES / sizeof(S);

/// Result of comparing Wides whose numbers have sizeof(Bits) bytes: all bits are set in each true lane.
template <std::signed_integral Bits, std::size_t Lanes = lanes_of_register<Bits>>
struct WideMask {
    using Vector = typename detail::VectorRegister<Bits, Lanes>::type;
    Vector bits;

    /// The mask for numbers of another size.
    template <std::signed_integral Other>
    [[nodiscard]] GSH_INLINE explicit operator WideMask<Other, Lanes>() const {
        using To = typename WideMask<Other, Lanes>::Vector;
        return {__builtin_convertvector(bits, To)};
    }

    [[nodiscard]] GSH_INLINE friend WideMask operator&(WideMask a, WideMask b) { return {a.bits & b.bits}; }
    [[nodiscard]] GSH_INLINE friend WideMask operator|(WideMask a, WideMask b) { return {a.bits | b.bits}; }
    [[nodiscard]] GSH_INLINE friend WideMask operator&&(WideMask a, WideMask b) { return a & b; }
    [[nodiscard]] GSH_INLINE friend WideMask operator||(WideMask a, WideMask b) { return a | b; }
    [[nodiscard]] GSH_INLINE friend WideMask operator!(WideMask a) { return {~a.bits}; }
    [[nodiscard]] GSH_INLINE bool operator[](std::size_t lane) const { return bits[lane] != 0; }
};

/// Numbers of which arithmetic acts on all at once. By default, they are as many as one vector register of the target
/// machine holds, and have the functions of math/wide.hpp, too. Rows of few numbers state how many: Wide<float, 4>.
template <class S, std::size_t Lanes = lanes_of_register<S>>
    requires(std::is_arithmetic_v<S> && sizeof(S) >= 4 && sizeof(S) <= 8 && std::has_single_bit(Lanes))
struct Wide {
    using Vector = typename detail::VectorRegister<S, Lanes>::type;
    using Mask = WideMask<std::conditional_t<sizeof(S) == 4, std::int32_t, std::int64_t>, Lanes>;
    static constexpr std::size_t width = Lanes;

    Vector v;

    Wide() = default;
    GSH_INLINE Wide(S number) : v(number - Vector{}) {} // all lanes; minus a zero keeps a -0
    GSH_INLINE explicit Wide(Vector v_) : v(v_) {}
    /// Each number converted.
    template <class From>
    GSH_INLINE explicit Wide(Wide<From, Lanes> from) : v(__builtin_convertvector(from.v, Vector)) {}

    /// number(lane) in each lane.
    template <class F>
    [[nodiscard]] GSH_INLINE static Wide generate(const F& number) {
        return generate(number, std::make_index_sequence<Lanes>());
    }

    [[nodiscard]] GSH_INLINE static Wide load(const S* numbers) {
        Wide wide;
        std::memcpy(&wide.v, numbers, sizeof(Vector));
        return wide;
    }
    GSH_INLINE void store(S* numbers) const { std::memcpy(numbers, &v, sizeof(Vector)); }
    /// Reads the first `Count` lanes; the others are 0.
    template <std::size_t Count>
        requires(Count <= width)
    [[nodiscard]] GSH_INLINE static Wide load_first(const S* numbers) {
        Wide wide(S(0));
        std::memcpy(&wide.v, numbers, Count * sizeof(S));
        return wide;
    }
    /// Writes the numbers of the first `Count` lanes.
    template <std::size_t Count>
        requires(Count <= width)
    GSH_INLINE void store_first(S* numbers) const {
#if defined(__AVX512F__)
        if constexpr (std::is_same_v<Wide, Wide<float>>) {
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
        requires std::integral<S>
    {
        return Wide(a.v << bits);
    }
    [[nodiscard]] GSH_INLINE friend Wide operator>>(Wide a, int bits)
        requires std::integral<S>
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
#if defined(__AVX512F__) // GCC 12 would compare and select; with a full mask, as for sqrt in math/wide.hpp
        if constexpr (std::is_same_v<Wide, Wide<float>>) return Wide(Vector(_mm512_maskz_min_ps(0xffff, b.v, a.v)));
        else if constexpr (std::is_same_v<Wide, Wide<double>>) return Wide(Vector(_mm512_maskz_min_pd(0xff, b.v, a.v)));
        else if constexpr (std::is_same_v<Wide, Wide<std::uint32_t>>)
            return Wide(Vector(_mm512_maskz_min_epu32(0xffff, __m512i(a.v), __m512i(b.v))));
        else
#endif
        return select(b < a, b, a);
    }
    [[nodiscard]] GSH_INLINE friend Wide max(Wide a, Wide b) { // a < b ? b : a
#if defined(__AVX512F__)
        if constexpr (std::is_same_v<Wide, Wide<float>>) return Wide(Vector(_mm512_maskz_max_ps(0xffff, b.v, a.v)));
        else if constexpr (std::is_same_v<Wide, Wide<double>>) return Wide(Vector(_mm512_maskz_max_pd(0xff, b.v, a.v)));
        else if constexpr (std::is_same_v<Wide, Wide<std::uint32_t>>)
            return Wide(Vector(_mm512_maskz_max_epu32(0xffff, __m512i(a.v), __m512i(b.v))));
        else
#endif
        return select(a < b, b, a);
    }
    [[nodiscard]] GSH_INLINE friend Wide abs(Wide x) { return select(x > S(0), x, S(0) - x); }

private:
    template <class F, std::size_t... Lane>
    [[nodiscard]] GSH_INLINE static Wide generate(const F& number, std::index_sequence<Lane...>) {
        return Wide(Vector{static_cast<S>(number(Lane))...});
    }
};

/// The same bits as numbers of another type.
template <class To, class From, std::size_t Lanes>
    requires(sizeof(To) == sizeof(Wide<From, Lanes>))
[[nodiscard]] GSH_INLINE To bits_as(Wide<From, Lanes> from) {
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
    for (std::size_t lane = 0; lane < lanes_of_register<Bits>; ++lane)
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
    for (std::size_t lane = 0; lane < lanes_of_register<Bits>; ++lane) seen |= mask.bits[lane];
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

} // namespace gsh
