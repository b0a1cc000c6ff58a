// SPDX-License-Identifier: Apache-2.0
/// @file  The colour of a Gaussian from its spherical harmonics, a direction and its ambient occlusion.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/enum_names.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/math/sh.hpp>
#include <gsh/math/vec.hpp>

#include <array>
#include <string_view>

namespace gsh {

/// The range to which colours are clamped: [0, 1], or [0, ∞) as in a plain 3DGS scene.
enum class ColorClamp { both, below };
template <>
struct EnumNames<ColorClamp> {
    static constexpr std::array<std::string_view, 2> names{"both", "below"};
};

/// The constant SH coefficient that gives this colour from every direction if the other coefficients are zero:
/// (color - 0.5) / Y_0.
template <Lane T>
[[nodiscard]] GSH_HD vec3<T> sh_of_color(const vec3<T>& color) {
    return (color - vec3<T>(T(0.5))) * T(ScalarOf<T>(3.5449077018110318)); // 1 / Y_0 = 2 sqrt(pi)
}

namespace detail {

/// Y(sh, dir) + 0.5 before the clamp.
template <int Degree, Lane T>
[[nodiscard]] GSH_HD vec3<T> unclamped_color(const vec3<T>* sh, const vec3<T>& dir) {
    return SHEval<Degree>::forward(sh, dir) + vec3<T>(T(0.5));
}

template <Lane T>
[[nodiscard]] GSH_HD T clamp_color(T c, ColorClamp clamping) {
    const T above = max(c, T(0));
    return clamping == ColorClamp::both ? min(above, T(1)) : above;
}

/// The gradient where clamp_color did not clamp c, else 0. The interval's ends count as not clamped.
template <Lane T>
[[nodiscard]] GSH_HD T clamp_color_gradient(T c, T dL_dclamped, ColorClamp clamping) {
    const T above = select(c >= T(0), dL_dclamped, T(0));
    return clamping == ColorClamp::both ? select(c <= T(1), above, T(0)) : above;
}

} // namespace detail

/// color = ao · clamp(Y(sh, dir) + 0.5).
///
/// Shapes  sh [(Degree+1)²] RGB; color [3].
/// Frame   dir is a unit vector from camera centre to Gaussian, in the frame sh is stored in.
/// Units   display-referred sRGB; ao is a factor, 1 where nothing is occluded.
template <int Degree, Lane T>
[[nodiscard]] GSH_HD vec3<T> shade(const vec3<T>* sh, const vec3<T>& dir, T ao, ColorClamp clamping) {
    const vec3<T> c = detail::unclamped_color<Degree>(sh, dir);
    return vec3<T>(detail::clamp_color(c.x, clamping), detail::clamp_color(c.y, clamping),
                   detail::clamp_color(c.z, clamping)) * ao;
}

/// Adjoint of shade: adds to dL_dsh, dL_ddir (x, y, z independent) and dL_dao. A clamped channel adds nothing to dL_dsh
/// and dL_ddir. dL_dao receives dL_dcolor times the colour without ao.
template <int Degree, Lane T>
GSH_HD void shade_backward(const vec3<T>* sh, const vec3<T>& dir, T ao, ColorClamp clamping, const vec3<T>& dL_dcolor,
                           vec3<T>* dL_dsh, vec3<T>& dL_ddir, T& dL_dao) {
    const vec3<T> c = detail::unclamped_color<Degree>(sh, dir);
    vec3<T> dL_dc;
    for (int channel = 0; channel < 3; ++channel) {
        dL_dao += dL_dcolor[channel] * detail::clamp_color(c[channel], clamping);
        dL_dc[channel] = detail::clamp_color_gradient(c[channel], dL_dcolor[channel] * ao, clamping);
    }
    SHEval<Degree>::backward(sh, dir, dL_dc, dL_dsh, dL_ddir);
}

} // namespace gsh
