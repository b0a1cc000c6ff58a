// SPDX-License-Identifier: Apache-2.0
/// @file  Pose-dependent ambient occlusion: a field over Gaussians and joint rotations, baked for display.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/body/skeleton.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/features.hpp>
#include <gsh/field/mlp.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/math/vec.hpp>

#include <cmath>
#include <concepts>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// A trained field of ambient occlusion on the host, as avatar files store it.
///
/// The points of an avatar never move in the canonical frame, so the contribution of their encoding to the first layer
/// is constant. It is stored here in place of the encoding's table and of the first layer's weights for the encoding.
///
/// Shapes  N Gaussians, W neurons, P = 9 (J - 1) numbers of a pose of J joints.
struct OcclusionFieldData {
    std::vector<float> neurons = {};      // [N, W] W_0 h_i, the first layer's sums over the encoding
    std::vector<float> pose_weights = {}; // [W, P] the first layer's weights of vec(R - I)
    std::vector<float> weights = {};      // weights of the layers after the first; network() gives their shapes
    int width = 64;                       ///< W
    int hidden_layers = 2;                ///< of the whole network, at least one
    double bias = 0;                      ///< added to the network's output
    double largest = 1;                   ///< ao lies between 0 and this value

    /// The layers after the first.
    [[nodiscard]] Mlp network() const {
        return Mlp({.inputs = width, .outputs = 1, .width = width, .hidden_layers = hidden_layers - 1});
    }
};

/// Throws ShapeError or ValueError, with the name of the member, unless the field fits `point_count` Gaussians and
/// `joint_count` joints.
inline void check_occlusion_field(std::string_view where, const OcclusionFieldData& field, std::size_t point_count,
                                  std::size_t joint_count) {
    check_value(field.width >= 1 && field.width <= 4096, where,
                "the occlusion field's width is " + std::to_string(field.width) + ", expected 1 to 4096");
    check_value(field.hidden_layers >= 1 && field.hidden_layers <= 64, where,
                "the occlusion field's hidden_layers is " + std::to_string(field.hidden_layers) + ", expected 1 to 64");
    const auto width = static_cast<std::size_t>(field.width);
    check_size(where, "the occlusion field's neurons", field.neurons.size(), point_count * width,
               "one row per Gaussian");
    check_size(where, "the occlusion field's pose_weights", field.pose_weights.size(),
               width * 9 * (joint_count ? joint_count - 1 : 0), "nine numbers per neuron and joint but the root");
    check_size(where, "the occlusion field's weights", field.weights.size(), field.network().parameter_count());
    check_finite<float>(where, "the occlusion field's neurons", field.neurons);
    check_finite<float>(where, "the occlusion field's pose_weights", field.pose_weights);
    check_finite<float>(where, "the occlusion field's weights", field.weights);
    check_value(std::isfinite(field.bias), where, "the occlusion field's bias must be finite");
    check_value(field.largest > 0 && std::isfinite(field.largest), where,
                "the occlusion field's largest value must be positive");
}

namespace detail {

/// ao = largest * sigmoid(the network's output + bias), in place.
template <class T>
struct AoFromLogit {
    Span<T> values;
    T bias, largest;
    GSH_HD void operator()(std::size_t i) const { values[i] = largest * sigmoid(values[i] + bias); }
};

template <class T>
struct AoFromLogitBackward {
    Span<const T> ao;
    T largest;
    Span<T> gradient; // with respect to ao, then to the logit
    GSH_HD void operator()(std::size_t i) const {
        T dL_dlogit(0);
        sigmoid_backward(ao[i] / largest, gradient[i] * largest, dL_dlogit);
        gradient[i] = dL_dlogit;
    }
};

/// sums[o] = the contribution of a pose to neuron o.
template <class T>
struct PoseOfNeurons {
    Span<const T> weights, feature; // [W, P], [P]
    Span<T> sums;
    GSH_HD void operator()(std::size_t o) const {
        T sum(0);
        for (std::size_t c = 0; c < feature.size(); ++c) sum += weights[o * feature.size() + c] * feature[c];
        sums[o] = sum;
    }
};

template <class T>
struct PoseOfNeuronsBackward {
    Span<const T> weights, dL_dsums; // [W, P], [W]
    Span<T> dL_dfeature;             // [P]
    GSH_HD void operator()(std::size_t c) const {
        for (std::size_t o = 0; o < dL_dsums.size(); ++o)
            dL_dfeature[c] += weights[o * dL_dfeature.size() + c] * dL_dsums[o];
    }
};

} // namespace detail

