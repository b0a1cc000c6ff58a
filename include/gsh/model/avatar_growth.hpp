// SPDX-License-Identifier: Apache-2.0
/// @file  What a model has learned, carried over to one with more Gaussians, or with colours stored instead of a field.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/body/nearest_points.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/learn/learned_array.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/model/appearance.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// For each point of a finer set of samples, the nearest one of a coarser set, and how its Gaussian changes.
///
/// Shapes  all [N] of the finer set.
struct PointParents {
    std::size_t parent_count; ///< points of the coarser set
    std::vector<std::size_t> parents;
    std::vector<quat<double>> turns; ///< the shortest rotations from the parents' normals to the points' own
    std::vector<double> log_scales;  ///< logarithms of the initial scales, relative to those of the parents

    /// Errors  ValueError if a set is empty.
    PointParents(const SurfaceSamples& coarse, const SurfaceSamples& fine) : parent_count(coarse.size()) {
        check_value(coarse.size() > 0 && fine.size() > 0, "PointParents",
                    "there are no samples, expected at least one");
        const NearestPoints nearest{coarse.positions};
        for (std::size_t i = 0; i < fine.size(); ++i) {
            const std::size_t parent = nearest.nearest(fine.positions[i], 1).front().second;
            const vec3<double>&from = coarse.normals[parent], &to = fine.normals[i];
            const double cosine = dot(from, to);
            const vec3<double> axis = cross(from, to);
            parents.push_back(parent);
            turns.push_back(cosine > -0.5 ? normalize(quat<double>{1 + cosine, axis.x, axis.y, axis.z})
                                          : quat<double>()); // the other side of something thin
            log_scales.push_back(std::log(fine.scales[i] / coarse.scales[parent]));
        }
    }
};

namespace detail {

/// The array of a name, or null.
template <class T>
[[nodiscard]] const LearnedArray<T>* find_array(const LearnedArrays<T>& arrays, std::string_view name) {
    const auto found =
        std::find_if(arrays.begin(), arrays.end(), [&](const auto& array) { return array.name == name; });
    return found == arrays.end() ? nullptr : &*found;
}

/// rows[i] = factor times row parents[i] of an array.
template <class T>
[[nodiscard]] std::vector<T> rows_of_parents(const std::vector<T>& array, const std::vector<std::size_t>& parents,
                                             std::size_t width, double factor) {
    std::vector<T> rows;
    rows.reserve(parents.size() * width);
    for (const std::size_t parent : parents)
        for (std::size_t k = 0; k < width; ++k) rows.push_back(static_cast<T>(factor * array[parent * width + k]));
    return rows;
}

} // namespace detail

/// Copies values and moments of Adam to the arrays of the same name. Other arrays stay as they are.
/// Errors  ShapeError for an array of another size.
template <Backend B, class T>
void carry_over(B& backend, const LearnedArrays<T>& from, const LearnedArrays<T>& to) {
    for (const LearnedArray<T>& array : to)
        if (const LearnedArray<T>* same = detail::find_array(from, array.name)) {
            check_size("carry_over", array.name, array.values.size(), same->values.size());
            backend.copy(Span<const T>(same->values), array.values);
            backend.copy(Span<const T>(same->first_moment), array.first_moment);
            backend.copy(Span<const T>(same->second_moment), array.second_moment);
        }
}

/// The same from a coarser set of points to a finer one. An array with a row per point has the rows of the points'
/// parents: rotations turn with the normal, and scales change as the initial ones do. The gradient of a Gaussian falls
/// with its area, and so do the moments.
///
/// Errors  ShapeError for an array that is neither of the same size nor has a row per point.
template <Backend B, class T>
void carry_over(B& backend, const LearnedArrays<T>& coarse, const LearnedArrays<T>& fine, const PointParents& points) {
    LearnedArrays<T> whole; // arrays that do not depend on the points
    for (const LearnedArray<T>& to : fine) {
        const LearnedArray<T>* const from = detail::find_array(coarse, to.name);
        if (!from || from->values.size() == to.values.size()) {
            whole.push_back(to);
            continue;
        }
        const std::size_t width = from->values.size() / points.parent_count;
        check_size("carry_over", to.name, to.values.size(), width * points.parents.size(), "a row per point");
        const auto rows = [&](Span<const T> array, double factor) {
            return detail::rows_of_parents(downloaded(backend, array), points.parents, width, factor);
        };
        std::vector<T> values = rows(from->values, 1);
        if (to.name == "log_scales")
            for (std::size_t i = 0; i < values.size(); ++i) values[i] += static_cast<T>(points.log_scales[i / width]);
        if (to.name == "quats")
            for (std::size_t i = 0; i < points.turns.size(); ++i) {
                T* const q = values.data() + 4 * i;
                const quat<double> turned = product(points.turns[i], quat<double>{q[0], q[1], q[2], q[3]});
                q[0] = T(turned.w), q[1] = T(turned.x), q[2] = T(turned.y), q[3] = T(turned.z);
            }
        const double area = static_cast<double>(points.parent_count) / static_cast<double>(points.parents.size());
        backend.upload(Span<const T>(values), to.values);
        backend.upload(Span<const T>(rows(from->first_moment, area)), to.first_moment);
        backend.upload(Span<const T>(rows(from->second_moment, area * area)), to.second_moment);
    }
    carry_over(backend, coarse, whole);
}

/// Stores what an appearance gives in the arrays `sh` and `displacements` of StoredAttributes at the same points. Bands
/// that are not used yet (`used` coefficients are) start at zero.
/// Errors  ValueError without these arrays, ShapeError for other points.
template <Backend B, class T>
void store_appearance(B& backend, const AppearanceView<T>& from, std::size_t used, const LearnedArrays<T>& stored) {
    const auto find = [&](const std::string& name) -> const LearnedArray<T>& {
        const LearnedArray<T>* const array = detail::find_array(stored, name);
        check_value(array, "store_appearance", "the model has no array " + name);
        return *array;
    };
    const LearnedArray<T>&sh = find("sh"), &displacements = find("displacements");
    const std::size_t points = displacements.values.size() / 3;
    const std::size_t basis = sh.values.size() / 3 / std::max<std::size_t>(points, 1);
    const std::vector<vec3<T>> rows = downloaded(backend, from.sh), moves = downloaded(backend, from.displacements);
    check_size("store_appearance", "sh", rows.size(), points * from.sh_stride, "those of the same points");
    std::vector<vec3<T>> colors(points * basis, vec3<T>(T(0))), places(points);
    for (std::size_t i = 0; i < points; ++i) {
        std::copy_n(rows.begin() + static_cast<std::ptrdiff_t>(i * from.sh_stride), std::min(used, basis),
                    colors.begin() + static_cast<std::ptrdiff_t>(i * basis));
        places[i] = moves[i * from.displacement_stride];
    }
    backend.upload(view_as<const T>(Span<const vec3<T>>(colors)), sh.values);
    backend.upload(view_as<const T>(Span<const vec3<T>>(places)), displacements.values);
}

} // namespace gsh
