// SPDX-License-Identifier: Apache-2.0
/// @file  Geodesic distance: exact shortest paths over a triangle mesh from a set of its vertices.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numbers>
#include <queue>
#include <tuple>
#include <utility>
#include <vector>

namespace gsh {

/// Lengths of the shortest paths over a mesh from a set of its vertices to all others, exact up to rounding.
///
/// A shortest path is straight across triangles that are unfolded into a plane. It bends only at sources, at vertices
/// whose angles sum to more than 2π, and at the border; these points act as secondary sources. The algorithm propagates
/// windows. A window is the part of an edge that is visible from one source through a chain of unfolded triangles.
/// Windows are processed in order of their distance. A window is discarded if a path through a vertex of its edge is
/// shorter for every point behind it.
///
/// The mesh may be open, non-manifold or inconsistently oriented, and may have obtuse or degenerate triangles. Surfaces
/// that touch without shared vertices are not connected. The object is immutable; calls with different sources may
/// share it.
///
/// Errors  ValueError for a coordinate that is not finite, an index out of range, or a reach that is negative or NaN.
/// Source  Chen and Han, "Shortest paths on a polyhedron", 1990, in the order and with the filter of Xin and Wang,
///         "Improving Chen and Han's algorithm on the discrete geodesic problem", 2009.
class GeodesicDistance {
public:
    static constexpr double unreachable = std::numeric_limits<double>::infinity();

    GeodesicDistance(Span<const vec3<double>> vertices, Span<const std::array<int, 3>> faces);

    /// Metres to the nearest source [V]; infinity if there is no path, or none shorter than `reach`.
    [[nodiscard]] std::vector<double> from(Span<const int> sources, double reach = unreachable) const;

    [[nodiscard]] std::size_t vertex_count() const { return turns_.size(); }

private:
    /// A triangle at an edge. The edge runs from the triangle's corner `corner` + 1 to `corner` + 2.
    struct Side {
        std::uint32_t face, corner;
    };
    /// A triangle in the plane: the edge on the x axis from 0 to `length`, the third corner at (x, y), y >= 0.
    struct Apex {
        double length, x, y;
    };
    /// The part of an edge that is visible from a source; the window enters the triangle `side.face` next.
    struct Window {
        double nearest; ///< metres from a source vertex to the window's nearest point; the order of processing
        Side side;        ///< the edge, as seen from the triangle that is entered
        double low, high; ///< the visible part of the edge
        double x, y;      ///< the source in the plane of `Apex`, y < 0
        double passed;    ///< metres from the source vertices to the window's source
        bool operator<(const Window& other) const { return nearest > other.nearest; } // priority_queue: smallest first
    };
    struct Arrival {
        double distance;
        std::uint32_t vertex;
        bool operator<(const Arrival& other) const { return distance > other.distance; }
    };
    struct Search;

    std::vector<std::array<std::uint32_t, 3>> faces_; // [F]
    std::vector<std::array<Apex, 3>> planes_;         // [F] one for each edge
    std::vector<std::array<std::uint32_t, 3>> edges_; // [F] the edge opposite each corner
    std::vector<Side> sides_;                         // grouped by edge
    std::vector<std::uint32_t> edge_starts_;          // [E + 1]
    std::vector<Side> corners_;                       // grouped by vertex
    std::vector<std::uint32_t> corner_starts_;        // [V + 1]
    std::vector<char> turns_;                         // [V] nonzero where a shortest path may bend

