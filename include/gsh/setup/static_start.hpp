// SPDX-License-Identifier: Apache-2.0
/// @file  Initial Gaussians of a static scene: from points of a reconstruction, or random ones in the visual hull.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/math/box.hpp>
#include <gsh/photo/photo.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

namespace gsh {

/// Points with colours, from which initial Gaussians are made.
///
/// Shapes  points, colors [N].
/// Units   metres (or the reconstruction's own unit); display-referred sRGB in [0, 1].
struct ColoredPoints {
    std::vector<vec3<double>> points, colors;
};

/// Mean squared distance of each point to its `count` nearest others; to all others if there are fewer, 0 if there are
/// none. Uses a k-d tree, because the density of a reconstruction's points varies widely.
[[nodiscard]] inline std::vector<double> neighbor_distances(const std::vector<vec3<double>>& points, std::size_t count);

/// Round Gaussians of degree 0. The width of each is the root mean squared distance to its three nearest points.
///
/// Errors  ShapeError for another number of colours than points; ValueError for numbers that are not finite.
/// Source  Kerbl et al., "3D Gaussian Splatting", 2023, §5.1 and its code.
template <std::floating_point T = float>
[[nodiscard]] GaussianCloud<T> initial_gaussians(const ColoredPoints& start, double opacity = 0.1);

/// The box of the masks' visual hull, carved out of a cube around the point nearest to all optical axes. Without masks
/// it is the box of those points of the cube that three quarters of the photographs see.
///
/// Errors  ValueError if the optical axes are parallel, or the masks have no point in common. Then use a box of your
///         own.
[[nodiscard]] inline Box hull_box(const std::vector<Photo>& photos);

/// Random points of the box inside the visual hull. At least three quarters of the photographs see such a point, and in
/// all of these it lies on the mask (alpha above 1/2). Colours are the means over these photographs.
///
/// Errors  ValueError if the hull fills less than a 100,000th of the box.
[[nodiscard]] inline ColoredPoints visual_hull_points(const std::vector<Photo>& photos, const Box& box,
                                                      std::size_t count, std::uint64_t seed);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// A balanced k-d tree without nodes. The middle element of each range of `order_` divides it, along its entry of
/// `axes_`.
class PointTree {
public:
    explicit PointTree(const std::vector<vec3<double>>& points)
        : points_(points), order_(points.size()), axes_(points.size()) {
        for (std::size_t i = 0; i < order_.size(); ++i) order_[i] = static_cast<std::uint32_t>(i);
        build(0, order_.size());
    }

    [[nodiscard]] double mean_squared_distance(std::size_t i, std::size_t count) const {
        std::vector<double> nearest; // ascending, at most count
        search(i, count, 0, order_.size(), nearest);
        double sum = 0;
        for (const double squared : nearest) sum += squared;
        return nearest.empty() ? 0 : sum / static_cast<double>(nearest.size());
    }

private:
    void build(std::size_t begin, std::size_t end) {
        if (end - begin < 2) return;
        vec3<double> low = points_[order_[begin]], high = low;
        for (std::size_t k = begin; k < end; ++k)
            for (int c = 0; c < 3; ++c) {
                low[c] = std::min(low[c], points_[order_[k]][c]);
                high[c] = std::max(high[c], points_[order_[k]][c]);
            }
        const vec3<double> extent = high - low;
        const int axis = extent.x >= extent.y && extent.x >= extent.z ? 0 : extent.y >= extent.z ? 1 : 2;
        const std::size_t middle = begin + (end - begin) / 2;
        const auto at = [&](std::size_t k) { return order_.begin() + static_cast<std::ptrdiff_t>(k); };
        std::nth_element(at(begin), at(middle), at(end),
                         [&](std::uint32_t a, std::uint32_t b) { return points_[a][axis] < points_[b][axis]; });
        axes_[middle] = static_cast<std::uint8_t>(axis);
        build(begin, middle);
        build(middle + 1, end);
    }

    void search(std::size_t i, std::size_t count, std::size_t begin, std::size_t end,
                std::vector<double>& nearest) const {
        if (begin == end) return;
        const std::size_t middle = begin + (end - begin) / 2, here = order_[middle];
        if (here != i) {
            const vec3<double> d = points_[here] - points_[i];
            const double squared = dot(d, d);
            if (nearest.size() < count || squared < nearest.back()) {
                if (nearest.size() == count) nearest.pop_back();
                nearest.insert(std::upper_bound(nearest.begin(), nearest.end(), squared), squared);
            }
        }
        const double beyond = points_[i][axes_[middle]] - points_[here][axes_[middle]];
        const bool right = beyond > 0;
        search(i, count, right ? middle + 1 : begin, right ? end : middle, nearest);
        if (nearest.size() < count || beyond * beyond < nearest.back())
            search(i, count, right ? begin : middle + 1, right ? middle : end, nearest);
    }

