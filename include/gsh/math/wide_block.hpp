// SPDX-License-Identifier: Apache-2.0
/// @file  Elements of arrays, one in each lane of a vector register.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/math/wide.hpp>

#include <cstddef>

namespace gsh::inline GSH_ISA {

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
