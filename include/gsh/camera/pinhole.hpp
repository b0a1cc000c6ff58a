// SPDX-License-Identifier: Apache-2.0
/// @file  The pinhole camera: extrinsics, intrinsics with principal point, projection and its adjoint.
#pragma once

#include <gsh/math/vec.hpp>

namespace gsh {

/// A calibrated camera, x_cam = R x_world + t, pixel = (fx x/z + cx, fy y/z + cy).
///
/// Frame   camera x right, y down, z forward (OpenCV); the image's corner is (0, 0), its first pixel's centre (0.5, 0.5).
/// Units   metres; pixels.
template <class T>
struct Camera {
    mat3<T> R = mat3<T>(T(1));
    vec3<T> t = vec3<T>(T(0));
    T fx = T(1), fy = T(1), cx = T(0), cy = T(0);
    int width = 0, height = 0;

    /// The optical centre in the world, -Rᵀ t.
    [[nodiscard]] GSH_HD vec3<T> center() const { return -transposed_times(R, t); }

    template <class U>
    [[nodiscard]] Camera<U> cast() const {
        return {mat3<U>(R), vec3<U>(t), U(fx), U(fy), U(cx), U(cy), width, height};
    }
};

/// Gradient with respect to a camera's numbers; the nine of R count as independent.
template <class T>
struct CameraGradient {
    mat3<T> dL_dR = mat3<T>(T(0));
    vec3<T> dL_dt = vec3<T>(T(0));
    T dL_dfx = T(0), dL_dfy = T(0), dL_dcx = T(0), dL_dcy = T(0);

    GSH_HD CameraGradient& operator+=(const CameraGradient& o) {
        dL_dR += o.dL_dR;
        dL_dt += o.dL_dt;
        dL_dfx += o.dL_dfx, dL_dfy += o.dL_dfy, dL_dcx += o.dL_dcx, dL_dcy += o.dL_dcy;
        return *this;
    }
};

/// World point in camera coordinates.
template <Lane T>
[[nodiscard]] GSH_HD vec3<T> to_camera(const Camera<T>& camera, const vec3<T>& point) {
    return camera.R * point + camera.t;
}

/// Camera point (z > 0) to pixel coordinates.
template <Lane T>
[[nodiscard]] GSH_HD vec2<T> to_pixel(const Camera<T>& camera, const vec3<T>& p) {
    const T inverse_z = T(1) / p.z;
    return {camera.fx * p.x * inverse_z + camera.cx, camera.fy * p.y * inverse_z + camera.cy};
}

/// Adjoint of to_pixel: adds to dL_dp and to the intrinsics of dL_dcamera.
template <Lane T>
GSH_HD void to_pixel_backward(const Camera<T>& camera, const vec3<T>& p, const vec2<T>& dL_dpixel, vec3<T>& dL_dp,
                              CameraGradient<T>& dL_dcamera) {
    const T inverse_z = T(1) / p.z, x = p.x * inverse_z, y = p.y * inverse_z;
    const T dL_dx = camera.fx * dL_dpixel.x, dL_dy = camera.fy * dL_dpixel.y;
    dL_dp += vec3<T>(dL_dx * inverse_z, dL_dy * inverse_z, -(dL_dx * x + dL_dy * y) * inverse_z);
    dL_dcamera.dL_dfx += dL_dpixel.x * x;
    dL_dcamera.dL_dfy += dL_dpixel.y * y;
    dL_dcamera.dL_dcx += dL_dpixel.x;
    dL_dcamera.dL_dcy += dL_dpixel.y;
}

/// Adjoint of to_camera: adds to dL_dpoint and to the extrinsics of dL_dcamera.
template <Lane T>
GSH_HD void to_camera_backward(const Camera<T>& camera, const vec3<T>& point, const vec3<T>& dL_dp,
                               vec3<T>& dL_dpoint, CameraGradient<T>& dL_dcamera) {
    dL_dpoint += transposed_times(camera.R, dL_dp);
    dL_dcamera.dL_dR += outer(dL_dp, point);
    dL_dcamera.dL_dt += dL_dp;
}

/// Adjoint of Camera::center: adds to the extrinsics of dL_dcamera.
template <Lane T>
GSH_HD void center_backward(const Camera<T>& camera, const vec3<T>& dL_dcenter, CameraGradient<T>& dL_dcamera) {
    dL_dcamera.dL_dR -= outer(camera.t, dL_dcenter);
    dL_dcamera.dL_dt -= camera.R * dL_dcenter;
}

} // namespace gsh
