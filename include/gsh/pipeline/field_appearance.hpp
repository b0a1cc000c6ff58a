// SPDX-License-Identifier: Apache-2.0
/// @file  What appearances from fields have in common: their settings, and the query of the canonical points.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/hash_field.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/pipeline/canonical_points.hpp>
#include <gsh/pipeline/learned_field.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>

namespace gsh {

/// Settings of an appearance.
struct AppearanceParams {
    FieldParams field;
    int fine_level = 12;          ///< the first level that only points with a share in the region have
    bool separate_tables = false; ///< coarse and fine features from a table each
    double sh_dc_scale = 60;      ///< a field's constant-colour outputs are multiplied by this
    /// Frames of the motion, if fields are to read γ(t): colours and displacements then change with the frame.
    std::size_t time_frames = 0;
    double sh_rate = 2e-3;                     ///< table and network of a field that gives colours
    double displacement_rate = 5e-4;           ///< of one that gives displacements, metres
    double stored_sh_rate = 2.5e-3;            ///< constant colour of each Gaussian, where it is stored
    double stored_sh_band_rate = 2.5e-3 / 20;  ///< the bands above it
    double stored_displacement_rate = 1.6e-4;  ///< δx of each Gaussian, where it is stored: as 3DGS moves means
    std::uint64_t seed = 0;
};

namespace detail {

/// Multiplies every stride-th vector: the constant colours among the coefficients.
template <class T>
struct ScaleConstant {
    Span<vec3<T>> values;
    std::size_t stride;
    T factor;
    GSH_HD void operator()(std::size_t i) const { values[i * stride] *= factor; }
};

/// Every stride-th gradient = that of a mean.
template <class T>
struct DisplacementGradient {
    Span<const vec3<T>> dL_dmeans;
    std::size_t stride;
    Span<vec3<T>> dL_ddisplacements;
    GSH_HD void operator()(std::size_t i) const { dL_ddisplacements[i * stride] = dL_dmeans[i]; }
};

/// The points as fields of colour and displacement read them: fine levels where the region is.
/// Errors  ValueError for a fine level that the grid does not have.
template <class Field, Backend B, std::floating_point T>
[[nodiscard]] typename Field::Query appearance_query(B& backend, const CanonicalPoints<B, T>& points,
                                                     const AppearanceParams& params) {
    const typename Field::Field geometry(
        {.base = params.field.base, .growth = params.field.growth, .table_size = params.field.table_size},
        {.outputs = 1});
    typename Field::Query query;
    geometry.prepare(
        backend, points.unit(), query,
        MultiScale<T>{points.region().empty() ? 0 : params.fine_level, params.separate_tables, points.region()});
    return query;
}

} // namespace detail
} // namespace gsh
