// SPDX-License-Identifier: Apache-2.0
/// @file  Numbers for points of a surface that have none: from their surroundings, and from the body's other side.
#pragma once

#include <gsh/body/nearest_points.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/sparse.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

namespace gsh {

struct SurfaceFillParams {
    std::size_t neighbours = 8; ///< of each point to fill
    /// Metres from the known points beyond which the other side of the body decides more than they do.
    double mirror_distance = 0.03;
    /// Metres within which a known point must lie of the place on the other side. Bodies that are not symmetric about
    /// x = 0 have none.
    double mirror_gap = 0.02;
};

/// Fills a function on a surface where it is not known. The filled numbers c minimise
///
///     sum over neighbours w_ij (c_i - c_j)²  +  sum μ_i (c_i - c_m(i))²  +  sum ε_i (c_i - mean of the known)²
///
/// in which known points keep their numbers. Neighbours are nearest points whose normals are less than a right angle
/// apart, so that colours do not pass from one thigh to the other; w is the inverse square of their distance. m(i) is a
/// known point at the place of i mirrored at x = 0. μ is such that the first two terms are equally strong at
/// `mirror_distance` from the known points: nearer to them a filled region continues its surroundings, farther inside
/// it looks like the other side. ε is so small that it decides only for points that no path leads to.
///
/// It is a template so that Eigen's solver, which takes seconds to compile, is compiled only where points are filled.
///
/// Shapes  N points; F of them are filled.
/// Frame   the canonical frame of a body that faces along z, with its plane of symmetry at x = 0.
/// Errors  ShapeError for arrays of another size than N.
template <std::same_as<double> T = double>
class SurfaceFill {
public:
    /// Normals are unit vectors or zero, and may be none. known[i] is not 0 where there are numbers.
    SurfaceFill(Span<const vec3<double>> positions, Span<const vec3<double>> normals,
                const std::vector<std::uint8_t>& known, const SurfaceFillParams& params = {})
        : known_(known) {
        const std::size_t N = positions.size();
        check_size("SurfaceFill", "known", known.size(), N, "one per point");
        if (!normals.empty()) check_size("SurfaceFill", "normals", normals.size(), N, "one per point, or none");
        std::vector<vec3<double>> source_positions;
        std::vector<std::size_t> sources;
        std::vector<std::size_t> row_of(N, none);
        for (std::size_t i = 0; i < N; ++i) {
            if (known[i]) sources.push_back(i), source_positions.push_back(positions[i]);
            else row_of[i] = filled_.size(), filled_.push_back(i);
        }
        if (sources.empty()) filled_.clear();
        if (filled_.empty()) return;
        const NearestPoints all(positions), of_sources{Span<const vec3<double>>(source_positions)};
        const auto agree = [&](std::size_t i, const vec3<double>& normal) {
            return normals.empty() || dot(normals[i], normals[i]) == 0 || dot(normal, normal) == 0 ||
                   dot(normals[i], normal) > 0;
        };
        std::vector<Eigen::Triplet<T>> entries, from_known;
        // Adds w (c_r - c_j)² to the energy.
        const auto join = [&](std::size_t r, std::size_t j, double w) {
            const int row = static_cast<int>(r), other = row_of[j] == none ? -1 : static_cast<int>(row_of[j]);
            entries.emplace_back(row, row, w);
            if (other < 0) {
                from_known.emplace_back(row, static_cast<int>(j), w);
                return;
            }
            entries.emplace_back(other, other, w);
            entries.emplace_back(std::max(row, other), std::min(row, other), -w);
        };
        for (std::size_t r = 0; r < filled_.size(); ++r) {
            const std::size_t i = filled_[r];
            std::vector<std::pair<double, std::size_t>> near;
            for (const auto& found : all.nearest(positions[i], 3 * params.neighbours + 1))
                if (found.second != i && near.size() < params.neighbours &&
                    (normals.empty() || agree(found.second, normals[i])))
                    near.push_back(found);
            double mean = 0; // of the squared distances
            for (const auto& [squared, j] : near) mean += squared / static_cast<double>(near.size());
            double weights = 0;
            for (const auto& [squared, j] : near) {
                const double weight = mean > 0 ? mean / (squared + 0.01 * mean) : 1;
                weights += weight;
                // Of two filled points, each is most likely a neighbour of the other, which adds the other half.
                join(r, j, row_of[j] == none ? weight : weight / 2);
            }
            const double pull = 1e-6 * std::max(weights, 1.0);
            entries.emplace_back(static_cast<int>(r), static_cast<int>(r), pull);
            const vec3<double> place(-positions[i].x, positions[i].y, positions[i].z);
            const auto other = of_sources.nearest(place, 1);
            if (other[0].first > params.mirror_gap * params.mirror_gap) continue;
            const std::size_t m = sources[other[0].second];
            const vec3<double> normal = normals.empty() ? vec3<double>(0) : normals[i];
            if (!agree(m, {-normal.x, normal.y, normal.z})) continue;
            // On a plane, sum w (c_j - c_i) is sum w d² / 4 times the Laplacian; w d² is about `mean` for each.
            const double weight =
                static_cast<double>(near.size()) * mean / 4 / (params.mirror_distance * params.mirror_distance);
            entries.emplace_back(static_cast<int>(r), static_cast<int>(r), weight);
            mirrors_.push_back({r, m, weight});
        }
        const auto F = static_cast<Eigen::Index>(filled_.size());
        matrix_.resize(F, F), from_known_.resize(F, static_cast<Eigen::Index>(N));
        matrix_.setFromTriplets(entries.begin(), entries.end());
        from_known_.setFromTriplets(from_known.begin(), from_known.end());
        solver_.setTolerance(1e-6);
        solver_.compute(matrix_);
    }

