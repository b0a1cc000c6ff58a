// SPDX-License-Identifier: Apache-2.0
/// @file  Links two translation units for two instruction sets. Each runs its own code, and their results agree.
///
/// Without the inline namespace GSH_ISA, the linker keeps one of two functions of the same name. If it replaces all of
/// a unit's functions, both units run the code of one and give identical results, and a machine without the larger set
/// stops at the first instruction of that set. If some functions are inlined and others replaced, code for 64-byte
/// vectors receives vectors of 16 bytes.

#define DOCTEST_CONFIG_IMPLEMENT // shared test code needs doctest's implementation; main is below
#include <doctest/doctest.h>

#include "instruction_sets/results.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <cstring>
#include <vector>

namespace {

/// The largest difference between two results, relative to the largest number in them.
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
    // Relative to the largest number; orders of sums differ, and multiply-adds may be fused.
    constexpr double tolerance = 2e-5;
    // The units run alternately, twice. The second run of a unit must not depend on the other unit.
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
    if (first.vector_bytes != other.vector_bytes && !own) { // the order of sums depends on the registers' width
        std::puts("the results are identical: one unit ran the other's code");
        good = false;
    }
    std::puts(good ? "they agree" : "they do NOT agree");
    return good ? 0 : 1;
}
