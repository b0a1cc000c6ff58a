// SPDX-License-Identifier: Apache-2.0
/// @file  Division by a number that is the same for a whole kernel, in five instructions instead of twenty.
#pragma once

#include <gsh/core/config.hpp>

#include <bit>
#include <cstdint>

namespace gsh::cuda {

/// A divisor with its reciprocal, which the host computes once. Quotients are exact for all numbers of 32 bits.
///
/// Source  Granlund and Montgomery, "Division by invariant integers using multiplication", 1994, figure 4.1.
struct Divisor {
    std::uint32_t number = 1;

    Divisor() = default;
    /// 0 is taken for 1: it is the size of parts where there is nothing to divide.
    explicit Divisor(std::uint32_t divisor) : number(divisor != 0 ? divisor : 1) {
        const auto bits = static_cast<std::uint32_t>(std::bit_width(number - 1)); // of the next power of two
        const std::uint64_t excess = (std::uint64_t(1) << bits) - number;
        factor_ = static_cast<std::uint32_t>((excess << 32) / number + 1);
        first_shift_ = bits == 0 ? 0 : 1;
        second_shift_ = static_cast<std::uint16_t>(bits - first_shift_);
    }

    [[nodiscard]] GSH_HD std::uint32_t quotient(std::uint32_t n) const {
        const auto high = static_cast<std::uint32_t>(std::uint64_t(n) * factor_ >> 32);
        return (high + ((n - high) >> first_shift_)) >> second_shift_;
    }
    [[nodiscard]] GSH_HD std::uint32_t remainder(std::uint32_t n, std::uint32_t quotient) const {
        return n - quotient * number;
    }

private:
    std::uint32_t factor_ = 1;
    std::uint16_t first_shift_ = 0, second_shift_ = 0;
};

} // namespace gsh::cuda
