// SPDX-License-Identifier: Apache-2.0
/// @file  A hash field that learns: table and network with their gradients, moments and cache.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/hash_field.hpp>
#include <gsh/field/hash_grid.hpp>
#include <gsh/field/mlp.hpp>
#include <gsh/learn/learned_array.hpp>
#include <gsh/learn/part_size.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace gsh {

/// Sizes of a field's hash grid and network.
struct FieldParams {
    HashGridParams grid = {};
    int width = Mlp::Params().width; ///< neurons of a hidden layer
    int hidden_layers = Mlp::Params().hidden_layers;
};

/// Streams of random numbers of an avatar's fields, which have the same seed. A field of stream s draws the entries of
/// its tables from the streams s and s + 100, and the weights of its network from s + 1. Streams of fields are
/// therefore odd. Other numbers would serve as well, but they would give other initial values for the same seed.
namespace field_stream {
inline constexpr std::uint64_t displacements = 1; ///< FieldDisplacements
inline constexpr std::uint64_t colors = 3;        ///< FieldColors
inline constexpr std::uint64_t shared = 5;        ///< SharedField: colours and displacements
inline constexpr std::uint64_t occlusion = 7;     ///< TimeOcclusion, PoseOcclusion
} // namespace field_stream

/// Where a field's random initial values come from.
struct FieldStart {
    std::uint64_t seed = 0;
    std::uint64_t stream = 0; ///< of random numbers, see field_stream; each field of an avatar has its own
};

/// A HashField with the memory that learning takes. The caller owns the query, so that fields over the same points
/// share it. backward takes the query and the inputs of forward again.
///
/// Shapes  outputs, dL_doutputs [N, outputs] row-major in the backend's memory.
template <Backend B, std::floating_point T = float, int Levels = 16, int Features = 4>
class LearnedField {
public:
    using Field = HashField<Levels, Features>;
    using Grid = typename Field::Grid;
    using Query = typename Field::template Query<B, T>;
    using Cache = typename Field::template Cache<B, T>;

    struct Params {
        std::string name;              ///< prefix of the names of the learned arrays
        FieldParams sizes = {};        ///< of hash grid and network
        int outputs = 1;               ///< numbers per point
        std::size_t point_inputs = 0;  ///< inputs of the network beside the encoding, a row per point
        std::size_t shared_inputs = 0; ///< inputs of the network that are the same for all points
        std::size_t tables = 1;        ///< one per grid of the query: 2 if coarse and fine levels have separate tables
        FieldStart start = {};
    };

    LearnedField(B& backend, const Params& params)
        : backend_(&backend), name_(params.name), field_(geometry(params)),
          table_(backend, initial_tables(params.tables, params.start)),
          network_(backend, initial_weights(params.start)) {}

    /// The table and the network; for each point the encoding, the hidden layers, and the outputs and their gradient.
    [[nodiscard]] static PartSize size(const Params& params) {
        const Field field = geometry(params);
        std::size_t hidden = 0;
        for (std::size_t layer = 0; layer + 1 < field.mlp().layer_count(); ++layer)
            hidden += field.mlp().layer_outputs(layer);
        return {.learned = {{params.name + ".table", params.tables * field.grid().parameter_count()},
                            {params.name + ".network", field.mlp().parameter_count()}},
                .other_per_point = std::size_t(Grid::output_count) + hidden + 2 * field.mlp().outputs()};
    }

    [[nodiscard]] const Field& field() const { return field_; }
    [[nodiscard]] const Mlp& mlp() const { return field_.mlp(); }
    [[nodiscard]] Span<const T> table() const { return table_.values(); }
    [[nodiscard]] Span<const T> weights() const { return network_.values(); }
    /// What forward stores for backward.
    [[nodiscard]] Cache& cache() { return cache_; }
    /// Frees it. The next forward allocates it again.
    void release_memory() { cache_ = {}; }

    /// Sets the last layer's weights to zero, so that the field starts as the constant 0.
    void silence_outputs() {
        const std::size_t last = mlp().layer_inputs(mlp().layer_count() - 1) * mlp().outputs();
        backend_->fill(network_.values().subspan(network_.size() - last, last), T(0));
    }
    /// Sets the first layer's weights of all inputs beside the encoding to zero. The encoding starts near zero, and so
    /// do the outputs. Inputs of order one would make the first outputs large.
    void silence_other_inputs() {
        std::vector<T> weights = downloaded(*backend_, this->weights());
        for (std::size_t o = 0; o < mlp().layer_outputs(0); ++o)
            for (std::size_t i = Grid::output_count; i < mlp().inputs(); ++i) weights[o * mlp().inputs() + i] = T(0);
        backend_->upload(Span<const T>(weights), network_.values());
    }

    void forward(const Query& query, Span<T> outputs, const FieldInputs<T>& inputs) {
        field_.forward(*backend_, table(), weights(), query, outputs, cache_, inputs);
    }
    /// Adds to the gradients of table and network, and to dL_dshared unless it is empty.
    void backward(const Query& query, Span<const T> dL_doutputs, const FieldInputs<T>& inputs,
                  Span<T> dL_dshared = {}) {
        field_.backward(*backend_, weights(), query, dL_doutputs, cache_, table_.gradient(), network_.gradient(),
                        inputs, dL_dshared);
    }

    /// The table, then the network, both at `rate`.
    [[nodiscard]] LearnedArrays<T> learned(const Query& query, double rate) {
        LearnedArrays<T> arrays{table_.announce(name_ + ".table", rate), network_.announce(name_ + ".network", rate)};
        arrays[0].touched_rows = query.touched;
        arrays[0].row_size = Grid::feature_count;
        return arrays;
    }

private:
    [[nodiscard]] static Field geometry(const Params& params) {
        const FieldParams& sizes = params.sizes;
        return {sizes.grid,
                {.outputs = params.outputs, .width = sizes.width, .hidden_layers = sizes.hidden_layers},
                params.point_inputs,
                params.shared_inputs};
    }
    [[nodiscard]] std::vector<T> initial_tables(std::size_t tables, const FieldStart& start) const {
        std::vector<T> entries;
        for (std::size_t t = 0; t < tables; ++t) {
            const auto more = field_.grid().template initial_table<T>(mix_bits(start.seed + start.stream + 100 * t));
            entries.insert(entries.end(), more.begin(), more.end());
        }
        return entries;
    }
    [[nodiscard]] std::vector<T> initial_weights(const FieldStart& start) const {
        return field_.mlp().template initial_weights<T>(mix_bits(start.seed + start.stream + 1));
    }

    B* backend_;
    std::string name_;
    Field field_;
    LearnedBuffer<B, T> table_, network_;
    Cache cache_;
};

} // namespace gsh
