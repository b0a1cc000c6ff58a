// SPDX-License-Identifier: Apache-2.0
/// @file  A continuous parameter field over space: hash encoding, then a small network.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/features.hpp>
#include <gsh/field/hash_grid.hpp>
#include <gsh/field/mlp.hpp>

#include <concepts>
#include <cstddef>
#include <type_traits>

namespace gsh {

/// outputs(x) = Mlp(HashGrid(x)) at the fixed points of a query: x ↦ SH, x ↦ δx of the paper.
///
/// Shapes  table [grid().parameter_count()], weights [mlp().parameter_count()], outputs [N, outputs].
/// Source  paper §3.4, equations for x₀ ↦ (SH, δx); Müller et al., "Instant Neural Graphics Primitives", 2022.
template <int Levels, int Features>
class HashField {
public:
    using Grid = HashGrid<Levels, Features>;

    template <Backend B, std::floating_point T = float>
    struct Cache {
        typename B::template Buffer<T> features;     ///< [Levels][N][Features]
        typename B::template Buffer<T> dL_dfeatures; ///< likewise
        Mlp::Cache<B, T> mlp;
    };

    /// The network's input count is the grid's output count, whatever `network` says.
    HashField(typename Grid::Params grid, Mlp::Params network) : grid_(grid), mlp_(with_inputs(network)) {}

    [[nodiscard]] const Grid& grid() const { return grid_; }
    [[nodiscard]] const Mlp& mlp() const { return mlp_; }

    template <Backend B, std::floating_point T>
    void forward(B& backend, std::type_identity_t<Span<const T>> table, std::type_identity_t<Span<const T>> weights,
                 const typename Grid::template Query<B, T>& query, std::type_identity_t<Span<T>> outputs,
                 Cache<B, T>& cache) const {
        cache.features.resize(query.size() * Grid::output_count);
        const FeatureView<T> features = view(Span<T>(cache.features), query.size());
        grid_.forward(backend, table, query, features);
        mlp_.forward(backend, weights, features, outputs, cache.mlp);
    }

    /// Adds to dL_dtable and dL_dweights.
    template <Backend B, std::floating_point T>
    void backward(B& backend, std::type_identity_t<Span<const T>> weights,
                  const typename Grid::template Query<B, T>& query, std::type_identity_t<Span<const T>> dL_doutputs,
                  Cache<B, T>& cache, std::type_identity_t<Span<T>> dL_dtable,
                  std::type_identity_t<Span<T>> dL_dweights) const {
        cache.dL_dfeatures.resize(cache.features.size());
        const FeatureView<T> features = view(Span<T>(cache.features), query.size());
        const FeatureView<T> dL_dfeatures = view(Span<T>(cache.dL_dfeatures), query.size());
        mlp_.backward(backend, weights, features, dL_doutputs, cache.mlp, dL_dweights, dL_dfeatures, Write::assign);
        grid_.backward(backend, dL_dfeatures, query, dL_dtable);
    }

private:
    static Mlp::Params with_inputs(Mlp::Params network) {
        network.inputs = Grid::output_count;
        return network;
    }
    template <class T>
    static FeatureView<T> view(Span<T> values, std::size_t rows) {
        return {values, rows, Grid::output_count, Features};
    }

    Grid grid_;
    Mlp mlp_;
};

} // namespace gsh
