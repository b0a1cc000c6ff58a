// SPDX-License-Identifier: Apache-2.0
/// @file  Lens distortion after Brown and Conrady: forward, adjoint, inverse, and the map that undistorts an image.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <string>
#include <string_view>

namespace gsh {

/// Distortion coefficients. A normalised image point (x, y) = (X/Z, Y/Z), with r² = x² + y², is mapped to
///
///     x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²)
///     y' = y (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2 y²) + 2 p2 x y
///
/// Source  Brown, "Close-Range Camera Calibration", 1971; order k1, k2, p1, p2, k3 as OpenCV stores it.
template <class T>
struct Distortion {
    T k1 = T(0), k2 = T(0), p1 = T(0), p2 = T(0), k3 = T(0);
};

/// The distorted position of an ideal normalised point.
template <Lane T>
[[nodiscard]] GSH_HD vec2<T> distort(const Distortion<T>& d, const vec2<T>& p) {
    const T xx = p.x * p.x, yy = p.y * p.y, xy = p.x * p.y, r2 = xx + yy;
    const T radial = T(1) + r2 * (d.k1 + r2 * (d.k2 + r2 * d.k3));
    return {p.x * radial + T(2) * d.p1 * xy + d.p2 * (r2 + T(2) * xx),
            p.y * radial + d.p1 * (r2 + T(2) * yy) + T(2) * d.p2 * xy};
}

/// Partial derivatives of distort: dx'/dx, dx'/dy = dy'/dx (the model's Jacobian is symmetric), dy'/dy.
template <Lane T>
struct DistortionJacobian {
    T xx, xy, yy;
};
template <Lane T>
[[nodiscard]] GSH_HD DistortionJacobian<T> distort_jacobian(const Distortion<T>& d, const vec2<T>& p) {
    const T r2 = p.x * p.x + p.y * p.y;
    const T radial = T(1) + r2 * (d.k1 + r2 * (d.k2 + r2 * d.k3));
    const T twice_slope = T(2) * (d.k1 + r2 * (T(2) * d.k2 + r2 * T(3) * d.k3)); // 2 dradial/dr²
    return {radial + twice_slope * p.x * p.x + T(2) * d.p1 * p.y + T(6) * d.p2 * p.x,
            twice_slope * p.x * p.y + T(2) * d.p1 * p.x + T(2) * d.p2 * p.y,
            radial + twice_slope * p.y * p.y + T(6) * d.p1 * p.y + T(2) * d.p2 * p.x};
}

/// Adjoint of distort: adds to dL_dp and to each coefficient of dL_dd.
template <Lane T>
GSH_HD void distort_backward(const Distortion<T>& d, const vec2<T>& p, const vec2<T>& dL_dout, vec2<T>& dL_dp,
                             Distortion<T>& dL_dd) {
    const DistortionJacobian<T> J = distort_jacobian(d, p);
    dL_dp += vec2<T>(J.xx * dL_dout.x + J.xy * dL_dout.y, J.xy * dL_dout.x + J.yy * dL_dout.y);

    const T xx = p.x * p.x, yy = p.y * p.y, xy = p.x * p.y, r2 = xx + yy;
    const T along = p.x * dL_dout.x + p.y * dL_dout.y;
    dL_dd.k1 += along * r2;
    dL_dd.k2 += along * r2 * r2;
    dL_dd.k3 += along * r2 * r2 * r2;
    dL_dd.p1 += T(2) * xy * dL_dout.x + (r2 + T(2) * yy) * dL_dout.y;
    dL_dd.p2 += (r2 + T(2) * xx) * dL_dout.x + T(2) * xy * dL_dout.y;
}

/// An undistorted point and its residual |distort(point) - input|, in normalised units.
template <Lane T>
struct Undistorted {
    vec2<T> point;
    T residual;
};

/// The ideal point whose distorted position is `distorted`. Newton's method starts at `distorted` and takes ten steps
/// for every element. Outside the region in which the model is one to one, the residual stays large or is NaN.
template <Lane T>
[[nodiscard]] GSH_HD Undistorted<T> undistort(const Distortion<T>& d, const vec2<T>& distorted) {
    vec2<T> p = distorted;
    for (int step = 0; step < 10; ++step) {
        const vec2<T> e = distort(d, p) - distorted;
        const DistortionJacobian<T> J = distort_jacobian(d, p);
        const T inverse_determinant = T(1) / (J.xx * J.yy - J.xy * J.xy);
        p -= vec2<T>((J.yy * e.x - J.xy * e.y) * inverse_determinant, (J.xx * e.y - J.xy * e.x) * inverse_determinant);
    }
    const vec2<T> e = distort(d, p) - distorted;
    return {p, sqrt(e.x * e.x + e.y * e.y)};
}

/// undistort with a check: throws ValueError unless the residual is within `tolerance` (normalised units) and the
/// Jacobian is positive definite, as it is on the branch that contains the image's centre.
template <std::floating_point T>
[[nodiscard]] vec2<T> undistort_checked(const Distortion<T>& d, const vec2<T>& distorted, T tolerance = T(1e-6)) {
    const Undistorted<T> result = undistort(d, distorted);
    const DistortionJacobian<T> J = distort_jacobian(d, result.point);
    const bool same_sheet = J.xx > T(0) && J.xx * J.yy - J.xy * J.xy > T(0);
    check_value(result.residual <= tolerance && same_sheet, "undistort_checked", // false for NaN
                "the distortion has no inverse at (" + detail::number_text(distorted.x) + ", " +
                    detail::number_text(distorted.y) + "), residual " + detail::number_text(result.residual) +
                    "; check the coefficients' order (k1, k2, p1, p2, k3) and signs");
    return result.point;
}

/// Maps a pixel of the undistorted image to a pixel of the photograph; pass it to resample (image/resample.hpp).
/// `straight` and `photographed` may differ in intrinsics and size. Their extrinsics are not used.
template <Lane T>
struct UndistortMap {
    Camera<T> straight, photographed;
    Distortion<T> distortion;

    [[nodiscard]] GSH_HD vec2<T> operator()(const vec2<T>& pixel) const {
        const vec2<T> p((pixel.x - straight.cx) / straight.fx, (pixel.y - straight.cy) / straight.fy);
        const vec2<T> q = distort(distortion, p);
        return {photographed.fx * q.x + photographed.cx, photographed.fy * q.y + photographed.cy};
    }
};

/// Throws ValueError unless the coefficients are finite and the model is one to one over the whole image. The test is a
/// positive definite Jacobian on a grid that covers the undistorted image and its border.
template <std::floating_point T>
void check_distortion(std::string_view where, std::string_view name, const Camera<T>& straight,
                      const Distortion<T>& d) {
    const T numbers[] = {d.k1, d.k2, d.p1, d.p2, d.k3};
    check_finite(where, std::string(name) + ".distortion", Span<const T>(numbers));
    constexpr int steps = 32;
    for (int j = 0; j <= steps; ++j)
        for (int i = 0; i <= steps; ++i) {
            const T u = T(straight.width) * T(i) / T(steps), v = T(straight.height) * T(j) / T(steps);
            const vec2<T> p((u - straight.cx) / straight.fx, (v - straight.cy) / straight.fy);
            const DistortionJacobian<T> J = distort_jacobian(d, p);
            check_value(J.xx > T(0) && J.xx * J.yy - J.xy * J.xy > T(0), where,
                        std::string(name) + " has a distortion that folds the image over at pixel (" +
                            detail::number_text(u) + ", " + detail::number_text(v) +
                            "); check the coefficients' order (k1, k2, p1, p2, k3) and signs");
        }
}

} // namespace gsh
