// SPDX-License-Identifier: Apache-2.0
/// @file  Multi-resolution hash encoding: trainable features of points in the unit cube.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/features.hpp>
#include <gsh/field/hash_level.hpp>
#include <gsh/math/vec.hpp>

#include <array>
#include <bit>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <vector>

namespace gsh {

/// Private storage of a backend for fixed points: what its passes need beside the points. Each backend specialises it
/// beside its overloads.
template <Backend B, std::floating_point T>
struct HashScratch {
    static_assert(detail::overload_is_included<B>,
                  "HashGrid: include its backend's overloads, <gsh/field/cpu/hash_grid.hpp> or <gsh/cpu.hpp>");
};

/// Fallback without the backend's overloads: fails to compile, and names the header to include.
template <Backend B, class... Arguments>
void hash_prepare(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>,
                  "HashGrid: include its backend's overloads, <gsh/field/cpu/hash_grid.hpp> or <gsh/cpu.hpp>");
}
template <Backend B, class... Arguments>
void hash_forward(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>,
                  "HashGrid: include its backend's overloads, <gsh/field/cpu/hash_grid.hpp> or <gsh/cpu.hpp>");
}
template <Backend B, class... Arguments>
void hash_backward(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>,
                  "HashGrid: include its backend's overloads, <gsh/field/cpu/hash_grid.hpp> or <gsh/cpu.hpp>");
}

/// The geometry of a hash grid.
struct HashGridParams {
    double base = 4;                     ///< cells per unit length on level 0, plus one
    double growth = 1.6;                 ///< ratio of cells from one level to the next
    std::uint32_t table_size = 1u << 17; ///< largest number of entries of a level; a power of two
};

/// features[l * Features + f] = sum over a cell's corners of weight(corner) * table[entry(l, corner), f], trilinear, on
/// Levels grids of growing resolution; with the adjoint to the table and to the point.
///
/// Shapes  table [entry_count, Features]; points [N] in [0, 1]^3; features [N, Levels * Features] in any blocks (blocks
///         of Features columns are the fastest).
/// Units   level l has base * growth^l - 1 cells per unit length and resolution ceil(that) + 1. It is dense while
///         (resolution + 1)^3 entries fit table_size; else a hash of the corner gives the entry, and corners may
///         collide.
/// Errors  ShapeError, ValueError before any work starts; the per-point functions are kernel code.
/// Source  Müller et al., "Instant Neural Graphics Primitives with a Multiresolution Hash Encoding", 2022.
template <int Levels, int Features>
    requires(Levels >= 1 && Features >= 1)
class HashGrid {
public:
    static constexpr int level_count = Levels, feature_count = Features, output_count = Levels * Features;

    using Params = HashGridParams;

    /// Fixed points, prepared once for every pass over every table of this geometry.
    template <Backend B, std::floating_point T = float>
    struct Query {
        typename B::template Buffer<T> x, y, z;           ///< [N]
        typename B::template Buffer<std::uint32_t> touched; ///< entries that at least one point uses, ascending
        std::array<std::size_t, Levels + 1>
            touched_begin{}; ///< level l has touched[touched_begin[l], touched_begin[l + 1])
        int split = 0;                                       ///< first fine level
        typename B::template Buffer<T> coarse, fine;         ///< [N] or empty: weights of the levels
        std::size_t lookups = 0;                             ///< number of table rows that a pass over all points reads
        HashScratch<B, T> scratch;                           ///< the backend's own

        [[nodiscard]] std::size_t size() const { return x.size(); }
        [[nodiscard]] LevelWeights<T> weights() const { return {split, coarse, fine}; }
    };

    explicit HashGrid(Params params = {}) : params_(params) {
        check_value(params.base > 1 && params.growth >= 1, "HashGrid", "base must exceed 1 and growth be at least 1");
        check_value(std::has_single_bit(params.table_size), "HashGrid", "table_size must be a power of two");
        std::uint64_t offset = 0;
        for (int l = 0; l < Levels; ++l) {
            HashLevel& level = levels_[l];
            level.scale = params.base * std::pow(params.growth, l) - 1;
            level.scale_single = static_cast<float>(level.scale);
            check_value(level.scale < (1 << 20), "HashGrid",
                        "the finest level must have fewer than 2^20 cells per unit");
            level.resolution = static_cast<std::uint32_t>(std::ceil(level.scale)) + 1;
            const std::uint64_t corners =
                std::uint64_t(level.resolution + 1) * (level.resolution + 1) * (level.resolution + 1);
            level.hashed = corners > params.table_size;
            // Levels start on a multiple of 16 entries, so that neighbours in x share a cache line.
            const std::uint64_t size = level.hashed ? params.table_size : (corners + 15) / 16 * 16;
            level.size = static_cast<std::uint32_t>(size);
            level.offset = static_cast<std::uint32_t>(offset);
            offset += size;
        }
        check_value(offset * Features < (std::uint64_t(1) << 31), "HashGrid",
                    "the table must have fewer than 2^31 numbers");
        entry_count_ = static_cast<std::size_t>(offset);
    }

