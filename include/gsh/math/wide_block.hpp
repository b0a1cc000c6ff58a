// SPDX-License-Identifier: Apache-2.0
/// @file  Elements of arrays, one in each lane of vector registers: reading, writing, and blocks of them.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/math/wide.hpp>
#include <gsh/math/wide_shuffle.hpp>

#include <cstddef>

namespace gsh::inline GSH_ISA {

/// Number of lanes that put_lanes writes.
template <class S>
inline constexpr std::size_t lanes_per_store = 16 / sizeof(S);

/// Writes a struct of S (a vector, a matrix, …) to each of the lanes [lane, lane + lanes_per_store) of the same struct
/// of Wide<S>; numbers(j) is the struct of lane + j. Several lanes share one store, since stores limit the speed of
/// such a transpose. The first `Skipped` numbers of the struct are left out.
template <class S, std::size_t Skipped = 0, class Wides, class F>
GSH_INLINE void put_lanes(Wides& wides, std::size_t lane, const F& numbers) {
    constexpr std::size_t lanes = lanes_per_store<S>;
    constexpr std::size_t bytes = sizeof(numbers(0)), count = bytes / sizeof(S);
    static_assert(sizeof(Wides) == count * sizeof(Wide<S>) && Wide<S>::width % lanes == 0);
    const S* first[lanes];
    for (std::size_t j = 0; j < lanes; ++j) first[j] = reinterpret_cast<const S*>(&numbers(j));
    for (std::size_t k = Skipped; k < count; ++k)
        Wide<S, lanes>::generate([&](std::size_t j) { return first[j][k]; })
            .store(reinterpret_cast<S*>(&wides) + k * Wide<S>::width + lane);
}

/// As many of the first numbers of a struct as transposes of whole registers can read or write.
template <class S, class Struct>
inline constexpr std::size_t whole_registers =
    sizeof(Struct) / sizeof(S) / Wide<S>::width * Wide<S>::width; // sizeof a reference is that of the struct

/// As put_lanes for all lanes, for structs of many numbers: these are transposed in registers.
template <class S, class Wides, class F>
GSH_INLINE void put_rows(Wides& wides, const F& numbers) {
    using W = Wide<S>;
    constexpr std::size_t whole = whole_registers<S, decltype(numbers(0))>;
    for (std::size_t part = 0; part < whole; part += W::width) {
        W rows[W::width];
        for (std::size_t j = 0; j < W::width; ++j)
            rows[j] = W::load(reinterpret_cast<const S*>(&numbers(j)) + part);
        transpose(rows);
        for (std::size_t k = 0; k < W::width; ++k) rows[k].store(reinterpret_cast<S*>(&wides) + (part + k) * W::width);
    }
    if constexpr (whole * sizeof(S) < sizeof(numbers(0)))
        for (std::size_t lane = 0; lane < W::width; lane += lanes_per_store<S>)
            put_lanes<S, whole>(wides, lane, [&](std::size_t j) -> auto& { return numbers(lane + j); });
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

/// Adds the lanes [0, count) of `wides` to structs of many numbers, as put_rows reads them; numbers(j) is lane j's.
template <class S, class Wides, class F>
GSH_INLINE void add_rows(const Wides& wides, std::size_t count, const F& numbers) {
    using W = Wide<S>;
    constexpr std::size_t bytes = sizeof(numbers(0)), whole = whole_registers<S, decltype(numbers(0))>;
    static_assert(sizeof(Wides) == bytes * W::width);
    const W* const from = reinterpret_cast<const W*>(&wides);
    for (std::size_t part = 0; part < whole; part += W::width) {
        W rows[W::width];
        for (std::size_t k = 0; k < W::width; ++k) rows[k] = from[part + k];
        transpose(rows);
        for (std::size_t j = 0; j < count; ++j) {
            S* const to = reinterpret_cast<S*>(&numbers(j)) + part;
            (W::load(to) + rows[j]).store(to);
        }
    }
    for (std::size_t j = 0; j < count; ++j)
        for (std::size_t k = whole; k < bytes / sizeof(S); ++k) reinterpret_cast<S*>(&numbers(j))[k] += from[k][j];
}

/// Indices of up to `width` elements, one per lane. If there are fewer, the last one fills the other lanes.
template <class T>
struct WideBlock {
    using W = Wide<T>;
    static constexpr std::size_t width = W::width;

    std::size_t index[width];
    std::size_t count = 0;

    /// Adds element i; true if the block is then full.
    bool push(std::size_t i) {
        index[count++] = i;
        return count == width;
    }
    /// Fills the lanes that are left. False for an empty block.
    bool fill() {
        for (std::size_t lane = count; lane < width && count != 0; ++lane) index[lane] = index[count - 1];
        return count != 0;
    }
    /// wides := value(index) in each lane.
    template <class Wides, class Value>
    GSH_INLINE void gather(Wides& wides, const Value& value) const {
        for (std::size_t lane = 0; lane < width; lane += lanes_per_store<T>)
            put_lanes<T>(wides, lane, [&](std::size_t j) -> auto& { return value(index[lane + j]); });
    }
};

} // namespace gsh::inline GSH_ISA
