// SPDX-License-Identifier: Apache-2.0
/// @file  A list of all per-element functions, each from plain numbers to plain numbers. One test uses it to compare
///        SIMD lanes with scalars, another to compare a device with the host.
#pragma once

#include <gsh/avatar/skinned_splats.hpp>
#include <gsh/body/skeleton.hpp>
#include <gsh/camera/camera_increment.hpp>
#include <gsh/camera/distortion.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/field/frequency.hpp>
#include <gsh/field/hash_grid.hpp>
#include <gsh/gaussian/covariance.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/gaussian/static_gaussian.hpp>
#include <gsh/image/color.hpp>
#include <gsh/light/lit_element.hpp>
#include <gsh/loss/ssim.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/dual_quat.hpp>
#include <gsh/math/polar.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/rotation_increment.hpp>
#include <gsh/math/sh.hpp>
#include <gsh/math/sh_rotation.hpp>
#include <gsh/math/sym.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/optim/adam.hpp>
#include <gsh/render/projection.hpp>
#include <gsh/render/splat_moments.hpp>
#include <gsh/render/tiles.hpp>

#include <cstddef>
#include <tuple>

namespace gsh::test {

/// The inputs of an element: its own random numbers in [-1, 1), and a table in [-1, 1) that all elements share.
inline constexpr std::size_t element_inputs = 160, element_outputs = 320, element_table_size = 1 << 14;

/// Reads an element's inputs one after another.
template <Lane T>
class Inputs {
public:
    GSH_HD explicit Inputs(const T* numbers) : next_(numbers) {}

    GSH_HD T number() { return *next_++; }
    /// In [low, high).
    GSH_HD T number(double low, double high) {
        const T half = T(static_cast<ScalarOf<T>>((high - low) / 2)),
                middle = T(static_cast<ScalarOf<T>>((high + low) / 2));
        return middle + half * number();
    }
    GSH_HD vec2<T> vector2() {
        const T x = number(), y = number();
        return {x, y};
    }
    GSH_HD vec3<T> vector() {
        const T x = number(), y = number(), z = number();
        return {x, y, z};
    }
    GSH_HD quat<T> quaternion() {
        const T w = number(1, 2), x = number(), y = number(), z = number();
        return {w, x, y, z};
    }
    GSH_HD dual_quat<T> dual_quaternion() {
        const quat<T> real = quaternion(), dual = quaternion();
        return {real, dual};
    }
    GSH_HD sym3<T> symmetric() {
        const vec3<T> a = vector(), b = vector();
        return {a.x, a.y, a.z, b.x, b.y, b.z};
    }
    GSH_HD mat3<T> matrix() {
        const vec3<T> a = vector(), b = vector(), c = vector();
        return mat3<T>(a, b, c);
    }
    /// Diagonally dominant, so that it has an inverse.
    GSH_HD mat3<T> regular_matrix() { return matrix() + mat3<T>(T(4)); }
    GSH_HD Affine<T> affine() {
        const mat3<T> linear = regular_matrix();
        return {linear, vector()};
    }
    /// Looks along z at the unit ball about (0, 0, 4).
    GSH_HD Camera<T> camera() {
        Camera<T> camera;
        camera.R = rotation_from_axis_angle(vector() * T(0.25));
        camera.t = vector() * T(0.25);
        camera.fx = number(90, 110), camera.fy = number(90, 110);
        camera.cx = number(45, 55), camera.cy = number(35, 45);
        camera.width = 100, camera.height = 80;
        return camera;
    }
    template <std::size_t Count>
    GSH_HD void vectors(vec3<T> (&values)[Count]) {
        for (vec3<T>& value : values) value = vector();
    }

private:
    const T* next_;
};

/// Writes an element's results one after another.
template <Lane T>
class Outputs {
public:
    GSH_HD explicit Outputs(T* numbers) : next_(numbers) {}