    [[nodiscard]] const Params& params() const { return params_; }
    [[nodiscard]] GSH_HD const HashLevel& level(int l) const { return levels_[l]; }
    [[nodiscard]] std::size_t entry_count() const { return entry_count_; }
    [[nodiscard]] std::size_t parameter_count() const { return entry_count_ * Features; }

    /// A table of uniform random numbers in ±1e-4, the same for the same seed.
    template <std::floating_point T>
    [[nodiscard]] std::vector<T> initial_table(std::uint64_t seed) const {
        std::vector<T> table(parameter_count());
        for (std::size_t i = 0; i < table.size(); ++i)
            table[i] = static_cast<T>(1e-4 * (2 * random_uniform(seed, i) - 1));
        return table;
    }

    // One point -----------------------------------------------------------------------------------------------------

    /// Features of one point (per lane); features [Levels * Features].
    template <Lane T>
    GSH_HD void encode(const ScalarOf<T>* table, const vec3<T>& point, T* features,
                       const LevelWeight<T>& weight = {}) const;

    /// Adds to dL_dpoint. Features are smooth inside a cell; their derivative jumps at its faces.
    template <Lane T>
    GSH_HD void encode_backward_point(const ScalarOf<T>* table, const vec3<T>& point, const T* dL_dfeatures,
                                      vec3<T>& dL_dpoint, const LevelWeight<T>& weight = {}) const;

    /// Adds to dL_dtable. Scalars only, since two lanes may add to the same entry.
    template <std::floating_point T>
    GSH_HD void encode_backward_table(const vec3<T>& point, const T* dL_dfeatures, T* dL_dtable,
                                      const LevelWeight<T>& weight = {}) const;

    // Many points ---------------------------------------------------------------------------------------------------

    /// Stores the points and the weights of their levels, and lists the entries that they use.
    template <Backend B, std::floating_point T>
    void prepare(B& backend, std::type_identity_t<Span<const vec3<T>>> points, Query<B, T>& query,
                 const std::type_identity_t<LevelWeights<T>>& weights = {}) const {
        const auto check_weights = [&](Span<const T> of_levels) {
            if (!of_levels.empty())
                check_size("HashGrid::prepare", "weights", of_levels.size(), points.size(),
                           "one weight per point, or none");
        };
        check_weights(weights.coarse);
        check_weights(weights.fine);
        check_memory(backend, "HashGrid::prepare", "points", points);
        check_memory(backend, "HashGrid::prepare", "weights.coarse", weights.coarse);
        check_memory(backend, "HashGrid::prepare", "weights.fine", weights.fine);
        query.x.resize(points.size());
        query.y.resize(points.size());
        query.z.resize(points.size());
        query.split = weights.split;
        query.coarse.resize(weights.coarse.size());
        query.fine.resize(weights.fine.size());
        hash_prepare(backend, *this, points, weights, query);
    }

    /// features = encoding of each point of the query; Write::add adds it to features instead.
    template <Backend B, std::floating_point T>
    void forward(B& backend, std::type_identity_t<Span<const T>> table, const Query<B, T>& query,
                 std::type_identity_t<FeatureView<T>> features, Write mode = Write::assign) const {
        check_size("HashGrid::forward", "table", table.size(), parameter_count());
        check_features("HashGrid::forward", "features", features, query.size(), output_count);
        check_value(features.block % Features == 0, "HashGrid::forward",
                    "features.block must be a multiple of Features");
        check_memory(backend, "HashGrid::forward", "table", table);
        check_memory(backend, "HashGrid::forward", "features", features.values);
        hash_forward(backend, *this, table, query, features, mode);
    }

    /// Adds to dL_dtable. Only touched entries change.
    template <Backend B, std::floating_point T>
    void backward(B& backend, std::type_identity_t<FeatureView<const T>> dL_dfeatures, const Query<B, T>& query,
                  std::type_identity_t<Span<T>> dL_dtable) const {
        check_size("HashGrid::backward", "dL_dtable", dL_dtable.size(), parameter_count());
        check_features("HashGrid::backward", "dL_dfeatures", dL_dfeatures, query.size(), output_count);
        check_value(dL_dfeatures.block % Features == 0, "HashGrid::backward",
                    "dL_dfeatures.block must be a multiple of Features");
        check_memory(backend, "HashGrid::backward", "dL_dfeatures", dL_dfeatures.values);
        check_memory(backend, "HashGrid::backward", "dL_dtable", dL_dtable);
        hash_backward(backend, *this, dL_dfeatures, query, dL_dtable);
    }

    /// Adds the gradient with respect to the points to dL_dpoints.
    template <Backend B, std::floating_point T>
    void backward_points(B& backend, std::type_identity_t<Span<const T>> table, const Query<B, T>& query,
                         std::type_identity_t<FeatureView<const T>> dL_dfeatures,
                         std::type_identity_t<Span<vec3<T>>> dL_dpoints) const;

private:
    Params params_;
    HashLevel levels_[Levels];
    std::size_t entry_count_ = 0;
};

