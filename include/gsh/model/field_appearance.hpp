// SPDX-License-Identifier: Apache-2.0
/// @file  Settings of appearances, and what those from fields share: the query of the canonical points.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/setting.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/hash_field.hpp>
#include <gsh/learn/frame_codes.hpp>
#include <gsh/learn/learned_array.hpp>
#include <gsh/learn/learned_field.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/model/canonical_points.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>

namespace gsh {

/// Settings of an appearance.
struct AppearanceParams {
    FieldParams field = {};
    int fine_level = 12; ///< only points with τ > 0 read it and finer ones; 11 still resolves 4.3 mm, a torso's pixel
    bool separate_tables = false; ///< coarse and fine levels have a table each
    double sh_dc_scale = 60;      ///< factor on a field's outputs for constant colours
    /// Number of frames of the motion if fields read γ(t), and colours and displacements change with the frame. Else 0.
    std::size_t time_frames = 0;
    double sh_rate = 2e-3;                     ///< of table and network of a field with colours
    double displacement_rate = 5e-4;           ///< of a displacement field, or a shared field's rows for them; metres
    double stored_sh_rate = 2.5e-3;            ///< of stored constant colours
    double stored_sh_bands = sh_band_share;    ///< of stored bands above them, as a share of stored_sh_rate
    double stored_displacement_rate = 1.6e-4;  ///< of stored δx; as 3DGS moves means
    std::uint64_t seed = 0;

    template <class Self, class F>
    static void for_each_setting(Self& self, const F& f) {
        f("hash.base", self.field.grid.base, SettingRange::above(1));
        f("hash.growth", self.field.grid.growth, SettingRange::at_least(1));
        f("hash.table_size", self.field.grid.table_size, SettingRange::power_of_two());
        f("hash.fine_level", self.fine_level, SettingRange::at_least(0).up_to(16));
        f("hash.separate_tables", self.separate_tables, SettingRange());
        f("mlp.width", self.field.width, SettingRange::at_least(1));
        f("mlp.hidden_layers", self.field.hidden_layers, SettingRange::at_least(0));
        f("sh_dc_scale", self.sh_dc_scale, SettingRange());
        f("rate.displacement", self.displacement_rate, SettingRange::at_least(0));
        f("rate.sh", self.sh_rate, SettingRange::at_least(0));
        f("rate.stored_displacements", self.stored_displacement_rate, SettingRange::at_least(0));
        f("rate.stored_sh", self.stored_sh_rate, SettingRange::at_least(0));
    }
};

namespace detail {

/// The settings of an appearance's field.
template <Backend B, std::floating_point T, class Field>
[[nodiscard]] typename Field::Params appearance_field(std::string name, int outputs, std::uint64_t stream,
                                                      const AppearanceParams& params, const PriorInputs& inputs) {
    return {.name = std::move(name),
            .sizes = params.field,
            .outputs = outputs,
            .point_inputs = inputs.feature_count,
            .shared_inputs = FrameCodes<B, T>::code_size(params.time_frames),
            .tables = params.separate_tables && inputs.has_region ? 2u : 1u,
            .start = {params.seed, stream}};
}

/// Multiplies every stride-th vector, the constant colours, by a factor.
template <class T>
struct ScaleConstant {
    Span<vec3<T>> values;
    std::size_t stride;
    T factor;
    GSH_HD void operator()(std::size_t i) const { values[i * stride] *= factor; }
};

/// The gradient of a field's rows of colours and a displacement. The displacement, the last vector of a row, has that
/// of the mean; that of the constant colours, the first one, passes the factor of ScaleConstant.
template <class T>
struct RowGradient {
    Span<vec3<T>> rows;
    std::size_t stride;
    T factor;
    Span<const vec3<T>> dL_dmeans;
    GSH_HD void operator()(std::size_t i) const {
        rows[i * stride] *= factor;
        rows[(i + 1) * stride - 1] = dL_dmeans[i];
    }
};

/// The query of the points for fields of colour and displacement. Fine levels are read where τ > 0.
/// Errors  ValueError for a fine level that the grid does not have.
template <class Field, Backend B, std::floating_point T>
[[nodiscard]] typename Field::Query appearance_query(B& backend, const CanonicalPoints<B, T>& points,
                                                     const AppearanceParams& params) {
    const typename Field::Field geometry(params.field.grid, {.outputs = 1});
    typename Field::Query query;
    geometry.prepare(
        backend, points.unit(), query,
        MultiScale<T>{points.region().empty() ? 0 : params.fine_level, params.separate_tables, points.region()});
    return query;
}

} // namespace detail
} // namespace gsh
