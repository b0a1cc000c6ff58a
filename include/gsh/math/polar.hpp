// SPDX-License-Identifier: Apache-2.0
/// @file  The rotation nearest to a matrix: the rotation factor of its polar decomposition, with adjoint.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/sym.hpp>
#include <gsh/math/vec.hpp>

namespace gsh {

namespace detail {

/// K⁻¹ for K = tr(B) I - sym(B). It returns the rotation vector ω with a given skew part: [ω]x S + S [ω]x = [K ω]x.
///
/// The eigenvalues of K are the pairwise sums of B's eigenvalues. K is singular where such a sum vanishes, which is
/// where the nearest rotation is not unique. The determinant of K is bounded from below, so the inverse stays finite
/// there.
template <Lane T>
struct TurnResponse {
    sym3<T> adjugate;
    T inverse_determinant;

    GSH_HD explicit TurnResponse(const mat3<T>& B) {
        const T half = T(0.5);
        const sym3<T> k{B[1].y + B[2].z,           -half * (B[1].x + B[0].y), -half * (B[2].x + B[0].z),
                        B[0].x + B[2].z,           -half * (B[2].y + B[1].z), B[0].x + B[1].y};
        adjugate = {k.yy * k.zz - k.yz * k.yz, k.xz * k.yz - k.xy * k.zz, k.xy * k.yz - k.xz * k.yy,
                    k.xx * k.zz - k.xz * k.xz, k.xy * k.xz - k.xx * k.yz, k.xx * k.yy - k.xy * k.xy};
        const T determinant = k.xx * adjugate.xx + k.xy * adjugate.xy + k.xz * adjugate.xz;
        inverse_determinant = T(1) / max(determinant, T(1e-3)); // the determinant is 8 for a rotation
    }

    [[nodiscard]] GSH_HD vec3<T> operator()(const vec3<T>& v) const {
        const sym3<T>& a = adjugate;
        return vec3<T>(a.xx * v.x + a.xy * v.y + a.xz * v.z, a.xy * v.x + a.yy * v.y + a.yz * v.z,
                       a.xz * v.x + a.yz * v.y + a.zz * v.z) * inverse_determinant;
    }
};

/// Symmetric 4x4 matrix by its columns.
template <Lane T>
struct QuatForm {
    quat<T> w, x, y, z;

    [[nodiscard]] GSH_HD QuatForm squared() const {
        const T wx = dot(w, x), wy = dot(w, y), wz = dot(w, z), xy = dot(x, y), xz = dot(x, z), yz = dot(y, z);
        return {{dot(w, w), wx, wy, wz}, {wx, dot(x, x), xy, xz}, {wy, xy, dot(y, y), yz}, {wz, xz, yz, dot(z, z)}};
    }

    /// The column with the largest diagonal element.
    [[nodiscard]] GSH_HD quat<T> longest_column() const {
        quat<T> longest = w;
        T largest = w.w;
        const auto compare = [&](const quat<T>& q, T diagonal) {
            const MaskOf<T> larger = diagonal > largest;
            longest = {select(larger, q.w, longest.w), select(larger, q.x, longest.x), select(larger, q.y, longest.y),
                       select(larger, q.z, longest.z)};
            largest = select(larger, diagonal, largest);
        };
        compare(x, x.x), compare(y, y.y), compare(z, z.z);
        return longest;
    }
};

} // namespace detail

/// R = argmax tr(Rᵀ M) over rotations: the rotation nearest to M, and the factor R of M = R S with S symmetric.
///
/// With q the quaternion of R, tr(Rᵀ M) = qᵀ N q for a symmetric 4x4 matrix N, so q is the eigenvector of N's largest
/// eigenvalue. Six squarings of N + c I give a first estimate. Newton's method on the rotations refines it; each step
/// cubes the error.
///
/// R is a rotation for every finite M. If det M < 0, S has a negative eigenvalue. If several rotations are equally near
/// (M = 0, or two eigenvalues of S sum to zero, as in the even blend of opposite rotations), R is one of them. The
/// exact adjoint is unbounded there; the one computed here is bounded.
///
/// Near such a case, the iteration may end at another rotation: if the two smaller eigenvalues of S sum to less than
/// 0.03 of the largest. tr(Rᵀ M) is then up to 0.02 of the largest eigenvalue below its maximum.
///
/// Units   any: R does not depend on M's scale, and dL_dM is orthogonal to M.
/// Source  the 4x4 form: Davenport, 1968; for M = Σ w_i R_i, N + 1 is 4 Σ w_i q_i q_iᵀ, the matrix of Markley et al.,
///         "Averaging Quaternions", 2007. Squarings and Newton steps are our own.
template <Lane T>
class PolarRotation {
public:
    mat3<T> R;

