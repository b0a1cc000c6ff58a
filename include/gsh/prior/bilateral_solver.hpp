// SPDX-License-Identifier: Apache-2.0
/// @file  The iteratively re-weighted least-squares solver of bilateral normal integration.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/image.hpp>
#include <gsh/math/sparse.hpp>

#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace gsh {

struct NormalIntegrationParams {
    double sharpness = 2;             ///< k: how strongly a pixel prefers one neighbour, per squared pixel of step
    double prior_weight = 1e-4;       ///< λ: weight of (depth - prior)² in pixels, relative to the slope residuals
    int max_iterations = 100;         ///< largest number of re-weighted solves
    double tolerance = 1e-4;          ///< relative change of the energy at which they stop
    int largest_direct = 50000;       ///< pixels for a direct factorisation; larger problems use conjugate gradients,
    double solver_tolerance = 1e-3;   ///< which stop at this relative residual and resume in the next solve
};

namespace detail {

/// The valid pixels, numbered row by row; the index of an invalid neighbour is -1.
struct IntegrationGrid {
    enum Direction : std::size_t { left, right, up, down };
    std::vector<std::size_t> pixels;
    std::vector<std::array<int, 4>> neighbors;

    explicit IntegrationGrid(const Image<std::uint8_t>& mask) {
        const auto width = static_cast<std::size_t>(mask.width);
        std::vector<int> number(mask.data.size(), -1);
        for (std::size_t i = 0; i < mask.data.size(); ++i)
            if (mask.data[i]) number[i] = static_cast<int>(pixels.size()), pixels.push_back(i);
        for (const std::size_t i : pixels) {
            const std::size_t x = i % width;
            neighbors.push_back({x > 0 ? number[i - 1] : -1, x + 1 < width ? number[i + 1] : -1,
                                 i >= width ? number[i - width] : -1,
                                 i + width < number.size() ? number[i + width] : -1});
        }
    }

    [[nodiscard]] std::size_t size() const { return pixels.size(); }

    /// Calls body with the members of each connected component.
    template <class Body>
    void for_each_piece(const Body& body) const {
        std::vector<bool> seen(size(), false);
        std::vector<std::size_t> piece;
        for (std::size_t start = 0; start < size(); ++start) {
            if (seen[start]) continue;
            piece.assign(1, start), seen[start] = true;
            for (std::size_t k = 0; k < piece.size(); ++k)
                for (const int neighbor : neighbors[piece[k]]) {
                    const auto n = static_cast<std::size_t>(neighbor);
                    if (neighbor >= 0 && !seen[n]) seen[n] = true, piece.push_back(n);
                }
            body(piece);
        }
    }
};

/// The equations a_axis Δz + b_axis = 0 of one pixel, z in pixels.
struct SlopeEquations {
    double a[2], b[2];
};

/// The final state of a solve.
struct IntegrationReport {
    double energy = 0;
    int iterations = 0;
    bool converged = false;
};

/// Iteratively re-weighted least squares on the grid. It is a template so that Eigen's solvers, which take seconds to
/// compile, are compiled only where normals are integrated.
template <std::same_as<double> T = double>
class BilateralIntegrator {
public:
    using Vector = Eigen::Matrix<T, Eigen::Dynamic, 1>;

    /// prior_weights [grid.size()] are λ where the prior is valid, else 0; prior [grid.size()]; z is the initial value.
    BilateralIntegrator(const IntegrationGrid& grid, Span<const SlopeEquations> equations, Vector prior,
                        Vector prior_weights, const NormalIntegrationParams& params, Vector z)
        : grid_(grid), equations_(equations), weights_(grid.size()), prior_(std::move(prior)),
          prior_weights_(std::move(prior_weights)), params_(params), z_(std::move(z)), rhs_(z_.size()) {
        lay_out();
    }

    [[nodiscard]] const Vector& z() const { return z_; }

    /// Iterates until the energy converges.
    [[nodiscard]] IntegrationReport run() {
        IntegrationReport result;
        const double nothing = 1e-12 * static_cast<double>(grid_.size()); // squared residuals at rounding level
        double last = weigh();
        while (result.iterations < params_.max_iterations && !result.converged) {
            assemble();
            solve();
            ++result.iterations;
            result.energy = weigh();
            result.converged = std::abs(result.energy - last) <= params_.tolerance * last + nothing;
            last = result.energy;
        }
        return result;
    }

private:
    using Matrix = Eigen::SparseMatrix<T>;
    static constexpr std::size_t directions = 4;

    [[nodiscard]] double at(std::size_t i) const { return z_[static_cast<Eigen::Index>(i)]; }
    /// The difference of z along the direction's axis, later pixel minus earlier; 0 if there is no neighbour.
    [[nodiscard]] double difference(std::size_t i, std::size_t direction) const {
        const int neighbor = grid_.neighbors[i][direction];
        if (neighbor < 0) return 0;
        const double step = at(static_cast<std::size_t>(neighbor)) - at(i);
        return direction % 2 ? step : -step; // right and down are later
    }

