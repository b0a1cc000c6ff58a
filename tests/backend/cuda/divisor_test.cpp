// SPDX-License-Identifier: Apache-2.0
/// @file  Quotients by a Divisor are those of a division.
#include <gsh/backend/cuda/divisor.cuh>

#include <doctest/doctest.h>

#include <cstdint>
#include <limits>
#include <vector>

namespace gsh::divisor_of_kernels {
namespace {

constexpr std::uint32_t largest = std::numeric_limits<std::uint32_t>::max();

TEST_CASE("quotients by a Divisor are exact for all numbers of 32 bits") {
    std::vector<std::uint32_t> divisors;
    for (std::uint32_t d = 1; d <= 300; ++d) divisors.push_back(d);
    for (unsigned bit = 9; bit < 32; ++bit)
        for (const std::uint32_t offset : {largest, 0u, 1u}) divisors.push_back((1u << bit) + offset);
    for (const std::uint32_t d : {641u, 65'537u, 1'000'003u, 6'700'417u, largest - 1, largest}) divisors.push_back(d);
    for (const std::uint32_t d : divisors) {
        CAPTURE(d);
        const cuda::Divisor divisor(d);
        std::uint64_t wrong = 0;
        const auto check = [&](std::uint32_t n) {
            const std::uint32_t quotient = divisor.quotient(n);
            wrong += quotient != n / d || divisor.remainder(n, quotient) != n % d;
        };
        for (std::uint32_t n = 0; n < 2000; ++n) check(n), check(largest - n);
        // Around multiples, where a quotient that is off by little is wrong.
        for (std::uint64_t multiple = d; multiple <= largest; multiple += (largest / 500 / d + 1) * std::uint64_t(d))
            for (const std::uint32_t offset : {largest, 0u, 1u}) check(static_cast<std::uint32_t>(multiple) + offset);
        CHECK(wrong == 0);
    }
}

TEST_CASE("a Divisor is 1 before it has a number, and in place of 0") {
    CHECK(cuda::Divisor().quotient(largest) == largest);
    CHECK(cuda::Divisor(0).quotient(largest) == largest);
}

} // namespace
} // namespace gsh::divisor_of_kernels