/// Private storage of a backend: weights in the layout of its products, intermediate results, partial sums. Each
/// backend specialises it beside its overloads.
template <Backend B, std::floating_point T>
struct OcclusionFieldScratch {
    static_assert(detail::overload_is_included<B>,
                  "OcclusionField: include its backend's overloads, "
                  "<gsh/avatar/cpu/occlusion_field.hpp> or <gsh/cpu.hpp>");
};

/// Fallback without the backend's overloads: fails to compile, and names the header to include.
template <Backend B, class... Arguments>
void occlusion_forward(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>,
                  "OcclusionField: include its backend's overloads, "
                  "<gsh/avatar/cpu/occlusion_field.hpp> or <gsh/cpu.hpp>");
}
template <Backend B, class... Arguments>
void occlusion_backward(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>,
                  "OcclusionField: include its backend's overloads, "
                  "<gsh/avatar/cpu/occlusion_field.hpp> or <gsh/cpu.hpp>");
}

/// Sums the contribution of a pose to each neuron. This version and the next need no overload; a backend may have
/// faster ones.
template <Backend B, class T>
void pose_of_neurons(B& backend, const detail::PoseOfNeurons<T>& element) {
    backend.for_each(element.sums.size(), element);
}
/// Its adjoint: adds to the gradient of the pose's numbers.
template <Backend B, class T>
void pose_of_neurons_backward(B& backend, const detail::PoseOfNeuronsBackward<T>& element) {
    backend.for_each(element.dL_dfeature.size(), element);
}

/// ao_i(R) = largest · sigmoid(Mlp([h_i, vec(R - I)]) + bias), where R are the rotations of the non-root joints
/// relative to their parents. ao is the same whenever the body bends in the same way, in any orientation of the body.
///
///     x_i = relu(W_0 h_i + W_p vec(R - I)),   ao_i = largest · sigmoid((the layers after the first)(x_i) + bias)
///
/// W_0 h_i is OcclusionFieldData::neurons, W_p its pose_weights. Sums run in the order of the trained network, so ao is
/// bit-identical to its output.
///
/// Shapes  rotations [J], ao [N].
/// Errors  ShapeError, ValueError before any work starts.
/// Source  the paper's ambient occlusion, §3.4, with the pose in place of γ(t).
template <Backend B, std::floating_point T = float>
class OcclusionField {
public:
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    /// Intermediate values of both passes, and working storage.
    struct Cache {
        Buffer<T> feature, dL_dfeature;      // [P]
        Buffer<T> neurons, dL_dneurons;      // [W] contribution of the pose
        Buffer<T> dL_dlogits;                // [N]
        OcclusionFieldScratch<B, T> scratch; // the backend's own
    };

    OcclusionField(B& backend, const OcclusionFieldData& data, std::size_t point_count, std::size_t joint_count)
        : backend_(&backend), network_(data.network()), width_(static_cast<std::size_t>(data.width)),
          bias_(T(data.bias)), largest_(T(data.largest)) {
        check_occlusion_field("OcclusionField", data, point_count, joint_count);
        const auto bring = [&](const std::vector<float>& from, Buffer<T>& to) {
            assign(backend, std::vector<T>(from.begin(), from.end()), to);
        };
        bring(data.neurons, neurons_);
        bring(data.pose_weights, pose_weights_);
        bring(data.weights, weights_);
    }

    [[nodiscard]] std::size_t size() const { return neurons_.size() / width_; }

    /// skeleton is the one to which the rotations belong.
    void forward(const Skeleton<B, T>& skeleton, Span<const mat3<T>> rotations, Span<T> ao, Cache& cache) const {
        check_size("OcclusionField::forward", "ao", ao.size(), size(), "one per Gaussian");
        check_size("OcclusionField::forward", "the pose's numbers", skeleton.pose_feature_count(),
                   pose_weights_.size() / width_, "the field must be made for this skeleton");
        check_memory(*backend_, "OcclusionField::forward", "rotations", rotations);
        check_memory(*backend_, "OcclusionField::forward", "ao", ao);
        cache.feature.resize(skeleton.pose_feature_count());
        cache.neurons.resize(width_);
        skeleton.feature(rotations, cache.feature);
        pose_of_neurons(*backend_, detail::PoseOfNeurons<T>{pose_weights_, cache.feature, cache.neurons});
        occlusion_forward(*backend_, network_, Span<const T>(weights_), Span<const T>(neurons_),
                          Span<const T>(cache.neurons), ao, cache.scratch);
        backend_->for_each(size(), detail::AoFromLogit<T>{ao, bias_, largest_});
    }

