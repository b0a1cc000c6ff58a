// SPDX-License-Identifier: Apache-2.0
/// @file  EWA projection of a Gaussian from the world to the image plane.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/math/sym.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>

namespace gsh {

template <std::floating_point S>
struct ProjectionParams {
    S near_plane = S(0.2);              ///< metres; Gaussians that are not farther away are culled
    S dilation = S(PixelFilter().dilation); ///< px², added to both variances, so that no splat is thinner than a pixel
    S jacobian_margin = S(0.15);        ///< of the image size, on each side: the Jacobian is clamped beyond it
    bool compensate_opacity = false;    ///< anti-aliasing: opacity is lowered so that dilation adds no total weight
    S compensation_floor = S(0.000025); ///< lower limit of the ratio of determinants

    template <std::floating_point U>
    [[nodiscard]] ProjectionParams<U> cast() const {
        return {U(near_plane), U(dilation), U(jacobian_margin), compensate_opacity, U(compensation_floor)};
    }
};

/// A Gaussian on the image plane.
template <class T>
struct Projection {
    vec2<T> mean2d;       ///< pixels
    T depth;              ///< camera z, metres
    sym2<T> covariance;   ///< px², dilated
    T opacity_factor;     ///< sqrt(max(floor, det before / det after dilation)) if compensated, else 1
    MaskOf<T> in_front;   ///< beyond the near plane; elsewhere the other members are meaningless
    T determinant;        ///< of the covariance; not read in a gradient
};

namespace detail {

/// Intermediate values of both passes: mean, and the rows a, b of J R.
template <class T>
struct ProjectionFrame {
    vec3<T> p, row0, row1, row2;  // camera point; rows of R
    T inverse_z, x, y;            // x / z, y / z
    T jx, jy;                     // fx x / z, fy y / z, clamped for the Jacobian
    MaskOf<T> x_inside, y_inside; // of the clamp
    vec3<T> a, b;                 // rows of J R
    MaskOf<T> in_front;

    template <class S>
    GSH_INLINE GSH_HD ProjectionFrame(const Camera<T>& camera, const vec3<T>& mean, const ProjectionParams<S>& params) {
        p = to_camera(camera, mean);
        in_front = p.z > T(params.near_plane);
        // Behind the plane, this avoids a division by zero. A backend may decide in_front in higher precision than the
        // adjoint, which then must not differ for a splat that lies within rounding of the plane.
        p.z = max(p.z, T(params.near_plane));
        inverse_z = T(S(1)) / p.z;
        x = p.x * inverse_z;
        y = p.y * inverse_z;
        // The clamp acts on pixels relative to the principal point, where its limits need no division.
        const T width(S(camera.width)), height(S(camera.height)), margin(params.jacobian_margin);
        const T left = -camera.cx - margin * width, right = width - camera.cx + margin * width;
        const T top = -camera.cy - margin * height, bottom = height - camera.cy + margin * height;
        const T px = camera.fx * x, py = camera.fy * y;
        const MaskOf<T> from_left = px >= left, to_right = px <= right, from_top = py >= top, to_bottom = py <= bottom;
        x_inside = from_left & to_right;
        y_inside = from_top & to_bottom;
        jx = min(max(px, left), right);
        jy = min(max(py, top), bottom);

        row0 = vec3<T>(camera.R[0].x, camera.R[1].x, camera.R[2].x);
        row1 = vec3<T>(camera.R[0].y, camera.R[1].y, camera.R[2].y);
        row2 = vec3<T>(camera.R[0].z, camera.R[1].z, camera.R[2].z);
        a = (row0 * camera.fx - row2 * jx) * inverse_z;
        b = (row1 * camera.fy - row2 * jy) * inverse_z;
    }
};

/// The shape on the image of a covariance Σ: [a b]ᵀ Σ [a b].
template <class T>
struct CovarianceShape {
    vec3<T> a, b, cov_a, cov_b; // cov_a: Σ a
    sym2<T> sharp;              // before dilation

