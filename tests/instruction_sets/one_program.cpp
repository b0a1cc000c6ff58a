// SPDX-License-Identifier: Apache-2.0
/// @file  Two translation units for two instruction sets in one program: each runs its own code, and they agree.
///
/// Without the inline namespace GSH_ISA the linker keeps one of two functions of the same name. Where it replaces all of a
/// unit's functions, both units run the code of one, with identical results, and a machine without the larger set stops
/// at its first instruction; where some are inlined and some replaced, 16 bytes meet code that expects 64.

#define DOCTEST_CONFIG_IMPLEMENT // what tests share needs it; main is our own
#include <doctest/doctest.h>

#include "instruction_sets/results.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <cstring>
#include <vector>

namespace {

/// The largest difference of two results, of the largest number in them.
double difference(const char* what, const std::vector<double>& a, const std::vector<double>& b) {
    double largest = 0, size = 0;
    for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i) {
        const double d = std::abs(a[i] - b[i]);
        largest = d <= largest ? largest : d; // NaN stays
        size = std::max(size, std::abs(a[i]));
    }
    if (a.size() != b.size() || size == 0) largest = size = NAN;
    std::printf("%-10s %6zu numbers, largest difference %.1e of the largest number\n", what, a.size(), largest / size);
    return largest / size;
}

} // namespace

int main() {
    constexpr double tolerance = 2e-5; // of the largest number: other orders of sums, fused multiply-adds
    // In turn and again: a unit's second run must not depend on what the other one did.
    const auto first = gsh::test::native_results(), other = gsh::test::baseline_results(),
               again = gsh::test::native_results();
    std::printf("%s (%zu bytes) and %s (%zu bytes)\n", first.instruction_set, first.vector_bytes, other.instruction_set,
                other.vector_bytes);
    bool good = first.posed == again.posed && first.field == again.field && first.rasterized == again.rasterized;
    if (std::strcmp(other.instruction_set, "baseline") != 0) good = false;
    for (const double d : {difference("posed", first.posed, other.posed), difference("field", first.field, other.field),
                           difference("rasterized", first.rasterized, other.rasterized)})
        good = good && d < tolerance; // false for NaN
    const bool own = first.field != other.field && first.rasterized != other.rasterized;
    if (first.vector_bytes != other.vector_bytes && !own) { // registers of another width add in another order
        std::puts("the results are identical: one unit ran the other's code");
        good = false;
    }
    std::puts(good ? "they agree" : "they do NOT agree");
    return good ? 0 : 1;
}
