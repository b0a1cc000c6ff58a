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

/// Number e of the result is number Source(e) of a's numbers followed by b's.
template <auto Source, class S, int... E>
[[nodiscard]] GSH_INLINE Wide<S> shuffle(Wide<S> a, Wide<S> b, std::integer_sequence<int, E...>) {
#if defined(__clang__)
    return Wide<S>(__builtin_shufflevector(a.v, b.v, Source(E)...));
#else // nvcc 13 loses a pack in the arguments of that function
    return Wide<S>(__builtin_shuffle(a.v, b.v, typename Wide<S>::Mask::Vector{Source(E)...}));
#endif
}
template <auto Source, class S>
[[nodiscard]] GSH_INLINE Wide<S> shuffle(Wide<S> a, Wide<S> b) {
    return shuffle<Source>(a, b, std::make_integer_sequence<int, int(Wide<S>::width)>());
}

/// a0 b0 a1 b1 … in two registers.
template <class S>
[[nodiscard]] GSH_INLINE WidePair<S> zip(Wide<S> a, Wide<S> b) {
    constexpr int n = Wide<S>::width;
    return {shuffle<[](int e) { return e / 2 + e % 2 * n; }>(a, b),
            shuffle<[](int e) { return (n + e) / 2 + e % 2 * n; }>(a, b)};
}
/// The inverse of zip: of the numbers of a, then those of b, every second one from the first on, and the others.
template <class S>
[[nodiscard]] GSH_INLINE WidePair<S> unzip(Wide<S> a, Wide<S> b) {
    return {shuffle<[](int e) { return 2 * e; }>(a, b), shuffle<[](int e) { return 2 * e + 1; }>(a, b)};
}

/// Number i of register j becomes number j of register i.
///
/// Machines shuffle fastest within blocks of 16 bytes. So the numbers of four registers change places within each block
/// first, and then whole blocks.
template <class S>
    requires(sizeof(S) == 4)
GSH_INLINE void transpose(Wide<S> (&rows)[Wide<S>::width]) {
    constexpr int n = Wide<S>::width, blocks = n / 4;
    constexpr auto low = [](int e) { return e / 4 * 4 + e % 4 / 2 + e % 2 * n; };
    constexpr auto high = [](int e) { return e / 4 * 4 + 2 + e % 4 / 2 + e % 2 * n; };
    constexpr auto first_pairs = [](int e) { return e / 4 * 4 + e % 2 + e % 4 / 2 * n; };
    constexpr auto second_pairs = [](int e) { return e / 4 * 4 + 2 + e % 2 + e % 4 / 2 * n; };
    for (int r = 0; r < n; r += 4) {
        const Wide<S> a = shuffle<low>(rows[r], rows[r + 1]), b = shuffle<high>(rows[r], rows[r + 1]),
                      c = shuffle<low>(rows[r + 2], rows[r + 3]), d = shuffle<high>(rows[r + 2], rows[r + 3]);
        rows[r] = shuffle<first_pairs>(a, c), rows[r + 1] = shuffle<second_pairs>(a, c);
        rows[r + 2] = shuffle<first_pairs>(b, d), rows[r + 3] = shuffle<second_pairs>(b, d);
    }
    constexpr auto even_blocks = [](int e) { return e / 4 * 8 + e % 4; };
    constexpr auto odd_blocks = [](int e) { return e / 4 * 8 + 4 + e % 4; };
    for (int done = 1; done < blocks; done *= 2) {
        Wide<S> next[n];
        for (int g = 0; g < blocks / 2; ++g)
            for (int k = 0; k < 4; ++k) {
                const Wide<S> a = rows[8 * g + k], b = rows[8 * g + 4 + k];
                next[4 * g + k] = shuffle<even_blocks>(a, b);
                next[4 * (blocks / 2 + g) + k] = shuffle<odd_blocks>(a, b);
            }
        for (int r = 0; r < n; ++r) rows[r] = next[r];
    }
}

template <class S>
    requires(sizeof(S) == 8)
GSH_INLINE void transpose(Wide<S> (&rows)[Wide<S>::width]) {
    constexpr std::size_t n = Wide<S>::width;
    for (std::size_t done = 1; done < n; done *= 2) {
        Wide<S> next[n];
        for (std::size_t r = 0; r < n / 2; ++r) {
            const WidePair<S> both = zip(rows[r], rows[r + n / 2]);
            next[2 * r] = both.first, next[2 * r + 1] = both.second;
        }
        for (std::size_t r = 0; r < n; ++r) rows[r] = next[r];
    }
}

/// Adds neighbouring runs of `Run` numbers: of each 2 Run numbers of a, then of b, the first Run plus the others.
template <int Run, class S>
[[nodiscard]] GSH_INLINE Wide<S> add_runs(Wide<S> a, Wide<S> b) {
    return shuffle<[](int e) { return e / Run * 2 * Run + e % Run; }>(a, b) +
           shuffle<[](int e) { return e / Run * 2 * Run + e % Run + Run; }>(a, b);
}

/// Number i of the result is the sum of the numbers of rows[i]; it is 0 where there is no row i. The numbers are added
/// in a fixed order, half by half.
template <int Count, class S>
    requires(Count <= int(Wide<S>::width))
[[nodiscard]] GSH_INLINE Wide<S> sums_of_rows(const Wide<S>* rows) {
    constexpr int n = Wide<S>::width;
    Wide<S> sums[n + 1];
    for (int i = 0; i < Count; ++i) sums[i] = rows[i];
    const auto halve = [&]<int Run, int Left>(const auto& self) {
        constexpr int next = (Left + 1) / 2;
        sums[Left] = Wide<S>(S(0)); // the partner of the last one, if their number is odd
        for (int i = 0; i < next; ++i) sums[i] = add_runs<Run>(sums[2 * i], sums[2 * i + 1]);
        if constexpr (Run > 1) self.template operator()<Run / 2, next>(self);
    };
    halve.template operator()<n / 2, Count>(halve);
    return sums[0];
}

} // namespace gsh::inline GSH_ISA