    GSH_INLINE GSH_HD CovarianceShape(const ProjectionFrame<T>& f, const sym3<T>& s)
        : a(f.a), b(f.b), cov_a(times(s, a)), cov_b(times(s, b)), sharp{dot(a, cov_a), dot(a, cov_b), dot(b, cov_b)} {}

    [[nodiscard]] GSH_INLINE GSH_HD T sharp_determinant() const { return determinant(sharp); }
    [[nodiscard]] GSH_INLINE GSH_HD T dilated_determinant(T dilation) const {
        return determinant(sym2<T>{sharp.xx + dilation, sharp.xy, sharp.yy + dilation});
    }

    /// Adjoint, given the gradient g of the covariance and those of both determinants: adds to dL_ds, and returns that
    /// of the rows a, b.
    GSH_INLINE GSH_HD void backward(sym2<T> g, T dL_dsharp_det, T dL_ddilated_det, T dilation, sym3<T>& dL_ds,
                                    vec3<T>& dL_da, vec3<T>& dL_db) const {
        const T two(ScalarOf<T>(2));
        g.xx += dL_dsharp_det * sharp.yy + dL_ddilated_det * (sharp.yy + dilation);
        g.yy += dL_dsharp_det * sharp.xx + dL_ddilated_det * (sharp.xx + dilation);
        g.xy -= two * (dL_dsharp_det + dL_ddilated_det) * sharp.xy;
        backward(g, dL_ds, dL_da, dL_db);
    }
    GSH_INLINE GSH_HD void backward(const sym2<T>& g, sym3<T>& dL_ds, vec3<T>& dL_da, vec3<T>& dL_db) const {
        const T two(ScalarOf<T>(2));
        dL_ds += sym3<T>{g.xx * a.x * a.x + g.xy * a.x * b.x + g.yy * b.x * b.x,
                         two * (g.xx * a.x * a.y + g.yy * b.x * b.y) + g.xy * (a.x * b.y + a.y * b.x),
                         two * (g.xx * a.x * a.z + g.yy * b.x * b.z) + g.xy * (a.x * b.z + a.z * b.x),
                         g.xx * a.y * a.y + g.xy * a.y * b.y + g.yy * b.y * b.y,
                         two * (g.xx * a.y * a.z + g.yy * b.y * b.z) + g.xy * (a.y * b.z + a.z * b.y),
                         g.xx * a.z * a.z + g.xy * a.z * b.z + g.yy * b.z * b.z};
        dL_da = cov_a * (two * g.xx) + cov_b * g.xy;
        dL_db = cov_b * (two * g.yy) + cov_a * g.xy;
    }

private:
    GSH_HD static vec3<T> times(const sym3<T>& s, const vec3<T>& v) {
        return {s.xx * v.x + s.xy * v.y + s.xz * v.z, s.xy * v.x + s.yy * v.y + s.yz * v.z,
                s.xz * v.x + s.yz * v.y + s.zz * v.z};
    }
};

/// The shape on the image of a factor F with Σ = F Fᵀ: [u v]ᵀ [u v] with u = Fᵀ a, v = Fᵀ b. Its determinant |u × v|²
/// loses no more digits than the splat is elongated; xx yy - xy², from the covariance, loses the square of that.
template <class T>
struct FactorShape {
    vec3<T> a, b, u, v, normal; // normal: u × v
    mat3<T> F;
    sym2<T> sharp;

    GSH_INLINE GSH_HD FactorShape(const ProjectionFrame<T>& f, const mat3<T>& factor)
        : a(f.a), b(f.b), u(transposed_times(factor, a)), v(transposed_times(factor, b)), normal(cross(u, v)),
          F(factor), sharp{dot(u, u), dot(u, v), dot(v, v)} {}

    [[nodiscard]] GSH_INLINE GSH_HD T sharp_determinant() const { return dot(normal, normal); }
    [[nodiscard]] GSH_INLINE GSH_HD T dilated_determinant(T dilation) const {
        return dot(normal, normal) + dilation * (sharp.xx + sharp.yy + dilation);
    }

