// SPDX-License-Identifier: Apache-2.0
/// @file  Ambient occlusion from a field over the canonical points and the time, or over the points and the pose.
#pragma once

#include <gsh/avatar/occlusion_field.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/body/surface_interpolation.hpp>
#include <gsh/body/thinned_interpolation.hpp>
#include <gsh/body/thinned_samples.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/setting.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/features.hpp>
#include <gsh/field/hash_grid.hpp>
#include <gsh/field/mlp.hpp>
#include <gsh/learn/frame_codes.hpp>
#include <gsh/learn/learned_array.hpp>
#include <gsh/learn/learned_field.hpp>
#include <gsh/learn/part_size.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/model/canonical_points.hpp>
#include <gsh/model/occlusion.hpp>

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

namespace gsh {

/// Settings of ambient occlusion from a field.
struct FieldOcclusionParams {
    HashGridParams grid = {};
    int width = 32; ///< neurons of a hidden layer
    int hidden_layers = FieldParams().hidden_layers;
    double largest = 2; ///< upper bound of ao; above 1, ao can also brighten the colours learned before it began
    double initial = 1; ///< ao of every Gaussian before the first step
    double rate = 5e-3; ///< of table and network
    /// Of an occlusion over the time: the most points at which the field is evaluated. If there are more Gaussians,
    /// each gets what the nearest of an even part of them have. 0: all.
    int most_points = 0;
    std::uint64_t seed = 0;

    template <class Self, class F>
    static void for_each_setting(Self& self, const F& f) {
        f("ao.growth", self.grid.growth, SettingRange::at_least(1));
        f("ao.width", self.width, SettingRange::at_least(1));
        f("ao.table_size", self.grid.table_size, SettingRange::power_of_two());
        f("ao.initial", self.initial, SettingRange::above(0));
        f("ao.largest", self.largest, SettingRange::above(0));
        f("ao.points", self.most_points, SettingRange::at_least(0));
        f("rate.ao", self.rate, SettingRange::at_least(0));
    }
};

namespace detail {

/// ao = largest · sigmoid(field(x₀, code) + logit(initial / largest)). The code is the same for every point. The field
/// starts at zero, so that ao is `initial` everywhere at first. With a stride above 1, it is evaluated at every
/// stride-th point and interpolated at all.
template <Backend B, std::floating_point T, int Levels, int Features>
class FieldOcclusion {
public:
    using Field = LearnedField<B, T, Levels, Features>;
    using Grid = typename Field::Grid;

    FieldOcclusion(B& backend, const CanonicalPoints<B, T>& points, const FieldOcclusionParams& params,
                   std::size_t code_size, std::size_t stride = 1)
        : backend_(&backend), params_(params), field_(backend, params_of_field(params, code_size)) {
        check_value(params.initial > 0 && params.initial < params.largest, "FieldOcclusionParams",
                    "initial must lie between 0 and largest");
        if (stride == 1) {
            field_.field().prepare(backend, points.unit(), query_);
        } else {
            typename B::template Buffer<vec3<T>> part;
            assign(backend, thinned_rows(downloaded(backend, points.unit()), 1, stride), part);
            field_.field().prepare(backend, part, query_);
            std::vector<vec3<double>> positions;
            for (const vec3<T>& position : downloaded(backend, points.positions()))
                positions.push_back(vec3<double>(position));
            interpolation_.emplace(thinned_interpolation<B, T>(backend, positions, stride));
            part_ao_.resize(part.size()), dL_dpart_ao_.resize(part.size());
        }
        field_.silence_outputs();
    }
    /// The size of a field that is evaluated at `most_points` points, or at all if that is 0.
    [[nodiscard]] static PartSize size(const FieldOcclusionParams& params, std::size_t code_size,
                                       std::size_t most_points = 0) {
        PartSize size = Field::size(params_of_field(params, code_size));
        size.queries = 1;
        if (most_points > 0) {
            size.other = most_points * (size.other_per_point + 2);
            size.other_per_point = 12; // six contributions of an index and a weight
            size.queries = 0;
        }
        return size;
    }

