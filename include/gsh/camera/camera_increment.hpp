// SPDX-License-Identifier: Apache-2.0
/// @file  A small correction of a calibrated camera, with its adjoint.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>

namespace gsh {

/// An increment to a camera's parameters. A zero increment leaves the camera unchanged, bit for bit. A gradient with
/// respect to the parameters has the same type.
///
/// The camera rotates about a pivot in the scene, not about its own centre. A rotation then shows the subject from
/// another side, and a translation moves it in the image. About the camera's centre both would move the subject in the
/// image, so the two parameters would be nearly redundant.
///
/// Frame   rotation about the camera's axes, translation along them.
/// Units   radians, metres, logarithm of a factor on both focal lengths, pixels.
template <class T>
struct CameraIncrement {
    vec3<T> rotation = vec3<T>(T(0));
    vec3<T> translation = vec3<T>(T(0));
    T log_focal = T(0);
    vec2<T> principal_point = vec2<T>(T(0));
};

/// x_cam = exp(rotation) (R x + t - p) + p + translation with p = R pivot + t; f *= exp(log_focal);
/// c += principal_point.
template <Lane T>
[[nodiscard]] GSH_HD Camera<T> moved_camera(const Camera<T>& camera, const vec3<T>& pivot,
                                            const CameraIncrement<T>& increment) {
    const mat3<T> turn = rotation_from_axis_angle(increment.rotation);
    const vec3<T> from_pivot = -(camera.R * pivot); // t - p
    const T zoom = exp(increment.log_focal);
    Camera<T> moved = camera;
    moved.R = turn * camera.R;
    moved.t = camera.t + (turn * from_pivot - from_pivot) + increment.translation;
    moved.fx = camera.fx * zoom, moved.fy = camera.fy * zoom;
    moved.cx = camera.cx + increment.principal_point.x, moved.cy = camera.cy + increment.principal_point.y;
    return moved;
}

/// Adjoint of moved_camera with respect to the increment: adds to dL_dincrement.
template <Lane T>
GSH_HD void moved_camera_backward(const Camera<T>& camera, const vec3<T>& pivot, const CameraIncrement<T>& increment,
                                  const CameraGradient<T>& dL_dmoved, CameraIncrement<T>& dL_dincrement) {
    const mat3<T> dL_dturn = dL_dmoved.dL_dR * transpose(camera.R) - outer(dL_dmoved.dL_dt, camera.R * pivot);
    const T zoom = exp(increment.log_focal);
    rotation_from_axis_angle_backward(increment.rotation, dL_dturn, dL_dincrement.rotation);
    dL_dincrement.translation += dL_dmoved.dL_dt;
    dL_dincrement.log_focal += (dL_dmoved.dL_dfx * camera.fx + dL_dmoved.dL_dfy * camera.fy) * zoom;
    dL_dincrement.principal_point += vec2<T>(dL_dmoved.dL_dcx, dL_dmoved.dL_dcy);
}

namespace detail {

/// One camera, moved by its increment.
template <class T>
struct MovedCamera {
    Camera<T> initial;
    vec3<T> pivot;
    Span<const CameraIncrement<T>> increment;
    Span<Camera<T>> moved;  // [1]
    Span<vec3<T>> center;   // [1]
    GSH_HD void operator()(std::size_t) const {
        moved[0] = moved_camera(initial, pivot, increment[0]);
        center[0] = moved[0].center();
    }
};

/// One camera: gradients of the camera and of its centre become the gradient of its increment.
template <class T>
struct MovedCameraBackward {
    Camera<T> initial;
    vec3<T> pivot;
    Span<const CameraIncrement<T>> increment;
    Span<const CameraGradient<T>> dL_dcamera;
    Span<const vec3<T>> dL_dcenter; // or empty
    Span<CameraIncrement<T>> dL_dincrement;
    GSH_HD void operator()(std::size_t) const {
        CameraGradient<T> dL_dmoved = dL_dcamera[0];
        if (!dL_dcenter.empty()) center_backward(moved_camera(initial, pivot, increment[0]), dL_dcenter[0], dL_dmoved);
        moved_camera_backward(initial, pivot, increment[0], dL_dmoved, dL_dincrement[0]);
    }
};

} // namespace detail

} // namespace gsh
