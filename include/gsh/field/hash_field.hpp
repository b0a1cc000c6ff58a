// SPDX-License-Identifier: Apache-2.0
/// @file  A continuous parameter field over space: a hash encoding followed by a small network.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/features.hpp>
#include <gsh/field/hash_grid.hpp>
#include <gsh/field/mlp.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <type_traits>
#include <vector>

namespace gsh {

/// Resolution that depends on the region: fine where detail matters (τ near 1), coarse elsewhere (τ = 0),
///
///     z = τ F_h + (1 - τ) F_l,   with F_h of all levels, F_l of the coarse levels alone.
///
/// Shapes  region [N], τ in [0, 1] per point, in the backend's memory; empty: every level counts everywhere.
/// Source  paper §3.3, equation 9, and §3.4 for the assignment of levels.
template <class T>
struct MultiScale {
    int fine_level = 0;          ///< the first level that counts only where τ > 0
    bool separate_tables = false; ///< F_h and F_l have one table each; else they share one, and z = [coarse, τ fine]
    Span<const T> region;
};

/// Inputs of a field's network beside the encoding.
///
/// Shapes  points [N, point_inputs] row-major, separate for each point (prior features); shared [shared_inputs], the
///         same for every point (the time, a pose); both in the backend's memory.
template <class T>
struct FieldInputs {
    Span<const T> points = {};
    Span<const T> shared = {};
};

/// Whether the backend has run the passes of a field itself, after the checks of sizes. This version needs no overload:
/// the field runs grid and network. A backend may have one that stores what passes between them in its own way.
template <Backend B, class Field, class T, class Query, class Cache>
[[nodiscard]] bool hash_field_forward(B&, const Field&, Span<const T> /*table*/, Span<const T> /*weights*/,
                                      const Query&, Span<T> /*outputs*/, Cache&, const FieldInputs<T>&) {
    return false;
}
template <Backend B, class Field, class T, class Query, class Cache>
[[nodiscard]] bool hash_field_backward(B&, const Field&, Span<const T> /*weights*/, const Query&,
                                       Span<const T> /*dL_doutputs*/, Cache&, Span<T> /*dL_dtable*/,
                                       Span<T> /*dL_dweights*/, const FieldInputs<T>&, Span<T> /*dL_dshared*/) {
    return false;
}

/// outputs(x) = Mlp([HashGrid(x), points, shared]) at the fixed points of a query: x ↦ SH, x ↦ δx, x ↦ ao of the paper.
///
/// Shapes  table [table_parameter_count(query)], weights [mlp().parameter_count()], outputs [N, outputs] row-major, all
///         in the backend's memory.
/// Errors  ShapeError, ValueError before any work starts.
/// Source  paper §3.4, equations 12, 15 and 16; Müller et al., "Instant Neural Graphics Primitives", 2022.
template <int Levels, int Features>
class HashField {
public:
    using Grid = HashGrid<Levels, Features>;

    /// Fixed points, prepared once for all passes. There is one grid, or two where fine and coarse levels have separate
    /// tables; the first is then that of F_l.
    template <Backend B, std::floating_point T = float>
    struct Query {
        std::vector<typename Grid::template Query<B, T>> grids;
        typename B::template Buffer<std::uint32_t> touched; ///< entries that at least one point uses, ascending

        [[nodiscard]] std::size_t size() const { return grids.empty() ? 0 : grids[0].size(); }
        /// Number of table rows that one pass over all points reads.
        [[nodiscard]] std::size_t lookups() const {
            std::size_t sum = 0;
            for (const auto& grid : grids) sum += grid.lookups;
            return sum;
        }
    };

    template <Backend B, std::floating_point T = float>
    struct Cache {
        /// [Levels][N][Features], after backward their gradient; empty where a backend stores its own.
        typename B::template Buffer<T> features;
        Mlp::Cache<B, T> mlp;
    };

