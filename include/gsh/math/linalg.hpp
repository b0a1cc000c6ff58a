// SPDX-License-Identifier: Apache-2.0
/// @file  The door to Eigen: host code that solves or multiplies large things includes this, and it keeps nvcc quiet.
#pragma once

#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#if defined(__CUDACC__) && !defined(EIGEN_NO_CUDA)
#define EIGEN_NO_CUDA // we solve on the host; Eigen's own device code does not pass nvcc without warnings
#endif
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Warray-bounds" // GCC 12 follows packet loops into arrays too short to have a packet
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif
#include <Eigen/Core>
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic pop
#endif

#include <cstddef>
#include <type_traits>

namespace gsh {

/// A span of numbers as an Eigen column; no copy.
template <class T>
[[nodiscard]] auto eigen_map(Span<T> values) {
    using Column = Eigen::Matrix<std::remove_const_t<T>, Eigen::Dynamic, 1>;
    using Plain = std::conditional_t<std::is_const_v<T>, const Column, Column>;
    return Eigen::Map<Plain>(values.data(), static_cast<Eigen::Index>(values.size()));
}

template <class T>
[[nodiscard]] Eigen::Matrix<T, 3, 1> to_eigen(const vec3<T>& v) {
    return {v.x, v.y, v.z};
}
template <class T>
[[nodiscard]] Eigen::Matrix<T, 3, 3> to_eigen(const mat3<T>& m) {
    return Eigen::Map<const Eigen::Matrix<T, 3, 3>>(&m[0].x); // both are stored by columns
}

template <class T>
[[nodiscard]] vec3<T> from_eigen(const Eigen::Matrix<T, 3, 1>& v) {
    return {v.x(), v.y(), v.z()};
}
template <class T>
[[nodiscard]] mat3<T> from_eigen(const Eigen::Matrix<T, 3, 3>& m) {
    return mat3<T>(m(0, 0), m(1, 0), m(2, 0), m(0, 1), m(1, 1), m(2, 1), m(0, 2), m(1, 2), m(2, 2));
}

} // namespace gsh
