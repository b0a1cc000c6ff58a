// SPDX-License-Identifier: Apache-2.0
#include <gsh/core/prefetch.hpp>

#include <doctest/doctest.h>

namespace {
/// A function that only writes and prefetches, called through a pointer. GCC 12 used to remove such calls.
[[gnu::noinline]] void write_and_prefetch(int* values, int count) {
    for (int i = 0; i < count; ++i) {
        gsh::prefetch(values + i + 16);
        values[i] += i;
    }
}
} // namespace

TEST_CASE("prefetching changes nothing, at any address") {
    gsh::prefetch(nullptr);
    int values[40] = {};
    write_and_prefetch(values, 40);
    for (int i = 0; i < 40; ++i) CHECK(values[i] == i);
}