    GSH_HD explicit PolarRotation(const mat3<T>& M)
        : PolarRotation(M, dot(M[0], M[0]) + dot(M[1], M[1]) + dot(M[2], M[2])) {}

    /// Adds to dL_dM. From Rᵀ dM = [ω]x S + dS, ω = K⁻¹ axial(Rᵀ dM): dL_dM = R [K⁻¹ axial(Rᵀ dL_dR)]x.
    GSH_HD void backward(const mat3<T>& dL_dR, mat3<T>& dL_dM) const {
        const vec3<T> u = response_(detail::axial(transpose(R) * dL_dR)) * scale_;
        dL_dM += mat3<T>(R[1] * u.z - R[2] * u.y, R[2] * u.x - R[0] * u.z, R[0] * u.y - R[1] * u.x);
    }

private:
    T scale_; // scales M to Frobenius norm sqrt(3), that of a rotation; 0 for M = 0
    detail::TurnResponse<T> response_;

    GSH_HD PolarRotation(const mat3<T>& M, T squared)
        : scale_(select(squared > T(1e-30), sqrt(T(3) / max(squared, T(1e-30))), T(0))),
          response_(nearest(M * scale_)) {}

    /// Sets R, and returns Rᵀ m.
    GSH_HD mat3<T> nearest(const mat3<T>& m) {
        // Let a >= b >= |c| be the eigenvalues of S. Those of N lie between c - a - b and a + b + c. A shift larger
        // than -c <= 1, here 3/2, makes the largest of them the largest in magnitude. The factor h keeps its powers
        // within the range of float.
        const T h = T(ScalarOf<T>(1 / 2.6)), shift = T(1.5) * h;
        const T xx = m[0].x * h, yy = m[1].y * h, zz = m[2].z * h;
        const vec3<T> a = detail::axial(m) * h;
        const T xy = (m[1].x + m[0].y) * h, xz = (m[2].x + m[0].z) * h, yz = (m[2].y + m[1].z) * h;
        detail::QuatForm<T> form{{shift + xx + yy + zz, a.x, a.y, a.z},
                                 {a.x, shift + xx - yy - zz, xy, xz},
                                 {a.y, xy, shift + yy - xx - zz, yz},
                                 {a.z, xz, yz, shift + zz - xx - yy}};
        for (int k = 0; k < 6; ++k) form = form.squared();
        quat<T> q = normalize(form.longest_column());
        constexpr int steps = sizeof(ScalarOf<T>) > 4 ? 3 : 2;
        for (int k = 0; k < steps; ++k) {
            const mat3<T> B = transpose(rotation_matrix(q)) * m;
            const vec3<T> t = detail::TurnResponse<T>(B)(detail::axial(B)) * T(0.5), v(q.x, q.y, q.z);
            const vec3<T> turned = v + t * q.w + cross(v, t);
            q = normalize(quat<T>{q.w - dot(v, t), turned.x, turned.y, turned.z});
        }
        R = rotation_matrix(q);
        return transpose(R) * m;
    }
};

/// The rotation nearest to M.
template <Lane T>
[[nodiscard]] GSH_HD mat3<T> polar_rotation(const mat3<T>& M) {
    return PolarRotation<T>(M).R;
}

/// Adjoint of polar_rotation: adds to dL_dM.
template <Lane T>
GSH_HD void polar_rotation_backward(const mat3<T>& M, const mat3<T>& dL_dR, mat3<T>& dL_dM) {
    PolarRotation<T>(M).backward(dL_dR, dL_dM);
}

} // namespace gsh
