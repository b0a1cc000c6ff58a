// SPDX-License-Identifier: Apache-2.0
/// @file  Real spherical harmonics: the view-dependent colour of a Gaussian.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/math/vec.hpp>

namespace gsh {

/// Number of basis functions, and of RGB coefficients, up to a degree.
[[nodiscard]] GSH_HD constexpr int sh_basis_count(int degree) { return (degree + 1) * (degree + 1); }

/// Evaluates color = sum_k Y_k(dir) * sh[k] and its adjoint.
///
/// Shapes  sh [basis_count] RGB coefficients, k = l*l + l + m; dir [3]; color [3].
/// Frame   dir is a unit vector from camera centre to Gaussian, in the frame sh is stored in.
/// Units   display-referred sRGB, as in the images; the +0.5 offset and the clamp are in gaussian/shade.hpp.
/// Errors  none, this is kernel code.
/// Source  Sloan, "Stupid Spherical Harmonics (SH) Tricks", 2008, appendix; order and signs
///         as in Kerbl et al., "3D Gaussian Splatting", 2023. Each basis function is a homogeneous polynomial.
template <int Degree>
    requires(0 <= Degree && Degree <= 4)
struct SHEval {
    static constexpr int basis_count = sh_basis_count(Degree);

    template <Lane T>
    [[nodiscard]] GSH_HD static vec3<T> forward(const vec3<T>* sh, const vec3<T>& dir) {
        const Basis<T> basis(dir);
        vec3<T> color = basis.Y[0] * sh[0];
        for (int k = 1; k < basis_count; ++k) color += basis.Y[k] * sh[k];
        return color;
    }

    /// Adds to dL_dsh and dL_ddir. x, y, z count as independent; normalize_backward (math/vec.hpp) covers the
    /// normalisation of dir.
    template <Lane T>
    GSH_HD static void backward(const vec3<T>* sh, const vec3<T>& dir, const vec3<T>& dL_dcolor, vec3<T>* dL_dsh,
                                vec3<T>& dL_ddir) {
        const Basis<T> basis(dir);
        for (int k = 0; k < basis_count; ++k) dL_dsh[k] += basis.Y[k] * dL_dcolor;
        for (int k = 1; k < basis_count; ++k) dL_ddir += dot(sh[k], dL_dcolor) * basis.dY_ddir[k];
    }

private:
    /// One line per function: its value, then its three partial derivatives.
    template <Lane T>
    struct Basis {
        T Y[basis_count];
        vec3<T> dY_ddir[basis_count];

        GSH_HD explicit Basis(const vec3<T>& dir) {
            const T x = dir.x, y = dir.y, z = dir.z, xx = x * x, yy = y * y, zz = z * z, o = T(0);
            int k = 0;
            const auto add = [&](T v, T dx, T dy, T dz) { Y[k] = v, dY_ddir[k++] = vec3<T>(dx, dy, dz); };
            const auto n = [](double factor) { return T(static_cast<ScalarOf<T>>(factor)); };

            add(n(0.28209479177387814), o, o, o);
            if constexpr (Degree >= 1) {
                const T a = n(0.48860251190291992);
                add(-a * y, o, -a, o);
                add( a * z, o, o, a);
                add(-a * x, -a, o, o);
            }
            if constexpr (Degree >= 2) {
                const T a = n(1.09254843059207907), b = n(0.31539156525252001), c = n(0.54627421529603954);
                add( a * x*y, a * y, a * x, o);
                add(-a * y*z, o, -a * z, -a * y);
                add( b * (n(2)*zz - xx - yy), n(-2)*b * x, n(-2)*b * y, n(4)*b * z);
                add(-a * x*z, -a * z, o, -a * x);
                add( c * (xx - yy), n(2)*c * x, n(-2)*c * y, o);
            }
            if constexpr (Degree >= 3) {
                const T a = n(0.59004358992664352), b = n(2.89061144264055405), c = n(0.45704579946446577);
                const T d = n(0.37317633259011540), e = n(1.44530572132027703);
                const T f = n(4)*zz - xx - yy, three_xx = n(3)*xx, three_yy = n(3)*yy;
                add(-a * y*(three_xx - yy), n(-6)*a * x*y, n(-3)*a * (xx - yy), o);
                add( b * x*y*z, b * y*z, b * x*z, b * x*y);
                add(-c * y*f, n(2)*c * x*y, -c * (f - n(2)*yy), n(-8)*c * y*z);
                add( d * z*(n(2)*zz - three_xx - three_yy), n(-6)*d * x*z, n(-6)*d * y*z, n(3)*d * (n(2)*zz - xx - yy));
                add(-c * x*f, -c * (f - n(2)*xx), n(2)*c * x*y, n(-8)*c * x*z);
                add( e * z*(xx - yy), n(2)*e * x*z, n(-2)*e * y*z, e * (xx - yy));
                add(-a * x*(xx - three_yy), n(-3)*a * (xx - yy), n(6)*a * x*y, o);
            }
            if constexpr (Degree >= 4) {
                const T a = n(2.50334294179670454), b = n(1.77013076977993053), c = n(0.94617469575755997);
                const T d = n(0.66904654355728917), e = n(0.10578554691520431), g = n(0.47308734787877998);
                const T h = n(0.62583573544917614);
                const T r = xx + yy, s = n(6)*zz - r, t = n(4)*zz - n(3)*r; // 7zz - 1 and 7zz - 3 on the unit sphere
                const T p = n(3)*xx - yy, q = xx - n(3)*yy;
                add( a * x*y*(xx - yy), a * y*p, a * x*q, o);
                add(-b * y*z*p, n(-6)*b * x*y*z, n(-3)*b * z*(xx - yy), -b * y*p);
                add( c * x*y*s, c * y*(s - n(2)*xx), c * x*(s - n(2)*yy), n(12)*c * x*y*z);
                add(-d * y*z*t, n(6)*d * x*y*z, -d * z*(t - n(6)*yy), -d * y*(t + n(8)*zz));
                add( e * (n(8)*zz*zz - n(24)*zz*r + n(3)*r*r), n(-12)*e * x*(n(4)*zz - r), n(-12)*e * y*(n(4)*zz - r),
                    n(16)*e * z*(n(2)*zz - n(3)*r));
                add(-d * x*z*t, -d * z*(t - n(6)*xx), n(6)*d * x*y*z, -d * x*(t + n(8)*zz));
                add( g * (xx - yy)*s, n(4)*g * x*(n(3)*zz - xx), n(-4)*g * y*(n(3)*zz - yy), n(12)*g * z*(xx - yy));
                add(-b * x*z*q, n(-3)*b * z*(xx - yy), n(6)*b * x*y*z, -b * x*q);
                add( h * (xx*q - yy*p), n(4)*h * x*q, n(-4)*h * y*p, o);
            }
        }
    };
};

} // namespace gsh
