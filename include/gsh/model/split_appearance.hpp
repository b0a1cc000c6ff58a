// SPDX-License-Identifier: Apache-2.0
/// @file  Appearances with one source for colours and one for displacements: a field, or an array stored per Gaussian.
#pragma once

#include <gsh/avatar/rig.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>
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
#include <vector>

namespace gsh {

/// Colours from a field of their own: SH = field(x₀).
template <Backend B, std::floating_point T, int Degree, int Levels, int Features>
class FieldColors {
public:
    using Field = LearnedField<B, T, Levels, Features>;
    static constexpr std::size_t stride = static_cast<std::size_t>(sh_basis_count(Degree));
    static constexpr bool is_field = true;

    FieldColors(B& backend, const CanonicalPoints<B, T>& points, const AppearanceParams& params)
        : backend_(&backend), scale_(params.sh_dc_scale), rate_(params.sh_rate),
          field_(backend, params_of_field(params, points.inputs())), sh_(points.size() * stride) {
        field_.silence_other_inputs();
    }
    [[nodiscard]] static PartSize size(const AppearanceParams& params, const PriorInputs& inputs) {
        return Field::size(params_of_field(params, inputs));
    }
    void forward(const typename Field::Query& query, const FieldInputs<T>& inputs) {
        field_.forward(query, view_as<T>(Span<vec3<T>>(sh_)), inputs);
        scale(sh_);
    }
    [[nodiscard]] Span<const vec3<T>> view() const { return sh_; }
    [[nodiscard]] Span<vec3<T>> color_gradient() {
        dL_dsh_.resize(sh_.size());
        backend_->fill(Span<vec3<T>>(dL_dsh_), vec3<T>(T(0)));
        return dL_dsh_;
    }
    void backward(const typename Field::Query& query, const FieldInputs<T>& inputs) {
        scale(dL_dsh_);
        field_.backward(query, view_as<T>(Span<vec3<T>>(dL_dsh_)), inputs);
    }
    [[nodiscard]] LearnedArrays<T> learned(const typename Field::Query& query) { return field_.learned(query, rate_); }
    void release_memory() {
        field_.release_memory();
        dL_dsh_ = {};
    }

private:
    [[nodiscard]] static typename Field::Params params_of_field(const AppearanceParams& params,
                                                                const PriorInputs& inputs) {
        return detail::appearance_field<B, T, Field>("sh_field", 3 * static_cast<int>(stride), field_stream::colors,
                                                     params, inputs);
    }
    void scale(Span<vec3<T>> sh) {
        backend_->for_each(sh.size() / stride, detail::ScaleConstant<T>{sh, stride, T(scale_)});
    }

    B* backend_;
    double scale_, rate_;
    Field field_;
    typename B::template Buffer<vec3<T>> sh_, dL_dsh_; // [N, stride]
};

/// Colours stored with each Gaussian, as in 3DGS.
template <Backend B, std::floating_point T, int Degree, int Levels, int Features>
class StoredColors {
public:
    using Field = LearnedField<B, T, Levels, Features>;
    static constexpr std::size_t stride = static_cast<std::size_t>(sh_basis_count(Degree));
    static constexpr bool is_field = false;

    StoredColors(B& backend, const CanonicalPoints<B, T>& points, const AppearanceParams& params)
        : rate_(params.stored_sh_rate), band_rate_(params.stored_sh_rate * params.stored_sh_bands),
          sh_(backend, std::vector<vec3<T>>(stride * points.size(), vec3<T>(T(0)))) {}
    [[nodiscard]] static PartSize size(const AppearanceParams&, const PriorInputs&) {
        return {.learned = {{.name = "sh", .per_point = 3 * stride}}};
    }