    GSH_HD void put(T x) { *next_++ = x; }
    GSH_HD void put(const vec2<T>& v) { put(v.x), put(v.y); }
    GSH_HD void put(const vec3<T>& v) { put(v.x), put(v.y), put(v.z); }
    GSH_HD void put(const quat<T>& q) { put(q.w), put(q.x), put(q.y), put(q.z); }
    GSH_HD void put(const sym3<T>& s) { put(s.xx), put(s.xy), put(s.xz), put(s.yy), put(s.yz), put(s.zz); }
    GSH_HD void put(const mat3<T>& m) { put(m[0]), put(m[1]), put(m[2]); }
    GSH_HD void put(const Affine<T>& a) { put(a.linear), put(a.translation); }
    GSH_HD void put(const dual_quat<T>& q) { put(q.real), put(q.dual); }
    GSH_HD void put(const CameraGradient<T>& c) {
        put(c.dL_dR), put(c.dL_dt);
        put(c.dL_dfx), put(c.dL_dfy), put(c.dL_dcx), put(c.dL_dcy);
    }
    template <std::size_t Count>
    GSH_HD void put(const vec3<T> (&values)[Count]) {
        for (const vec3<T>& value : values) put(value);
    }

private:
    T* next_;
};

template <Lane T>
[[nodiscard]] GSH_HD quat<T> zero_quat() {
    return {T(0), T(0), T(0), T(0)};
}
template <Lane T>
[[nodiscard]] GSH_HD sym3<T> zero_sym3() {
    return {T(0), T(0), T(0), T(0), T(0), T(0)};
}

// An element is a type with a name and `run(in, out, table)` over any lane type; what it holds is made on the host.
// -----------------------------------

struct VectorElement {
    static constexpr const char* name = "math/vec";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>*) const {
        const vec3<T> a = in.vector() + vec3<T>(T(2)), b = in.vector();
        const mat3<T> m = in.regular_matrix(), dL_dinverse = in.matrix();
        out.put(dot(a, b)), out.put(cross(a, b)), out.put(length(a)), out.put(normalize(a)), out.put(outer(a, b));
        vec3<T> dL_da(T(0));
        normalize_backward(a, b, dL_da);
        out.put(dL_da), out.put(transposed_times(m, a)), out.put(determinant(m)), out.put(transpose(m));
        mat3<T> dL_dm(T(0));
        inverse_backward(inverse(m), dL_dinverse, dL_dm);
        out.put(inverse(m)), out.put(dL_dm);
    }
};

struct ScalarElement {
    static constexpr const char* name = "core/lane and math/activation";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>* table) const {
        const T x = in.number(-3, 3), y = in.number(), p = in.number(0.1, 0.9);
        out.put(min(x, y)), out.put(max(x, y)), out.put(abs(x)), out.put(sqrt(p)), out.put(exp(x)), out.put(log(p));
        out.put(sin(x)), out.put(cos(x)), out.put(floor(x)), out.put(clamp(x, T(-1), T(2))),
            out.put(select(x < y, x, p));
        const auto index = LaneTraits<T>::to_index(p * T(100));
        out.put(power(p, x)), out.put(exp_normal(x));
        out.put(LaneTraits<T>::from_index(index)), out.put(LaneTraits<T>::gather(table, index));
        T dL_dx = T(0), dL_dp = T(0);
        sigmoid_backward(sigmoid(x), y, dL_dx), exp_backward(exp(x), y, dL_dx), logit_backward(p, y, dL_dp);
        out.put(sigmoid(x)), out.put(logit(p)), out.put(dL_dx), out.put(dL_dp);
    }
};

struct RotationElement {
    static constexpr const char* name = "math/rotation and math/quat";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>*) const {
        const T n = in.number();
        const vec3<T> v = in.vector() * (T(3) * n * n * n * n); // both sides of the change of formula at one radian
        const mat3<T> dL_dR = in.matrix();
        vec3<T> dL_dv(T(0));
        rotation_from_axis_angle_backward(v, dL_dR, dL_dv);
        out.put(rotation_from_axis_angle(v)), out.put(dL_dv);

        const vec3<T> angles = in.vector() * T(3);
        for (const auto order : {EulerOrder::xyz, EulerOrder::zxy}) {
            vec3<T> dL_dangles(T(0));
            rotation_from_euler_backward(angles, order, dL_dR, dL_dangles);
            out.put(rotation_from_euler(angles, order)), out.put(dL_dangles);
        }
        const quat<T> q = in.quaternion();
        quat<T> dL_dq = zero_quat<T>();
        rotation_from_quat_backward(q, dL_dR, dL_dq);
        out.put(rotation_from_quat(q)), out.put(dL_dq);
        for (const T side : {T(1), T(-1)}) { // both ways of writing 1 + z
            const vec3<T> w(v.x, v.y, side * T(2));
            out.put(quat_from_z_axis(w * (T(1) / sqrt(dot(w, w)))));
        }
    }
};

