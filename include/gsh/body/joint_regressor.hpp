// SPDX-License-Identifier: Apache-2.0
/// @file  Fits sparse rows of a joint regressor: few vertices around a joint, whose weighted mean it is in all shapes.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/linalg.hpp>
#include <gsh/math/vec.hpp>

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <limits>
#include <numbers>
#include <vector>

namespace gsh {

/// The nearest of the vertices in each of `bins` directions from a point, sorted.
///
/// Shapes  vertices [V]; allowed [V]: other vertices are left out.
[[nodiscard]] inline std::vector<int> vertices_around(Span<const vec3<double>> vertices,
                                                      const std::vector<bool>& allowed, const vec3<double>& point,
                                                      int bins = 200);

/// Weights w >= 0 with Σ w = 1 that minimise Σ_s |Σ_v w_v x_sv - joint_s|² + ridge |w|². The first of the S rows holds
/// positions, the others are displacements of shapes: Σ w = 1 makes the joint follow them, too. The positions count a
/// hundred times as much. A ridge spreads weights over more vertices.
///
/// Shapes  candidates [C]; shapes [S][V] vertices; joint [S].
/// Source  Lawson and Hanson, "Solving Least Squares Problems", 1974, chapter 23.
template <std::same_as<double> T = double> // compiled only where it is called
[[nodiscard]] std::vector<RegressorEntry> fitted_regressor_row(const std::vector<int>& candidates,
                                                               const std::vector<std::vector<vec3<T>>>& shapes,
                                                               const std::vector<vec3<T>>& joint);

// -------------------------------------------------------------------------------------------------------------

inline std::vector<int> vertices_around(Span<const vec3<double>> vertices, const std::vector<bool>& allowed,
                                        const vec3<double>& point, int bins) {
    std::vector<vec3<double>> directions; // a Fibonacci lattice, mirrored with the point so that sides agree
    for (int k = 0; k < bins; ++k) {
        const double y = 1 - (2 * k + 1) / static_cast<double>(bins), radius = std::sqrt(1 - y * y);
        const double angle = std::numbers::pi * (3 - std::sqrt(5.0)) * k;
        directions.emplace_back(radius * std::cos(angle) * (point.x < 0 ? -1 : 1), y, radius * std::sin(angle));
    }
    std::vector<int> nearest(directions.size(), -1);
    std::vector<double> distances(directions.size(), std::numeric_limits<double>::infinity());
    for (std::size_t v = 0; v < vertices.size(); ++v) {
        if (!allowed[v]) continue;
        const vec3<double> away = vertices[v] - point;
        const double distance = length(away);
        if (!(distance > 0)) return {static_cast<int>(v)};
        const auto bin = static_cast<std::size_t>(
            std::max_element(directions.begin(), directions.end(),
                             [&](const auto& a, const auto& b) { return dot(a, away) < dot(b, away); }) -
            directions.begin());
        if (distance < distances[bin]) distances[bin] = distance, nearest[bin] = static_cast<int>(v);
    }
    std::erase(nearest, -1);
    std::sort(nearest.begin(), nearest.end());
    return nearest;
}

template <std::same_as<double> T>
std::vector<RegressorEntry> fitted_regressor_row(const std::vector<int>& candidates,
                                                 const std::vector<std::vector<vec3<T>>>& shapes,
                                                 const std::vector<vec3<T>>& joint) {
    check_size("fitted_regressor_row", "joint", joint.size(), shapes.size(), "one position or displacement per shape");
    check_value(!candidates.empty() && !shapes.empty(), "fitted_regressor_row", "there are no candidates or no shapes");
    using Matrix = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;
    using Vector = Eigen::Matrix<T, Eigen::Dynamic, 1>;
    const auto C = static_cast<Eigen::Index>(candidates.size()), S = static_cast<Eigen::Index>(shapes.size());
    constexpr T position_weight = 100, sum_weight = 100;
    constexpr T ridge = 1e-6; // m²: a millimetre, over a thousand vertices
    Matrix A(3 * S + 1, C);
    Vector b(3 * S + 1);
    for (Eigen::Index s = 0; s < S; ++s) {
        const T weight = s == 0 ? position_weight : T(1);
        for (int axis = 0; axis < 3; ++axis) {
            b(3 * s + axis) = 0; // relative to the joint, which Σ w = 1 allows for positions and displacements alike
            for (Eigen::Index c = 0; c < C; ++c) {
                const auto v = static_cast<std::size_t>(candidates[static_cast<std::size_t>(c)]);
                A(3 * s + axis, c) =
                    weight * (shapes[static_cast<std::size_t>(s)][v][axis] - joint[static_cast<std::size_t>(s)][axis]);
            }
        }
    }
    A.row(3 * S).setConstant(sum_weight), b(3 * S) = sum_weight;
    Matrix normal = A.transpose() * A;
    normal.diagonal().array() += ridge;
    const Vector right = A.transpose() * b;

    Vector weights = Vector::Zero(C);
    std::vector<Eigen::Index> free; // the weights that may differ from 0
    const auto solve = [&] {
        const auto F = static_cast<Eigen::Index>(free.size());
        Matrix part(F, F);
        Vector target(F);
        for (Eigen::Index i = 0; i < F; ++i) {
            target(i) = right(free[static_cast<std::size_t>(i)]);
            for (Eigen::Index k = 0; k < F; ++k)
                part(i, k) = normal(free[static_cast<std::size_t>(i)], free[static_cast<std::size_t>(k)]);
        }
        return Vector(part.ldlt().solve(target));
    };
    for (Eigen::Index round = 0; round < 3 * C; ++round) {
        const Vector gradient = right - normal * weights;
        Eigen::Index best = -1;
        for (Eigen::Index c = 0; c < C; ++c)
            if (std::find(free.begin(), free.end(), c) == free.end() && gradient(c) > 1e-10 &&
                (best < 0 || gradient(c) > gradient(best)))
                best = c;
        if (best < 0) break;
        free.push_back(best);
        for (;;) {
            const Vector solution = solve();
            T step = 1;
            for (std::size_t i = 0; i < free.size(); ++i) {
                const T now = weights(free[i]), next = solution(static_cast<Eigen::Index>(i));
                if (next <= 0) step = std::min(step, now / (now - next));
            }
            for (std::size_t i = 0; i < free.size(); ++i)
                weights(free[i]) += step * (solution(static_cast<Eigen::Index>(i)) - weights(free[i]));
            if (step >= 1) break;
            std::erase_if(free, [&](Eigen::Index c) { return weights(c) <= 1e-12; });
            for (Eigen::Index c = 0; c < C; ++c)
                if (std::find(free.begin(), free.end(), c) == free.end()) weights(c) = 0;
        }
    }
    const T sum = weights.sum();
    std::vector<RegressorEntry> row;
    for (Eigen::Index c = 0; c < C; ++c)
        if (weights(c) > 0) row.push_back({candidates[static_cast<std::size_t>(c)], weights(c) / sum});
    return row;
}

} // namespace gsh
