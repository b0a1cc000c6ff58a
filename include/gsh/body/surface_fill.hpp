// SPDX-License-Identifier: Apache-2.0
/// @file  Numbers for points of a surface that have none: from their surroundings, and from the body's other side.
#pragma once

#include <gsh/body/nearest_points.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numeric>
#include <optional>
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
/// Shapes  N points; F of them are filled.
/// Frame   the canonical frame of a body that faces along z, with its plane of symmetry at x = 0.
/// Errors  ShapeError for arrays of another size than N.
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
        std::vector<std::vector<Link>> links(filled_.size()); // both ways between filled points
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
                if (row_of[j] == none) {
                    links[r].push_back({j, weight});
                    continue;
                }
                links[r].push_back({j, weight / 2}); // the other half comes from j, to which i is most likely near, too
                links[row_of[j]].push_back({i, weight / 2});
            }
            rows_.push_back({.pull = 1e-6 * std::max(weights, 1.0), .mirror_weight = 0, .mirror = none});
            const vec3<double> place(-positions[i].x, positions[i].y, positions[i].z);
            const auto other = of_sources.nearest(place, 1);
            if (other[0].first > params.mirror_gap * params.mirror_gap) continue;
            const std::size_t m = sources[other[0].second];
            const vec3<double> normal = normals.empty() ? vec3<double>(0) : normals[i];
            if (!agree(m, {-normal.x, normal.y, normal.z})) continue;
            // On a plane, sum w (c_j - c_i) is sum w d² / 4 times the Laplacian; w d² is about `mean` for each.
            rows_[r].mirror = m;
            rows_[r].mirror_weight = static_cast<double>(near.size()) * mean / 4 /
                                     (params.mirror_distance * params.mirror_distance);
        }
        starts_.push_back(0);
        for (std::size_t r = 0; r < links.size(); ++r) {
            double diagonal = rows_[r].pull + rows_[r].mirror_weight;
            for (const Link& link : links[r]) {
                diagonal += link.weight;
                links_.push_back(link);
            }
            diagonal_.push_back(diagonal);
            starts_.push_back(links_.size());
        }
        for (Link& link : links_)
            if (row_of[link.point] != none) link.row = row_of[link.point];
    }

    /// The points that are filled, ascending: those without numbers, or none of them if no point has any.
    [[nodiscard]] const std::vector<std::size_t>& filled() const { return filled_; }

    /// The numbers [F] of the filled points. Those of `values` [N] at points to fill are not read. `mirrored` is the
    /// factor on numbers of the other side: -1 for the x of a vector.
    [[nodiscard]] std::vector<double> fill(Span<const double> values, double mirrored = 1) const {
        check_size("SurfaceFill::fill", "values", values.size(), known_.size(), "one per point");
        const std::size_t F = filled_.size();
        if (F == 0) return {};
        double mean = 0, count = 0;
        for (std::size_t i = 0; i < known_.size(); ++i)
            if (known_[i]) mean += values[i], ++count;
        mean /= count;
        // Conjugate gradients with the inverse diagonal, for A x = b with x relative to the mean of the known.
        std::vector<double> x(F, 0), residual(F), z(F), direction(F), image(F);
        for (std::size_t r = 0; r < F; ++r) {
            double b = 0;
            if (rows_[r].mirror != none) b += rows_[r].mirror_weight * (mirrored * values[rows_[r].mirror] - mean);
            for (std::size_t k = starts_[r]; k < starts_[r + 1]; ++k)
                if (links_[k].row == none) b += links_[k].weight * (values[links_[k].point] - mean);
            residual[r] = b;
            z[r] = b / diagonal_[r];
        }
        direction = z;
        double rho = inner(residual, z);
        const double enough = 1e-12 * rho;
        for (int step = 0; step < most_steps && rho > enough; ++step) {
            multiply(direction, image);
            const double alpha = rho / inner(direction, image);
            for (std::size_t r = 0; r < F; ++r) x[r] += alpha * direction[r], residual[r] -= alpha * image[r];
            for (std::size_t r = 0; r < F; ++r) z[r] = residual[r] / diagonal_[r];
            const double next = inner(residual, z), beta = next / rho;
            for (std::size_t r = 0; r < F; ++r) direction[r] = z[r] + beta * direction[r];
            rho = next;
        }
        for (double& number : x) number += mean;
        return x;
    }

private:
    static constexpr std::size_t none = std::numeric_limits<std::size_t>::max();
    static constexpr int most_steps = 2000;
    struct Link {
        std::size_t point;
        double weight;
        std::size_t row = none; ///< if the point is filled, too
    };
    struct Row {
        double pull, mirror_weight;
        std::size_t mirror; ///< or none
    };

    [[nodiscard]] static double inner(const std::vector<double>& a, const std::vector<double>& b) {
        return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
    }
    void multiply(const std::vector<double>& x, std::vector<double>& image) const {
        for (std::size_t r = 0; r < x.size(); ++r) {
            double sum = diagonal_[r] * x[r];
            for (std::size_t k = starts_[r]; k < starts_[r + 1]; ++k)
                if (links_[k].row != none) sum -= links_[k].weight * x[links_[k].row];
            image[r] = sum;
        }
    }

    std::vector<std::uint8_t> known_;
    std::vector<std::size_t> filled_;
    std::vector<Row> rows_;            // [F]
    std::vector<double> diagonal_;     // [F]
    std::vector<std::size_t> starts_;  // [F + 1]
    std::vector<Link> links_;          // grouped by filled point
};

} // namespace gsh
