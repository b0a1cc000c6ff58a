// SPDX-License-Identifier: Apache-2.0
/// @file  The two meanings of SCALE in glTF files of Gaussians: lengths, and the logarithms of an earlier draft.
#pragma once

#include <gsh/gaussian/gaussians.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace gsh::detail {

/// Whether a scale is negative. As a length it would be invalid, so all scales of the file are logarithms.
[[nodiscard]] inline bool has_negative_scale(const GaussianCloud<float>& cloud) {
    return std::any_of(cloud.log_scales.begin(), cloud.log_scales.end(),
                       [](const vec3<float>& s) { return s.x < 0 || s.y < 0 || s.z < 0; });
}

/// Whether positive scales are likely to be logarithms: as lengths, Gaussians would be far smaller than the distances
/// between them, and as logarithms they would meet. Of fewer than 100 Gaussians it is false.
[[nodiscard]] inline bool may_be_logarithms(const GaussianCloud<float>& cloud) {
    const std::size_t n = cloud.size();
    if (n < 100) return false;
    const auto quantile = [n](std::vector<float>& values, double share) {
        const auto at = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(n - 1));
        std::nth_element(values.begin(), at, values.end());
        return static_cast<double>(*at);
    };
    std::vector<float> values(n);
    double squared = 0; // of the diagonal of the box without outliers
    for (int axis = 0; axis < 3; ++axis) {
        for (std::size_t i = 0; i < n; ++i) values[i] = cloud.means[i][axis];
        const double extent = quantile(values, 0.95) - quantile(values, 0.05);
        squared += extent * extent;
    }
    for (std::size_t i = 0; i < n; ++i) {
        const vec3<float>& s = cloud.log_scales[i];
        values[i] = std::max({s.x, s.y, s.z});
    }
    const double spacing = std::sqrt(squared / static_cast<double>(n)), typical = quantile(values, 0.5);
    return typical > 0 && typical < spacing / 4 && std::abs(std::log(spacing) - typical) < 1.5;
}

/// Makes logarithms of a file's scales: of lengths, none of them below a nanometre.
inline void finish_gltf_scales(GaussianCloud<float>& cloud, bool are_logarithms) {
    if (are_logarithms) return;
    for (vec3<float>& s : cloud.log_scales)
        for (int k = 0; k < 3; ++k) s[k] = std::log(std::max(s[k], 1e-9f));
}

} // namespace gsh::detail