struct RotationIncrementElement {
    static constexpr const char* name = "math/rotation_increment";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>*) const {
        const vec3<T> result = in.vector() * T(1.8), increment = in.vector(), dL_dresult = in.vector();
        const ExponentialJacobian<T> J(result);
        out.put(J.times(increment)), out.put(J.inverse_times(increment));
        vec3<T> dL_dincrement(T(0));
        turned_backward(increment, result, dL_dresult, dL_dincrement);
        out.put(dL_dincrement);
    }
};

struct AffineElement {
    static constexpr const char* name = "math/affine";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>*) const {
        const Affine<T> a = in.affine(), b = in.affine(), dL_dproduct = in.affine();
        const vec3<T> point = in.vector(), dL_dy = in.vector();
        Affine<T> dL_da = Affine<T>::zero(), dL_db = Affine<T>::zero();
        vec3<T> dL_dpoint(T(0));
        product_backward(a, b, dL_dproduct, dL_da, dL_db);
        apply_backward(a, point, dL_dy, dL_da, dL_dpoint);
        dL_da.add_scaled(b, in.number());
        out.put(a * b), out.put(a(point)), out.put(dL_da), out.put(dL_db), out.put(dL_dpoint);
    }
};

struct SymmetricElement {
    static constexpr const char* name = "math/sym";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>*) const {
        const mat3<T> m = in.matrix();
        const sym3<T> s = in.symmetric(), dL_dresult = in.symmetric();
        mat3<T> dL_dm(T(0));
        sym3<T> dL_ds = zero_sym3<T>();
        gram_backward(m, dL_dresult, dL_dm);
        congruence_backward(m, s, dL_dresult, dL_dm, dL_ds);
        out.put(gram(m)), out.put(congruence(m, s)), out.put(dL_dm), out.put(dL_ds);
    }
};

template <int Degree>
struct SHElement {
    static constexpr const char* name = "math/sh";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>*) const {
        vec3<T> sh[sh_basis_count(Degree)], dL_dsh[sh_basis_count(Degree)], dL_ddir(T(0));
        in.vectors(sh);
        for (vec3<T>& value : dL_dsh) value = vec3<T>(T(0));
        const vec3<T> dir = normalize(in.vector()), dL_dcolor = in.vector();
        SHEval<Degree>::backward(sh, dir, dL_dcolor, dL_dsh, dL_ddir);
        out.put(SHEval<Degree>::forward(sh, dir)), out.put(dL_dsh), out.put(dL_ddir);
    }
};

template <int Degree>
struct SHRotationElement {
    static constexpr const char* name = "math/sh_rotation";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>*) const {
        constexpr int count = sh_basis_count(Degree);
        vec3<T> sh[count], rotated[count], dL_drotated[count], dL_dsh[count];
        in.vectors(sh), in.vectors(dL_drotated);
        for (vec3<T>& value : dL_dsh) value = vec3<T>(T(0));
        const mat3<T> R = rotation_from_axis_angle(in.vector());
        mat3<T> dL_dR(T(0));
        ShRotation<Degree>::forward(sh, R, rotated);
        ShRotation<Degree>::backward(sh, R, dL_drotated, dL_dsh, dL_dR);
        out.put(rotated), out.put(dL_dsh), out.put(dL_dR);
    }
};

struct CovarianceElement {
    static constexpr const char* name = "gaussian/covariance";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>*) const {
        const quat<T> q = in.quaternion();
        const vec3<T> log_scale = in.vector();
        const sym3<T> dL_dcovariance = in.symmetric();
        quat<T> dL_dq = zero_quat<T>();
        vec3<T> dL_dlog_scale(T(0));
        covariance_backward(q, log_scale, dL_dcovariance, dL_dq, dL_dlog_scale);
        out.put(covariance(q, log_scale)), out.put(dL_dq), out.put(dL_dlog_scale);
    }
};

