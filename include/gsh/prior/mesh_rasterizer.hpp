// SPDX-License-Identifier: Apache-2.0
/// @file  A z-buffer for triangle meshes: the nearest triangle at each pixel, its depth and barycentric coordinates.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/image.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/prior/orthographic_camera.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

struct MeshRasterParams {
    double near = 0.01; ///< metres; near plane of a pinhole camera. An orthographic camera has none
};

/// The nearest surface at each pixel's centre. Triangles are visible from both sides.
struct MeshImage {
    int height = 0, width = 0;
    std::vector<int> triangle;             // [height, width] index into faces; -1 for background
    std::vector<double> depth;             // [height, width] camera z, metres; 0 for background
    std::vector<vec3<double>> barycentric; // [height, width] in 3D space; zero for background

    [[nodiscard]] std::size_t size() const { return triangle.size(); }
    [[nodiscard]] bool covers(std::size_t pixel) const { return triangle[pixel] >= 0; }
    /// 1 where the mesh covers the pixel, else 0.
    [[nodiscard]] Image<std::uint8_t> mask() const {
        Image<std::uint8_t> result(1, height, width);
        for (std::size_t i = 0; i < size(); ++i) result.data[i] = covers(i);
        return result;
    }
};

/// Rasterizes a mesh for an orthographic or a pinhole camera.
///
/// Vertices are rounded to 2^-14 pixel, and coverage is decided in integers by the top-left rule. A pixel on an edge or
/// a vertex therefore belongs to exactly one of the triangles around it. At equal depth the first face is kept. Serial
/// and Threads agree bit for bit, because a row of pixels depends only on the faces and their order.
///
/// Shapes  vertices [V]; faces [F] indices into them, of either orientation.
/// Errors  ValueError for an invalid camera, vertices that are not finite, indices out of range, or an image wider or
///         higher than 16384 pixels.
template <HostExecutor E>
[[nodiscard]] MeshImage rasterize_mesh(E& executor, Span<const vec3<double>> vertices,
                                       Span<const std::array<int, 3>> faces, const OrthographicCamera& camera);
template <HostExecutor E>
[[nodiscard]] MeshImage rasterize_mesh(E& executor, Span<const vec3<double>> vertices,
                                       Span<const std::array<int, 3>> faces, const Camera<double>& camera,
                                       const MeshRasterParams& params = {});

/// A vertex attribute (number or vector) at each pixel, [height, width]; zero for background.
///
/// Errors  ShapeError if an attribute is missing, ValueError if `faces` are not those of the image.
template <class V>
[[nodiscard]] std::vector<V> interpolate_attribute(const MeshImage& image, Span<const std::array<int, 3>> faces,
                                                   Span<const V> attribute) {
    std::vector<V> result(image.size(), V(0));
    for (std::size_t i = 0; i < image.size(); ++i) {
        if (!image.covers(i)) continue;
        const auto f = static_cast<std::size_t>(image.triangle[i]);
        check_value(f < faces.size(), "interpolate_attribute",
                    "the image shows a face that is not there; give its own");
        for (int k = 0; k < 3; ++k) {
            const auto v = static_cast<std::size_t>(faces[f][static_cast<std::size_t>(k)]);
            if (v >= attribute.size())
                check_size("interpolate_attribute", "attribute", attribute.size(), v + 1,
                           "store at least one per vertex");
            result[i] += attribute[v] * image.barycentric[i][k];
        }
    }
    return result;
}

// -------------------------------------------------------------------------------------------------------------

namespace detail {

inline constexpr int subpixel_bits = 14;
inline constexpr int largest_raster = 1 << 14;   // pixels along a side of the image
inline constexpr double raster_guard = 1 << 15;  // pixels: triangles are clipped there, so that products fit 62 bits

/// A vertex before the perspective division: pixel = (x, y) / w. w is the depth of a pinhole camera, 1 if orthographic.
struct RasterCorner {
    double x = 0, y = 0, w = 1, z = 0;
    vec3<double> barycentric = vec3<double>(0);
};

/// A convex polygon: a triangle clipped by at most five planes.
struct RasterPolygon {
    std::array<RasterCorner, 9> corners;
    std::size_t count = 0;