    void find_edges();
    void find_turns();
};

// -------------------------------------------------------------------------------------------------------------

inline GeodesicDistance::GeodesicDistance(Span<const vec3<double>> vertices, Span<const std::array<int, 3>> faces)
    : corner_starts_(vertices.size() + 1, 0), turns_(vertices.size(), 0) {
    constexpr auto where = "GeodesicDistance";
    detail::check_coordinates(where, "vertices", vertices);
    for (const auto& face : faces) {
        detail::check_index_range(where, "a triangle", face, vertices.size());
        if (face[0] == face[1] || face[1] == face[2] || face[2] == face[0]) continue; // degenerate
        std::array<std::uint32_t, 3> corners{};
        std::array<vec3<double>, 3> p;
        for (std::size_t k = 0; k < 3; ++k) {
            corners[k] = static_cast<std::uint32_t>(face[k]);
            p[k] = vertices[corners[k]];
        }
        std::array<Apex, 3> planes{};
        for (std::size_t k = 0; k < 3; ++k) {
            const vec3<double> along = p[(k + 2) % 3] - p[(k + 1) % 3], up = p[k] - p[(k + 1) % 3];
            const double size = length(along), scale = size > 0 ? 1 / size : 0;
            planes[k] = {size, dot(up, along) * scale, length(cross(along, up)) * scale};
        }
        faces_.push_back(corners), planes_.push_back(planes);
    }
    find_edges();
    find_turns();
}

inline void GeodesicDistance::find_edges() {
    struct Half {
        std::uint32_t a, b;
        Side side;
    };
    std::vector<Half> halves;
    for (std::uint32_t f = 0; f < faces_.size(); ++f)
        for (std::uint32_t k = 0; k < 3; ++k) {
            const auto [a, b] = std::minmax(faces_[f][(k + 1) % 3], faces_[f][(k + 2) % 3]);
            halves.push_back({a, b, {f, k}});
            ++corner_starts_[faces_[f][k] + 1];
        }
    const auto key = [](const Half& h) { return std::tuple(h.a, h.b, h.side.face, h.side.corner); };
    std::sort(halves.begin(), halves.end(), [&](const Half& h, const Half& i) { return key(h) < key(i); });
    edges_.resize(faces_.size());
    for (std::size_t i = 0; i < halves.size(); ++i) {
        if (i == 0 || halves[i].a != halves[i - 1].a || halves[i].b != halves[i - 1].b)
            edge_starts_.push_back(static_cast<std::uint32_t>(i));
        edges_[halves[i].side.face][halves[i].side.corner] = static_cast<std::uint32_t>(edge_starts_.size() - 1);
        sides_.push_back(halves[i].side);
    }
    edge_starts_.push_back(static_cast<std::uint32_t>(halves.size()));

    for (std::size_t v = 1; v < corner_starts_.size(); ++v) corner_starts_[v] += corner_starts_[v - 1];
    corners_.resize(3 * faces_.size());
    auto next = corner_starts_;
    for (std::uint32_t f = 0; f < faces_.size(); ++f)
        for (std::uint32_t k = 0; k < 3; ++k) corners_[next[faces_[f][k]]++] = {f, k};
}

inline void GeodesicDistance::find_turns() {
    for (std::size_t v = 0; v < turns_.size(); ++v) {
        double angle = 0;
        for (std::uint32_t n = corner_starts_[v]; n < corner_starts_[v + 1]; ++n) {
            const auto [f, k] = corners_[n];
            const Apex& plane = planes_[f][(k + 2) % 3]; // its edge starts at v; its angle at 0 is the one at v
            angle += std::atan2(plane.y, plane.x);
            for (const std::uint32_t other : {(k + 1) % 3, (k + 2) % 3}) {
                const std::uint32_t edge = edges_[f][other];
                if (edge_starts_[edge + 1] - edge_starts_[edge] != 2) turns_[v] = 1;
            }
        }
        if (angle > 2 * std::numbers::pi - 1e-9) turns_[v] = 1;
    }
}

/// The state of one call.
struct GeodesicDistance::Search {
    const GeodesicDistance& mesh;
    double reach;
    std::vector<double> distances; // [V]
    std::priority_queue<Arrival> arrivals;
    std::priority_queue<Window> windows;

    void arrive(std::uint32_t vertex, double distance) {
        if (!(distance < distances[vertex]) || distance > reach) return;
        distances[vertex] = distance;
        arrivals.push({distance, vertex});
    }

    /// Propagates a vertex whose distance is final: along its edges and, where paths may bend, across its triangles.
    void leave(std::uint32_t v) {
        const double passed = distances[v];
        for (std::uint32_t n = mesh.corner_starts_[v]; n < mesh.corner_starts_[v + 1]; ++n) {
            const auto [f, k] = mesh.corners_[n];
            const auto& face = mesh.faces_[f];
            const Apex& plane = mesh.planes_[f][k]; // v is the apex
            arrive(face[(k + 1) % 3], passed + std::hypot(plane.x, plane.y));
            arrive(face[(k + 2) % 3], passed + std::hypot(plane.length - plane.x, plane.y));
            if (mesh.turns_[v] || passed == 0)
                cross_edge({f, k}, face[(k + 1) % 3], {0, {}, 0, plane.length, plane.x, -plane.y, passed});
        }
    }

