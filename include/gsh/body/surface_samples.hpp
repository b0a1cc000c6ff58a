// SPDX-License-Identifier: Apache-2.0
/// @file  Initial positions of the Gaussians: K samples per vertex on the body's surface, with weights and scales.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/mesh.hpp>
#include <gsh/body/nearest_points.hpp>
#include <gsh/body/skinning.hpp>
#include <gsh/core/enum_names.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/core/setting.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/box.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <string_view>
#include <vector>

namespace gsh {

/// The source of a sample's skinning weights: the vertex that it was drawn for, or all three vertices of its triangle.
/// With copied weights the samples of each vertex move as one rigid piece, and neighbouring pieces separate or overlap
/// where the body bends. Interpolated weights follow the posed mesh.
enum class SampleWeights { barycentric, copied };
template <>
struct EnumNames<SampleWeights> {
    static constexpr std::array<std::string_view, 2> names{"barycentric", "copied"};
};

struct SurfaceSampleParams {
    std::size_t total = 0; ///< scales K so that there are exactly this many samples; 0: no scaling
    SampleWeights weights = SampleWeights::barycentric;
    std::size_t max_influences = 8; ///< joints per sample (those with the largest weights are kept); 0: no limit
    double jitter = 0;              ///< largest displacement along an axis, as a fraction of the local vertex distance

    template <class Self, class F>
    static void for_each_setting(Self& self, const F& f) {
        f("sample_weights", self.weights, SettingRange());
        f("sample_jitter", self.jitter, SettingRange::at_least(0));
    }
};
/// The former name of SurfaceSampleParams.
using SurfaceSampleOptions [[deprecated("use SurfaceSampleParams")]] = SurfaceSampleParams;

/// N points on a mesh, sorted along a Morton curve so that neighbours in memory are neighbours in space.
struct SurfaceSamples {
    std::vector<vec3<double>> positions;       // [N] metres
    std::vector<vec3<double>> normals;         // [N] unit, outward; zero if unknown
    std::vector<std::array<int, 3>> triangles; // [N] vertex indices of the triangle
    std::vector<vec3<double>> barycentric;     // [N] of the position before jitter
    std::vector<int> sources;                  // [N] the vertex it was drawn for, nearest in its triangle
    std::vector<double> scales;                // [N] metres, initial standard deviation of an isotropic Gaussian
    SkinWeightTable<double> weights;           // [N, influences]

    [[nodiscard]] std::size_t size() const { return positions.size(); }
};

/// Draws K(v) points in expectation for each vertex v, uniform by area over the vertex's part of the surface. In each
/// triangle at v, this part is the region nearer to v than to the other two corners (the Voronoi part of the one-ring).
///
/// Fractional K are rounded by error diffusion from a random start. Each vertex's expected count is exact, and the sum
/// over any run of vertices differs from the sum of their K by less than one. The initial scale of a
/// sample is sqrt(d² / K(v)), where d² is the mean squared distance from v to its 3 nearest vertices.
///
/// Shapes  vertices [V] positions to sample on (the shaped mesh), samples_per_vertex [V].
/// Errors  ShapeError; ValueError for no triangles, a negative or infinite K, or all K zero if `total` > 0.
[[nodiscard]] inline SurfaceSamples sample_surface(const BodyModel& model, Span<const vec3<double>> vertices,
                                                   Span<const double> samples_per_vertex, std::uint64_t seed,
                                                   const SurfaceSampleParams& options = {});

/// The same with one K for all vertices.
[[nodiscard]] inline SurfaceSamples sample_surface(const BodyModel& model, Span<const vec3<double>> vertices,
                                                   double samples_per_vertex, std::uint64_t seed,
                                                   const SurfaceSampleParams& options = {}) {
    const std::vector<double> K(model.vertex_count(), samples_per_vertex);
    return sample_surface(model, vertices, K, seed, options);
}

/// Numbers given at the vertices [V], interpolated at the samples [N] with their barycentric coordinates.
///
/// Errors  ValueError if a triangle refers to a vertex without a number.
[[nodiscard]] inline std::vector<double> interpolate(const SurfaceSamples& samples, Span<const double> values);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Interleaves the top 21 bits of three numbers in [0, 1].
[[nodiscard]] inline std::uint64_t morton_code(const vec3<double>& unit) {
    const auto spread = [](double x) {
        auto bits = static_cast<std::uint64_t>(std::clamp(x, 0.0, 1.0) * 2097151.0);
        bits = (bits | bits << 32) & 0x1F00000000FFFFull;
        bits = (bits | bits << 16) & 0x1F0000FF0000FFull;
        bits = (bits | bits << 8) & 0x100F00F00F00F00Full;
        bits = (bits | bits << 4) & 0x10C30C30C30C30C3ull;
        return (bits | bits << 2) & 0x1249249249249249ull;
    };
    return spread(unit.x) | spread(unit.y) << 1 | spread(unit.z) << 2;
}

/// Indices of the points along a Morton curve through their bounding cube; ties keep their order.
[[nodiscard]] inline std::vector<std::size_t> morton_order(Span<const vec3<double>> points) {
    std::vector<std::size_t> order(points.size());
    std::iota(order.begin(), order.end(), std::size_t(0));
    if (points.empty()) return order;
    const auto [low, high] = box_of_points(points);
    const vec3<double> extent = high - low;
    const double largest = std::max({extent.x, extent.y, extent.z});
    const double scale = largest > 0 ? 1 / largest : 0;
    std::vector<std::uint64_t> codes(points.size());
    for (std::size_t i = 0; i < points.size(); ++i) codes[i] = morton_code((points[i] - low) * scale);
    std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
        return codes[a] != codes[b] ? codes[a] < codes[b] : a < b;
    });
    return order;
}

