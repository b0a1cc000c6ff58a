// SPDX-License-Identifier: Apache-2.0
/// @file  A hash field in mixed precision: features and their gradients pass between grid and network in bf16.
///
/// The network rounds its inputs to bf16 in any case, so features in bf16 cost no accuracy. Their gradients are not
/// rounded otherwise. But they come from products of numbers of bf16, and each entry of the table sums many of them:
/// the error of the sum is smaller than that of its terms. bf16 has the range of float, so nothing needs a scale. Both
/// passes of the grid are bound by memory, and read or write half of the bytes.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/memory.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/cuda/half_row.cuh>
#include <gsh/field/cuda/hash_grid.cuh>
#include <gsh/field/cuda/mlp.cuh>
#include <gsh/field/cuda/mlp_mixed_rows.cuh>
#include <gsh/field/features.hpp>
#include <gsh/field/hash_field.hpp>

#include <concepts>
#include <cstddef>
#include <string_view>

namespace gsh::cuda {

namespace detail {

/// What both passes of a field share.
template <class Field>
class MixedField {
public:
    using Grid = typename Field::Grid;
    static constexpr std::size_t F = Grid::feature_count;
    using Feature = Bf16Row<F>;
    using Inputs = MixedWordInputs<static_cast<unsigned>(Grid::output_count), static_cast<unsigned>(F)>;

    MixedField(std::string_view where, Device& device, const Field& field, std::size_t rows,
               const FieldInputs<float>& inputs)
        : where_(where), device_(device), rows_(rows), inputs_(inputs),
          network_(mlp_shape<float>(where, field.mlp(), rows, inputs.shared.size())) {}

    [[nodiscard]] bool is_mixed() const { return detail::is_mixed<float>(device_, network_); }
    [[nodiscard]] const MlpShape& network() const { return network_; }
    [[nodiscard]] std::size_t word_count() const { return rows_ * Grid::output_count / 2; }

    /// Level after level, for the grid.
    template <class Row>
    [[nodiscard]] HashRows<Row> rows(Device::Buffer<std::uint32_t>& words) const {
        return HashRows<Row>(where_, as_half_rows<Feature>(words), rows_, 1);
    }
    /// The same, for the network.
    template <class Word>
    [[nodiscard]] typename Inputs::template Words<Word> words(Device::Buffer<std::uint32_t>& words) const {
        return {words, rows_};
    }
    [[nodiscard]] Inputs inputs(Device::Buffer<std::uint32_t>& features) const {
        return {words<const std::uint32_t>(features), inputs_.points, network_.inputs - Grid::output_count};
    }
    template <class T>
    void check(std::string_view argument, Span<T> memory) const {
        check_memory(device_, where_, argument, memory);
    }
    void check_inputs() const {
        check("inputs.points", inputs_.points);
        check("inputs.shared", inputs_.shared);
    }

private:
    std::string_view where_;
    Device& device_;
    std::size_t rows_;
    const FieldInputs<float>& inputs_;
    MlpShape network_;
};

} // namespace detail

template <class Field, class T, class Query, class Cache>
[[nodiscard]] bool hash_field_forward(Device& device, const Field& field, Span<const T> table, Span<const T> weights,
                                      const Query& query, Span<T> outputs, Cache& cache, const FieldInputs<T>& inputs) {
    using Grid = typename Field::Grid;
    if constexpr (detail::hash_has_half<Grid, T>) {
        const detail::MixedField<Field> mixed("HashField::forward", device, field, query.size(), inputs);
        if (!mixed.is_mixed()) return false;
        mixed.check("table", table), mixed.check("weights", weights), mixed.check("outputs", outputs);
        mixed.check_inputs();
        MlpScratch<Device, float>& scratch = cache.mlp.scratch;
        scratch.features.resize(mixed.word_count());
        const std::size_t grid_size = field.grid().parameter_count();
        for (std::size_t g = 0; g < query.grids.size(); ++g)
            detail::hash_encode_half(device, field.grid(), table.subspan(g * grid_size, grid_size), query.grids[g],
                                     mixed.template rows<typename decltype(mixed)::Feature>(scratch.features),
                                     g ? Write::add : Write::assign);
        detail::mixed_forward(device, mixed.network(), weights, mixed.inputs(scratch.features), query.size(),
                              inputs.shared, outputs, scratch);
        cache.mlp.rows = query.size();
        return true;
    } else {
        return false;
    }
}

template <class Field, class T, class Query, class Cache>
[[nodiscard]] bool hash_field_backward(Device& device, const Field& field, Span<const T> weights, const Query& query,
                                       Span<const T> dL_doutputs, Cache& cache, Span<T> dL_dtable, Span<T> dL_dweights,
                                       const FieldInputs<T>& inputs, Span<T> dL_dshared) {
    using Grid = typename Field::Grid;
    if constexpr (detail::hash_has_half<Grid, T>) {
        using Mixed = detail::MixedField<Field>;
        const Mixed mixed("HashField::backward", device, field, query.size(), inputs);
        if (!mixed.is_mixed()) return false;
        mixed.check("weights", weights), mixed.check("dL_doutputs", dL_doutputs), mixed.check("dL_dtable", dL_dtable);
        mixed.check("dL_dweights", dL_dweights), mixed.check("dL_dshared", dL_dshared);
        mixed.check_inputs();
        MlpScratch<Device, float>& scratch = cache.mlp.scratch;
        scratch.dL_dfeatures.resize(mixed.word_count());
        detail::mixed_backward(device, mixed.network(), weights, mixed.inputs(scratch.features), query.size(),
                               inputs.shared, dL_doutputs, scratch, dL_dweights,
                               {mixed.template words<std::uint32_t>(scratch.dL_dfeatures)}, dL_dshared,
                               detail::mlp_most_blocks);
        const std::size_t grid_size = field.grid().parameter_count();
        for (std::size_t g = 0; g < query.grids.size(); ++g)
            detail::hash_add_gradients(device, field.grid(),
                                       mixed.template rows<const typename Mixed::Feature>(scratch.dL_dfeatures),
                                       query.grids[g], dL_dtable.subspan(g * grid_size, grid_size));
        return true;
    } else {
        return false;
    }
}

} // namespace gsh::cuda
