// SPDX-License-Identifier: Apache-2.0
/// @file  Quadratic functions of numbers that must not be negative, minimised one number at a time.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>

namespace gsh {

/// Minimises xᵀ A x / 2 - bᵀ x over x >= 0 by coordinate descent. It ends after a sweep in which no number moved by
/// more than 1e-9 of the largest, or after 500 sweeps.
///
/// Shapes  A [K, K] symmetric, with a positive diagonal; x [K] the start, then the result; gradient [K] A x - b at the
///         start, overwritten.
/// Errors  ShapeError.
template <std::floating_point T>
void descend_nonnegative(Span<const T> A, Span<T> gradient, Span<T> x) {
    const std::size_t K = x.size();
    check_size("descend_nonnegative", "A", A.size(), K * K, "one row per number");
    check_size("descend_nonnegative", "gradient", gradient.size(), K, "one per number");
    for (int sweep = 0; sweep < 500; ++sweep) {
        T moved = 0, largest = 0;
        for (std::size_t k = 0; k < K; ++k) {
            const T next = std::max(T(0), x[k] - gradient[k] / A[k * K + k]), change = next - x[k];
            largest = std::max(largest, next);
            if (change == 0) continue;
            for (std::size_t j = 0; j < K; ++j) gradient[j] += change * A[k * K + j];
            x[k] = next;
            moved = std::max(moved, std::abs(change));
        }
        if (moved <= T(1e-9) * largest) break;
    }
}

} // namespace gsh
