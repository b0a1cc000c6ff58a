// SPDX-License-Identifier: Apache-2.0
/// @file  Output images and background of the rasterizer, and the gradients of both.
#pragma once

#include <gsh/core/span.hpp>
#include <gsh/image/image.hpp>
#include <gsh/math/vec.hpp>

namespace gsh {

/// The background behind the splats: one colour, or an image if one is given.
template <class T>
struct Background {
    vec3<T> color = vec3<T>(T(0));
    ImageView<const T> image = {}; ///< [3, height, width] or empty
};

/// Gradient of a background; the caller sets the members that it needs.
template <class T>
struct BackgroundGradient {
    Span<vec3<T>> color = {};  ///< [1] or empty
    ImageView<T> image = {};   ///< [3, height, width] or empty
};

/// Output images of a rendering. All but the colour may be empty.
///
/// Shapes  color [3, height, width], the others [1, height, width].
/// Units   display-referred sRGB; metres along the camera's z axis.
template <class T>
struct RenderTarget {
    ImageView<T> color;
    ImageView<T> alpha = {};          ///< 1 - final transmittance
    ImageView<T> expected_depth = {}; ///< sum of weight * z; divided by alpha it is the mean depth of the splats
    ImageView<T> median_depth = {};   ///< z of the splat that takes the transmittance to 1/2 or below; 0 if none does

    [[nodiscard]] bool has_depth() const { return !expected_depth.empty() || !median_depth.empty(); }
};

/// Gradient with respect to a rendering. Empty images count as zero.
template <class T>
struct RenderGradient {
    ImageView<const T> color = {};
    ImageView<const T> alpha = {};
    ImageView<const T> expected_depth = {};
    ImageView<const T> median_depth = {};

    [[nodiscard]] bool has_depth() const { return !expected_depth.empty() || !median_depth.empty(); }
};

} // namespace gsh