    void forward(Span<const T> code, Span<T> ao) {
        const Span<T> values = interpolation_ ? Span<T>(part_ao_) : ao;
        field_.forward(query_, values, {{}, code});
        backend_->for_each(values.size(), AoFromLogit<T>{values, static_cast<T>(bias()), T(params_.largest)});
        if (!interpolation_) return;
        backend_->fill(ao, T(0));
        interpolation_->template forward<T>(part_ao_, ao);
    }
    /// Adds to the gradients of table and network, and to dL_dcode unless it is empty. Without a stride, overwrites
    /// dL_dao with the gradient of the field's output.
    void backward(Span<const T> code, Span<const T> ao, Span<T> dL_dao, Span<T> dL_dcode) {
        if (interpolation_) {
            backend_->fill(Span<T>(dL_dpart_ao_), T(0));
            interpolation_->template backward<T>(dL_dao, dL_dpart_ao_);
            ao = Span<const T>(part_ao_), dL_dao = Span<T>(dL_dpart_ao_);
        }
        logit_backward(ao, dL_dao);
        field_.backward(query_, dL_dao, {{}, code}, dL_dcode);
    }
    /// The same for the code alone. For a stride of 1.
    void backward_to_code(Span<const T> code, Span<const T> ao, Span<T> dL_dao, Span<T> dL_dcode) {
        const Span<const T> features(field_.cache().features);
        unused_.resize(field_.mlp().parameter_count());
        backend_->fill(Span<T>(unused_), T(0));
        logit_backward(ao, dL_dao);
        field_.mlp().backward(*backend_, field_.weights(),
                              {blocked(features, Grid::output_count, Features), {}, code}, dL_dao, field_.cache().mlp,
                              unused_, {}, Write::add, dL_dcode);
    }
    [[nodiscard]] LearnedArrays<T> learned() { return field_.learned(query_, params_.rate); }

    /// The field as avatar files store it. Empty if the network is a single matrix, which cannot be baked. For a stride
    /// of 1.
    [[nodiscard]] std::optional<OcclusionFieldData> baked() const {
        if constexpr (std::same_as<T, float>) {
            if (field_.mlp().params().hidden_layers < 1) return std::nullopt;
            typename B::template Buffer<T> encoding(query_.size() * Grid::output_count);
            field_.field().grid().forward(*backend_, field_.table(), query_.grids[0],
                                          row_major(Span<T>(encoding), Grid::output_count));
            return bake_occlusion_field(*backend_, field_.mlp(), field_.weights(),
                                        FeatureView<const T>(row_major(Span<const T>(encoding), Grid::output_count)),
                                        bias(), params_.largest);
        } else {
            return std::nullopt;
        }
    }

private:
    /// The arrays keep their first name, shadow_field, so that checkpoints stay readable.
    [[nodiscard]] static typename Field::Params params_of_field(const FieldOcclusionParams& params,
                                                                std::size_t code_size) {
        return {.name = "shadow_field",
                .sizes = {params.grid, params.width, params.hidden_layers},
                .outputs = 1,
                .shared_inputs = code_size,
                .start = {params.seed, field_stream::occlusion}};
    }
    [[nodiscard]] double bias() const { return logit(params_.initial / params_.largest); }
    void logit_backward(Span<const T> ao, Span<T> dL_dao) {
        backend_->for_each(ao.size(), AoFromLogitBackward<T>{ao, T(params_.largest), dL_dao});
    }

    B* backend_;
    FieldOcclusionParams params_;
    Field field_;
    typename Field::Query query_;
    typename B::template Buffer<T> unused_; // gradient of the network, not used
    std::optional<SurfaceInterpolation<B, T>> interpolation_;  // with a stride above 1
    typename B::template Buffer<T> part_ao_, dL_dpart_ao_; // [N / stride] of the last passes
};

} // namespace detail

/// Ambient occlusion over the time: ao_i = field(x₀, γ(t)). In a new motion each Gaussian has its mean over the
/// training frames.
///
/// Source  paper §3.4, equations 15 and 16.
template <Backend B, std::floating_point T = float, int Levels = 16, int Features = 4>
class TimeOcclusion : public PlainOcclusion<B, T> {
public:
    TimeOcclusion(B& backend, const CanonicalPoints<B, T>& points, std::size_t frame_count,
                  const FieldOcclusionParams& params = {})
        : codes_(backend, frame_count),
          field_(backend, points, params, codes_.size(), stride_for(points.size(), most_points(params))) {}
    TimeOcclusion(B& backend, const CanonicalPoints<B, T>& points, const OcclusionSizes& sizes,
                  const FieldOcclusionParams& params)
        : TimeOcclusion(backend, points, sizes.frame_count, params) {}
    [[nodiscard]] static PartSize size(const FieldOcclusionParams& params, const OcclusionSizes& sizes) {
        return detail::FieldOcclusion<B, T, Levels, Features>::size(
            params, FrameCodes<B, T>::code_size(sizes.frame_count), most_points(params));
    }

