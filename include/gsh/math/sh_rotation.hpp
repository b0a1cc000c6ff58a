// SPDX-License-Identifier: Apache-2.0
/// @file  Rotation of real spherical harmonics of degrees 0 to 4 by any rotation, exact, with adjoint.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/math/sh.hpp>
#include <gsh/math/vec.hpp>

#include <cmath>

namespace gsh {

/// The coefficients c' of the turned function f'(d) = f(Rᵀ d), where f(d) = Σ_k Y_k(d) c_k.
///
/// f' has the degree of f, and Y_k is orthonormal, so c'_k = ∫ Y_k(d) f(Rᵀ d) over the sphere. The integrand is a
/// polynomial of degree 2 Degree, for which a product rule is exact: Degree + 1 nodes of Gauss and Legendre in z,
/// 2 Degree + 1 equal steps of longitude,
///
///     c'_k = Σ_i w_i Y_k(d_i) f(Rᵀ d_i).
///
/// Bands do not mix, since a rotation keeps them apart and the rule is exact.
///
/// Shapes  sh, rotated [basis_count] RGB, in the order of SHEval; R [3, 3].
/// Frame   R leads from the frame of sh to that of rotated. It must be a rotation; see polar_rotation for the one
///         nearest to another matrix.
/// Errors  none, this is kernel code.
/// Source  our own; the usual ways (Ivanic and Ruedenberg, "Rotation Matrices for Real Spherical Harmonics", 1996) give
///         the same numbers by recursion over matrices of each band.
template <int Degree>
    requires(0 <= Degree && Degree <= 4)
struct ShRotation {
    static constexpr int basis_count = sh_basis_count(Degree);

    /// Overwrites rotated, which must not overlap with sh.
    template <Lane T>
    GSH_HD static void forward(const vec3<T>* sh, const mat3<T>& R, vec3<T>* rotated) {
        for (int k = 0; k < basis_count; ++k) rotated[k] = vec3<T>(T(0));
        vec3<T> unused(T(0));
        for_each_node<T>([&](const vec3<T>& d, T weight) {
            const vec3<T> value = SHEval<Degree>::forward(sh, transposed_times(R, d));
            SHEval<Degree>::backward(sh, d, value * weight, rotated, unused); // adds Y_k(d) value weight
        });
    }

    /// Adds to dL_dsh and dL_dR. The entries of R count as independent.
    template <Lane T>
    GSH_HD static void backward(const vec3<T>* sh, const mat3<T>& R, const vec3<T>* dL_drotated, vec3<T>* dL_dsh,
                                mat3<T>& dL_dR) {
        for_each_node<T>([&](const vec3<T>& d, T weight) {
            const vec3<T> dL_dvalue = SHEval<Degree>::forward(dL_drotated, d) * weight;
            vec3<T> dL_dturned(T(0));
            SHEval<Degree>::backward(sh, transposed_times(R, d), dL_dvalue, dL_dsh, dL_dturned);
            dL_dR += outer(d, dL_dturned);
        });
    }

private:
    /// A rule's nodes with z >= 0, and cosine and sine of one step of longitude.
    struct Rule {
        double z[3], weight[3], cosine, sine;
    };
    [[nodiscard]] GSH_HD static constexpr Rule rule() {
        if constexpr (Degree == 0)
            return {{0}, {2}, 1, 0};
        else if constexpr (Degree == 1)
            return {{0.57735026918962576}, {1}, -0.5, 0.86602540378443865};
        else if constexpr (Degree == 2)
            return {{0, 0.77459666924148338},
                    {0.88888888888888889, 0.55555555555555556},
                    0.30901699437494742,
                    0.95105651629515357};
        else if constexpr (Degree == 3)
            return {{0.33998104358485626, 0.86113631159405258},
                    {0.65214515486254614, 0.34785484513745386},
                    0.62348980185873353,
                    0.78183148246802981};
        else
            return {{0, 0.53846931010568309, 0.90617984593866399},
                    {0.56888888888888889, 0.47862867049936647, 0.23692688505618909},
                    0.76604444311897804,
                    0.64278760968653933};
    }

    /// Calls visit(direction, weight) for each node. The weights sum to 4 pi.
    template <Lane T, class Visit>
    GSH_HD static void for_each_node(const Visit& visit) {
        using S = ScalarOf<T>;
        constexpr Rule rule_of_degree = rule();
        constexpr int longitudes = 2 * Degree + 1;
        constexpr double step = 2 * 3.14159265358979324 / longitudes;
        for (int node = 0; node <= Degree / 2; ++node) {
            const double z = rule_of_degree.z[node], radius = std::sqrt(1 - z * z);
            double x = radius, y = 0;
            for (int longitude = 0; longitude < longitudes; ++longitude) {
                const T weight(static_cast<S>(rule_of_degree.weight[node] * step));
                const T tx(static_cast<S>(x)), ty(static_cast<S>(y)), tz(static_cast<S>(z));
                visit(vec3<T>(tx, ty, tz), weight);
                if (z > 0) visit(vec3<T>(tx, ty, -tz), weight);
                const double turned = rule_of_degree.cosine * x - rule_of_degree.sine * y;
                y = rule_of_degree.sine * x + rule_of_degree.cosine * y;
                x = turned;
            }
        }
    }
};

} // namespace gsh
