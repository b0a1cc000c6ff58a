// SPDX-License-Identifier: Apache-2.0
/// @file  A small fully connected network on a batch of points.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/features.hpp>

#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <type_traits>
#include <vector>

namespace gsh {

/// Private storage of a backend: activations, weights in the layout of its products, partial sums. Each backend
/// specialises it beside its overloads.
template <Backend B, std::floating_point T>
struct MlpScratch {
    static_assert(detail::overload_is_included<B>,
                  "Mlp: include its backend's overloads, <gsh/field/cpu/mlp.hpp> or <gsh/cpu.hpp>");
};

/// Fallback without the backend's overloads: fails to compile, and names the header to include.
template <Backend B, class... Arguments>
void mlp_forward(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>,
                  "Mlp: include its backend's overloads, <gsh/field/cpu/mlp.hpp> or <gsh/cpu.hpp>");
}
template <Backend B, class... Arguments>
void mlp_backward(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>,
                  "Mlp: include its backend's overloads, <gsh/field/cpu/mlp.hpp> or <gsh/cpu.hpp>");
}

/// y = W_H relu(W_{H-1} … relu(W_0 x)): no bias, linear output, and its adjoint.
///
/// Shapes  weights: layer after layer, each [outputs of the layer, inputs of the layer] row-major;
///         inputs [N, inputs] as MlpInputs splits them, outputs [N, outputs] row-major.
/// Errors  ShapeError, ValueError before any work starts.
/// Source  Müller et al., "Instant Neural Graphics Primitives with a Multiresolution Hash Encoding", 2022, section 4;
///         initialisation Glorot and Bengio, "Understanding the difficulty of training deep feedforward neural
///         networks", 2010, equation 16.
class Mlp {
public:
    struct Params {
        int inputs = 0;
        int outputs = 0;
        int width = 64;        ///< numbers in a hidden layer
        int hidden_layers = 2; ///< 0 means a single matrix
    };

    /// Values of forward that backward needs, and working storage; one per batch in flight.
    template <Backend B, std::floating_point T = float>
    struct Cache {
        std::size_t rows = 0;     ///< batch size of the last forward
        MlpScratch<B, T> scratch; ///< the backend's own
    };

    explicit Mlp(Params params) : params_(params) {
        check_value(params.inputs > 0 && params.outputs > 0, "Mlp", "inputs and outputs must be positive");
        check_value(params.hidden_layers >= 0, "Mlp", "hidden_layers must not be negative");
        check_value(params.width > 0 || params.hidden_layers == 0, "Mlp", "width must be positive");
    }

    [[nodiscard]] const Params& params() const { return params_; }
    [[nodiscard]] std::size_t inputs() const { return static_cast<std::size_t>(params_.inputs); }
    [[nodiscard]] std::size_t outputs() const { return static_cast<std::size_t>(params_.outputs); }
    /// Number of matrices: one more than hidden layers.
    [[nodiscard]] std::size_t layer_count() const { return static_cast<std::size_t>(params_.hidden_layers) + 1; }
    [[nodiscard]] std::size_t layer_inputs(std::size_t layer) const {
        return layer == 0 ? inputs() : static_cast<std::size_t>(params_.width);
    }
    [[nodiscard]] std::size_t layer_outputs(std::size_t layer) const {
        return layer + 1 == layer_count() ? outputs() : static_cast<std::size_t>(params_.width);
    }
    /// Index in weights of the first number of a layer's matrix.
    [[nodiscard]] std::size_t layer_offset(std::size_t layer) const {
        std::size_t offset = 0;
        for (std::size_t l = 0; l < layer; ++l) offset += layer_inputs(l) * layer_outputs(l);
        return offset;
    }
    [[nodiscard]] std::size_t parameter_count() const { return layer_offset(layer_count()); }

    /// Uniform random weights in ±sqrt(6 / (inputs + outputs)) of each layer, the same for the same seed.
    template <std::floating_point T>
    [[nodiscard]] std::vector<T> initial_weights(std::uint64_t seed) const {
        std::vector<T> weights;
        weights.reserve(parameter_count());
        Rng rng(seed);
        for (std::size_t layer = 0; layer < layer_count(); ++layer) {
            const std::size_t in = layer_inputs(layer), out = layer_outputs(layer);
            const double bound = std::sqrt(6.0 / static_cast<double>(in + out));
            for (std::size_t i = 0; i < in * out; ++i) weights.push_back(static_cast<T>(rng.uniform(-bound, bound)));
        }
        return weights;
    }