    /// Keeps the side where `distance`, linear in the corners, is not negative. New corners are computed from the
    /// inside to the outside, so that both triangles at an edge get identical ones.
    template <class Distance>
    void clip(const Distance& distance) {
        RasterPolygon kept;
        for (std::size_t k = 0; k < count; ++k) {
            const RasterCorner &p = corners[k], &q = corners[(k + 1) % count];
            const double at_p = distance(p), at_q = distance(q);
            if (at_p >= 0) kept.corners[kept.count++] = p;
            if ((at_p < 0) == (at_q < 0)) continue;
            kept.corners[kept.count++] =
                at_p >= 0 ? between(p, q, at_p / (at_p - at_q)) : between(q, p, at_q / (at_q - at_p));
        }
        *this = kept;
    }

private:
    static RasterCorner between(const RasterCorner& a, const RasterCorner& b, double s) {
        return {a.x + (b.x - a.x) * s, a.y + (b.y - a.y) * s, a.w + (b.w - a.w) * s, a.z + (b.z - a.z) * s,
                a.barycentric + (b.barycentric - a.barycentric) * s};
    }
};

/// A triangle in integer raster coordinates, oriented so that its edge functions are positive inside.
struct RasterTriangle {
    std::int64_t x[3], y[3]; ///< 2^-subpixel_bits pixels
    double inverse_w[3], z[3], inverse_area;
    vec3<double> barycentric[3];
    int face, column_begin, column_end, row_begin, row_end;

