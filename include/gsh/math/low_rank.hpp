// SPDX-License-Identifier: Apache-2.0
/// @file  Rows of numbers as a low-rank product, made while the rows arrive.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/linalg.hpp>

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <utility>
#include <vector>

namespace gsh {

/// row_t ≈ base + Σ_k coefficients[t, k] basis[k].
struct LowRank {
    std::size_t rank = 0;
    std::vector<float> basis;        // [rank, N]
    std::vector<float> coefficients; // [rows, rank]
    double error = 0;                ///< root of the weighted mean square of what is left, over all rows
};

struct LowRankParams {
    double tolerance = 1e-3;    ///< the error that is allowed, in the unit of the numbers
    std::size_t most_rank = 64; ///< of the result; where it is too small for the tolerance, the error is larger
};

/// Turns rows of N numbers, such as an attribute of all Gaussians in each frame of a motion, into a low-rank product.
///
/// Gram-Schmidt: of each row that is added, the part outside of the basis so far becomes a new element of the basis if
/// it is larger than half the tolerance. `finish` then takes the singular vectors of the coefficients and keeps the
/// fewest that meet the tolerance: no other basis of that size in the same space has a smaller error. Memory is that of
/// the basis, however many rows there are.
///
/// Shapes  base, weights, rows [N]; weights are not negative, and their scale does not matter.
/// Errors  ShapeError for other sizes; ValueError for weights and rows that are not finite.
/// Source  Eckart and Young, "The Approximation of One Matrix by Another of Lower Rank", 1936.
class LowRankRows {
public:
    LowRankRows(std::vector<float> base, std::vector<float> weights, const LowRankParams& params = {})
        : base_(std::move(base)), weights_(std::move(weights)), params_(params) {
        check_size("LowRankRows", "weights", weights_.size(), base_.size(), "one per number of the base");
        check_finite<float>("LowRankRows", "base", base_);
        check_finite<float>("LowRankRows", "weights", weights_);
        double sum = 0;
        for (const float w : weights_) {
            check_value(w >= 0, "LowRankRows", "weights must not be negative");
            sum += static_cast<double>(w);
        }
        for (float& w : weights_) w = sum > 0 ? static_cast<float>(static_cast<double>(w) / sum) : 0;
        rest_.resize(base_.size());
    }

    [[nodiscard]] std::size_t size() const { return base_.size(); }

    void add(Span<const float> row) {
        check_size("LowRankRows::add", "row", row.size(), size(), "one number per number of the base");
        check_finite<float>("LowRankRows::add", "row", row);
        for (std::size_t i = 0; i < size(); ++i)
            rest_[i] = static_cast<double>(row[i]) - static_cast<double>(base_[i]);
        std::vector<double> found(basis_.size(), 0.0);
        for (int pass = 0; pass < 2; ++pass) // the second one removes what rounding left of the first
            for (std::size_t k = 0; k < basis_.size(); ++k) {
                const std::vector<float>& q = basis_[k];
                double share = 0;
                for (std::size_t i = 0; i < size(); ++i)
                    share += static_cast<double>(weights_[i]) * static_cast<double>(q[i]) * rest_[i];
                for (std::size_t i = 0; i < size(); ++i) rest_[i] -= share * static_cast<double>(q[i]);
                found[k] += share;
            }
        double square = 0;
        for (std::size_t i = 0; i < size(); ++i) square += static_cast<double>(weights_[i]) * rest_[i] * rest_[i];
        if (square > params_.tolerance * params_.tolerance / 4 && basis_.size() < 2 * params_.most_rank) {
            const double norm = std::sqrt(square);
            std::vector<float>& q = basis_.emplace_back(size());
            for (std::size_t i = 0; i < size(); ++i) q[i] = static_cast<float>(rest_[i] / norm);
            found.push_back(norm);
            square = 0;
        }
        rows_.push_back(std::move(found));
        left_ += square;
    }

    /// A template so that Eigen's solver, which takes seconds to compile, is compiled only where this is called.
    template <std::same_as<double> T = double>
    [[nodiscard]] LowRank finish() const {
        using Matrix = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;
        const std::size_t K = basis_.size(), rows = rows_.size();
        LowRank result;
        result.error = rows ? std::sqrt(left_ / static_cast<double>(rows)) : 0;
        if (K == 0) return result;
        const auto index = [](std::size_t i) { return static_cast<Eigen::Index>(i); };
        Matrix coefficients = Matrix::Zero(index(rows), index(K));
        for (std::size_t t = 0; t < rows; ++t)
            for (std::size_t k = 0; k < rows_[t].size(); ++k) coefficients(index(t), index(k)) = rows_[t][k];
        // Right singular vectors, as eigenvectors: ascending, so the last come first here. Energies are squares of
        // singular values; those that rounding loses lie far below any tolerance of floats.
        const Eigen::SelfAdjointEigenSolver<Matrix> solver(coefficients.transpose() * coefficients);
        const auto energy = [&](std::size_t r) { return std::max(solver.eigenvalues()(index(K - 1 - r)), 0.0); };

        double left = left_;
        for (std::size_t r = 0; r < K; ++r) left += energy(r);
        const double allowed = params_.tolerance * params_.tolerance * static_cast<double>(rows);
        while (result.rank < std::min(K, params_.most_rank) && left > allowed) left -= energy(result.rank++);
        result.error = std::sqrt(std::max(left, 0.0) / static_cast<double>(rows));
        const Matrix turns = solver.eigenvectors().rowwise().reverse().leftCols(index(result.rank));
        for (std::size_t r = 0; r < result.rank; ++r) {
            std::vector<double> direction(size(), 0.0);
            for (std::size_t k = 0; k < K; ++k)
                for (std::size_t i = 0; i < size(); ++i)
                    direction[i] += turns(index(k), index(r)) * static_cast<double>(basis_[k][i]);
            for (const double x : direction) result.basis.push_back(static_cast<float>(x));
        }
        const Matrix turned = coefficients * turns;
        for (std::size_t t = 0; t < rows; ++t)
            for (std::size_t r = 0; r < result.rank; ++r)
                result.coefficients.push_back(static_cast<float>(turned(index(t), index(r))));
        return result;
    }

private:
    std::vector<float> base_, weights_; // the weights sum to 1
    LowRankParams params_;
    std::vector<std::vector<float>> basis_;  // orthonormal in the inner product of the weights
    std::vector<std::vector<double>> rows_;  // coefficients; later rows have more
    std::vector<double> rest_;
    double left_ = 0; // sum over rows of what lies outside of the basis, squared
};

} // namespace gsh