struct ShadeElement {
    static constexpr const char* name = "gaussian/shade";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>*) const {
        vec3<T> sh[9];
        in.vectors(sh);
        const vec3<T> center = in.vector(), mean = in.vector() + vec3<T>(T(3)), dL_dcolor = in.vector();
        const vec3<T> dir = view_direction(mean, center);
        const T ao = in.number(0, 1);
        for (const auto clamping : {ColorClamp::both, ColorClamp::below}) {
            vec3<T> dL_dsh[9], dL_ddir(T(0)), dL_doffset(T(0));
            for (vec3<T>& value : dL_dsh) value = vec3<T>(T(0));
            T dL_dao = T(0);
            shade_backward<2>(sh, dir, ao, clamping, dL_dcolor, dL_dsh, dL_ddir, dL_dao);
            view_direction_backward(mean, center, dL_ddir, dL_doffset);
            out.put(shade<2>(sh, dir, ao, clamping)), out.put(dL_dsh), out.put(dL_doffset), out.put(dL_dao);
        }
    }
};

struct PinholeElement {
    static constexpr const char* name = "camera/pinhole";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>*) const {
        const Camera<T> camera = in.camera();
        const vec3<T> point = in.vector() + vec3<T>(T(0), T(0), T(4)), p = to_camera(camera, point);
        vec3<T> dL_dp(T(0)), dL_dpoint(T(0));
        CameraGradient<T> dL_dcamera;
        to_pixel_backward(camera, p, in.vector2(), dL_dp, dL_dcamera);
        to_camera_backward(camera, point, dL_dp, dL_dpoint, dL_dcamera);
        center_backward(camera, in.vector(), dL_dcamera);
        out.put(to_pixel(camera, p)), out.put(camera.center()), out.put(dL_dpoint), out.put(dL_dcamera);
    }
};

struct CameraIncrementElement {
    static constexpr const char* name = "camera/camera_increment";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>*) const {
        const Camera<T> camera = in.camera();
        const vec3<T> pivot = in.vector();
        const CameraIncrement<T> increment{in.vector(), in.vector(), in.number(), in.vector2()};
        const Camera<T> moved = moved_camera(camera, pivot, increment);
        out.put(moved.R), out.put(moved.t), out.put(moved.fx), out.put(moved.cy);
        CameraGradient<T> dL_dmoved{in.matrix(), in.vector(), in.number(), in.number(), in.number(), in.number()};
        CameraIncrement<T> dL_dincrement;
        moved_camera_backward(camera, pivot, increment, dL_dmoved, dL_dincrement);
        out.put(dL_dincrement.rotation), out.put(dL_dincrement.translation);
        out.put(dL_dincrement.log_focal), out.put(dL_dincrement.principal_point);
    }
};

struct DistortionElement {
    static constexpr const char* name = "camera/distortion";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>*) const {
        const vec3<T> k = in.vector() * T(0.1);
        const vec2<T> p = in.vector2() * T(0.5), tangential = in.vector2() * T(0.01), dL_dout = in.vector2();
        const Distortion<T> d{k.x, k.y, tangential.x, tangential.y, k.z};
        vec2<T> dL_dp(T(0));
        Distortion<T> dL_dd{T(0), T(0), T(0), T(0), T(0)};
        distort_backward(d, p, dL_dout, dL_dp, dL_dd);
        out.put(distort(d, p)), out.put(dL_dp), out.put(undistort(d, p).point);
        out.put(dL_dd.k1), out.put(dL_dd.k2), out.put(dL_dd.p1), out.put(dL_dd.p2), out.put(dL_dd.k3);
    }
};

