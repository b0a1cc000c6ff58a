// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/bordered_band.hpp>

#include "support/gradient.hpp"

#include <Eigen/Cholesky>

#include <cstddef>

using namespace gsh;

namespace {

/// A system JᵀJ of random residuals that each see three neighbouring times and the shared unknowns, and the same as one
/// dense matrix.
struct Random {
    BorderedBand band;
    Eigen::MatrixXd dense;
    Eigen::VectorXd right;

    Random(std::size_t times, int n, int m, std::uint64_t seed) : band(times, n, m) {
        const Eigen::Index T = static_cast<Eigen::Index>(times), size = T * n + m;
        test::Rng rng(seed);
        dense = Eigen::MatrixXd::Zero(size, size), right = Eigen::VectorXd::Zero(size);
        for (Eigen::Index t = 0; t < T; ++t)
            for (int k = 0; k < 2 * n + m; ++k) {
                Eigen::VectorXd row = Eigen::VectorXd::Zero(size);
                for (Eigen::Index s = t; s <= std::min(t + 2, T - 1); ++s)
                    for (int i = 0; i < n; ++i) row[s * n + i] = rng.uniform(-1, 1);
                for (int i = 0; i < m; ++i) row[T * n + i] = rng.uniform(-1, 1);
                dense += row * row.transpose(), right += row * rng.uniform(-1, 1);
            }
        for (Eigen::Index t = 0; t < T; ++t) {
            BorderedBand::Rows& rows = band.rows[static_cast<std::size_t>(t)];
            rows.diagonal = dense.block(t * n, t * n, n, n).triangularView<Eigen::Lower>();
            if (t >= 1) rows.before = dense.block(t * n, (t - 1) * n, n, n);
            if (t >= 2) rows.before2 = dense.block(t * n, (t - 2) * n, n, n);
            rows.border = dense.block(t * n, T * n, n, m), rows.right = right.segment(t * n, n);
        }
        band.corner = dense.bottomRightCorner(m, m), band.shared_right = right.tail(m);
    }
    [[nodiscard]] Eigen::VectorXd solution(double damping, double floor) const {
        const BorderedBand::Solution parts = band.solve(damping, floor);
        Eigen::VectorXd whole(dense.rows());
        Eigen::Index at = 0;
        for (const auto& x : parts.x) whole.segment(at, x.size()) = x, at += x.size();
        whole.tail(parts.y.size()) = parts.y;
        return whole;
    }
};

} // namespace

TEST_CASE("a bordered band is solved as the dense system is, damped or not") {
    for (const auto& [times, n, m] : {std::tuple{1, 3, 2}, {2, 4, 0}, {3, 1, 1}, {7, 5, 3}, {20, 6, 4}})
        for (const double damping : {0.0, 0.3}) {
            const Random random(static_cast<std::size_t>(times), n, m, 5);
            Eigen::MatrixXd damped = random.dense;
            const double floor = damping > 0 ? 1e-3 : 0;
            damped.diagonal() = random.dense.diagonal() * (1 + damping);
            damped.diagonal().array() += floor;
            const Eigen::VectorXd expected = damped.llt().solve(random.right);
            CAPTURE(times);
            CHECK((random.solution(damping, floor) - expected).norm() < 1e-9 * expected.norm());
        }
}

TEST_CASE("the information of the shared unknowns is the inverse of their covariance") {
    const Random random(6, 3, 2, 8);
    const Eigen::MatrixXd covariance = random.dense.inverse().bottomRightCorner(2, 2);
    CHECK((random.band.solve().shared_information * covariance - Eigen::MatrixXd::Identity(2, 2)).norm() < 1e-9);
}

TEST_CASE("a system without a minimum is refused, and solved with a floor") {
    BorderedBand band(3, 2, 1); // all zeros
    CHECK_THROWS_WITH_AS((void)band.solve(0.5),
                         "BorderedBand::solve: the block of time 0 is not positive definite; raise the damping", Error);
    CHECK(band.solve(0, 1e-6).y.norm() == 0);
    Random random(4, 2, 1, 3);
    random.band.set_zero();
    CHECK_THROWS_AS((void)random.band.solve(), Error);
}