/// Integers whose expectations over `start` in [0, 1) are the given numbers. If `total` is not 0, they sum to it.
[[nodiscard]] inline std::vector<std::size_t> diffuse_counts(Span<const double> expected, std::size_t total,
                                                             double start) {
    const double sum = std::accumulate(expected.begin(), expected.end(), 0.0);
    std::vector<std::size_t> counts(expected.size(), 0);
    double cumulative = 0;
    std::size_t drawn = 0;
    for (std::size_t v = 0; v < expected.size(); ++v) {
        cumulative += expected[v];
        const double target = total ? cumulative / sum * static_cast<double>(total) : cumulative;
        auto reached = static_cast<std::size_t>(target + start);
        if (total) reached = std::min(reached, total); // rounding may carry start + total too far
        counts[v] = reached - drawn;
        drawn = reached;
    }
    return counts;
}

/// The triangle corners that meet at each vertex, and the areas of their regions.
struct OneRings {
    struct Corner {
        std::size_t face;
        int corner;
        double area; ///< square metres of the part of the face that belongs to this vertex
    };
    std::vector<std::size_t> starts; // [V + 1]
    std::vector<Corner> corners;     // grouped by vertex

    OneRings(Span<const std::array<int, 3>> faces, Span<const vec3<double>> vertices)
        : starts(vertices.size() + 1, 0), corners(3 * faces.size()) {
        for (const auto& face : faces)
            for (const int v : face) ++starts[static_cast<std::size_t>(v) + 1];
        std::partial_sum(starts.begin(), starts.end(), starts.begin());
        auto next = starts;
        for (std::size_t f = 0; f < faces.size(); ++f)
            for (int corner = 0; corner < 3; ++corner) {
                const auto [a, b, c] = positions(faces[f], corner, vertices);
                const double area = length(cross(b - a, c - a)) / 2;
                corners[next[static_cast<std::size_t>(faces[f][static_cast<std::size_t>(corner)])]++] = {
                    f, corner, area * CornerRegion(a, b, c).fraction()};
            }
    }

    /// The corners of a face, starting from one of them.
    [[nodiscard]] static std::array<vec3<double>, 3> positions(const std::array<int, 3>& face, int first,
                                                               Span<const vec3<double>> vertices) {
        std::array<vec3<double>, 3> p;
        for (int k = 0; k < 3; ++k)
            p[static_cast<std::size_t>(k)] =
                vertices[static_cast<std::size_t>(face[static_cast<std::size_t>((first + k) % 3)])];
        return p;
    }
};

} // namespace detail

