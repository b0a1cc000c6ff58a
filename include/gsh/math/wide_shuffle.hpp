// SPDX-License-Identifier: Apache-2.0
/// @file  Reordering the numbers of vector registers: zip, unzip, transpose.
#pragma once

#include <gsh/math/wide.hpp>

#include <cstddef>
#include <utility>

namespace gsh::inline GSH_ISA {

template <class S>
struct WidePair {
    Wide<S> first, second;
};

/// a0 b0 a1 b1 … in two registers.
template <class S>
[[nodiscard]] GSH_INLINE WidePair<S> zip(Wide<S> a, Wide<S> b) {
    constexpr int n = Wide<S>::width;
    return [&]<int... I>(std::integer_sequence<int, I...>) -> WidePair<S> {
        return {Wide<S>(__builtin_shufflevector(a.v, b.v, (I / 2 + I % 2 * n)...)),
                Wide<S>(__builtin_shufflevector(a.v, b.v, ((n + I) / 2 + I % 2 * n)...))};
    }(std::make_integer_sequence<int, n>());
}
/// The inverse of zip: of the numbers of a, then those of b, every second one from the first on, and the others.
template <class S>
[[nodiscard]] GSH_INLINE WidePair<S> unzip(Wide<S> a, Wide<S> b) {
    return [&]<int... I>(std::integer_sequence<int, I...>) -> WidePair<S> {
        return {Wide<S>(__builtin_shufflevector(a.v, b.v, (2 * I)...)),
                Wide<S>(__builtin_shufflevector(a.v, b.v, (2 * I + 1)...))};
    }(std::make_integer_sequence<int, int(Wide<S>::width)>());
}

/// Number i of register j becomes number j of register i.
template <class S>
GSH_INLINE void transpose(Wide<S> (&rows)[Wide<S>::width]) {
    constexpr std::size_t n = Wide<S>::width;
    for (std::size_t done = 1; done < n; done *= 2) { // each round moves one bit of the index from column to row
        Wide<S> next[n];
        for (std::size_t i = 0; i < n / 2; ++i) {
            const WidePair<S> both = zip(rows[i], rows[i + n / 2]);
            next[2 * i] = both.first, next[2 * i + 1] = both.second;
        }
        for (std::size_t i = 0; i < n; ++i) rows[i] = next[i];
    }
}

} // namespace gsh::inline GSH_ISA