    /// As for CovarianceShape; adds to dL_dF.
    GSH_INLINE GSH_HD void backward(const sym2<T>& g, T dL_dsharp_det, T dL_ddilated_det, T dilation, mat3<T>& dL_dF,
                                    vec3<T>& dL_da, vec3<T>& dL_db) const {
        const T two(ScalarOf<T>(2)), to_normal = two * (dL_dsharp_det + dL_ddilated_det),
                                     to_lengths = two * dilation * dL_ddilated_det;
        add(g, u * to_lengths + cross(v, normal) * to_normal, v * to_lengths + cross(normal, u) * to_normal, dL_dF,
            dL_da, dL_db);
    }
    GSH_INLINE GSH_HD void backward(const sym2<T>& g, mat3<T>& dL_dF, vec3<T>& dL_da, vec3<T>& dL_db) const {
        const vec3<T> none(T(ScalarOf<T>(0)));
        add(g, none, none, dL_dF, dL_da, dL_db);
    }

private:
    /// With what reaches u and v through the determinants.
    GSH_INLINE GSH_HD void add(const sym2<T>& g, const vec3<T>& other_u, const vec3<T>& other_v, mat3<T>& dL_dF,
                               vec3<T>& dL_da, vec3<T>& dL_db) const {
        const T two(ScalarOf<T>(2));
        const vec3<T> dL_du = u * (two * g.xx) + v * g.xy + other_u, dL_dv = v * (two * g.yy) + u * g.xy + other_v;
        dL_dF += outer(a, dL_du) + outer(b, dL_dv);
        dL_da = F * dL_du;
        dL_db = F * dL_dv;
    }
};

template <class T>
[[nodiscard]] GSH_INLINE GSH_HD CovarianceShape<T> shape_of(const ProjectionFrame<T>& f, const sym3<T>& s) {
    return {f, s};
}
template <class T>
[[nodiscard]] GSH_INLINE GSH_HD FactorShape<T> shape_of(const ProjectionFrame<T>& f, const mat3<T>& factor) {
    return {f, factor};
}

} // namespace detail

/// Projects the mean exactly and the shape by the projection's Jacobian J at the mean:
/// covariance = J R Σ Rᵀ Jᵀ + dilation I, J = [fx 0 -jx; 0 fy -jy] / z, where jx, jy are fx x/z, fy y/z clamped to
/// the image widened by jacobian_margin on each side. `shape` is Σ, as a sym3, or a factor F of Σ = F Fᵀ, as a mat3.
///
/// Frame   mean and shape in the world; mean2d in pixels, the image's corner at (0, 0).
/// Source  Zwicker et al., "EWA Splatting", 2002; clamp and dilation as in Kerbl et al., "3D Gaussian Splatting",
///         2023, but with the principal point; opacity factor as in Yu et al., "Mip-Splatting", 2024.
template <Lane T, class Shape>
[[nodiscard]] GSH_INLINE GSH_HD Projection<T> project(const Camera<T>& camera, const vec3<T>& mean, const Shape& shape,
                                                      const ProjectionParams<ScalarOf<T>>& params) {
    using S = ScalarOf<T>;
    const detail::ProjectionFrame<T> f(camera, mean, params);
    const auto on_image = detail::shape_of(f, shape);
    const sym2<T>& sharp = on_image.sharp;
    Projection<T> result;
    result.mean2d = vec2<T>(camera.fx * f.x + camera.cx, camera.fy * f.y + camera.cy);
    result.depth = f.p.z;
    result.covariance = {sharp.xx + T(params.dilation), sharp.xy, sharp.yy + T(params.dilation)};
    result.determinant = on_image.dilated_determinant(T(params.dilation));
    result.opacity_factor = T(S(1));
    result.in_front = f.in_front;
    if (params.compensate_opacity) {
        const T ratio = on_image.sharp_determinant() / result.determinant;
        result.opacity_factor = sqrt(max(ratio, T(params.compensation_floor)));
    }
    return result;
}

/// Adjoint of project for a Gaussian in front of the near plane: adds to dL_dmean, dL_dshape and, unless that is null,
/// to *dL_dcamera.
///
/// The clamp of the Jacobian passes no gradient except to the intrinsics that set its limits. The floor of the
/// compensation passes none. dL_dprojection.in_front and determinant are not read.
template <Lane T, class Shape>
GSH_INLINE GSH_HD void project_backward(const Camera<T>& camera, const vec3<T>& mean, const Shape& shape,
                                        const ProjectionParams<ScalarOf<T>>& params,
                                        const Projection<T>& dL_dprojection, vec3<T>& dL_dmean, Shape& dL_dshape,
                                        CameraGradient<T>* dL_dcamera = nullptr) {
    using S = ScalarOf<T>;
    const T zero(S(0)), two(S(2));
    const detail::ProjectionFrame<T> f(camera, mean, params);
    const auto on_image = detail::shape_of(f, shape);
    vec3<T> dL_da, dL_db;
    if (params.compensate_opacity) {
        const T dilation(params.dilation), inverse_det = T(S(1)) / on_image.dilated_determinant(dilation),
                                           ratio = on_image.sharp_determinant() * inverse_det;
        const auto above = ratio > T(params.compensation_floor);
        const T dL_dratio =
            select(above, dL_dprojection.opacity_factor / (two * sqrt(max(ratio, T(params.compensation_floor)))), zero);
        const T to_sharp = dL_dratio * inverse_det, to_dilated = dL_dratio * ratio * inverse_det;
        on_image.backward(dL_dprojection.covariance, to_sharp, -to_dilated, dilation, dL_dshape, dL_da, dL_db);
    } else {
        on_image.backward(dL_dprojection.covariance, dL_dshape, dL_da, dL_db);
    }

    // a = (fx R0 - jx R2) / z, b likewise.
    const vec3<T> dL_dalong_x = dL_da * f.inverse_z, dL_dalong_y = dL_db * f.inverse_z;
    const T dL_djx = -dot(dL_dalong_x, f.row2), dL_djy = -dot(dL_dalong_y, f.row2);

    // mean2d = (fx x + cx, fy y + cy); jx = fx x inside the clamp, else -cx and a constant.
    const T through_x = select(f.x_inside, dL_djx, zero), through_y = select(f.y_inside, dL_djy, zero);
    const T dL_dpx = dL_dprojection.mean2d.x + through_x, dL_dpy = dL_dprojection.mean2d.y + through_y;
    const T dL_dx = dL_dpx * camera.fx, dL_dy = dL_dpy * camera.fy;
    const T dL_dz =
        dL_dprojection.depth - f.inverse_z * (dL_dx * f.x + dL_dy * f.y + dot(dL_da, f.a) + dot(dL_db, f.b));
    const vec3<T> dL_dp(dL_dx * f.inverse_z, dL_dy * f.inverse_z, dL_dz);
    dL_dmean += f.row0 * dL_dp.x + f.row1 * dL_dp.y + f.row2 * dL_dp.z;
    if (dL_dcamera == nullptr) return;

    dL_dcamera->dL_dR += outer(dL_dp, mean) + transpose(mat3<T>(dL_dalong_x * camera.fx, dL_dalong_y * camera.fy,
                                                                -(dL_dalong_x * f.jx + dL_dalong_y * f.jy)));
    dL_dcamera->dL_dt += dL_dp;
    dL_dcamera->dL_dfx += dL_dpx * f.x + dot(dL_dalong_x, f.row0);
    dL_dcamera->dL_dfy += dL_dpy * f.y + dot(dL_dalong_y, f.row1);
    dL_dcamera->dL_dcx += dL_dpx - dL_djx;
    dL_dcamera->dL_dcy += dL_dpy - dL_djy;
}

} // namespace gsh
