// SPDX-License-Identifier: Apache-2.0
/// @file  A part of a surface's samples, evenly spread: the points of a coarser avatar.
#pragma once

#include <gsh/body/skinning.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/core/error.hpp>

#include <cmath>
#include <cstddef>
#include <vector>

namespace gsh {

/// How many of `count` elements are left of which every stride-th is taken, the first among them.
[[nodiscard]] constexpr std::size_t thinned_count(std::size_t count, std::size_t stride) {
    return (count + stride - 1) / stride;
}

/// Every stride-th row of `width` elements. Fewer strides keep more: the rows at stride 2 s are among those at s.
/// Errors  ValueError unless stride is at least 1.
template <class Element>
[[nodiscard]] std::vector<Element> thinned_rows(const std::vector<Element>& rows, std::size_t width,
                                                std::size_t stride) {
    check_value(stride >= 1, "thinned_rows", "stride is 0, expected at least 1");
    std::vector<Element> kept;
    if (width == 0) return kept;
    kept.reserve(thinned_count(rows.size() / width, stride) * width);
    for (std::size_t i = 0; i + width <= rows.size(); i += stride * width)
        kept.insert(kept.end(), rows.begin() + static_cast<std::ptrdiff_t>(i),
                    rows.begin() + static_cast<std::ptrdiff_t>(i + width));
    return kept;
}

/// Skinning weights of every stride-th point.
template <class T>
[[nodiscard]] SkinWeightTable<T> thinned(const SkinWeightTable<T>& skin, std::size_t stride) {
    return {thinned_rows(skin.joints, skin.influences, stride), thinned_rows(skin.weights, skin.influences, stride),
            skin.influences};
}

/// Every stride-th sample. Samples lie along a Morton curve, so these have the density of all of them, divided by
/// stride. Scales grow by the root of stride: the surface stays covered.
/// Errors  ValueError unless stride is at least 1.
[[nodiscard]] inline SurfaceSamples thinned(const SurfaceSamples& samples, std::size_t stride) {
    SurfaceSamples kept{.positions = thinned_rows(samples.positions, 1, stride),
                        .normals = thinned_rows(samples.normals, 1, stride),
                        .triangles = thinned_rows(samples.triangles, 1, stride),
                        .barycentric = thinned_rows(samples.barycentric, 1, stride),
                        .sources = thinned_rows(samples.sources, 1, stride),
                        .scales = thinned_rows(samples.scales, 1, stride),
                        .weights = thinned(samples.weights, stride)};
    for (double& scale : kept.scales) scale *= std::sqrt(static_cast<double>(stride));
    return kept;
}

} // namespace gsh