    /// Sets up the matrix's constant pattern: its lower triangle, one column per pixel, rows ascending.
    void lay_out() {
        const auto n = static_cast<Eigen::Index>(grid_.size());
        std::vector<Eigen::Triplet<T>> triplets;
        for (std::size_t i = 0; i < grid_.size(); ++i) {
            triplets.emplace_back(static_cast<int>(i), static_cast<int>(i), 1.0);
            for (const std::size_t d : {IntegrationGrid::right, IntegrationGrid::down})
                if (grid_.neighbors[i][d] >= 0) triplets.emplace_back(grid_.neighbors[i][d], static_cast<int>(i), 1.0);
        }
        matrix_.resize(n, n);
        matrix_.setFromTriplets(triplets.begin(), triplets.end());
        matrix_.makeCompressed();
    }

    /// Computes the weights for the current z; returns the energy with these weights.
    double weigh() {
        double energy = 0;
        for (std::size_t i = 0; i < grid_.size(); ++i) {
            for (std::size_t axis = 0; axis < 2; ++axis) {
                const double a = equations_[i].a[axis], b = equations_[i].b[axis];
                const double behind = a * difference(i, 2 * axis), ahead = a * difference(i, 2 * axis + 1);
                const double share = 1 / (1 + std::exp(-params_.sharpness * (behind * behind - ahead * ahead)));
                weights_[i][2 * axis] = 1 - share, weights_[i][2 * axis + 1] = share;
                if (grid_.neighbors[i][2 * axis] >= 0) energy += (1 - share) * (behind + b) * (behind + b);
                if (grid_.neighbors[i][2 * axis + 1] >= 0) energy += share * (ahead + b) * (ahead + b);
            }
            const auto e = static_cast<Eigen::Index>(i);
            energy += prior_weights_[e] * (z_[e] - prior_[e]) * (z_[e] - prior_[e]);
        }
        return energy;
    }

    void assemble() {
        // A constant offset per component is undetermined. A weak pull towards the current value keeps the matrix
        // definite.
        constexpr double gauge = 1e-9;
        double* values = matrix_.valuePtr();
        const int* starts = matrix_.outerIndexPtr();
        for (std::size_t i = 0; i < grid_.size(); ++i) {
            const auto e = static_cast<Eigen::Index>(i);
            values[starts[i]] = prior_weights_[e] + gauge;
            for (int k = starts[i] + 1; k < starts[i + 1]; ++k) values[k] = 0;
            rhs_[e] = prior_weights_[e] * prior_[e] + gauge * z_[e];
        }
        for (std::size_t i = 0; i < grid_.size(); ++i)
            for (std::size_t d = 0; d < directions; ++d) {
                if (grid_.neighbors[i][d] < 0) continue;
                const auto j = static_cast<std::size_t>(grid_.neighbors[i][d]);
                const double a = equations_[i].a[d / 2], b = equations_[i].b[d / 2], w = weights_[i][d];
                const std::size_t behind = d % 2 ? i : j, ahead = d % 2 ? j : i;
                values[starts[i]] += w * a * a, values[starts[j]] += w * a * a;
                // In the earlier pixel's column, the entry of the right neighbour precedes that of the lower one.
                const bool second = d / 2 == 1 && grid_.neighbors[behind][IntegrationGrid::right] >= 0;
                values[starts[behind] + 1 + second] -= w * a * a;
                rhs_[static_cast<Eigen::Index>(ahead)] -= w * a * b;
                rhs_[static_cast<Eigen::Index>(behind)] += w * a * b;
            }
    }

    void solve() {
        if (grid_.size() <= static_cast<std::size_t>(params_.largest_direct)) {
            if (!factors_.rows()) factors_.analyzePattern(matrix_);
            factors_.factorize(matrix_);
            z_ = factors_.solve(rhs_);
        } else {
            using Preconditioner = Eigen::IncompleteCholesky<T, Eigen::Lower, Eigen::NaturalOrdering<int>>;
            Eigen::ConjugateGradient<Matrix, Eigen::Lower, Preconditioner> solver;
            solver.setTolerance(params_.solver_tolerance);
            solver.setMaxIterations(2000); // the weights are updated then anyway
            solver.compute(matrix_);
            z_ = solver.solveWithGuess(rhs_, z_);
        }
        if (!z_.allFinite()) throw Error("integrate_normals: a solve broke down; are the normals unit vectors?");
    }

    const IntegrationGrid& grid_;
    Span<const SlopeEquations> equations_;
    std::vector<std::array<double, directions>> weights_; // in the order of IntegrationGrid::Direction
    Vector prior_, prior_weights_;
    NormalIntegrationParams params_;
    Vector z_, rhs_;
    Matrix matrix_;
    Eigen::SimplicialLDLT<Matrix, Eigen::Lower> factors_;
};

} // namespace detail
} // namespace gsh
