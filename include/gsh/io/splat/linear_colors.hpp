// SPDX-License-Identifier: Apache-2.0
/// @file  Gaussians whose SH sum to linear light, converted to those of gsh, which sum to sRGB.
#pragma once

#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/sh_fit.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/image/color.hpp>
#include <gsh/light/light.hpp>
#include <gsh/math/sh.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace gsh::detail {

/// Converts the coefficients in place. Without bands, the colour is exact. With bands, the sRGB curve of a sum of SH is
/// no sum of SH: the coefficients are those with the least squared error over all directions. Colours below 0 are
/// clamped before the curve, as where they are shown. Returns the root mean square of the error of colours in [0, 1].
[[nodiscard]] inline double convert_linear_colors(GaussianCloud<float>& cloud) {
    double squared = 0;
    std::size_t count = 0;
    with_sh_degree(cloud.sh_degree, [&](auto degree) {
        constexpr int D = decltype(degree)::value;
        constexpr std::size_t basis = sh_basis_count(D);
        const std::vector<vec3<double>> directions = even_directions(D == 0 ? 1 : 64);
        std::vector<vec3<double>> wanted(directions.size());
        for (std::size_t i = 0; i < cloud.size(); ++i) {
            vec3<double> sh[basis], fitted[basis];
            for (std::size_t k = 0; k < basis; ++k) sh[k] = vec3<double>(cloud.sh[i * basis + k]);
            const vec3<double> none[basis] = {};
            ShFit<D> fit(none);
            for (std::size_t d = 0; d < directions.size(); ++d) {
                const vec3<double> linear = shade<D>(sh, directions[d], 1.0, ColorClamp::below);
                for (int c = 0; c < 3; ++c) wanted[d][c] = linear_to_srgb(linear[c]);
                fit.add(directions[d], wanted[d], 1);
            }
            fit.solve(1e-12, fitted);
            for (std::size_t d = 0; d < directions.size(); ++d) {
                const vec3<double> color = shade<D>(fitted, directions[d], 1.0, ColorClamp::below);
                for (int c = 0; c < 3; ++c, ++count)
                    squared += std::pow(std::min(color[c], 1.0) - std::min(wanted[d][c], 1.0), 2);
            }
            for (std::size_t k = 0; k < basis; ++k) cloud.sh[i * basis + k] = vec3<float>(fitted[k]);
        }
    });
    return count ? std::sqrt(squared / static_cast<double>(count)) : 0;
}

} // namespace gsh::detail