    /// network.inputs is ignored: the number of inputs follows from the other arguments.
    HashField(typename Grid::Params grid, Mlp::Params network, std::size_t point_inputs = 0,
              std::size_t shared_inputs = 0)
        : grid_(grid), mlp_(with_inputs(network, point_inputs + shared_inputs)), point_inputs_(point_inputs),
          shared_inputs_(shared_inputs) {}

    [[nodiscard]] const Grid& grid() const { return grid_; }
    [[nodiscard]] const Mlp& mlp() const { return mlp_; }
    [[nodiscard]] std::size_t point_inputs() const { return point_inputs_; }
    [[nodiscard]] std::size_t shared_inputs() const { return shared_inputs_; }

    /// Stores the points, in [0, 1]^3, and the weights of their levels.
    ///
    /// Shapes  points [N] in the backend's memory.
    /// Errors  ShapeError unless there is one τ per point, ValueError for a fine_level outside the grid's levels.
    template <Backend B, std::floating_point T>
    void prepare(B& backend, std::type_identity_t<Span<const vec3<T>>> points, Query<B, T>& query,
                 const std::type_identity_t<MultiScale<T>>& scales = {}) const {
        check_value(scales.fine_level >= 0 && scales.fine_level <= Levels, "HashField::prepare",
                    "fine_level must lie between 0 and the number of levels");
        if (scales.region.empty()) {
            query.grids.resize(1);
            grid_.prepare(backend, points, query.grids[0]);
        } else if (!scales.separate_tables) {
            query.grids.resize(1);
            grid_.prepare(backend, points, query.grids[0], LevelWeights<T>{scales.fine_level, {}, scales.region});
        } else {
            check_size("HashField::prepare", "region", scales.region.size(), points.size(), "one τ per point");
            check_memory(backend, "HashField::prepare", "region", scales.region);
            std::vector<T> rest(points.size()), none(points.size(), T(0)), region(points.size());
            backend.download(scales.region, Span<T>(region));
            for (std::size_t i = 0; i < region.size(); ++i) rest[i] = T(1) - region[i];
            typename B::template Buffer<T> on_backend[2];
            assign(backend, rest, on_backend[0]);
            assign(backend, none, on_backend[1]);
            query.grids.resize(2);
            grid_.prepare(backend, points, query.grids[0],
                          LevelWeights<T>{scales.fine_level, on_backend[0], on_backend[1]});
            grid_.prepare(backend, points, query.grids[1],
                          LevelWeights<T>{scales.fine_level, scales.region, scales.region});
        }
        join_touched(backend, query);
    }

    /// Size of the table of a field with this query: that of the grid, or with separate tables twice that, F_l before
    /// F_h.
    [[nodiscard]] std::size_t table_parameter_count(const auto& query) const {
        return query.grids.size() * grid_.parameter_count();
    }

    /// Writes the outputs of every point, and stores in the cache what backward needs.
    template <Backend B, std::floating_point T>
    void forward(B& backend, std::type_identity_t<Span<const T>> table, std::type_identity_t<Span<const T>> weights,
                 const Query<B, T>& query, std::type_identity_t<Span<T>> outputs, Cache<B, T>& cache,
                 const std::type_identity_t<FieldInputs<T>>& inputs = {}) const {
        check(query, weights.size(), outputs.size(), "outputs", inputs, "HashField::forward");
        check_size("HashField::forward", "table", table.size(), table_parameter_count(query));
        if (hash_field_forward(backend, *this, table, weights, query, outputs, cache, inputs)) return;
        cache.features.resize(query.size() * Grid::output_count);
        const FeatureView<T> features = view(Span<T>(cache.features), query.size());
        for (std::size_t g = 0; g < query.grids.size(); ++g)
            grid_.forward(backend, table.subspan(g * grid_.parameter_count(), grid_.parameter_count()), query.grids[g],
                          features, g ? Write::add : Write::assign);
        mlp_.forward(backend, weights, MlpInputs<T>{features, inputs.points, inputs.shared}, outputs, cache.mlp);
    }