struct SkeletonElement {
    static constexpr const char* name = "body/skeleton";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>*) const {
        const int parents[3] = {-1, 0, 1};
        mat3<T> rotations[3], dL_drotations[3] = {mat3<T>(T(0)), mat3<T>(T(0)), mat3<T>(T(0))};
        vec3<T> joints[3], dL_djoints[3] = {vec3<T>(T(0)), vec3<T>(T(0)), vec3<T>(T(0))}, dL_dtransl(T(0));
        Affine<T> bones[3], dL_dbones[3], scratch[3];
        for (int j = 0; j < 3; ++j) {
            rotations[j] = rotation_from_axis_angle(in.vector());
            joints[j] = in.vector();
            dL_dbones[j] = in.affine();
        }
        const vec3<T> transl = in.vector();
        bone_transforms<T>({parents, 3}, {rotations, 3}, {joints, 3}, transl, {bones, 3});
        bone_transforms_backward<T>({parents, 3}, {rotations, 3}, {joints, 3}, {bones, 3}, {dL_dbones, 3},
                                    {dL_drotations, 3}, {dL_djoints, 3}, dL_dtransl, {scratch, 3});
        T feature[18];
        for (std::size_t j = 1; j < 3; ++j) {
            pose_feature<T>(j, rotations[j], {feature, 18});
            pose_feature_backward<T>(j, {feature, 18}, dL_drotations[j]);
        }
        for (int j = 0; j < 3; ++j) out.put(bones[j]), out.put(dL_drotations[j]), out.put(dL_djoints[j]);
        out.put(dL_dtransl);
        for (const T value : feature) out.put(value);
    }
};

struct ProjectionElement {
    static constexpr const char* name = "render/projection";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>*) const {
        const Camera<T> camera = in.camera();
        // Wide enough that some lanes lie beyond the Jacobian's clamp and some behind the near plane.
        const vec3<T> mean = in.vector() * T(4) + vec3<T>(T(0), T(0), T(3.5));
        const sym3<T> covariance = gram(in.matrix() * T(0.1)), dL_dcovariance3 = in.symmetric();
        Projection<T> dL_dprojection;
        dL_dprojection.mean2d = in.vector2();
        dL_dprojection.depth = in.number();
        dL_dprojection.covariance = {dL_dcovariance3.xx, dL_dcovariance3.xy, dL_dcovariance3.yy};
        dL_dprojection.opacity_factor = in.number();
        for (const bool compensate : {false, true}) {
            ProjectionParams<ScalarOf<T>> params;
            params.compensate_opacity = compensate;
            const Projection<T> p = project(camera, mean, covariance, params);
            vec3<T> dL_dmean(T(0));
            sym3<T> dL_dcovariance = zero_sym3<T>();
            CameraGradient<T> dL_dcamera;
            project_backward(camera, mean, covariance, params, dL_dprojection, dL_dmean, dL_dcovariance, &dL_dcamera);
            const T seen = select(p.in_front, T(1), T(0)); // results behind the camera are undefined
            out.put(seen), out.put(p.mean2d * seen), out.put(p.depth * seen), out.put(p.opacity_factor * seen);
            out.put(p.covariance.xx * seen), out.put(p.covariance.xy * seen), out.put(p.covariance.yy * seen);
            out.put(dL_dmean * seen), out.put(dL_dcamera.dL_dR * seen), out.put(dL_dcamera.dL_dt * seen);
            out.put(dL_dcovariance.xx * seen), out.put(dL_dcovariance.xz * seen), out.put(dL_dcovariance.yz * seen);
            out.put(dL_dcamera.dL_dfx * seen), out.put(dL_dcamera.dL_dcy * seen);
        }
    }
};

struct WhitenElement {
    static constexpr const char* name = "render/tiles";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>*) const {
        const Whitening<T> w = whiten(sym2<T>{in.number(1, 3), in.number(-0.9, 0.9), in.number(1, 3)});
        out.put(w.ux), out.put(w.uy), out.put(w.vy);
    }
};

struct SplatMomentsElement {
    static constexpr const char* name = "render/splat_moments";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>*) const {
        const Whitening<T> w{in.number(), in.number(), in.number()};
        const SplatMoments<T> moments{in.number(), in.number(), in.number(), in.number(), in.number()};
        Projection<T> dL_dprojection;
        moments_backward(w, moments, dL_dprojection);
        const sym2<T>& c = dL_dprojection.covariance;
        out.put(dL_dprojection.mean2d), out.put(c.xx), out.put(c.xy), out.put(c.yy);
    }
};

struct ColorElement {
    static constexpr const char* name = "image/color";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>*) const {
        for (int k = 0; k < 8; ++k) {
            const T n = in.number(0, 1), x = n * n * n, dL_dy = in.number(); // both branches
            T dL_dlinear = T(0), dL_dsrgb = T(0);
            srgb_to_linear_backward(x, dL_dy, dL_dsrgb), srgb_to_linear_backward(x, srgb_to_linear(x), dL_dy, dL_dsrgb);
            linear_to_srgb_backward(x, dL_dy, dL_dlinear);
            out.put(srgb_to_linear(x)), out.put(linear_to_srgb(x)), out.put(dL_dsrgb), out.put(dL_dlinear);
        }
    }
};