inline SurfaceSamples sample_surface(const BodyModel& model, Span<const vec3<double>> vertices,
                                     Span<const double> samples_per_vertex, std::uint64_t seed,
                                     const SurfaceSampleParams& options) {
    constexpr auto where = "sample_surface";
    const std::size_t V = model.vertex_count(), J = model.joint_count();
    check_size(where, "vertices", vertices.size(), V, "pass the shaped mesh");
    check_size(where, "samples_per_vertex", samples_per_vertex.size(), V, "store one count per vertex");
    check_size(where, "model.weights", model.weights.size(), V * J);
    check_value(!model.faces.empty(), where, "the body has no triangles to sample");
    detail::check_triangles(where, "faces", model.faces, V);
    detail::check_coordinates(where, "vertices", vertices);
    check_finite<double>(where, "samples_per_vertex", samples_per_vertex);
    check_value(std::isfinite(options.jitter) && options.jitter >= 0, where,
                "jitter must be a finite share, at least 0");

    const detail::OneRings rings(model.faces, vertices);
    std::vector<double> ring_areas(V, 0), expected(V, 0);
    for (std::size_t v = 0; v < V; ++v) {
        check_value(samples_per_vertex[v] >= 0, where, "samples_per_vertex holds a negative count");
        for (std::size_t n = rings.starts[v]; n < rings.starts[v + 1]; ++n) ring_areas[v] += rings.corners[n].area;
        if (ring_areas[v] > 0) expected[v] = samples_per_vertex[v]; // a vertex without surface has no samples
    }
    const double sum = std::accumulate(expected.begin(), expected.end(), 0.0);
    check_value(options.total == 0 || sum > 0, where, "every K is 0, so no samples can be drawn; raise some");
    const double scale_of_K = options.total ? static_cast<double>(options.total) / sum : 1;

    Rng rng(seed);
    const std::vector<std::size_t> counts = detail::diffuse_counts(expected, options.total, rng.uniform());

    // Draw vertex by vertex: stratified along the ring, a golden-ratio sequence across it, both from random starts.
    SurfaceSamples drawn;
    std::vector<double> spacing; // per sample: distance to the next vertices
    const NearestPoints neighbours(vertices);
    constexpr double golden = 0.61803398874989485, smallest_squared = 1e-10; // square metres: coincident vertices
    for (std::size_t v = 0; v < V; ++v) {
        const auto K = static_cast<double>(counts[v]);
        const double squared = counts[v] ? std::max(neighbours.mean_squared_distance(v, 3), smallest_squared) : 0;
        const double across = rng.uniform();
        std::size_t n = rings.starts[v];
        double passed = 0; // total area of the ring's corners before n
        for (std::size_t k = 0; k < counts[v]; ++k) {
            const double along = (static_cast<double>(k) + rng.uniform()) / K * ring_areas[v];
            while (n + 1 < rings.starts[v + 1] && along >= passed + rings.corners[n].area)
                passed += rings.corners[n++].area;
            const auto& corner = rings.corners[n];
            const auto [a, b, c] = detail::OneRings::positions(model.faces[corner.face], corner.corner, vertices);
            const double v_across = across + golden * static_cast<double>(k);
            const vec3<double> turned =
                CornerRegion(a, b, c).at(corner.area > 0 ? std::clamp((along - passed) / corner.area, 0.0, 1.0) : 0,
                                         v_across - std::floor(v_across));
            vec3<double> weights; // in the order of the face's vertices
            for (int t = 0; t < 3; ++t) weights[(corner.corner + t) % 3] = turned[t];
            drawn.positions.push_back(a * turned.x + b * turned.y + c * turned.z);
            drawn.triangles.push_back(model.faces[corner.face]);
            drawn.barycentric.push_back(weights);
            drawn.sources.push_back(static_cast<int>(v));
            drawn.scales.push_back(std::sqrt(squared / (expected[v] * scale_of_K)));
            spacing.push_back(std::sqrt(squared));
        }
    }

    // Sort the samples, then compute what depends on their triangles.
    const auto vertex_normal = vertex_normals(vertices, model.faces);
    const auto order = detail::morton_order(drawn.positions);
    const auto sorted = [&](auto& values) {
        auto result = values;
        for (std::size_t i = 0; i < order.size(); ++i) result[i] = values[order[i]];
        values.swap(result);
    };
    sorted(drawn.positions), sorted(drawn.triangles), sorted(drawn.barycentric), sorted(drawn.sources);
    sorted(drawn.scales), sorted(spacing);
    SkinWeightBuilder builder(options.max_influences);
    const Span<const double> rows(model.weights);
    for (std::size_t i = 0; i < drawn.size(); ++i) {
        vec3<double> normal(0);
        for (int t = 0; t < 3; ++t) {
            const auto corner = static_cast<std::size_t>(drawn.triangles[i][static_cast<std::size_t>(t)]);
            normal += vertex_normal[corner] * drawn.barycentric[i][t];
            if (options.weights == SampleWeights::barycentric)
                builder.add(rows.subspan(corner * J, J), drawn.barycentric[i][t]);
        }
        if (options.weights == SampleWeights::copied)
            builder.add(rows.subspan(static_cast<std::size_t>(drawn.sources[i]) * J, J));
        builder.finish_point();
        const double size = length(normal);
        drawn.normals.push_back(size > 0 ? normal * (1 / size) : vec3<double>(0));
        if (options.jitter > 0)
            for (int k = 0; k < 3; ++k) drawn.positions[i][k] += options.jitter * spacing[i] * rng.uniform(-1, 1);
    }
    drawn.weights = builder.table();
    return drawn;
}

inline std::vector<double> interpolate(const SurfaceSamples& samples, Span<const double> values) {
    detail::check_triangles("interpolate", "samples.triangles", samples.triangles, values.size());
    check_size("interpolate", "samples.barycentric", samples.barycentric.size(), samples.triangles.size());
    std::vector<double> result;
    for (std::size_t i = 0; i < samples.triangles.size(); ++i) {
        const auto& [a, b, c] = samples.triangles[i];
        result.push_back(dot(samples.barycentric[i], vec3<double>(values[static_cast<std::size_t>(a)],
                                                                  values[static_cast<std::size_t>(b)],
                                                                  values[static_cast<std::size_t>(c)])));
    }
    return result;
}

} // namespace gsh