    /// Twice the area of (corner k + 1, corner k + 2, point).
    [[nodiscard]] std::int64_t edge(int k, std::int64_t px, std::int64_t py) const {
        const int a = (k + 1) % 3, b = (k + 2) % 3;
        return (x[b] - x[a]) * (py - y[a]) - (y[b] - y[a]) * (px - x[a]);
    }
    /// The smallest value of edge(k) inside: 0 for a top or left edge, whose points are inside, else 1.
    [[nodiscard]] std::int64_t least(int k) const {
        const int a = (k + 1) % 3, b = (k + 2) % 3;
        return y[b] < y[a] || (y[b] == y[a] && x[b] > x[a]) ? 0 : 1;
    }
};

/// Converts a triangle to raster coordinates; false if it certainly covers no pixel's centre.
inline bool place_triangle(const RasterCorner& a, const RasterCorner& b, const RasterCorner& c, int face, int height,
                           int width, RasterTriangle& result) {
    const RasterCorner* corners[3] = {&a, &b, &c};
    constexpr double one = 1 << subpixel_bits;
    const auto fixed = [&](double v, double w) { return static_cast<std::int64_t>(std::llround(v / w * one)); };
    for (int k = 0; k < 3; ++k)
        result.x[k] = fixed(corners[k]->x, corners[k]->w), result.y[k] = fixed(corners[k]->y, corners[k]->w);
    std::int64_t area = result.edge(0, result.x[0], result.y[0]);
    if (area == 0) return false;
    if (area < 0) {
        std::swap(corners[1], corners[2]), std::swap(result.x[1], result.x[2]), std::swap(result.y[1], result.y[2]);
        area = -area;
    }
    // First and last pixel whose centre lies within the bounds; a right shift of a negative number rounds down.
    const auto range = [&](const std::int64_t* v, int size, int& begin, int& end) {
        constexpr std::int64_t half = std::int64_t(1) << (subpixel_bits - 1);
        const auto [low, high] = std::minmax({v[0], v[1], v[2]});
        begin = static_cast<int>(std::clamp<std::int64_t>((low + half - 1) >> subpixel_bits, 0, size));
        end = static_cast<int>(std::clamp<std::int64_t>(((high - half) >> subpixel_bits) + 1, 0, size));
    };
    range(result.x, width, result.column_begin, result.column_end);
    range(result.y, height, result.row_begin, result.row_end);
    if (result.column_begin >= result.column_end || result.row_begin >= result.row_end) return false;
    for (int k = 0; k < 3; ++k) {
        result.inverse_w[k] = 1 / corners[k]->w, result.z[k] = corners[k]->z;
        result.barycentric[k] = corners[k]->barycentric;
    }
    result.inverse_area = 1 / static_cast<double>(area);
    result.face = face;
    return true;
}

/// Draws rows [row_begin, row_end) of one triangle.
inline void draw_triangle(const RasterTriangle& t, int row_begin, int row_end, MeshImage& image) {
    constexpr std::int64_t one = std::int64_t(1) << subpixel_bits;
    std::int64_t step[3], least[3];
    for (int k = 0; k < 3; ++k) step[k] = -(t.y[(k + 2) % 3] - t.y[(k + 1) % 3]) * one, least[k] = t.least(k);
    for (int row = std::max(row_begin, t.row_begin); row < std::min(row_end, t.row_end); ++row) {
        const std::int64_t px = t.column_begin * one + one / 2, py = row * one + one / 2;
        std::int64_t e[3] = {t.edge(0, px, py), t.edge(1, px, py), t.edge(2, px, py)};
        std::size_t pixel = static_cast<std::size_t>(row) * static_cast<std::size_t>(image.width) +
                            static_cast<std::size_t>(t.column_begin);
        for (int column = t.column_begin; column < t.column_end;
             ++column, ++pixel, e[0] += step[0], e[1] += step[1], e[2] += step[2]) {
            if (e[0] < least[0] || e[1] < least[1] || e[2] < least[2]) continue;
            double share[3], sum = 0, depth = 0; // linear in 3D space, not in image space
            for (int k = 0; k < 3; ++k) {
                share[k] = static_cast<double>(e[k]) * t.inverse_area * t.inverse_w[k];
                sum += share[k], depth += share[k] * t.z[k];
            }
            depth /= sum;
            if (image.covers(pixel) && !(depth < image.depth[pixel])) continue; // faces are processed in order
            image.depth[pixel] = depth, image.triangle[pixel] = t.face;
            image.barycentric[pixel] =
                (t.barycentric[0] * share[0] + t.barycentric[1] * share[1] + t.barycentric[2] * share[2]) * (1 / sum);
        }
    }
}

/// `corners` [V] are the projected vertices. Parts with w below `near` are clipped.
template <HostExecutor E>
MeshImage rasterize_corners(E& executor, Span<const RasterCorner> corners, Span<const std::array<int, 3>> faces,
                            int height, int width, double near) {
    constexpr std::size_t grain = 2048; // faces
    std::vector<std::vector<RasterTriangle>> placed(chunk_count(faces.size(), grain));
    executor.for_chunks(faces.size(), grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        for (std::size_t f = begin; f < end; ++f) {
            RasterPolygon polygon;
            bool whole = true;
            for (std::size_t k = 0; k < 3; ++k) {
                RasterCorner& corner = polygon.corners[polygon.count++];
                corner = corners[static_cast<std::size_t>(faces[f][k])];
                corner.barycentric[static_cast<int>(k)] = 1;
                const double guard = raster_guard * corner.w;
                whole = whole && corner.w >= near && std::abs(corner.x) <= guard && std::abs(corner.y) <= guard;
            }
            if (!whole) {
                polygon.clip([&](const RasterCorner& c) { return c.w - near; });
                polygon.clip([](const RasterCorner& c) { return raster_guard * c.w - c.x; });
                polygon.clip([](const RasterCorner& c) { return raster_guard * c.w + c.x; });
                polygon.clip([](const RasterCorner& c) { return raster_guard * c.w - c.y; });
                polygon.clip([](const RasterCorner& c) { return raster_guard * c.w + c.y; });
            }
            RasterTriangle triangle;
            for (std::size_t k = 2; k < polygon.count; ++k)
                if (place_triangle(polygon.corners[0], polygon.corners[k - 1], polygon.corners[k], static_cast<int>(f),
                                   height, width, triangle))
                    placed[chunk].push_back(triangle);
        }
    });

