// SPDX-License-Identifier: Apache-2.0
/// @file  Elements of arrays, one in each lane of vector registers: reading, writing, and blocks of them.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/math/wide.hpp>

#include <cstddef>

namespace gsh::inline GSH_ISA {

/// Number of lanes that put_lanes writes.
template <class S>
inline constexpr std::size_t lanes_per_store = 16 / sizeof(S);

/// Writes a struct of S (a vector, a matrix, …) to each of the lanes [lane, lane + lanes_per_store) of the same struct
/// of Wide<S>; numbers(j) is the struct of lane + j. Several lanes share one store, since stores limit the speed of
/// such a transpose.
template <class S, class Wides, class F>
GSH_INLINE void put_lanes(Wides& wides, std::size_t lane, const F& numbers) {
    constexpr std::size_t lanes = lanes_per_store<S>;
    constexpr std::size_t bytes = sizeof(numbers(0)), count = bytes / sizeof(S);
    static_assert(sizeof(Wides) == count * sizeof(Wide<S>) && Wide<S>::width % lanes == 0);
    const S* first[lanes];
    for (std::size_t j = 0; j < lanes; ++j) first[j] = reinterpret_cast<const S*>(&numbers(j));
    for (std::size_t k = 0; k < count; ++k)
        Wide<S, lanes>::generate([&](std::size_t j) { return first[j][k]; })
            .store(reinterpret_cast<S*>(&wides) + k * Wide<S>::width + lane);
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
