// SPDX-License-Identifier: Apache-2.0
/// @file  Numbers of 16 bits with the exponent of a float: the upper half of a float, rounded.
///
/// A word holds two of them, the first in its lower half. Products of words, pair by pair, are what the matrix
/// instructions of CPUs and GPUs compute.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/math/wide.hpp>
#include <gsh/math/wide_shuffle.hpp>

#include <bit>
#include <cstdint>

namespace gsh {

/// The bits of x rounded to bf16: to the nearest, ties to even. Not a number stays that.
[[nodiscard]] inline std::uint32_t bf16_bits(float x) {
    const auto bits = std::bit_cast<std::uint32_t>(x);
    if ((bits & 0x7fffffffu) > 0x7f800000u) return 0x7fffu;
    return (bits + 0x7fffu + (bits >> 16 & 1u)) >> 16;
}
/// Two numbers in a word.
[[nodiscard]] inline std::uint32_t bf16_word(float low, float high) { return bf16_bits(low) | bf16_bits(high) << 16; }

inline namespace GSH_ISA {

/// Words, each with a number of `low` and one of `high`.
[[nodiscard]] GSH_INLINE Wide<std::uint32_t> bf16_words(Wide<float> low, Wide<float> high) {
    using Words = Wide<std::uint32_t>;
#if defined(__AVX512BF16__)
    typedef std::uint16_t Halves __attribute__((vector_size(64)));
    const auto both = reinterpret_cast<Halves>(_mm512_cvtne2ps_pbh(high.v, low.v)); // all of low, then all of high
    return Words(reinterpret_cast<Words::Vector>(__builtin_shufflevector(
        both, both, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23, 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13,
        29, 14, 30, 15, 31)));
#else
    const auto bits = [](Wide<float> x) {
        const Words u = bits_as<Words>(x), rounded = (u + (Words(0x7fffu) + (u >> 16 & Words(1u)))) >> 16;
        return bits_as<Words>(select(x == x, bits_as<Wide<float>>(rounded), bits_as<Wide<float>>(Words(0x7fffu))));
    };
    return bits(low) | bits(high) << 16;
#endif
}
/// Words of neighbours: of the numbers of `first`, then of `second`, two and two.
[[nodiscard]] GSH_INLINE Wide<std::uint32_t> bf16_neighbours(Wide<float> first, Wide<float> second) {
#if defined(__AVX512BF16__)
    return Wide<std::uint32_t>(reinterpret_cast<Wide<std::uint32_t>::Vector>(_mm512_cvtne2ps_pbh(second.v, first.v)));
#else
    const WidePair<float> both = unzip(first, second);
    return bf16_words(both.first, both.second);
#endif
}
/// Words with a number of `first` and the number of `second` at the same place, in two registers.
[[nodiscard]] GSH_INLINE WidePair<std::uint32_t> zip_bf16(Wide<std::uint32_t> first, Wide<std::uint32_t> second) {
    using Words = Wide<std::uint32_t>;
#if defined(__AVX512BF16__)
    typedef std::uint16_t Halves __attribute__((vector_size(64)));
    const auto a = reinterpret_cast<Halves>(first.v), b = reinterpret_cast<Halves>(second.v);
    return {Words(reinterpret_cast<Words::Vector>(__builtin_shufflevector(
                a, b, 0, 32, 1, 33, 2, 34, 3, 35, 4, 36, 5, 37, 6, 38, 7, 39, 8, 40, 9, 41, 10, 42, 11, 43, 12, 44, 13,
                45, 14, 46, 15, 47))),
            Words(reinterpret_cast<Words::Vector>(__builtin_shufflevector(
                a, b, 16, 48, 17, 49, 18, 50, 19, 51, 20, 52, 21, 53, 22, 54, 23, 55, 24, 56, 25, 57, 26, 58, 27, 59,
                28, 60, 29, 61, 30, 62, 31, 63)))};
#else
    return zip((first & Words(0xffffu)) | second << 16, first >> 16 | (second & Words(0xffff0000u)));
#endif
}
[[nodiscard]] GSH_INLINE Wide<float> low_bf16(Wide<std::uint32_t> words) { return bits_as<Wide<float>>(words << 16); }
[[nodiscard]] GSH_INLINE Wide<float> high_bf16(Wide<std::uint32_t> words) {
    return bits_as<Wide<float>>(words & Wide<std::uint32_t>(0xffff0000u));
}

/// sum + a.low b.low + a.high b.high in every word. How the three are rounded depends on the machine.
[[nodiscard]] GSH_INLINE Wide<float> dot_bf16(Wide<float> sum, Wide<std::uint32_t> a, Wide<std::uint32_t> b) {
#if defined(__AVX512BF16__)
    return Wide<float>(Wide<float>::Vector(_mm512_dpbf16_ps(sum.v, reinterpret_cast<__m512bh>(a.v),
                                                            reinterpret_cast<__m512bh>(b.v))));
#else
    return multiply_add(high_bf16(a), high_bf16(b), multiply_add(low_bf16(a), low_bf16(b), sum));
#endif
}

} // namespace GSH_ISA

} // namespace gsh
