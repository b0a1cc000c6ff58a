// SPDX-License-Identifier: Apache-2.0
/// @file  How well a number of shape directions describes adults of MakeHuman that were not among those they came from.
#pragma once

#include <gsh/core/rng.hpp>
#include <gsh/io/body/makehuman_body.hpp>
#include <gsh/io/body/makehuman_data.hpp>
#include <gsh/io/body/makehuman_shapes.hpp>
#include <gsh/math/linalg.hpp>

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace gsh {

/// Distances of vertices after the best fit, in metres, by area of the skin without the head.
struct FitError {
    double rms = 0, percentile_95 = 0;
};

/// The error of each number of betas.
struct FitErrors {
    int betas = 0;
    FitError adults, heavy_man, thin_woman;
};

/// Fits random adults, and two extreme ones, with different numbers of betas. Vertices correspond, so the distance to
/// the surface is smaller.
///
/// Shapes  counts ascending.
[[nodiscard]] inline std::vector<FitErrors> fit_errors(const MakeHumanData& data, const MakeHumanShapes& shapes,
                                                       const std::vector<int>& counts, std::size_t people,
                                                       std::uint64_t seed);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// A vertex's distance and the area that it stands for.
using WeightedErrors = std::vector<std::pair<double, double>>;

inline FitError summary_of(WeightedErrors errors) {
    std::sort(errors.begin(), errors.end());
    double squares = 0, area = 0, below = 0;
    for (const auto& [error, weight] : errors) squares += error * error * weight, area += weight;
    FitError summary;
    for (const auto& [error, weight] : errors) {
        summary.percentile_95 = error;
        if ((below += weight) >= 0.95 * area) break;
    }
    summary.rms = area > 0 ? std::sqrt(squares / area) : 0;
    return summary;
}

} // namespace detail

inline std::vector<FitErrors> fit_errors(const MakeHumanData& data, const MakeHumanShapes& shapes,
                                         const std::vector<int>& counts, std::size_t people, std::uint64_t seed) {
    const std::size_t V = shapes.vertices.size(), most = body_directions_of(counts.empty() ? 0 : counts.back());
    const std::vector<MakeHumanDirection> directions = makehuman_directions(shapes, most, 0);
    std::vector<double> areas = shapes.areas;
    for (const int v : vertices_of_joints(data, is_head_joint)) areas[static_cast<std::size_t>(v)] = 0;

    std::vector<std::vector<double>> coefficients;
    for (std::size_t n = 0; n < people; ++n) {
        Rng rng(random_bits(seed, n));
        coefficients.push_back(random_coefficients(data, rng));
    }
    MakeHumanPerson heavy_man, thin_woman;
    heavy_man.sex = 1, heavy_man.age = 0.4, heavy_man.muscle = 0.05, heavy_man.weight = 1;
    thin_woman.sex = 0, thin_woman.age = 0.4, thin_woman.muscle = 0.05, thin_woman.weight = 0;
    for (const MakeHumanPerson& person : {heavy_man, thin_woman})
        coefficients.push_back(target_coefficients(data, person));

    const auto rows = static_cast<Eigen::Index>(3 * V), K = static_cast<Eigen::Index>(directions.size()),
               N = static_cast<Eigen::Index>(coefficients.size());
    Eigen::VectorXd weights(rows);
    Eigen::MatrixXd basis(rows, K), bodies = Eigen::MatrixXd::Zero(rows, N);
    for (Eigen::Index i = 0; i < rows; ++i) weights(i) = std::sqrt(areas[static_cast<std::size_t>(i) / 3]);
    for (Eigen::Index k = 0; k < K; ++k)
        for (Eigen::Index i = 0; i < rows; ++i)
            basis(i, k) =
                weights(i) * static_cast<double>(
                                 directions[static_cast<std::size_t>(k)].shape.vertices[static_cast<std::size_t>(i)]);
    for (Eigen::Index n = 0; n < N; ++n)
        for (std::size_t t = 0; t < shapes.targets.size(); ++t)
            if (const double c = coefficients[static_cast<std::size_t>(n)][t] - shapes.mean[t]; c != 0)
                for (Eigen::Index i = 0; i < rows; ++i)
                    bodies(i, n) +=
                        c * weights(i) * static_cast<double>(shapes.targets[t][static_cast<std::size_t>(i)]);

    const Eigen::MatrixXd normal = basis.transpose() * basis, right = basis.transpose() * bodies;
    std::vector<FitErrors> curve;
    for (const int count : counts) {
        const auto used = std::min(K, static_cast<Eigen::Index>(body_directions_of(count)));
        const Eigen::MatrixXd fit = normal.topLeftCorner(used, used).ldlt().solve(right.topRows(used));
        const Eigen::MatrixXd left = bodies - basis.leftCols(used) * fit;
        const auto errors_of = [&](Eigen::Index first, Eigen::Index last) {
            detail::WeightedErrors errors;
            for (Eigen::Index n = first; n < last; ++n)
                for (std::size_t v = 0; v < V; ++v)
                    if (areas[v] > 0)
                        errors.emplace_back(left.col(n).segment<3>(static_cast<Eigen::Index>(3 * v)).norm() /
                                                std::sqrt(areas[v]),
                                            areas[v]);
            return detail::summary_of(std::move(errors));
        };
        curve.push_back({count, errors_of(0, N - 2), errors_of(N - 2, N - 1), errors_of(N - 1, N)});
    }
    return curve;
}

} // namespace gsh
