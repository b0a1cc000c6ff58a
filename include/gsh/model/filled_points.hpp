// SPDX-License-Identifier: Apache-2.0
/// @file  Gaussians whose colour, displacement and opacity are given instead of learned: those that no photograph saw.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/model/appearance.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace gsh {

/// What some Gaussians are given, on the host. Their colours do not depend on the direction.
///
/// Shapes  F points; points [F] ascending, colors [F] the constant coefficients, displacements [F], opacity_logits [F].
template <std::floating_point T>
struct PointFill {
    std::vector<std::uint32_t> points;
    std::vector<vec3<T>> colors, displacements;
    std::vector<T> opacity_logits;
};

namespace detail {

/// Copies a Gaussian's appearance, or writes what it is given.
template <class T>
struct FilledAppearance {
    AppearanceView<T> learned;
    Span<const T> learned_logits;
    Span<const std::uint32_t> rows; // [N] 1 + the row of the fill, or 0
    Span<const vec3<T>> colors, filled_displacements;
    Span<const T> filled_logits;
    std::size_t basis;
    Span<vec3<T>> sh, displacements; // [N, basis], [N]
    Span<T> opacity_logits;

    GSH_HD void operator()(std::size_t i) const {
        const std::size_t row = rows[i];
        for (std::size_t k = 0; k < basis; ++k)
            sh[i * basis + k] = row == 0 ? learned.sh[i * learned.sh_stride + k]
                                : k == 0 ? colors[row - 1]
                                         : vec3<T>(T(0));
        displacements[i] = row == 0 ? learned.displacements[i * learned.displacement_stride]
                                    : filled_displacements[row - 1];
        opacity_logits[i] = row == 0 ? learned_logits[i] : filled_logits[row - 1];
    }
};

} // namespace detail

/// A copy of an appearance in which some Gaussians have what a PointFill gives them.
///
/// Errors  ShapeError for arrays of different lengths; ValueError for points that do not exist or are not ascending.
template <Backend B, std::floating_point T = float>
class FilledPoints {
public:
    FilledPoints(B& backend, std::size_t count, int basis, const PointFill<T>& fill)
        : backend_(&backend), basis_(static_cast<std::size_t>(basis)) {
        constexpr const char* where = "FilledPoints";
        const std::size_t F = fill.points.size();
        check_size(where, "colors", fill.colors.size(), F, "one per point");
        check_size(where, "displacements", fill.displacements.size(), F, "one per point");
        check_size(where, "opacity_logits", fill.opacity_logits.size(), F, "one per point");
        std::vector<std::uint32_t> rows(count, 0);
        for (std::size_t k = 0; k < F; ++k) {
            check_value(fill.points[k] < count && (k == 0 || fill.points[k - 1] < fill.points[k]), where,
                        "points must be ascending and below the number of Gaussians");
            rows[fill.points[k]] = static_cast<std::uint32_t>(k + 1);
        }
        assign(backend, rows, rows_);
        assign(backend, fill.colors, colors_);
        assign(backend, fill.displacements, filled_displacements_);
        assign(backend, fill.opacity_logits, filled_logits_);
        sh_.resize(count * basis_), displacements_.resize(count), opacity_logits_.resize(count);
    }

    void forward(const AppearanceView<T>& learned, Span<const T> opacity_logits) {
        backend_->for_each(rows_.size(), detail::FilledAppearance<T>{learned, opacity_logits, rows_, colors_,
                                                                     filled_displacements_, filled_logits_, basis_,
                                                                     sh_, displacements_, opacity_logits_});
    }
    /// Results of the last forward.
    [[nodiscard]] AppearanceView<T> view() const { return {sh_, basis_, displacements_, 1}; }
    [[nodiscard]] Span<const T> opacity_logits() const { return opacity_logits_; }

private:
    template <class U>
    using Buffer = typename B::template Buffer<U>;
    B* backend_;
    std::size_t basis_;
    Buffer<std::uint32_t> rows_;
    Buffer<vec3<T>> colors_, filled_displacements_, sh_, displacements_;
    Buffer<T> filled_logits_, opacity_logits_;
};

} // namespace gsh