    constexpr int band = 16; // rows
    const auto rows = static_cast<std::size_t>(height), columns = static_cast<std::size_t>(width);
    std::vector<std::vector<const RasterTriangle*>> bands(chunk_count(rows, band));
    for (const auto& chunk : placed)
        for (const RasterTriangle& t : chunk)
            for (int b = t.row_begin / band; b <= (t.row_end - 1) / band; ++b)
                bands[static_cast<std::size_t>(b)].push_back(&t);

    MeshImage image{height, width, std::vector<int>(rows * columns, -1), std::vector<double>(rows * columns, 0),
                    std::vector<vec3<double>>(rows * columns, vec3<double>(0))};
    executor.for_chunks(rows, band, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        for (const RasterTriangle* t : bands[chunk])
            draw_triangle(*t, static_cast<int>(begin), static_cast<int>(end), image);
    });
    return image;
}

/// Projects the vertices by `corner(point in camera coordinates)` and validates the inputs.
template <class AnyCamera, class Corner>
std::vector<RasterCorner> raster_corners(Span<const vec3<double>> vertices, Span<const std::array<int, 3>> faces,
                                         const AnyCamera& camera, const Corner& corner) {
    constexpr std::string_view where = "rasterize_mesh";
    check_camera(where, "camera", camera);
    check_value(camera.width <= largest_raster && camera.height <= largest_raster, where,
                "the image has " + std::to_string(camera.width) + " x " + std::to_string(camera.height) +
                    " pixels, expected at most " + std::to_string(largest_raster) + " along a side");
    for (std::size_t f = 0; f < faces.size(); ++f)
        for (const int v : faces[f])
            if (v < 0 || static_cast<std::size_t>(v) >= vertices.size())
                throw ValueError(std::string(where) + ": faces[" + std::to_string(f) + "] names vertex " +
                                 std::to_string(v) + ", expected an index below " + std::to_string(vertices.size()));
    std::vector<RasterCorner> corners(vertices.size());
    for (std::size_t v = 0; v < vertices.size(); ++v) {
        corners[v] = corner(to_camera(camera, vertices[v]));
        if (!(std::abs(corners[v].x) + std::abs(corners[v].y) + std::abs(corners[v].z) < 1e30)) // also true for NaN
            throw ValueError(std::string(where) + ": vertices[" + std::to_string(v) +
                             "] is not finite or absurdly far away; check the mesh and its units (metres)");
    }
    return corners;
}

} // namespace detail

template <HostExecutor E>
MeshImage rasterize_mesh(E& executor, Span<const vec3<double>> vertices, Span<const std::array<int, 3>> faces,
                         const OrthographicCamera& camera) {
    const auto corners = detail::raster_corners(vertices, faces, camera, [&](const vec3<double>& p) {
        const vec2<double> pixel = to_pixel(camera, p);
        return detail::RasterCorner{pixel.x, pixel.y, 1, p.z};
    });
    return detail::rasterize_corners<E>(executor, corners, faces, camera.height, camera.width, 0);
}

template <HostExecutor E>
MeshImage rasterize_mesh(E& executor, Span<const vec3<double>> vertices, Span<const std::array<int, 3>> faces,
                         const Camera<double>& camera, const MeshRasterParams& params) {
    check_value(params.near > 0, "rasterize_mesh",
                "near is " + detail::number_text(params.near) + ", expected metres above 0");
    const auto corners = detail::raster_corners(vertices, faces, camera, [&](const vec3<double>& p) {
        return detail::RasterCorner{camera.fx * p.x + camera.cx * p.z, camera.fy * p.y + camera.cy * p.z, p.z, p.z};
    });
    return detail::rasterize_corners<E>(executor, corners, faces, camera.height, camera.width, params.near);
}

} // namespace gsh