struct HashGridElement {
    static constexpr const char* name = "field/hash_grid";
    HashGrid<5, 2> grid{{.base = 4, .growth = 1.5, .table_size = 1024}}; // dense levels and hashed ones

    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>* table) const {
        // Braces define the order of evaluation.
        const vec3<T> point{in.number(-0.1, 1.1), in.number(-0.1, 1.1), in.number(0, 1)};
        T features[10], dL_dfeatures[10];
        for (T& value : dL_dfeatures) value = in.number();
        grid.encode(table, point, features);
        vec3<T> dL_dpoint(T(0));
        grid.encode_backward_point(table, point, dL_dfeatures, dL_dpoint);
        for (const T value : features) out.put(value);
        out.put(dL_dpoint);
    }
};

template <class D>
struct SkinnedGaussianElement {
    static constexpr const char* name = D::value == Deformation::linear  ? "avatar/skinned_gaussian"
                                        : D::value == Deformation::polar ? "avatar/skinned_gaussian polar"
                                                                         : "avatar/skinned_gaussian dual";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>*) const {
        using Skinned = SkinnedGaussian<2, D>;
        vec3<T> sh[9], dL_dsh[9];
        in.vectors(sh);
        for (vec3<T>& value : dL_dsh) value = vec3<T>(T(0));
        typename Skinned::template Input<T> gaussian;
        gaussian.mean = in.vector();
        gaussian.q = in.quaternion();
        gaussian.log_scale = in.vector();
        gaussian.opacity_logit = in.number(-3, 3);
        gaussian.sh = sh;
        gaussian.ao = in.number(0, 1);
        if constexpr (D::value == Deformation::dual_quaternion) gaussian.blend = in.dual_quaternion();
        else gaussian.blend = in.affine();
        gaussian.center = in.vector() + vec3<T>(T(0), T(0), T(-20));
        typename Skinned::template Output<T> dL_dout;
        dL_dout.mean = in.vector();
        dL_dout.covariance = in.symmetric();
        dL_dout.opacity = in.number();
        dL_dout.color = in.vector();
        typename Skinned::template Gradient<T> gradient;
        gradient.sh = dL_dsh;
        const auto splat = Skinned::forward(gaussian, ColorClamp::both);
        Skinned::backward(gaussian, ColorClamp::both, dL_dout, gradient);
        out.put(splat.mean), out.put(splat.covariance), out.put(splat.opacity), out.put(splat.color);
        out.put(gradient.mean), out.put(gradient.q), out.put(gradient.log_scale), out.put(gradient.opacity_logit);
        out.put(dL_dsh), out.put(gradient.ao), out.put(gradient.blend), out.put(gradient.center);
    }
};

/// Three points and two directions that all elements share.
struct LitElement {
    static constexpr const char* name = "light/lit_element";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>*) const {
        using S = ScalarOf<T>;
        const vec3<S> points[3] = {{0, 3, 2}, {3, -1, 1}, {-2, 0, -3}};
        const vec3<S> directions[2] = {{0, 1, 0}, {S(0.6), 0, S(0.8)}};
        const S factors[7] = {3, 2, 4, S(0.5), S(0.3), S(0.8), 12};
        const LitLight<S> light{{points, 3}, {directions, 2}, {factors, 7}, true};
        LitPoint::Input<T> point;
        point.position = in.vector();
        const vec3<T> base = in.vector() * T(0.4) + vec3<T>(T(0.5));
        point.normal = in.vector() + vec3<T>(T(0), T(0), T(1.5));
        point.center = in.vector() + vec3<T>(T(0), T(0), T(4));
        T visibility[5];
        for (T& value : visibility) value = in.number(0, 1);
        const auto visible = [&](std::size_t k) { return visibility[k]; };
        const LitShading<T> shading = LitPoint::forward(light, point, visible);
        const vec3<T> dL_dcolor = in.vector();
        LitShading<T> dL_dshading(T(0));
        LitPoint::Gradient<T> gradient;
        vec3<T> dL_dbase(T(0));
        vec3<T> dL_dpoints[3] = {vec3<T>(T(0)), vec3<T>(T(0)), vec3<T>(T(0))};
        T dL_dlog_intensities[5] = {T(0), T(0), T(0), T(0), T(0)}, dL_dgloss[2] = {T(0), T(0)};
        LitColor::backward(base, shading, dL_dcolor, ColorClamp::both, dL_dbase, dL_dshading);
        LitPoint::backward(light, point, visible, shading, dL_dshading, gradient,
                           LitLightSums<T>{dL_dpoints, dL_dlog_intensities, dL_dgloss});
        out.put(shading.x), out.put(shading.y);
        out.put(LitColor::forward(base, shading, ColorClamp::both));
        out.put(gradient.position), out.put(dL_dbase), out.put(gradient.normal), out.put(gradient.center);
        out.put(dL_dpoints), out.put(dL_dgloss[0]), out.put(dL_dgloss[1]);
        for (const T value : dL_dlog_intensities) out.put(value);
    }
};

