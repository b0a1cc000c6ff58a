// SPDX-License-Identifier: Apache-2.0
/// @file  The principal axes of M Mᵀ as a rotation, and the lengths along them: M up to a rotation from the right.
#pragma once

#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <limits>
#include <utility>

namespace gsh {

/// M Mᵀ = R diag(lengths)² Rᵀ.
template <std::floating_point T>
struct PrincipalAxes {
    mat3<T> R;       ///< a rotation: right-handed
    vec3<T> lengths; ///< not negative, in no particular order
};

/// The principal axes of M Mᵀ, from the left singular vectors and the singular values of M.
///
/// The columns of M are made orthogonal by rotations of two columns at a time, M V = R diag(lengths). Compared with the
/// eigenvectors of M Mᵀ, small lengths keep their relative accuracy. If the columns are orthogonal already, they are
/// the axes, in their order; so the axes of a Gaussian that moves rigidly do not change places from frame to frame.
///
/// Errors  none; a length of zero gets an axis perpendicular to the others. M must be finite.
/// Source  one-sided Jacobi rotations: Hestenes, "Inversion of Matrices by Biorthogonalization and Related Results",
///         1958.
template <std::floating_point T>
[[nodiscard]] PrincipalAxes<T> principal_axes(const mat3<T>& M) {
    mat3<T> columns = M;
    constexpr T negligible = 4 * std::numeric_limits<T>::epsilon();
    for (int sweep = 0, turned = 1; turned && sweep < 30; ++sweep) {
        turned = 0;
        for (const auto& [a, b] : {std::pair(0, 1), std::pair(0, 2), std::pair(1, 2)}) {
            const T aa = dot(columns[a], columns[a]), bb = dot(columns[b], columns[b]),
                    ab = dot(columns[a], columns[b]);
            if (!(std::abs(ab) > negligible * std::sqrt(aa * bb))) continue;
            turned = 1;
            const T ratio = (bb - aa) / (2 * ab);
            const T tangent = (ratio < 0 ? T(-1) : T(1)) / (std::abs(ratio) + std::sqrt(1 + ratio * ratio));
            const T cosine = 1 / std::sqrt(1 + tangent * tangent), sine = tangent * cosine;
            const vec3<T> first = columns[a] * cosine - columns[b] * sine;
            columns[b] = columns[a] * sine + columns[b] * cosine;
            columns[a] = first;
        }
    }

    PrincipalAxes<T> axes{mat3<T>(T(0)), vec3<T>(T(0))};
    T longest = 0;
    for (int k = 0; k < 3; ++k) longest = std::max(longest, axes.lengths[k] = length(columns[k]));
    int known[3], unknown[3], known_count = 0, unknown_count = 0;
    for (int k = 0; k < 3; ++k) {
        if (axes.lengths[k] > longest * std::numeric_limits<T>::epsilon()) {
            axes.R[k] = columns[k] * (1 / axes.lengths[k]);
            known[known_count++] = k;
        } else {
            unknown[unknown_count++] = k;
        }
    }
    if (known_count == 0) return {mat3<T>(T(1)), vec3<T>(T(0))};
    if (known_count == 1) { // any direction perpendicular to the one axis
        const vec3<T>& axis = axes.R[known[0]];
        const vec3<T> other = std::abs(axis.x) < T(0.7) ? vec3<T>(1, 0, 0) : vec3<T>(0, 1, 0);
        axes.R[unknown[0]] = normalize(cross(axis, other));
        known[known_count++] = unknown[0], unknown[0] = unknown[1];
    }
    if (known_count == 2) axes.R[unknown[0]] = cross(axes.R[known[0]], axes.R[known[1]]);
    if (determinant(axes.R) < 0) {
        int shortest = 0; // between frames, a change of its sign matters least
        for (int k = 1; k < 3; ++k)
            if (axes.lengths[k] < axes.lengths[shortest]) shortest = k;
        axes.R[shortest] = -axes.R[shortest];
    }
    return axes;
}

} // namespace gsh