    /// Adds to dL_dtable, dL_dweights and, unless it is empty, dL_dshared. weights, inputs and cache are those of
    /// forward. The cache is used up, because the gradient of the features takes their place.
    template <Backend B, std::floating_point T>
    void backward(B& backend, std::type_identity_t<Span<const T>> weights, const Query<B, T>& query,
                  std::type_identity_t<Span<const T>> dL_doutputs, Cache<B, T>& cache,
                  std::type_identity_t<Span<T>> dL_dtable, std::type_identity_t<Span<T>> dL_dweights,
                  const std::type_identity_t<FieldInputs<T>>& inputs = {},
                  std::type_identity_t<Span<T>> dL_dshared = {}) const {
        check(query, weights.size(), dL_doutputs.size(), "dL_doutputs", inputs, "HashField::backward");
        check_size("HashField::backward", "dL_dtable", dL_dtable.size(), table_parameter_count(query));
        check_size("HashField::backward", "dL_dweights", dL_dweights.size(), mlp_.parameter_count());
        check_size("HashField::backward", "cache.rows", cache.mlp.rows, query.size(), "forward must come first");
        if (!dL_dshared.empty())
            check_size("HashField::backward", "dL_dshared", dL_dshared.size(), shared_inputs_);
        if (!hash_field_backward(backend, *this, weights, query, dL_doutputs, cache, dL_dtable, dL_dweights, inputs,
                                 dL_dshared)) {
            const FeatureView<T> features = view(Span<T>(cache.features), query.size()), &dL_dfeatures = features;
            mlp_.backward(backend, weights, MlpInputs<T>{features, inputs.points, inputs.shared}, dL_doutputs,
                          cache.mlp, dL_dweights, dL_dfeatures, Write::assign, dL_dshared);
            for (std::size_t g = 0; g < query.grids.size(); ++g)
                grid_.backward(backend, dL_dfeatures, query.grids[g],
                               dL_dtable.subspan(g * grid_.parameter_count(), grid_.parameter_count()));
        }
        cache.mlp.rows = 0;
    }

private:
    static Mlp::Params with_inputs(Mlp::Params network, std::size_t beside) {
        network.inputs = Grid::output_count + static_cast<int>(beside);
        return network;
    }

    template <class T>
    static FeatureView<T> view(Span<T> values, std::size_t rows) {
        return {values, rows, Grid::output_count, Features};
    }

    template <Backend B, class T>
    void check(const Query<B, T>& query, std::size_t weights, std::size_t outputs, std::string_view outputs_name,
               const FieldInputs<T>& inputs, std::string_view where) const {
        check_size(where, "weights", weights, mlp_.parameter_count());
        check_size(where, outputs_name, outputs, query.size() * mlp_.outputs());
        check_size(where, "inputs.points", inputs.points.size(), query.size() * point_inputs_);
        check_size(where, "inputs.shared", inputs.shared.size(), shared_inputs_);
    }

    template <Backend B, class T>
    void join_touched(B& backend, Query<B, T>& query) const {
        std::size_t count = 0;
        for (const auto& grid : query.grids) count += grid.touched.size();
        query.touched.resize(count);
        std::vector<std::uint32_t> entries;
        entries.reserve(count);
        for (std::size_t g = 0; g < query.grids.size(); ++g) {
            const std::vector<std::uint32_t> of_grid =
                downloaded(backend, Span<const std::uint32_t>(query.grids[g].touched));
            for (const std::uint32_t e : of_grid)
                entries.push_back(e + static_cast<std::uint32_t>(g * grid_.entry_count()));
        }
        backend.upload(Span<const std::uint32_t>(entries), Span<std::uint32_t>(query.touched));
    }

    Grid grid_;
    Mlp mlp_;
    std::size_t point_inputs_, shared_inputs_;
};

} // namespace gsh