template <int Levels, int Features>
    requires(Levels >= 1 && Features >= 1)
template <Lane T>
GSH_HD void HashGrid<Levels, Features>::encode(const ScalarOf<T>* table, const vec3<T>& point, T* features,
                                               const LevelWeight<T>& level_weight) const {
    for (int l = 0; l < Levels; ++l) {
        const HashCell<T> cell = levels_[l].cell(point);
        T* out = features + l * Features;
        for (int f = 0; f < Features; ++f) out[f] = T(0);
        for (int corner = 0; corner < 8; ++corner) {
            const T weight = cell.weight(corner) * level_weight(l);
            const IndexOf<T> first = levels_[l].index(cell, corner) * IndexOf<T>(Features);
            for (int f = 0; f < Features; ++f) out[f] += weight * LaneTraits<T>::gather(table + f, first);
        }
    }
}

template <int Levels, int Features>
    requires(Levels >= 1 && Features >= 1)
template <Lane T>
GSH_HD void HashGrid<Levels, Features>::encode_backward_point(const ScalarOf<T>* table, const vec3<T>& point,
                                                              const T* dL_dfeatures, vec3<T>& dL_dpoint,
                                                              const LevelWeight<T>& level_weight) const {
    vec3<T> dL_dinside(T(0));
    for (int l = 0; l < Levels; ++l) {
        const HashCell<T> cell = levels_[l].cell(point);
        vec3<T> dL_dfraction(T(0));
        for (int corner = 0; corner < 8; ++corner) {
            const IndexOf<T> first = levels_[l].index(cell, corner) * IndexOf<T>(Features);
            T dL_dweight(0);
            for (int f = 0; f < Features; ++f)
                dL_dweight += dL_dfeatures[l * Features + f] * LaneTraits<T>::gather(table + f, first);
            dL_dfraction += cell.weight_gradient(corner) * dL_dweight;
        }
        dL_dinside += dL_dfraction * (T(levels_[l].template scale_as<ScalarOf<T>>()) * level_weight(l));
    }
    for (int axis = 0; axis < 3; ++axis) // a coordinate outside the cube was moved to a face: no gradient
        dL_dpoint[axis] += select(point[axis] < T(0) || point[axis] > T(1), T(0), dL_dinside[axis]);
}

template <int Levels, int Features>
    requires(Levels >= 1 && Features >= 1)
template <std::floating_point T>
GSH_HD void HashGrid<Levels, Features>::encode_backward_table(const vec3<T>& point, const T* dL_dfeatures,
                                                              T* dL_dtable,
                                                              const LevelWeight<T>& level_weight) const {
    for (int l = 0; l < Levels; ++l) {
        const HashCell<T> cell = levels_[l].cell(point);
        for (int corner = 0; corner < 8; ++corner) {
            T* row = dL_dtable + levels_[l].index(cell, corner) * Features;
            const T weight = cell.weight(corner) * level_weight(l);
            for (int f = 0; f < Features; ++f) row[f] += weight * dL_dfeatures[l * Features + f];
        }
    }
}

namespace detail {
template <class Grid, class T>
struct HashBackwardPoint {
    Grid grid;
    Span<const T> x, y, z, table;
    FeatureView<const T> dL_dfeatures;
    LevelWeights<T> weights;
    Span<vec3<T>> dL_dpoints;

    GSH_HD void operator()(std::size_t i) const {
        T row[Grid::output_count];
        for (int c = 0; c < Grid::output_count; ++c) row[c] = dL_dfeatures(i, static_cast<std::size_t>(c));
        grid.encode_backward_point(table.data(), vec3<T>(x[i], y[i], z[i]), row, dL_dpoints[i], weights[i]);
    }
};
} // namespace detail

template <int Levels, int Features>
    requires(Levels >= 1 && Features >= 1)
template <Backend B, std::floating_point T>
void HashGrid<Levels, Features>::backward_points(B& backend, std::type_identity_t<Span<const T>> table,
                                                 const Query<B, T>& query,
                                                 std::type_identity_t<FeatureView<const T>> dL_dfeatures,
                                                 std::type_identity_t<Span<vec3<T>>> dL_dpoints) const {
    check_size("HashGrid::backward_points", "table", table.size(), parameter_count());
    check_features("HashGrid::backward_points", "dL_dfeatures", dL_dfeatures, query.size(), output_count);
    check_size("HashGrid::backward_points", "dL_dpoints", dL_dpoints.size(), query.size());
    check_memory(backend, "HashGrid::backward_points", "table", table);
    check_memory(backend, "HashGrid::backward_points", "dL_dfeatures", dL_dfeatures.values);
    check_memory(backend, "HashGrid::backward_points", "dL_dpoints", dL_dpoints);
    backend.for_each(query.size(), detail::HashBackwardPoint<HashGrid, T>{*this, query.x, query.y, query.z, table,
                                                                          dL_dfeatures, query.weights(), dL_dpoints});
}

} // namespace gsh
