// SPDX-License-Identifier: Apache-2.0
/// @file  The pinhole camera: extrinsics, intrinsics with principal point, projection and its adjoint.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/math/vec.hpp>

#include <cmath>
#include <concepts>
#include <string>
#include <string_view>

namespace gsh {

/// A calibrated camera, x_cam = R x_world + t, pixel = (fx x/z + cx, fy y/z + cy).
///
/// Frame   camera x right, y down, z forward (OpenCV); the image's corner is (0, 0), the centre of the first pixel is
///         (0.5, 0.5).
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
    [[nodiscard]] GSH_HD Camera<U> cast() const {
        return {mat3<U>(R), vec3<U>(t), U(fx), U(fy), U(cx), U(cy), width, height};
    }
};

/// Gradient with respect to a camera's parameters; the nine entries of R count as independent.
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

/// The camera of an image reduced by averaging factor x factor pixels. Incomplete blocks at the right and at the bottom
/// are dropped.
[[nodiscard]] inline Camera<double> reduced_camera(Camera<double> camera, int factor) {
    camera.fx /= factor, camera.fy /= factor, camera.cx /= factor, camera.cy /= factor;
    camera.width /= factor, camera.height /= factor;
    return camera;
}

/// World point in camera coordinates.
template <Lane T>
[[nodiscard]] GSH_HD vec3<T> to_camera(const Camera<T>& camera, const vec3<T>& point) {
    return camera.R * point + camera.t;
}

/// Projects a camera-space point (z > 0) to pixel coordinates.
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

/// Throws ValueError unless every number is finite, R is a rotation, the focal lengths are positive and the image has a
/// size. `where` and `name` appear in the message. The tolerance on R allows for matrices printed with four digits.
template <std::floating_point T>
void check_camera(std::string_view where, std::string_view name, const Camera<T>& camera) {
    const auto require = [&](bool condition, const std::string& what) {
        check_value(condition, where, std::string(name) + ' ' + what);
    };
    const auto number = [](T x) { return detail::number_text(x); };
    const T numbers[] = {camera.fx, camera.fy, camera.cx, camera.cy, camera.t.x, camera.t.y, camera.t.z};
    for (const T x : numbers)
        require(std::isfinite(x), "holds a NaN or an infinity in K or t, expected finite numbers");
    require(camera.fx > T(0) && camera.fy > T(0),
            "has focal lengths fx = " + number(camera.fx) + ", fy = " + number(camera.fy) +
                ", expected both above 0 (a zero makes K singular); give them in pixels");
    require(camera.width > 0 && camera.height > 0, "has an image of " + std::to_string(camera.width) + " x " +
                                                       std::to_string(camera.height) +
                                                       " pixels, expected at least 1 x 1");
    bool orthonormal = determinant(camera.R) > T(0); // false for NaN, as all comparisons below
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            orthonormal = orthonormal && abs(dot(camera.R[i], camera.R[j]) - T(i == j)) < T(1e-3);
    require(orthonormal, "has an R that is not a rotation (orthonormal, determinant +1); x_cam = R x_world + t");
}

/// A camera from the usual 3x3 intrinsic matrix.
///
/// Shapes  K [9], row-major: fx 0 cx, 0 fy cy, 0 0 1; a common factor other than 1 is divided out.
/// Errors  ShapeError for another size; ValueError for a singular K, for skew, and for whatever check_camera rejects.
///         Messages begin with `name`, such as a file and the camera in it.
template <std::floating_point T>
[[nodiscard]] Camera<T> camera_from_K(Span<const T> K, const mat3<T>& R, const vec3<T>& t, int width, int height,
                                      std::string_view name = "camera_from_K: camera") {
    check_size(name, "K", K.size(), 9, "give the 3x3 matrix row by row");
    check_finite(name, "K", K);
    const T scale = K[8], tolerance = T(1e-6) * max(abs(K[0]), abs(K[4]));
    check_value(scale != T(0) && K[0] != T(0) && K[4] != T(0), name,
                "K is singular: its diagonal is " + detail::number_text(K[0]) + ", " + detail::number_text(K[4]) +
                    ", " + detail::number_text(K[8]) + ", expected fx, fy, 1");
    check_value(abs(K[1]) <= tolerance, name,
                "K has skew " + detail::number_text(K[1]) + ", expected 0; resample the image to square its axes");
    check_value(K[3] == T(0) && K[6] == T(0) && K[7] == T(0), name,
                "K has a number other than 0 below its diagonal; give it row by row");
    const Camera<T> camera{R, t, K[0] / scale, K[4] / scale, K[2] / scale, K[5] / scale, width, height};
    check_camera(name, "the camera", camera);
    return camera;
}

/// A camera at `eye` that looks at `target`. The principal point is the image's centre; `up` points up in the image.
///
/// Units   vertical_fov in radians.
/// Errors  ValueError where the direction is undefined or parallel to up, or the field of view is not in (0, pi).
template <std::floating_point T>
[[nodiscard]] Camera<T> look_at(const vec3<T>& eye, const vec3<T>& target, const vec3<T>& up, T vertical_fov, int width,
                                int height) {
    const vec3<T> forward = target - eye;
    const vec3<T> right = cross(forward, up);
    check_value(length(right) > T(1e-6) * length(forward) * length(up), "look_at",
                "target - eye is zero or parallel to up; choose another up");
    check_value(vertical_fov > T(0) && vertical_fov < T(3.14159265), "look_at",
                "vertical_fov is " + detail::number_text(vertical_fov) + ", expected radians in (0, pi)");
    const vec3<T> z = normalize(forward), x = normalize(right), y = cross(z, x);
    Camera<T> camera;
    camera.R = transpose(mat3<T>(x, y, z));
    camera.t = -(camera.R * eye);
    camera.fx = camera.fy = T(height) / (T(2) * std::tan(vertical_fov / T(2)));
    camera.cx = T(width) / T(2), camera.cy = T(height) / T(2);
    camera.width = width, camera.height = height;
    check_camera("look_at", "camera", camera);
    return camera;
}

/// A camera that sees a whole sphere. It is placed from `center` in the direction `from_center`.
template <std::floating_point T>
[[nodiscard]] Camera<T> frame_sphere(const vec3<T>& center, T radius, const vec3<T>& from_center, const vec3<T>& up,
                                     T vertical_fov, int width, int height) {
    check_value(radius > T(0), "frame_sphere",
                "radius is " + detail::number_text(radius) + ", expected metres above 0");
    check_value(width > 0 && height > 0, "frame_sphere", "the image has no pixels; give a width and a height above 0");
    const T aspect = min(T(1), T(width) / T(height)); // a tall image is limited by its width
    const T half_angle = std::atan(std::tan(vertical_fov / T(2)) * aspect);
    const T distance = radius / std::sin(half_angle);
    return look_at(center + normalize(from_center) * distance, center, up, vertical_fov, width, height);
}

} // namespace gsh