    /// Adjoint with respect to the rotations, for a fixed field: adds to dL_drotations. ao and cache are those of
    /// forward.
    void backward(const Skeleton<B, T>& skeleton, Span<const T> ao, Span<const T> dL_dao, Cache& cache,
                  Span<mat3<T>> dL_drotations) const {
        check_size("OcclusionField::backward", "ao", ao.size(), size(), "one per Gaussian");
        check_size("OcclusionField::backward", "dL_dao", dL_dao.size(), size(), "one per Gaussian");
        check_size("OcclusionField::backward", "cache.neurons", cache.neurons.size(), width_,
                   "forward must come first");
        check_memory(*backend_, "OcclusionField::backward", "ao", ao);
        check_memory(*backend_, "OcclusionField::backward", "dL_dao", dL_dao);
        check_memory(*backend_, "OcclusionField::backward", "dL_drotations", dL_drotations);
        cache.dL_dlogits.resize(size());
        cache.dL_dneurons.resize(width_);
        cache.dL_dfeature.resize(cache.feature.size());
        backend_->copy(dL_dao, cache.dL_dlogits);
        backend_->fill(Span<T>(cache.dL_dneurons), T(0));
        backend_->fill(Span<T>(cache.dL_dfeature), T(0));
        backend_->for_each(size(), detail::AoFromLogitBackward<T>{ao, largest_, cache.dL_dlogits});
        occlusion_backward(*backend_, network_, Span<const T>(weights_), Span<const T>(neurons_),
                           Span<const T>(cache.neurons), Span<const T>(cache.dL_dlogits), cache.scratch,
                           Span<T>(cache.dL_dneurons));
        pose_of_neurons_backward(
            *backend_, detail::PoseOfNeuronsBackward<T>{pose_weights_, cache.dL_dneurons, cache.dL_dfeature});
        skeleton.feature_backward(cache.dL_dfeature, dL_drotations);
    }

private:
    B* backend_;
    Mlp network_; // the layers after the first
    std::size_t width_;
    T bias_, largest_;
    Buffer<T> neurons_, pose_weights_, weights_;
};

/// Bakes a trained network Mlp([encoding, vec(R - I)]). `weights` are all of its weights and `features` the encoding of
/// each Gaussian, both in the backend's memory. The inputs after the features are the numbers of the pose.
///
/// Errors  ShapeError or ValueError unless the network has one output, at least one hidden layer, and matching weights.
template <Backend B>
[[nodiscard]] OcclusionFieldData bake_occlusion_field(B& backend, const Mlp& mlp, Span<const float> weights,
                                                      const FeatureView<const float>& features, double bias,
                                                      double largest) {
    check_size("bake_occlusion_field", "weights", weights.size(), mlp.parameter_count());
    check_value(mlp.outputs() == 1 && mlp.params().hidden_layers >= 1, "bake_occlusion_field",
                "the network must have one output and a hidden layer");
    check_value(features.columns <= mlp.inputs(), "bake_occlusion_field",
                "there are more features than the network has inputs");
    check_memory(backend, "bake_occlusion_field", "weights", weights);
    check_memory(backend, "bake_occlusion_field", "features", features.values);
    OcclusionFieldData data{
        .width = mlp.params().width, .hidden_layers = mlp.params().hidden_layers, .bias = bias, .largest = largest};
    const std::size_t W = mlp.layer_outputs(0), F = features.columns, P = mlp.inputs() - F;
    const std::vector<float> all = downloaded(backend, weights);
    std::vector<float> first;
    for (std::size_t o = 0; o < W; ++o) {
        const float* row = all.data() + o * mlp.inputs();
        first.insert(first.end(), row, row + F);
        data.pose_weights.insert(data.pose_weights.end(), row + F, row + F + P);
    }
    data.weights.assign(all.begin() + static_cast<std::ptrdiff_t>(mlp.layer_offset(1)), all.end());

    const Mlp layer({.inputs = static_cast<int>(F), .outputs = static_cast<int>(W), .hidden_layers = 0});
    typename B::template Buffer<float> matrix(first.size()), neurons(features.rows * W);
    Mlp::Cache<B, float> cache;
    backend.upload(Span<const float>(first), matrix);
    layer.forward(backend, Span<const float>(matrix), MlpInputs<float>{features}, Span<float>(neurons), cache);
    data.neurons = downloaded(backend, Span<const float>(neurons));
    return data;
}

} // namespace gsh
