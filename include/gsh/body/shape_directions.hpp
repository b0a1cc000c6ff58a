// SPDX-License-Identifier: Apache-2.0
/// @file  The few directions in which mixtures of many blend shapes vary most: shape directions of a body.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/linalg.hpp>

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <vector>

namespace gsh {

/// Directions d_k = Σ_t mixing[t, k] · target_t.
struct ShapeMixture {
    std::size_t count = 0;
    std::vector<double> variances; // [count] |d_k|², descending
    std::vector<double> mixing;    // [targets, count]
};

/// The inner products Σ_v weight_v · target_t[v] · target_u[v] of targets, [T, T].
///
/// Shapes  targets [T][3 V]; weights [V].
/// Errors  ShapeError for other sizes.
template <std::same_as<double> T = double> // compiled only where it is called: Eigen's products take seconds
[[nodiscard]] std::vector<T> target_products(const std::vector<std::vector<float>>& targets,
                                             Span<const double> weights);

/// Principal directions of the shapes Σ_t c_t · target_t for random coefficients c: x = Σ_k β_k d_k with independent β
/// of unit variance has the same covariance, as far as `count` directions reach, and no other directions leave less.
///
/// With S = cov(c) = B Bᵀ and the inner products G of the targets, H = Bᵀ G B = U Λ Uᵀ; then mixing = B U and the
/// variance of direction k is λ_k. The targets themselves are not needed, however many numbers each has.
///
/// Shapes  gram, covariance [T, T], symmetric, without negative eigenvalues but for rounding.
/// Errors  ShapeError for other sizes.
template <std::same_as<double> T = double> // compiled only where it is called: Eigen's solver takes seconds
[[nodiscard]] ShapeMixture principal_mixture(Span<const T> gram, Span<const T> covariance, std::size_t targets,
                                             std::size_t count) {
    check_size("principal_mixture", "gram", gram.size(), targets * targets, "one row per target");
    check_size("principal_mixture", "covariance", covariance.size(), targets * targets, "one row per target");
    using Matrix = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;
    const auto size = static_cast<Eigen::Index>(targets);
    const Eigen::Map<const Matrix> G(gram.data(), size, size), S(covariance.data(), size, size);
    ShapeMixture mixture;
    mixture.count = std::min(count, targets);
    if (mixture.count == 0) return mixture;

    const Eigen::SelfAdjointEigenSolver<Matrix> of_coefficients(S);
    const Matrix B =
        of_coefficients.eigenvectors() * of_coefficients.eigenvalues().cwiseMax(0).cwiseSqrt().asDiagonal();
    const Eigen::SelfAdjointEigenSolver<Matrix> of_shapes(B.transpose() * G * B);
    const auto K = static_cast<Eigen::Index>(mixture.count);
    const Matrix mixing = B * of_shapes.eigenvectors().rowwise().reverse().leftCols(K); // the largest come last
    for (Eigen::Index k = 0; k < K; ++k)
        mixture.variances.push_back(std::max(of_shapes.eigenvalues()(size - 1 - k), T(0)));
    for (Eigen::Index t = 0; t < size; ++t)
        for (Eigen::Index k = 0; k < K; ++k) mixture.mixing.push_back(mixing(t, k));
    return mixture;
}

template <std::same_as<double> T>
std::vector<T> target_products(const std::vector<std::vector<float>>& targets, Span<const double> weights) {
    for (const auto& target : targets)
        check_size("target_products", "target", target.size(), 3 * weights.size(), "three numbers per vertex");
    const std::size_t count = targets.size(), numbers = 3 * weights.size(), most_rows = 1024;
    using Matrix = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;
    Matrix products = Matrix::Zero(static_cast<Eigen::Index>(count), static_cast<Eigen::Index>(count));
    for (std::size_t first = 0; first < numbers; first += most_rows) {
        const std::size_t rows = std::min(most_rows, numbers - first);
        Matrix block(static_cast<Eigen::Index>(rows), static_cast<Eigen::Index>(count));
        for (std::size_t t = 0; t < count; ++t)
            for (std::size_t i = 0; i < rows; ++i)
                block(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(t)) =
                    static_cast<T>(targets[t][first + i]) * std::sqrt(weights[(first + i) / 3]);
        products.noalias() += block.transpose() * block;
    }
    return {products.data(), products.data() + products.size()};
}

} // namespace gsh
