// SPDX-License-Identifier: Apache-2.0
/// @file  Consecutive elements of a caller's arrays in the lanes of registers of double.
#pragma once

#include <gsh/math/vec.hpp>
#include <gsh/math/wide.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>

namespace gsh_python {

/// The elements from `first` on, one per lane. Beyond `end`, lanes repeat the last element and are not written.
struct Lanes {
    using W = gsh::Wide<double>;
    std::size_t first, count;

    Lanes(std::size_t begin, std::size_t end) : first(begin), count(std::min(W::width, end - begin)) {}

    /// Number k of each element; an element has `stride` numbers.
    template <class T>
    [[nodiscard]] GSH_INLINE W load(const T* from, std::size_t stride, std::size_t k) const {
        alignas(64) double numbers[W::width];
        const T* const start = from + first * stride + k;
        for (std::size_t lane = 0; lane < W::width; ++lane)
            numbers[lane] = static_cast<double>(start[std::min(lane, count - 1) * stride]);
        return W::load(numbers);
    }
    template <class T>
    [[nodiscard]] GSH_INLINE gsh::vec3<W> load_vec3(const T* from) const {
        return {load(from, 3, 0), load(from, 3, 1), load(from, 3, 2)};
    }
    template <class T>
    GSH_INLINE void store(W numbers, T* to, std::size_t stride, std::size_t k) const {
        alignas(64) double lanes[W::width];
        numbers.store(lanes);
        for (std::size_t lane = 0; lane < count; ++lane) to[(first + lane) * stride + k] = static_cast<T>(lanes[lane]);
    }
    template <class T>
    GSH_INLINE void add(W numbers, T* to, std::size_t stride, std::size_t k) const {
        alignas(64) double lanes[W::width];
        numbers.store(lanes);
        for (std::size_t lane = 0; lane < count; ++lane) to[(first + lane) * stride + k] += static_cast<T>(lanes[lane]);
    }
    /// The lanes with an element whose radii are above 0.
    [[nodiscard]] GSH_INLINE auto visible(const std::int32_t* radii) const {
        alignas(64) double kept[W::width] = {};
        for (std::size_t lane = 0; lane < count; ++lane) {
            const std::int32_t* const r = radii + 2 * (first + lane);
            kept[lane] = r[0] > 0 && r[1] > 0 ? 1 : 0;
        }
        return W::load(kept) > W(0.5);
    }
};

} // namespace gsh_python
