// SPDX-License-Identifier: Apache-2.0
/// @file  Scalar arithmetic without branches or library calls, so that loops over pixels are vectorised.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/render/arithmetic.hpp>

#include <bit>
#include <cstdint>

namespace gsh::cpu::inline GSH_ISA {

using gsh::detail::exp2_minus;
using gsh::detail::max_positive;
using gsh::detail::min_positive;
using gsh::detail::multiply_add;
using gsh::detail::rough_sqrt;

/// 1 / sqrt(x) for a normal x > 0, to 2 units in the last place: Newton's iteration without a library call. std::sqrt
/// may set errno, which keeps a loop from being vectorised.
[[nodiscard]] inline double inverse_sqrt(double x) {
    double y = std::bit_cast<double>(0x5FE6EB50C7B537A9ull - (std::bit_cast<std::uint64_t>(x) >> 1));
    for (int i = 0; i < 4; ++i) y = y * (1.5 - 0.5 * (x * y) * y);
    return y;
}

} // namespace gsh::cpu