struct PolarElement {
    static constexpr const char* name = "math/polar";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>*) const {
        const mat3<T> m = in.regular_matrix(), dL_dR = in.matrix();
        mat3<T> dL_dm(T(0));
        out.put(polar_rotation(m));
        polar_rotation_backward(m, dL_dR, dL_dm);
        out.put(dL_dm);
    }
};

struct DualQuatElement {
    static constexpr const char* name = "math/dual_quat";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>*) const {
        const dual_quat<T> b = in.dual_quaternion();
        dual_quat<T> dL_db = dual_quat<T>::zero();
        out.put(rigid_from_dual_quat(b));
        rigid_from_dual_quat_backward(b, in.affine(), dL_db);
        out.put(dL_db);
    }
};

struct AdamElement {
    static constexpr const char* name = "optim/adam";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>*) const {
        using S = ScalarOf<T>;
        const gsh::detail::AdamCoefficients<S> c{S(0.9), S(0.999), S(0.1), S(0.001), S(0.05), S(3), S(1e-15)};
        T parameter = in.number(), m = in.number(), v = in.number(0.01, 1);
        gsh::detail::adam_update(parameter, in.number(), m, v, c);
        out.put(parameter), out.put(m), out.put(v);
    }
};

struct FrequencyElement {
    static constexpr const char* name = "field/frequency";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>*) const {
        const T t = in.number(0, 1);
        T features[9], dL_dfeatures[9], dL_dt = T(0);
        for (T& value : dL_dfeatures) value = in.number();
        FrequencyEncoding<4>::forward(t, features);
        FrequencyEncoding<4>::backward(t, dL_dfeatures, dL_dt);
        for (const T value : features) out.put(value);
        out.put(dL_dt);
    }
};

struct SsimElement {
    static constexpr const char* name = "loss/ssim";
    template <Lane T>
    GSH_HD void run(Inputs<T> in, Outputs<T> out, const ScalarOf<T>*) const {
        const T s = in.number(0, 2), d = in.number(-0.5, 0.5);
        SsimPartials<T> partials;
        out.put(ssim_loss(SsimMoments<T>{s, d, s * s + in.number(0.05, 0.5), d * d + in.number(0.01, 0.04)}, partials));
        out.put(partials.mean), out.put(partials.ss), out.put(partials.dd);
    }
};

/// All elements. For a new per-element function, add a struct above and its name here.
using Elements =
    std::tuple<VectorElement, ScalarElement, RotationElement, RotationIncrementElement, CameraIncrementElement,
               AffineElement, SymmetricElement, SHElement<0>,
               SHElement<1>, SHElement<2>, SHElement<3>, SHElement<4>, SHRotationElement<2>,
               SHRotationElement<4>, CovarianceElement, ShadeElement, PinholeElement,
               DistortionElement, SkeletonElement, ProjectionElement, WhitenElement, SplatMomentsElement,
               ColorElement, HashGridElement, PolarElement, DualQuatElement, SkinnedGaussianElement<LinearBlend>,
               SkinnedGaussianElement<PolarBlend>, SkinnedGaussianElement<DualQuaternionBlend>, LitElement, AdamElement,
               FrequencyElement, SsimElement>;

} // namespace gsh::test
