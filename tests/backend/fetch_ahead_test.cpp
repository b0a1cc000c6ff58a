// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/fetch_ahead.hpp>

#include <gsh/backend/serial.hpp>
#include <gsh/core/error.hpp>

#include <doctest/doctest.h>

#include "support/guarded.hpp"

#include <cstddef>
#include <cstdint>
#include <vector>

using namespace gsh;

TEST_CASE_TEMPLATE("arrays arrive whole, whatever was announced", B, cpu::Serial, test::Guarded) {
    const std::vector<std::vector<std::uint8_t>> arrays{{1, 2, 3}, {}, {4, 5, 6, 7, 8}, {9}};
    B backend;
    FetchAhead<B> ahead(backend, {arrays.begin(), arrays.end()});
    for (const std::size_t k : {2, 0, 1, 2, 3, 3}) {
        const Span<const std::uint8_t> found = ahead.get(k);
        std::vector<std::uint8_t> host = downloaded(backend, found);
        CHECK(host == arrays[k]);
        ahead.fetch((k + 1) % 4);
    }
    CHECK_THROWS_WITH_AS((void)ahead.get(4), "FetchAhead: there is no array 4, expected one of 4", ValueError);
    CHECK_THROWS_AS(ahead.fetch(4), ValueError);
}
