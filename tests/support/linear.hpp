// SPDX-License-Identifier: Apache-2.0
/// @file  Random matrices and motions, their inner products (losses whose gradients are known) and distances.
#pragma once

#include "support/gradient.hpp"

#include <gsh/math/affine.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>

namespace gsh::test {

inline mat3<double> random_matrix(Rng& rng) {
    const auto a = rng.vec(), b = rng.vec(), c = rng.vec();
    return mat3<double>(a, b, c);
}

inline Affine<double> random_affine(Rng& rng) {
    const auto linear = random_matrix(rng);
    return {linear, rng.vec()};
}

/// The inner product: the sum of the products of corresponding numbers.
inline double inner(const mat3<double>& a, const mat3<double>& b) {
    return dot(a[0], b[0]) + dot(a[1], b[1]) + dot(a[2], b[2]);
}
inline double inner(const Affine<double>& a, const Affine<double>& b) {
    return inner(a.linear, b.linear) + dot(a.translation, b.translation);
}

/// The largest difference between corresponding numbers.
template <class T>
T distance(const vec3<T>& a, const vec3<T>& b) {
    return std::max({std::abs(a.x - b.x), std::abs(a.y - b.y), std::abs(a.z - b.z)});
}
template <class T>
T distance(const mat3<T>& a, const mat3<T>& b) {
    return std::max({distance(a[0], b[0]), distance(a[1], b[1]), distance(a[2], b[2])});
}
template <class T>
T distance(const Affine<T>& a, const Affine<T>& b) {
    return std::max(distance(a.linear, b.linear), distance(a.translation, b.translation));
}

} // namespace gsh::test