    void forward(const OcclusionInput<B, T>& input, Span<T> ao) { field_.forward(codes_[input.frame], ao); }
    void backward(const OcclusionInput<B, T>& input, Span<const T> ao, Span<T> dL_dao, Span<vec3<T>>) {
        field_.backward(codes_[input.frame], ao, dL_dao, {});
    }
    [[nodiscard]] LearnedArrays<T> learned() { return field_.learned(); }

private:
    [[nodiscard]] static std::size_t most_points(const FieldOcclusionParams& params) {
        return static_cast<std::size_t>(std::max(params.most_points, 0));
    }
    /// A power of two, so that stages of a training with more points and a larger stride use the same ones.
    [[nodiscard]] static std::size_t stride_for(std::size_t points, std::size_t most) {
        std::size_t stride = 1;
        while (most > 0 && thinned_count(points, stride) > most) stride *= 2;
        return stride;
    }

    FrameCodes<B, T> codes_;
    detail::FieldOcclusion<B, T, Levels, Features> field_;
};

/// Ambient occlusion over the pose: ao_i = field(x₀, vec(R - I)). R are the rotations of all joints but the root,
/// relative to their parents. ao follows a pose that is refined, and a new motion.
///
/// Source  the paper's ambient occlusion, §3.4, with the pose in place of γ(t).
template <Backend B, std::floating_point T = float, int Levels = 16, int Features = 4>
class PoseOcclusion {
public:
    PoseOcclusion(B& backend, const CanonicalPoints<B, T>& points, std::size_t pose_feature_count,
                  const FieldOcclusionParams& params = {})
        : backend_(&backend), feature_(pose_feature_count), field_(backend, points, params, pose_feature_count) {}
    PoseOcclusion(B& backend, const CanonicalPoints<B, T>& points, const OcclusionSizes& sizes,
                  const FieldOcclusionParams& params)
        : PoseOcclusion(backend, points, sizes.pose_feature_count, params) {}
    [[nodiscard]] static PartSize size(const FieldOcclusionParams& params, const OcclusionSizes& sizes) {
        return detail::FieldOcclusion<B, T, Levels, Features>::size(params, sizes.pose_feature_count);
    }

    [[nodiscard]] bool occludes() const { return true; }
    [[nodiscard]] bool follows_pose() const { return true; }
    void forward(const OcclusionInput<B, T>& input, Span<T> ao) {
        input.skeleton.feature(input.rotations, feature_);
        field_.forward(feature_, ao);
    }
    void backward(const OcclusionInput<B, T>& input, Span<const T> ao, Span<T> dL_dao, Span<vec3<T>> dL_dpose) {
        field_.backward(feature_, ao, dL_dao, dL_dpose.empty() ? Span<T>() : start_feature_gradient());
        if (!dL_dpose.empty()) feature_backward(input, dL_dpose);
    }
    void backward_to_pose(const OcclusionInput<B, T>& input, Span<const T> ao, Span<T> dL_dao, Span<vec3<T>> dL_dpose) {
        field_.backward_to_code(feature_, ao, dL_dao, start_feature_gradient());
        feature_backward(input, dL_dpose);
    }
    [[nodiscard]] LearnedArrays<T> learned() { return field_.learned(); }
    [[nodiscard]] std::optional<OcclusionFieldData> baked() const { return field_.baked(); }

    /// vec(R - I) of the last forward, [9 (J - 1)] in the backend's memory.
    [[nodiscard]] Span<const T> feature() const { return feature_; }

private:
    [[nodiscard]] Span<T> start_feature_gradient() {
        dL_dfeature_.resize(feature_.size());
        backend_->fill(Span<T>(dL_dfeature_), T(0));
        return dL_dfeature_;
    }
    void feature_backward(const OcclusionInput<B, T>& input, Span<vec3<T>> dL_dpose) {
        dL_drotations_.resize(input.rotations.size());
        backend_->fill(Span<mat3<T>>(dL_drotations_), mat3<T>(T(0)));
        input.skeleton.feature_backward(dL_dfeature_, dL_drotations_);
        input.skeleton.rotations_backward(input.pose, dL_drotations_, dL_dpose);
    }

    B* backend_;
    typename B::template Buffer<T> feature_, dL_dfeature_; // [9 (J - 1)]
    typename B::template Buffer<mat3<T>> dL_drotations_;   // [J]
    detail::FieldOcclusion<B, T, Levels, Features> field_;
};

/// Former names.
using FieldShadowParams [[deprecated("use FieldOcclusionParams")]] = FieldOcclusionParams;
template <Backend B, std::floating_point T = float, int Levels = 16, int Features = 4>
using TimeShadow [[deprecated("use TimeOcclusion")]] = TimeOcclusion<B, T, Levels, Features>;
template <Backend B, std::floating_point T = float, int Levels = 16, int Features = 4>
using PoseShadow [[deprecated("use PoseOcclusion")]] = PoseOcclusion<B, T, Levels, Features>;

} // namespace gsh
