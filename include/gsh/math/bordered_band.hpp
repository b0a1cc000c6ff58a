// SPDX-License-Identifier: Apache-2.0
/// @file  Solves symmetric systems of blocks in time order, each coupled to the two before it, with a dense border.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/math/linalg.hpp>

#include <Eigen/Cholesky>

#include <concepts>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// The normal equations of a trajectory: T blocks of n unknowns, one for each time, and m unknowns shared by all.
///
///     | A  C | |x|   |g|      A is block pentadiagonal: block t meets t - 1 and t - 2 (accelerations)
///     | Cᵀ S | |y| = |h|      C [T n, m] is the border
///
/// A Cholesky factorisation of A eliminates the times in their order, at a cost of about 3 n³ multiplications each. The
/// shared unknowns follow from the Schur complement S - Cᵀ A⁻¹ C.
///
/// Shapes  as given at each member; n and m are fixed at construction.
/// Source  Triggs et al., "Bundle Adjustment: A Modern Synthesis", 2000, section 6.
class BorderedBand {
public:
    using Matrix = Eigen::MatrixXd;
    using Vector = Eigen::VectorXd;

    /// The rows of one time.
    struct Rows {
        Matrix diagonal; ///< [n, n], lower triangle
        Matrix before;   ///< [n, n], the rows' coupling to time t - 1; of no meaning at t = 0
        Matrix before2;  ///< [n, n], to time t - 2; of no meaning at t < 2
        Matrix border;   ///< [n, m]
        Vector right;    ///< [n] of g
    };

    BorderedBand(std::size_t times, int block, int shared) : rows(times) {
        for (Rows& row : rows) {
            row.diagonal.resize(block, block), row.before.resize(block, block), row.before2.resize(block, block);
            row.border.resize(block, shared), row.right.resize(block);
        }
        corner.resize(shared, shared), shared_right.resize(shared);
        set_zero();
    }

    void set_zero() {
        for (Rows& row : rows) {
            row.diagonal.setZero(), row.before.setZero(), row.before2.setZero();
            row.border.setZero(), row.right.setZero();
        }
        corner.setZero(), shared_right.setZero();
    }

    std::vector<Rows> rows; // [T]
    Matrix corner;          ///< S [m, m]
    Vector shared_right;    ///< h [m]

    /// The unknowns.
    struct Solution {
        std::vector<Vector> x;     // [T] of [n]
        Vector y;                  // [m]
        Matrix shared_information; ///< [m, m] the Schur complement: the inverse of the covariance of y
    };

    /// Solves the system with its diagonal multiplied by 1 + damping (Levenberg-Marquardt), and increased by `floor`.
    ///
    /// Errors  Error if the damped system is not positive definite.
    template <std::same_as<double> Real = double> // compiled only where it is called
    [[nodiscard]] Solution solve(double damping = 0, double floor = 0) const {
        const std::size_t T = rows.size();
        Solution solution;
        std::vector<Factor> factors(T);
        Matrix schur = corner;
        for (Eigen::Index k = 0; k < schur.rows(); ++k) schur(k, k) += damping * corner(k, k) + floor;
        Vector reduced = shared_right;
        for (std::size_t t = 0; t < T; ++t) {
            const Rows& row = rows[t];
            Factor& now = factors[t];
            Matrix diagonal = row.diagonal;
            for (Eigen::Index k = 0; k < diagonal.rows(); ++k) diagonal(k, k) += damping * row.diagonal(k, k) + floor;
            now.border = row.border, now.right = row.right;
            if (t >= 2) { // L2 = A2 L(t-2)⁻ᵀ
                now.before2 = row.before2;
                factors[t - 2].solve_from_right(now.before2);
                subtract(now, diagonal, now.before2, factors[t - 2]);
            }
            if (t >= 1) { // L1 = (A1 - L2 L1(t-1)ᵀ) L(t-1)⁻ᵀ
                now.before = row.before;
                if (t >= 2) now.before.noalias() -= now.before2 * factors[t - 1].before.transpose();
                factors[t - 1].solve_from_right(now.before);
                subtract(now, diagonal, now.before, factors[t - 1]);
            }
            now.cholesky = std::move(diagonal);
            const Eigen::LLT<Eigen::Ref<Matrix>> factorised(now.cholesky); // in place
            if (factorised.info() != Eigen::Success)
                throw Error("BorderedBand::solve: the block of time " + std::to_string(t) +
                            " is not positive definite; raise the damping");
            now.cholesky.triangularView<Eigen::Lower>().solveInPlace(now.border);
            now.cholesky.triangularView<Eigen::Lower>().solveInPlace(now.right);
            schur.noalias() -= now.border.transpose() * now.border;
            reduced.noalias() -= now.border.transpose() * now.right;
        }
        solution.shared_information = schur;
        if (schur.rows()) {
            const Eigen::LLT<Matrix> factorised(schur);
            if (factorised.info() != Eigen::Success)
                throw Error("BorderedBand::solve: the shared unknowns are not determined; raise the damping");
            solution.y = factorised.solve(reduced);
        } else {
            solution.y.resize(0);
        }
        solution.x.resize(T);
        for (std::size_t t = T; t-- > 0;) {
            Vector x = factors[t].right - factors[t].border * solution.y;
            if (t + 1 < T) x.noalias() -= factors[t + 1].before.transpose() * solution.x[t + 1];
            if (t + 2 < T) x.noalias() -= factors[t + 2].before2.transpose() * solution.x[t + 2];
            factors[t].cholesky.transpose().triangularView<Eigen::Upper>().solveInPlace(x);
            solution.x[t] = std::move(x);
        }
        return solution;
    }

private:
    /// The rows of the Cholesky factor at one time, and border and right side multiplied by its inverse.
    struct Factor {
        Matrix cholesky, before, before2, border;
        Vector right;
        /// X = X L⁻ᵀ
        template <std::same_as<Matrix> M>
        void solve_from_right(M& X) const {
            cholesky.transpose().triangularView<Eigen::Upper>().solveInPlace<Eigen::OnTheRight>(X);
        }
    };

    template <std::same_as<Matrix> M>
    static void subtract(Factor& now, M& diagonal, const M& coupling, const Factor& earlier) {
        diagonal.template selfadjointView<Eigen::Lower>().rankUpdate(coupling, -1);
        now.border.noalias() -= coupling * earlier.border;
        now.right.noalias() -= coupling * earlier.right;
    }
};

} // namespace gsh
