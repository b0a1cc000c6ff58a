// SPDX-License-Identifier: Apache-2.0
/// @file  The order of things, as indices.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <vector>

namespace gsh {

/// The indices 0 to count - 1, sorted by before(a, b). Equal ones ascend, as by std::stable_sort, which in libstdc++ 12
/// calls a function that C++17 deprecates.
template <class Before>
[[nodiscard]] std::vector<std::uint32_t> ordered_indices(std::size_t count, const Before& before) {
    std::vector<std::uint32_t> order(count);
    std::iota(order.begin(), order.end(), 0u);
    std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
        if (before(a, b)) return true;
        return !before(b, a) && a < b;
    });
    return order;
}

} // namespace gsh