    const std::vector<vec3<double>>& points_;
    std::vector<std::uint32_t> order_;
    std::vector<std::uint8_t> axes_;
};

/// The pixel at a point's projection, or null.
inline const std::uint8_t* pixel_of(const Photo& photo, const vec3<double>& point) {
    const vec3<double> p = to_camera(photo.camera, point);
    if (!(p.z > 0)) return nullptr;
    const vec2<double> at = to_pixel(photo.camera, p);
    if (!(at.x >= 0 && at.y >= 0 && at.x < photo.camera.width && at.y < photo.camera.height)) return nullptr;
    return photo.pixel(static_cast<int>(at.x), static_cast<int>(at.y));
}

/// Whether a point is inside the hull. Sets `color` to the mean of its pixels.
inline bool in_hull(const std::vector<Photo>& photos, const vec3<double>& point, vec3<double>& color) {
    color = vec3<double>(0.0);
    std::size_t seen = 0;
    for (const Photo& photo : photos) {
        const std::uint8_t* pixel = pixel_of(photo, point);
        if (pixel == nullptr) continue;
        if (pixel[3] < 128) return false;
        color += vec3<double>(pixel[0], pixel[1], pixel[2]) / 255.0;
        ++seen;
    }
    if (seen == 0 || 4 * seen < 3 * photos.size()) return false;
    color /= static_cast<double>(seen);
    return true;
}

/// Shrinks `box` to the cells of a grid whose centres lie in the hull, widened by `margin` cells. False if there are
/// none.
inline bool carve(const std::vector<Photo>& photos, Box& box, int margin) {
    constexpr int cells = 64;
    const vec3<double> step = (box.high - box.low) / double(cells);
    vec3<double> low(1e300), high(-1e300), color;
    for (int z = 0; z < cells; ++z)
        for (int y = 0; y < cells; ++y)
            for (int x = 0; x < cells; ++x) {
                const vec3<double> center = box.low + step * vec3<double>(x + 0.5, y + 0.5, z + 0.5);
                if (!in_hull(photos, center, color)) continue;
                for (int c = 0; c < 3; ++c)
                    low[c] = std::min(low[c], center[c]), high[c] = std::max(high[c], center[c]);
            }
    if (!(low.x <= high.x)) return false;
    box = {low - step * (margin + 0.5), high + step * (margin + 0.5)};
    return true;
}

} // namespace detail

inline std::vector<double> neighbor_distances(const std::vector<vec3<double>>& points, std::size_t count) {
    std::vector<double> distances(points.size());
    if (count == 0) return distances;
    const detail::PointTree tree(points);
    for (std::size_t i = 0; i < points.size(); ++i) distances[i] = tree.mean_squared_distance(i, count);
    return distances;
}

template <std::floating_point T>
GaussianCloud<T> initial_gaussians(const ColoredPoints& start, double opacity) {
    constexpr const char* where = "initial_gaussians";
    check_size(where, "colors", start.colors.size(), start.points.size(), "one colour per point");
    check_value(opacity > 0 && opacity < 1, where, "opacity must lie between 0 and 1");
    for (std::size_t i = 0; i < start.points.size(); ++i)
        for (const vec3<double>& v : {start.points[i], start.colors[i]})
            check_value(std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z), where,
                        "point " + std::to_string(i) + " has a number that is not finite");
    constexpr double least = 1e-7; // square metres: points in one place
    const std::vector<double> squared = neighbor_distances(start.points, 3);
    GaussianCloud<T> cloud(start.points.size(), 0);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        cloud.means[i] = vec3<T>(start.points[i]);
        cloud.log_scales[i] = vec3<T>(T(0.5 * std::log(std::max(squared[i], least))));
        cloud.opacity_logits[i] = T(logit(opacity));
        cloud.sh[i] = sh_of_color(vec3<T>(start.colors[i]));
    }
    return cloud;
}

inline Box hull_box(const std::vector<Photo>& photos) {
    constexpr const char* where = "hull_box";
    check_value(!photos.empty(), where, "there are no photographs");
    // The point nearest to all optical axes: sum (I - d dᵀ) (x - c) = 0.
    mat3<double> sum(0.0);
    vec3<double> right(0.0);
    for (const Photo& photo : photos) {
        const vec3<double> c = photo.camera.center();
        const vec3<double> d = transposed_times(photo.camera.R, vec3<double>(0, 0, 1));
        const mat3<double> across = mat3<double>(1.0) - outer(d, d);
        sum += across, right += across * c;
    }
    const double count = static_cast<double>(photos.size());
    check_value(std::abs(determinant(sum)) > 1e-6 * count * count * count, where,
                "the cameras look along one line, so that they share no point; give a box");
    const vec3<double> middle = inverse(sum) * right;
    double distance = 0;
    for (const Photo& photo : photos) distance = std::max(distance, length(photo.camera.center() - middle));
    Box box{middle - vec3<double>(distance), middle + vec3<double>(distance)};
    // Twice: the first grid is coarse, and may miss parts that are thinner than its cells.
    check_value(detail::carve(photos, box, 2) && detail::carve(photos, box, 1), where,
                "no point lies on the masks of all photographs; do masks and cameras belong together? Or give a box");
    return box;
}

inline ColoredPoints visual_hull_points(const std::vector<Photo>& photos, const Box& box, std::size_t count,
                                        std::uint64_t seed) {
    constexpr const char* where = "visual_hull_points";
    const vec3<double> extent = box.high - box.low;
    check_value(extent.x > 0 && extent.y > 0 && extent.z > 0, where, "the box is empty, expected low below high");
    ColoredPoints found;
    Rng rng(seed);
    vec3<double> color;
    constexpr std::size_t rarest = 100'000;
    for (std::size_t tries = 0; found.points.size() < count; ++tries) {
        check_value(tries < rarest * (found.points.size() + 1), where,
                    "of " + std::to_string(tries) + " points of the box " + std::to_string(found.points.size()) +
                        " lie on the masks of all photographs; do masks, cameras and box belong together?");
        const double x = rng.uniform(), y = rng.uniform(), z = rng.uniform();
        const vec3<double> point = box.low + extent * vec3<double>(x, y, z);
        if (!detail::in_hull(photos, point, color)) continue;
        found.points.push_back(point);
        found.colors.push_back(color);
    }
    return found;
}

} // namespace gsh