    /// Propagates a window across its triangle, to one of the other two edges or to both and the corner between them.
    void cross_face(const Window& w) {
        const auto [f, k] = w.side;
        const auto& face = mesh.faces_[f];
        const Apex& plane = mesh.planes_[f][k];
        const double shadow = w.x + (plane.x - w.x) * -w.y / (plane.y - w.y); // the corner, projected onto the edge
        const double slack = 1e-10 * plane.length;
        if (w.low - slack <= shadow && shadow <= w.high + slack)
            arrive(face[k], w.passed + std::hypot(plane.x - w.x, plane.y - w.y));
        if (w.low < shadow)
            leave_face(f, (k + 2) % 3, face[(k + 1) % 3], plane.x, plane.y, w.low, std::min(w.high, shadow), w.x, w);
        if (w.high > shadow) { // the mirror image of the case above
            const double L = plane.length;
            leave_face(f, (k + 1) % 3, face[(k + 2) % 3], L - plane.x, plane.y, L - w.high,
                       L - std::max(w.low, shadow), L - w.x, w);
        }
    }

    /// Propagates a window to the edge from the origin (vertex `first`) to the apex at (apex_x, apex_y). The source is
    /// at (x, w.y); its visible range lies between the rays through (low, 0) and (high, 0).
    void leave_face(std::uint32_t f, std::uint32_t corner, std::uint32_t first, double apex_x, double apex_y,
                    double low, double high, double x, const Window& w) {
        const auto share = [&](double b) { // fraction of the edge up to the ray through (b, 0)
            const double scale = (b - x) * apex_y + w.y * apex_x;
            return scale < 0 ? std::clamp(b * w.y / scale, 0.0, 1.0) : 1.0;
        };
        const double size = std::hypot(apex_x, apex_y);
        if (!(size > 0)) return;
        const double c = apex_x / size, s = apex_y / size;
        const double along = x * c + w.y * s, behind = -std::abs(x * s - w.y * c);
        cross_edge({f, corner}, first, {0, {}, share(low) * size, share(high) * size, along, behind, w.passed});
    }

    /// Propagates a window into all triangles at an edge except `from`; `first` is the vertex at the edge's origin.
    void cross_edge(Side from, std::uint32_t first, Window w) {
        const std::uint32_t edge = mesh.edges_[from.face][from.corner];
        const double length = mesh.planes_[from.face][from.corner].length;
        if (!(w.low < w.high) || !(w.y < 0)) return; // empty, or the edge is collinear with the source
        w.nearest = w.passed + std::hypot(std::clamp(w.x, w.low, w.high) - w.x, w.y);
        for (std::uint32_t n = mesh.edge_starts_[edge]; n < mesh.edge_starts_[edge + 1]; ++n) {
            w.side = mesh.sides_[n];
            if (w.side.face == from.face) continue;
            Window turned = w;
            if (mesh.faces_[w.side.face][(w.side.corner + 1) % 3] != first)
                turned.low = length - w.high, turned.high = length - w.low, turned.x = length - w.x;
            if (turned.nearest <= reach && counts(turned)) windows.push(turned);
        }
    }

    /// Whether a shortest path may pass through the window. It cannot if a path through a vertex of the edge is
    /// shorter.
    [[nodiscard]] bool counts(const Window& w) const {
        const auto& face = mesh.faces_[w.side.face];
        const double length = mesh.planes_[w.side.face][w.side.corner].length;
        const double first = distances[face[(w.side.corner + 1) % 3]], last = distances[face[(w.side.corner + 2) % 3]];
        return w.passed + std::hypot(w.high - w.x, w.y) <= first + w.high &&
               w.passed + std::hypot(w.low - w.x, w.y) <= last + length - w.low;
    }
};

inline std::vector<double> GeodesicDistance::from(Span<const int> sources, double reach) const {
    constexpr auto where = "GeodesicDistance::from";
    detail::check_index_range(where, "sources", sources, vertex_count());
    check_value(reach >= 0, where, "reach must not be negative or NaN");
    Search search{*this, reach, std::vector<double>(vertex_count(), unreachable), {}, {}};
    for (const int source : sources) search.arrive(static_cast<std::uint32_t>(source), 0);
    while (!search.arrivals.empty() || !search.windows.empty()) {
        const bool vertex = !search.arrivals.empty() && (search.windows.empty() || search.arrivals.top().distance <=
                                                                                       search.windows.top().nearest);
        if (vertex) {
            const Arrival arrival = search.arrivals.top();
            search.arrivals.pop();
            if (arrival.distance <= search.distances[arrival.vertex]) search.leave(arrival.vertex);
        } else {
            const Window window = search.windows.top();
            search.windows.pop();
            if (search.counts(window)) search.cross_face(window);
        }
    }
    return std::move(search.distances);
}

} // namespace gsh