    /// outputs = the network at each row of inputs; the cache keeps what backward needs.
    template <Backend B, std::floating_point T>
    void forward(B& backend, std::type_identity_t<Span<const T>> weights,
                 const std::type_identity_t<MlpInputs<T>>& inputs, std::type_identity_t<Span<T>> outputs,
                 Cache<B, T>& cache) const {
        check_size("Mlp::forward", "weights", weights.size(), parameter_count());
        check_inputs("Mlp::forward", inputs, inputs.features.rows);
        check_size("Mlp::forward", "outputs", outputs.size(), inputs.features.rows * this->outputs());
        check_memory(backend, "Mlp::forward", "weights", weights);
        check_inputs_memory(backend, "Mlp::forward", inputs);
        check_memory(backend, "Mlp::forward", "outputs", outputs);
        cache.rows = inputs.features.rows;
        if (cache.rows) mlp_forward(backend, *this, weights, inputs, outputs, cache.scratch);
    }

    /// Adds to dL_dweights and dL_dshared. Adds to dL_dfeatures or, with Write::assign, overwrites it; it may then be
    /// the memory of inputs.features, since each row is read before its gradient is written. dL_dfeatures and
    /// dL_dshared may be empty ({}). weights, inputs and cache are those of forward.
    template <Backend B, std::floating_point T>
    void backward(B& backend, std::type_identity_t<Span<const T>> weights,
                  const std::type_identity_t<MlpInputs<T>>& inputs, std::type_identity_t<Span<const T>> dL_doutputs,
                  Cache<B, T>& cache, std::type_identity_t<Span<T>> dL_dweights,
                  std::type_identity_t<FeatureView<T>> dL_dfeatures, Write features_mode = Write::add,
                  std::type_identity_t<Span<T>> dL_dshared = {}) const {
        check_size("Mlp::backward", "weights", weights.size(), parameter_count());
        check_inputs("Mlp::backward", inputs, cache.rows);
        check_size("Mlp::backward", "dL_doutputs", dL_doutputs.size(), cache.rows * this->outputs());
        check_size("Mlp::backward", "dL_dweights", dL_dweights.size(), parameter_count());
        if (!dL_dfeatures.empty())
            check_features("Mlp::backward", "dL_dfeatures", dL_dfeatures, cache.rows, inputs.features.columns);
        if (!dL_dshared.empty()) check_size("Mlp::backward", "dL_dshared", dL_dshared.size(), inputs.shared.size());
        check_memory(backend, "Mlp::backward", "weights", weights);
        check_inputs_memory(backend, "Mlp::backward", inputs);
        check_memory(backend, "Mlp::backward", "dL_doutputs", dL_doutputs);
        check_memory(backend, "Mlp::backward", "dL_dweights", dL_dweights);
        check_memory(backend, "Mlp::backward", "dL_dfeatures", dL_dfeatures.values);
        check_memory(backend, "Mlp::backward", "dL_dshared", dL_dshared);
        if (cache.rows)
            mlp_backward(backend, *this, weights, inputs, dL_doutputs, cache.scratch, dL_dweights, dL_dfeatures,
                         features_mode, dL_dshared);
    }

private:
    template <class T>
    void check_inputs(std::string_view where, const MlpInputs<T>& inputs, std::size_t rows) const {
        const std::size_t beside = inputs.points.size() / (rows ? rows : 1) + inputs.shared.size();
        check_features(where, "inputs.features", inputs.features, rows, inputs.features.columns);
        if (rows == 0) return;
        check_value(inputs.points.size() % rows == 0, where,
                    "inputs.points must hold one row of numbers per row of features");
        check_size(where, "inputs", inputs.features.columns + beside, this->inputs(),
                   "columns of features and points, and shared");
    }

    template <Backend B, class T>
    static void check_inputs_memory(const B& backend, std::string_view where, const MlpInputs<T>& inputs) {
        check_memory(backend, where, "inputs.features", inputs.features.values);
        check_memory(backend, where, "inputs.points", inputs.points);
        check_memory(backend, where, "inputs.shared", inputs.shared);
    }

    Params params_;
};

} // namespace gsh
