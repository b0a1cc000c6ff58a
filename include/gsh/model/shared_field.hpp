// SPDX-License-Identifier: Apache-2.0
/// @file  The paper's appearance: one field gives colours and displacements.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/hash_field.hpp>
#include <gsh/learn/frame_codes.hpp>
#include <gsh/learn/learned_array.hpp>
#include <gsh/learn/learned_field.hpp>
#include <gsh/learn/part_size.hpp>
#include <gsh/math/sh.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/model/appearance.hpp>
#include <gsh/model/canonical_points.hpp>
#include <gsh/model/field_appearance.hpp>

#include <concepts>
#include <cstddef>
#include <utility>

namespace gsh {

/// (SH, δx) = field(x₀ | τ, prior features, γ(t)): one hash grid and one network.
///
/// Shapes  N points; outputs [N, (Degree + 1)² + 1] vectors, SH then δx.
/// Source  paper §3.4, equations 12 to 16.
template <Backend B, std::floating_point T = float, int Degree = 2, int Levels = 16, int Features = 4>
class SharedField {
public:
    using Field = LearnedField<B, T, Levels, Features>;
    static constexpr int sh_degree = Degree;
    static constexpr int basis_count = sh_basis_count(Degree);

    SharedField(B& backend, SharedPoints<B, T> points, const AppearanceParams& params = {})
        : backend_(&backend), params_(params), points_(std::move(points)), codes_(backend, params.time_frames),
          query_(detail::appearance_query<Field>(backend, *points_, params)),
          field_(backend, params_of_field(params, points_->inputs())), outputs_(points_->size() * stride) {
        field_.silence_other_inputs();
    }
    [[nodiscard]] static PartSize size(const AppearanceParams& params, const PriorInputs& inputs) {
        PartSize size = Field::size(params_of_field(params, inputs));
        size.queries = 1;
        return size;
    }

    void forward(std::size_t frame) {
        field_.forward(query_, numbers(outputs_), inputs(frame));
        backend_->for_each(points_->size(), detail::ScaleConstant<T>{outputs_, stride, T(params_.sh_dc_scale)});
    }
    [[nodiscard]] AppearanceView<T> view() const {
        const Span<const vec3<T>> rows(outputs_);
        return {rows, stride, rows.subspan(basis_count, rows.size() - basis_count), stride};
    }
    [[nodiscard]] ColorGradient<T> color_gradient() {
        dL_doutputs_.resize(outputs_.size());
        backend_->fill(Span<vec3<T>>(dL_doutputs_), vec3<T>(T(0)));
        return {dL_doutputs_, stride};
    }
    void backward(std::size_t frame, Span<vec3<T>> dL_dmeans) {
        backend_->for_each(points_->size(),
                           detail::RowGradient<T>{dL_doutputs_, stride, T(params_.sh_dc_scale), dL_dmeans});
        field_.backward(query_, numbers(dL_doutputs_), inputs(frame));
    }
    /// The last weights of the network give the displacements. They move at displacement_rate.
    [[nodiscard]] LearnedArrays<T> learned() {
        LearnedArrays<T> arrays = field_.learned(query_, params_.sh_rate);
        const Mlp& mlp = field_.mlp();
        using OtherRate = typename LearnedArray<T>::OtherRate;
        arrays[1].other = OtherRate{.where = OtherRate::Where::tail,
                                    .width = 3 * mlp.layer_inputs(mlp.layer_count() - 1),
                                    .rate = params_.displacement_rate};
        return arrays;
    }
    [[nodiscard]] bool reads_time() const { return codes_.size() != 0; }
    [[nodiscard]] std::size_t lookups() const { return query_.lookups(); }
    void release_memory() {
        field_.release_memory();
        dL_doutputs_ = {};
    }

private:
    static constexpr std::size_t stride = basis_count + 1; // vectors in a row of outputs

    [[nodiscard]] static typename Field::Params params_of_field(const AppearanceParams& params,
                                                                const PriorInputs& inputs) {
        return detail::appearance_field<B, T, Field>("shared_field", 3 * static_cast<int>(stride),
                                                     field_stream::shared, params, inputs);
    }
    static Span<T> numbers(typename B::template Buffer<vec3<T>>& rows) { return view_as<T>(Span<vec3<T>>(rows)); }
    [[nodiscard]] FieldInputs<T> inputs(std::size_t frame) const { return {points_->features(), codes_[frame]}; }

    B* backend_;
    AppearanceParams params_;
    SharedPoints<B, T> points_;
    FrameCodes<B, T> codes_;
    typename Field::Query query_;
    Field field_;
    typename B::template Buffer<vec3<T>> outputs_, dL_doutputs_; // [N, stride]
};

} // namespace gsh
