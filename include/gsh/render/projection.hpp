// SPDX-License-Identifier: Apache-2.0
/// @file  EWA projection of a Gaussian from the world to the image plane.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/math/sym.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>

namespace gsh {

template <std::floating_point S>
struct ProjectionParams {
    S near_plane = S(0.2);              ///< metres; Gaussians that are not farther away are culled
    S dilation = S(0.3);                ///< px², added to both variances, so that no splat is thinner than a pixel
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
};

namespace detail {

/// Intermediate values of both passes: covariance = [a b]ᵀ Σ [a b] with the rows a, b of J R.
template <class T>
struct ProjectionFrame {
    vec3<T> p, row0, row1, row2;  // camera point; rows of R
    T inverse_z, x, y;            // x / z, y / z
    T jx, jy;                     // fx x / z, fy y / z, clamped for the Jacobian
    MaskOf<T> x_inside, y_inside; // of the clamp
    vec3<T> a, b, cov_a, cov_b;   // rows of J R; Σ a, Σ b
    MaskOf<T> in_front;

    template <class S>
    GSH_INLINE GSH_HD ProjectionFrame(const Camera<T>& camera, const vec3<T>& mean, const sym3<T>& s,
                           const ProjectionParams<S>& params) {
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
        cov_a = times(s, a);
        cov_b = times(s, b);
    }

private:
    GSH_HD static vec3<T> times(const sym3<T>& s, const vec3<T>& v) {
        return {s.xx * v.x + s.xy * v.y + s.xz * v.z, s.xy * v.x + s.yy * v.y + s.yz * v.z,
                s.xz * v.x + s.yz * v.y + s.zz * v.z};
    }
};

} // namespace detail

/// Projects the mean exactly and the covariance by the projection's Jacobian J at the mean:
/// covariance = J R Σ Rᵀ Jᵀ + dilation I, J = [fx 0 -jx; 0 fy -jy] / z, where jx, jy are fx x/z, fy y/z clamped to
/// the image widened by jacobian_margin on each side.
///
/// Frame   mean and covariance in the world; mean2d in pixels, the image's corner at (0, 0).
/// Source  Zwicker et al., "EWA Splatting", 2002; clamp and dilation as in Kerbl et al., "3D Gaussian Splatting",
///         2023, but with the principal point; opacity factor as in Yu et al., "Mip-Splatting", 2024.
template <Lane T>
[[nodiscard]] GSH_INLINE GSH_HD Projection<T>
project(const Camera<T>& camera, const vec3<T>& mean, const sym3<T>& covariance,
        const ProjectionParams<ScalarOf<T>>& params) {
    using S = ScalarOf<T>;
    const detail::ProjectionFrame<T> f(camera, mean, covariance, params);
    const sym2<T> sharp{dot(f.a, f.cov_a), dot(f.a, f.cov_b), dot(f.b, f.cov_b)};
    Projection<T> result;
    result.mean2d = vec2<T>(camera.fx * f.x + camera.cx, camera.fy * f.y + camera.cy);
    result.depth = f.p.z;
    result.covariance = {sharp.xx + T(params.dilation), sharp.xy, sharp.yy + T(params.dilation)};
    result.opacity_factor = T(S(1));
    result.in_front = f.in_front;
    if (params.compensate_opacity) {
        const T ratio = determinant(sharp) / determinant(result.covariance);
        result.opacity_factor = sqrt(max(ratio, T(params.compensation_floor)));
    }
    return result;
}

/// Adjoint of project for a Gaussian in front of the near plane: adds to dL_dmean, dL_dcovariance and, unless that is
/// null, to *dL_dcamera.
///
/// The clamp of the Jacobian passes no gradient except to the intrinsics that set its limits. The floor of the
/// compensation passes none. dL_dprojection.in_front is not read.
template <Lane T>
GSH_INLINE GSH_HD void project_backward(const Camera<T>& camera, const vec3<T>& mean, const sym3<T>& covariance,
                             const ProjectionParams<ScalarOf<T>>& params, const Projection<T>& dL_dprojection,
                             vec3<T>& dL_dmean, sym3<T>& dL_dcovariance, CameraGradient<T>* dL_dcamera = nullptr) {
    using S = ScalarOf<T>;
    const T zero(S(0)), two(S(2));
    const detail::ProjectionFrame<T> f(camera, mean, covariance, params);
    sym2<T> g = dL_dprojection.covariance;
    if (params.compensate_opacity) {
        const sym2<T> sharp{dot(f.a, f.cov_a), dot(f.a, f.cov_b), dot(f.b, f.cov_b)};
        const sym2<T> dilated{sharp.xx + T(params.dilation), sharp.xy, sharp.yy + T(params.dilation)};
        const T inverse_det = T(S(1)) / determinant(dilated), ratio = determinant(sharp) * inverse_det;
        const auto above = ratio > T(params.compensation_floor);
        const T dL_dratio =
            select(above, dL_dprojection.opacity_factor / (two * sqrt(max(ratio, T(params.compensation_floor)))), zero);
        const T to_sharp = dL_dratio * inverse_det, to_dilated = dL_dratio * ratio * inverse_det;
        g.xx += to_sharp * sharp.yy - to_dilated * dilated.yy;
        g.yy += to_sharp * sharp.xx - to_dilated * dilated.xx;
        g.xy -= two * (to_sharp - to_dilated) * sharp.xy;
    }

    // Covariance: to Σ and to the rows a, b.
    const vec3<T>&a = f.a, &b = f.b;
    dL_dcovariance += sym3<T>{
        g.xx * a.x * a.x + g.xy * a.x * b.x + g.yy * b.x * b.x,
        two * (g.xx * a.x * a.y + g.yy * b.x * b.y) + g.xy * (a.x * b.y + a.y * b.x),
        two * (g.xx * a.x * a.z + g.yy * b.x * b.z) + g.xy * (a.x * b.z + a.z * b.x),
        g.xx * a.y * a.y + g.xy * a.y * b.y + g.yy * b.y * b.y,
        two * (g.xx * a.y * a.z + g.yy * b.y * b.z) + g.xy * (a.y * b.z + a.z * b.y),
        g.xx * a.z * a.z + g.xy * a.z * b.z + g.yy * b.z * b.z};
    const vec3<T> dL_da = f.cov_a * (two * g.xx) + f.cov_b * g.xy, dL_db = f.cov_b * (two * g.yy) + f.cov_a * g.xy;

    // a = (fx R0 - jx R2) / z, b likewise.
    const vec3<T> dL_dalong_x = dL_da * f.inverse_z, dL_dalong_y = dL_db * f.inverse_z;
    const T dL_djx = -dot(dL_dalong_x, f.row2), dL_djy = -dot(dL_dalong_y, f.row2);

    // mean2d = (fx x + cx, fy y + cy); jx = fx x inside the clamp, else -cx and a constant.
    const T through_x = select(f.x_inside, dL_djx, zero), through_y = select(f.y_inside, dL_djy, zero);
    const T dL_dpx = dL_dprojection.mean2d.x + through_x, dL_dpy = dL_dprojection.mean2d.y + through_y;
    const T dL_dx = dL_dpx * camera.fx, dL_dy = dL_dpy * camera.fy;
    const T dL_dz = dL_dprojection.depth -
                    f.inverse_z * (dL_dx * f.x + dL_dy * f.y + dot(dL_da, a) + dot(dL_db, b));
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