    SurfaceFill(const SurfaceFill&) = delete; // the solver refers to the matrix
    SurfaceFill& operator=(const SurfaceFill&) = delete;

    /// The points that are filled, ascending: those without numbers, or none of them if no point has any.
    [[nodiscard]] const std::vector<std::size_t>& filled() const { return filled_; }

    /// The numbers [F] of the filled points. Those of `values` [N] at points to fill are not read. `mirrored` is the
    /// factor on numbers of the other side: -1 for the x of a vector.
    [[nodiscard]] std::vector<double> fill(Span<const double> values, double mirrored = 1) const {
        check_size("SurfaceFill::fill", "values", values.size(), known_.size(), "one per point");
        if (filled_.empty()) return {};
        double mean = 0, count = 0;
        for (std::size_t i = 0; i < known_.size(); ++i)
            if (known_[i]) mean += values[i], ++count;
        mean /= count;
        // A x = b with x relative to the mean of the known, so that the weak pull is towards zero.
        Vector relative = Vector::Zero(static_cast<Eigen::Index>(known_.size()));
        for (std::size_t i = 0; i < known_.size(); ++i)
            if (known_[i]) relative[static_cast<Eigen::Index>(i)] = values[i] - mean;
        Vector b = from_known_ * relative;
        for (const Mirror& mirror : mirrors_)
            b[static_cast<Eigen::Index>(mirror.row)] += mirror.weight * (mirrored * values[mirror.point] - mean);
        const Vector x = solver_.solve(b);
        std::vector<double> result(filled_.size());
        for (std::size_t r = 0; r < result.size(); ++r) result[r] = x[static_cast<Eigen::Index>(r)] + mean;
        return result;
    }

private:
    static constexpr std::size_t none = std::numeric_limits<std::size_t>::max();
    using Vector = Eigen::Matrix<T, Eigen::Dynamic, 1>;
    using Matrix = Eigen::SparseMatrix<T>;
    struct Mirror {
        std::size_t row, point;
        double weight;
    };

    std::vector<std::uint8_t> known_;
    std::vector<std::size_t> filled_;
    std::vector<Mirror> mirrors_;
    Matrix matrix_, from_known_; // [F, F], of which the lower triangle is stored; [F, N]
    Eigen::ConjugateGradient<Matrix, Eigen::Lower> solver_;
};

} // namespace gsh