    void forward(const typename Field::Query&, const FieldInputs<T>&) {}
    [[nodiscard]] Span<const vec3<T>> view() const { return sh_.values(); }
    [[nodiscard]] Span<vec3<T>> color_gradient() { return sh_.gradient(); }
    void backward(const typename Field::Query&, const FieldInputs<T>&) {} // skinning added to the array's gradient
    [[nodiscard]] LearnedArrays<T> learned(const typename Field::Query&) {
        LearnedArrays<T> arrays{sh_.announce("sh", rate_)};
        arrays[0].other = {LearnedArray<T>::OtherRate::Where::columns, 3 * stride, 3, band_rate_};
        return arrays;
    }
    void release_memory() {}

private:
    double rate_, band_rate_;
    LearnedBuffer<B, vec3<T>> sh_; // [N, stride]
};

/// Displacements from a field of their own: δx = field(x₀).
template <Backend B, std::floating_point T, int Levels, int Features>
class FieldDisplacements {
public:
    using Field = LearnedField<B, T, Levels, Features>;
    static constexpr bool is_field = true;

    FieldDisplacements(B& backend, const CanonicalPoints<B, T>& points, const AppearanceParams& params)
        : rate_(params.displacement_rate), field_(backend, params_of_field(params, points.inputs())),
          displacements_(points.size()) {
        field_.silence_other_inputs();
    }
    [[nodiscard]] static PartSize size(const AppearanceParams& params, const PriorInputs& inputs) {
        return Field::size(params_of_field(params, inputs));
    }
    void forward(const typename Field::Query& query, const FieldInputs<T>& inputs) {
        field_.forward(query, view_as<T>(Span<vec3<T>>(displacements_)), inputs);
    }
    [[nodiscard]] Span<const vec3<T>> view() const { return displacements_; }
    void backward(const typename Field::Query& query, const FieldInputs<T>& inputs, Span<vec3<T>> dL_dmeans) {
        field_.backward(query, view_as<T>(dL_dmeans), inputs);
    }
    [[nodiscard]] LearnedArrays<T> learned(const typename Field::Query& query) { return field_.learned(query, rate_); }
    void release_memory() { field_.release_memory(); }

private:
    [[nodiscard]] static typename Field::Params params_of_field(const AppearanceParams& params,
                                                                const PriorInputs& inputs) {
        return detail::appearance_field<B, T, Field>("displacement_field", 3, field_stream::displacements, params,
                                                     inputs);
    }

    double rate_;
    Field field_;
    typename B::template Buffer<vec3<T>> displacements_; // [N]
};

/// Displacements stored with each Gaussian.
template <Backend B, std::floating_point T, int Levels, int Features>
class StoredDisplacements {
public:
    using Field = LearnedField<B, T, Levels, Features>;
    static constexpr bool is_field = false;

    StoredDisplacements(B& backend, const CanonicalPoints<B, T>& points, const AppearanceParams& params)
        : backend_(&backend), rate_(params.stored_displacement_rate),
          displacements_(backend, std::vector<vec3<T>>(points.size(), vec3<T>(T(0)))) {}
    [[nodiscard]] static PartSize size(const AppearanceParams&, const PriorInputs&) {
        return {.learned = {{.name = "displacements", .per_point = 3}}};
    }

    void forward(const typename Field::Query&, const FieldInputs<T>&) {}
    [[nodiscard]] Span<const vec3<T>> view() const { return displacements_.values(); }
    void backward(const typename Field::Query&, const FieldInputs<T>&, Span<vec3<T>> dL_dmeans) {
        backend_->for_each(displacements_.size(),
                           detail::Accumulate<vec3<T>>{dL_dmeans, displacements_.gradient()});
    }
    [[nodiscard]] LearnedArrays<T> learned(const typename Field::Query&) {
        return {displacements_.announce("displacements", rate_)};
    }
    void release_memory() {}

private:
    B* backend_;
    double rate_;
    LearnedBuffer<B, vec3<T>> displacements_; // [N]
};

/// An appearance with two sources over the same points. Its fields share one query of the points.
template <Backend B, class Colors, class Displacements, std::floating_point T, int Degree>
class SplitAppearance {
public:
    static constexpr int sh_degree = Degree;

