// SPDX-License-Identifier: Apache-2.0
#include <gsh/core/ordered_indices.hpp>

#include "support/gradient.hpp"

#include <doctest/doctest.h>

#include <cstddef>
#include <cstdint>
#include <vector>

using namespace gsh;

TEST_CASE("indices are sorted, and equal ones ascend") {
    test::Rng rng(3);
    std::vector<int> keys(1000);
    for (int& key : keys) key = static_cast<int>(7 * rng.uniform());
    const auto order = ordered_indices(keys.size(), [&](std::size_t a, std::size_t b) { return keys[a] > keys[b]; });
    REQUIRE(order.size() == keys.size());
    for (std::size_t k = 1; k < order.size(); ++k) {
        const bool ascend = keys[order[k - 1]] > keys[order[k]] ||
                            (keys[order[k - 1]] == keys[order[k]] && order[k - 1] < order[k]);
        CHECK(ascend);
    }
    CHECK(ordered_indices(0, [](std::size_t, std::size_t) { return true; }).empty());
}
