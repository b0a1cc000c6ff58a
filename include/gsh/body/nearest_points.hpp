// SPDX-License-Identifier: Apache-2.0
/// @file  Nearest neighbours of points in space by a uniform grid.
#pragma once

#include <gsh/core/span.hpp>
#include <gsh/math/box.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

namespace gsh {

/// Points sorted into the cells of a uniform grid, with about one point per cell along a surface.
///
/// A grid suits the points of a body mesh, whose spacing is nearly constant, and avoids a dependency.
class NearestPoints {
public:
    explicit NearestPoints(Span<const vec3<double>> points) : points_(points.begin(), points.end()) {
        if (points_.empty()) return;
        const Box box = box_of_points(points_);
        low_ = box.low;
        const vec3<double> extent = box.high - box.low;
        const double largest = std::max({extent.x, extent.y, extent.z, std::numeric_limits<double>::min()});
        // Points on a surface occupy about n² of n³ cells. The upper bound limits the memory for any other set.
        const double n = std::clamp(std::floor(std::sqrt(static_cast<double>(points_.size()))), 1.0, 256.0);
        cell_size_ = largest / n;
        for (int k = 0; k < 3; ++k) size_[static_cast<std::size_t>(k)] = cell(extent[k]) + 1;
        starts_.assign(static_cast<std::size_t>(size_[0] * size_[1] * size_[2]) + 1, 0);
        for (const auto& p : points_) ++starts_[index(cells(p)) + 1];
        for (std::size_t c = 1; c < starts_.size(); ++c) starts_[c] += starts_[c - 1];
        order_.resize(points_.size());
        auto next = starts_;
        for (std::size_t i = 0; i < points_.size(); ++i)
            order_[next[index(cells(points_[i]))]++] = static_cast<std::uint32_t>(i);
    }

    /// Mean squared distance from point i to its `count` nearest other points (to all of them if there are fewer,
    /// 0 if there are none).
    [[nodiscard]] double mean_squared_distance(std::size_t i, std::size_t count) const {
        std::vector<double> nearest; // ascending, at most count
        const auto found = [&](double unseen) { return nearest.size() == count && nearest.back() <= unseen; };
        visit_around(points_[i], found, [&](std::size_t other, double squared) {
            if (other == i) return;
            if (nearest.size() == count && squared >= nearest.back()) return;
            if (nearest.size() == count) nearest.pop_back();
            nearest.insert(std::upper_bound(nearest.begin(), nearest.end(), squared), squared);
        });
        double sum = 0;
        for (const double squared : nearest) sum += squared;
        return nearest.empty() ? 0 : sum / static_cast<double>(nearest.size());
    }

    /// The `count` points nearest to any (finite) position, or all if there are fewer, as (squared distance, index),
    /// nearest first.
    [[nodiscard]] std::vector<std::pair<double, std::size_t>> nearest(const vec3<double>& place,
                                                                      std::size_t count) const {
        std::vector<std::pair<double, std::size_t>> found;
        visit_around(
            place, [&](double unseen) { return found.size() == count && found.back().first <= unseen; },
            [&](std::size_t point, double squared) {
                const std::pair candidate(squared, point);
                if (found.size() == count && !(candidate < found.back())) return;
                if (found.size() == count) found.pop_back();
                found.insert(std::upper_bound(found.begin(), found.end(), candidate), candidate);
            });
        return found;
    }

    /// Squared distance from any (finite) position to the nearest point; infinite if there are no points.
    [[nodiscard]] double squared_distance(const vec3<double>& place) const {
        double nearest = std::numeric_limits<double>::infinity();
        visit_around(
            place, [&](double unseen) { return nearest <= unseen; },
            [&](std::size_t, double squared) { nearest = std::min(nearest, squared); });
        return nearest;
    }

private:
    using Cells = std::array<std::int64_t, 3>;

    [[nodiscard]] std::int64_t cell(double offset) const { return static_cast<std::int64_t>(offset / cell_size_); }
    /// The cell that contains a position, or the nearest cell for a position outside the grid.
    [[nodiscard]] Cells cells(const vec3<double>& place) const {
        Cells result;
        for (int k = 0; k < 3; ++k) {
            const auto axis = static_cast<std::size_t>(k);
            const double last = static_cast<double>(size_[axis] - 1);
            result[axis] = static_cast<std::int64_t>(std::clamp((place[k] - low_[k]) / cell_size_, 0.0, last));
        }
        return result;
    }
    [[nodiscard]] std::size_t index(const Cells& c) const {
        return static_cast<std::size_t>((c[2] * size_[1] + c[1]) * size_[0] + c[0]);
    }
    /// Calls visit(point, squared distance) for points around a position, cells ring by ring. Stops when the points are
    /// exhausted or when found(d) is true, where d is a lower bound on the squared distance of all unvisited points.
    template <class Found, class Visit>
    void visit_around(const vec3<double>& place, const Found& found, const Visit& visit) const {
        if (points_.empty()) return;
        const Cells center = cells(place);
        const std::int64_t reach = std::max({size_[0], size_[1], size_[2]});
        for (std::int64_t ring = 0; ring <= reach; ++ring) {
            // Every unvisited point is at least ring - 1 whole cells away.
            const double unseen = static_cast<double>(std::max<std::int64_t>(ring - 1, 0)) * cell_size_;
            if (found(unseen * unseen)) return;
            visit_ring(center, ring, [&](std::size_t point) {
                const vec3<double> d = points_[point] - place;
                visit(point, dot(d, d));
            });
        }
    }
    /// Calls visit(point) for the points in the cells at Chebyshev distance `ring` from `center`.
    template <class Visit>
    void visit_ring(const Cells& center, std::int64_t ring, const Visit& visit) const {
        const auto range = [&](std::size_t axis) {
            return std::pair{std::max<std::int64_t>(center[axis] - ring, 0),
                             std::min(center[axis] + ring, size_[axis] - 1)};
        };
        const auto [x0, x1] = range(0);
        const auto [y0, y1] = range(1);
        const auto [z0, z1] = range(2);
        for (std::int64_t z = z0; z <= z1; ++z)
            for (std::int64_t y = y0; y <= y1; ++y) {
                const bool shell = std::abs(z - center[2]) == ring || std::abs(y - center[1]) == ring;
                for (std::int64_t x = x0; x <= x1; ++x) {
                    if (!shell && std::abs(x - center[0]) != ring) continue;
                    const std::size_t c = index({x, y, z});
                    for (std::uint32_t n = starts_[c]; n < starts_[c + 1]; ++n) visit(order_[n]);
                }
            }
    }

    std::vector<vec3<double>> points_;
    vec3<double> low_ = vec3<double>(0);
    double cell_size_ = 1;
    Cells size_{};
    std::vector<std::uint32_t> starts_, order_;
};

} // namespace gsh