    SplitAppearance(B& backend, SharedPoints<B, T> points, const AppearanceParams& params = {})
        : points_(std::move(points)), codes_(backend, params.time_frames),
          query_(reads_points ? detail::appearance_query<typename Colors::Field>(backend, *points_, params) : Query()),
          colors_(backend, *points_, params), displacements_(backend, *points_, params) {}
    [[nodiscard]] static PartSize size(const AppearanceParams& params, const PriorInputs& inputs) {
        PartSize both = Colors::size(params, inputs);
        append(both, Displacements::size(params, inputs));
        both.queries = reads_points ? 1 : 0;
        return both;
    }

    void forward(std::size_t frame) {
        colors_.forward(query_, inputs(frame));
        displacements_.forward(query_, inputs(frame));
    }
    [[nodiscard]] AppearanceView<T> view() const { return {colors_.view(), Colors::stride, displacements_.view(), 1}; }
    [[nodiscard]] ColorGradient<T> color_gradient() { return {colors_.color_gradient(), Colors::stride}; }
    void backward(std::size_t frame, Span<vec3<T>> dL_dmeans) {
        displacements_.backward(query_, inputs(frame), dL_dmeans);
        colors_.backward(query_, inputs(frame));
    }
    [[nodiscard]] LearnedArrays<T> learned() {
        LearnedArrays<T> arrays = colors_.learned(query_);
        append(arrays, displacements_.learned(query_));
        return arrays;
    }
    [[nodiscard]] bool reads_time() const { return codes_.size() != 0; }
    [[nodiscard]] std::size_t lookups() const {
        return query_.lookups() * (std::size_t(Colors::is_field) + std::size_t(Displacements::is_field));
    }
    void release_memory() {
        colors_.release_memory();
        displacements_.release_memory();
    }

private:
    using Query = typename Colors::Field::Query;
    static constexpr bool reads_points = Colors::is_field || Displacements::is_field;

    [[nodiscard]] FieldInputs<T> inputs(std::size_t frame) const { return {points_->features(), codes_[frame]}; }

    SharedPoints<B, T> points_;
    FrameCodes<B, T> codes_;
    Query query_; // empty where no field reads it
    Colors colors_;
    Displacements displacements_;
};

/// A field for colours, and a field for displacements.
/// Source  Liu et al., "Animatable 3D Gaussian", 2024.
template <Backend B, std::floating_point T = float, int Degree = 2, int Levels = 16, int Features = 4>
using SeparateFields = SplitAppearance<B, FieldColors<B, T, Degree, Levels, Features>,
                                       FieldDisplacements<B, T, Levels, Features>, T, Degree>;

/// Colours stored, displacements from a field.
template <Backend B, std::floating_point T = float, int Degree = 2, int Levels = 16, int Features = 4>
using StoredColorsFieldDisplacements = SplitAppearance<B, StoredColors<B, T, Degree, Levels, Features>,
                                                       FieldDisplacements<B, T, Levels, Features>, T, Degree>;

/// Colours from a field, displacements stored.
template <Backend B, std::floating_point T = float, int Degree = 2, int Levels = 16, int Features = 4>
using FieldColorsStoredDisplacements = SplitAppearance<B, FieldColors<B, T, Degree, Levels, Features>,
                                                       StoredDisplacements<B, T, Levels, Features>, T, Degree>;

/// Both stored with each Gaussian, as in a static 3DGS scene.
template <Backend B, std::floating_point T = float, int Degree = 2, int Levels = 16, int Features = 4>
using StoredAttributes = SplitAppearance<B, StoredColors<B, T, Degree, Levels, Features>,
                                         StoredDisplacements<B, T, Levels, Features>, T, Degree>;

} // namespace gsh
