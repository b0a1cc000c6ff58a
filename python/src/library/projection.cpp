// SPDX-License-Identifier: Apache-2.0
/// @file  Projection of arrays of Gaussians with the radii of gsplat, and its adjoint.

#include "library/projection.hpp"

#include "library/arrays.hpp"
#include "library/errors.hpp"
#include "library/lanes.hpp"

#include <gsh/gaussian/covariance.hpp>
#include <gsh/math/wide.hpp>
#include <gsh/render/cpu/project.hpp>
#include <gsh/render/projection.hpp>
#include <gsh/render/screen_gradient.hpp>

#include <algorithm>
#include <atomic>
#include <vector>

namespace gsh_python {

namespace {

using namespace gsh;
using W = Wide<double>;
constexpr std::size_t grain = 1024;

[[nodiscard]] ProjectionParams<double> params_of(const ProjectionSettings& settings) {
    ProjectionParams<double> params;
    params.near_plane = settings.near_plane;
    params.dilation = settings.eps2d;
    params.compensate_opacity = settings.compensate != 0;
    params.compensation_floor = settings.compensation_floor;
    return params;
}

/// The shape of the Gaussians of a register: a factor from quaternions and scales, or a covariance.
template <class T>
struct FactorShapes {
    const T *quats, *scales;
    FactorShapes(const SplatArrays& splats, std::size_t batch, std::size_t n)
        : quats(static_cast<const T*>(splats.quats) + 4 * batch * n),
          scales(static_cast<const T*>(splats.scales) + 3 * batch * n) {}
    [[nodiscard]] gsh::quat<W> quat_at(const Lanes& lanes) const {
        return {lanes.load(quats, 4, 0), lanes.load(quats, 4, 1), lanes.load(quats, 4, 2), lanes.load(quats, 4, 3)};
    }
    [[nodiscard]] vec3<W> scale_at(const Lanes& lanes) const { return lanes.load_vec3(scales); }
    [[nodiscard]] mat3<W> operator()(const Lanes& lanes) const {
        return scaled_rotation(quat_at(lanes), scale_at(lanes));
    }
};
template <class T>
struct CovarianceShapes {
    const T* covars;
    CovarianceShapes(const SplatArrays& splats, std::size_t batch, std::size_t n)
        : covars(static_cast<const T*>(splats.covars) + 6 * batch * n) {}
    [[nodiscard]] sym3<W> operator()(const Lanes& lanes) const {
        const auto load = [&](std::size_t k) { return lanes.load(covars, 6, k); };
        return {load(0), load(1), load(2), load(3), load(4), load(5)};
    }
};

/// The radii of gsplat 1.5: min(3.33, sqrt(2 ln(255 opacity))) standard deviations along each axis, rounded up; 0 for a
/// Gaussian that is too close, too far, too faint, too small, or beside the image.
struct Radii {
    W x, y;
    MaskOf<W> kept;

    Radii(const Projection<W>& p, W opacity, const Camera<double>& camera, const ProjectionSettings& settings) {
        const W zero(0.0), threshold(1.0 / 255), one(1.0);
        const W ratio = max(opacity * W(255.0), one);
        const W extent = min(W(3.33), sqrt(W(2.0) * log_normal(ratio)));
        x = ceil(extent * sqrt(p.covariance.xx)), y = ceil(extent * sqrt(p.covariance.yy));
        const W clip(settings.radius_clip), width(static_cast<double>(camera.width)),
            height(static_cast<double>(camera.height));
        kept = (p.depth >= W(settings.near_plane)) & (p.depth <= W(settings.far_plane)) & p.in_front &
               (p.determinant > zero) & (opacity >= threshold) & ((x > clip) | (y > clip)) & (p.mean2d.x + x > zero) &
               (p.mean2d.x - x < width) & (p.mean2d.y + y > zero) & (p.mean2d.y - y < height);
    }

private:
    [[nodiscard]] static W ceil(W number) { // of numbers that an int holds, or anything for others
        const W shift(6755399441055744.0), rounded = (number + shift) - shift;
        return select(rounded < number, rounded + W(1.0), rounded);
    }
};

template <class T>
void store_factors(const Lanes& lanes, const mat3<W>& F, T* to) {
    for (int k = 0; k < 9; ++k) lanes.store(F[k / 3][k % 3], to, 9, static_cast<std::size_t>(k));
}
template <class T>
void store_factors(const Lanes&, const sym3<W>&, T*) {}

/// A sum of all numbers of a shape.
[[nodiscard]] W sum_of(const mat3<W>& F) {
    W sum(0.0);
    for (int c = 0; c < 3; ++c) sum += F[c].x + F[c].y + F[c].z;
    return sum;
}
[[nodiscard]] W sum_of(const sym3<W>& s) { return s.xx + s.xy + s.xz + s.yy + s.yz + s.zz; }

template <class T, class Shapes>
void project_image(cpu::Threads& backend, const Sizes& sizes, const SplatArrays& splats, const CameraArrays& cameras,
                   const ProjectionSettings& settings, const ProjectedArrays& out, std::size_t image) {
    const auto n = static_cast<std::size_t>(sizes.count), batch = image / static_cast<std::size_t>(sizes.cameras);
    const Camera<double> camera = camera_of<T>(cameras, image).template cast<double>();
    const Camera<W> wide_camera = cpu::detail::in_all_lanes<W>(camera);
    const ProjectionParams<double> params = params_of(settings);
    const T* const means = static_cast<const T*>(splats.means) + 3 * batch * n;
    const T* const opacities = splats.opacities ? static_cast<const T*>(splats.opacities) + batch * n : nullptr;
    const Shapes shapes(splats, batch, n);
    const std::size_t first = image * n;
    const auto at = [&](void* array, std::size_t numbers) {
        return array ? static_cast<T*>(array) + numbers * first : nullptr;
    };
    std::int32_t* const radii = out.radii + 2 * first;
    T *const means2d = at(out.means2d, 2), *const depths = at(out.depths, 1), *const conics = at(out.conics, 3);
    T *const compensations = at(out.compensations, 1), *const opacities_out = at(out.opacities, 1);
    T* const factors = out.factors && image % static_cast<std::size_t>(sizes.cameras) == 0
                           ? static_cast<T*>(out.factors) + 9 * batch * n
                           : nullptr;
    std::atomic<bool> finite = true;
    backend.for_chunks(n, grain, [&](std::size_t, std::size_t begin, std::size_t end) {
        W nonfinite(0.0); // 0, or NaN
        for (std::size_t i = begin; i < end; i += W::width) {
            const Lanes lanes(i, end);
            const vec3<W> mean = lanes.load_vec3(means);
            const auto shape = shapes(lanes);
            const Projection<W> p = gsh::project(wide_camera, mean, shape, params);
            const W opacity = opacities ? lanes.load(opacities, 1, 0) * p.opacity_factor : W(1.0);
            nonfinite += (mean.x + mean.y + mean.z + sum_of(shape) + opacity) * W(0.0);
            const Radii r(p, opacity, camera, settings);
            const W zero(0.0), inverse = W(1.0) / p.determinant;
            const auto put = [&](W numbers, auto* to, std::size_t stride, std::size_t k) {
                if (to) lanes.store(select(r.kept, numbers, zero), to, stride, k);
            };
            if (factors) store_factors(lanes, shape, factors);
            put(r.x, radii, 2, 0), put(r.y, radii, 2, 1);
            put(p.mean2d.x, means2d, 2, 0), put(p.mean2d.y, means2d, 2, 1);
            put(p.depth, depths, 1, 0);
            put(p.covariance.yy * inverse, conics, 3, 0), put(-p.covariance.xy * inverse, conics, 3, 1);
            put(p.covariance.xx * inverse, conics, 3, 2);
            put(p.opacity_factor, compensations, 1, 0), put(opacity, opacities_out, 1, 0);
        }
        if (any(nonfinite != W(0.0))) finite = false;
    });
    check_value(finite, "project", "a Gaussian has a number that is not finite");
}

/// Writes what a register of Gaussians adds to the gradient of its shape.
template <class T>
void add_shape(const Lanes& lanes, const FactorShapes<T>& shapes, const mat3<W>& dL_dF, const SplatGradients& out,
               std::size_t offset) {
    gsh::quat<W> dL_dq{W(0.0), W(0.0), W(0.0), W(0.0)};
    vec3<W> dL_dscale(W(0.0));
    scaled_rotation_backward(shapes.quat_at(lanes), shapes.scale_at(lanes), dL_dF, dL_dq, dL_dscale);
    if (out.quats) {
        T* const to = static_cast<T*>(out.quats) + 4 * offset;
        lanes.add(dL_dq.w, to, 4, 0), lanes.add(dL_dq.x, to, 4, 1), lanes.add(dL_dq.y, to, 4, 2);
        lanes.add(dL_dq.z, to, 4, 3);
    }
    if (out.scales)
        for (int k = 0; k < 3; ++k)
            lanes.add(dL_dscale[k], static_cast<T*>(out.scales) + 3 * offset, 3, static_cast<std::size_t>(k));
}
template <class T>
void add_shape(const Lanes& lanes, const CovarianceShapes<T>&, const sym3<W>& dL, const SplatGradients& out,
               std::size_t offset) {
    if (!out.covars) return;
    const W numbers[6] = {dL.xx, dL.xy, dL.xz, dL.yy, dL.yz, dL.zz};
    for (std::size_t k = 0; k < 6; ++k) lanes.add(numbers[k], static_cast<T*>(out.covars) + 6 * offset, 6, k);
}
[[nodiscard]] mat3<W> zero_of(const mat3<W>&) { return mat3<W>(W(0.0)); }
[[nodiscard]] sym3<W> zero_of(const sym3<W>&) {
    const W zero(0.0);
    return {zero, zero, zero, zero, zero, zero};
}
[[nodiscard]] mat3<W> masked(const MaskOf<W>& mask, const mat3<W>& m) {
    mat3<W> kept = m;
    for (int c = 0; c < 3; ++c)
        for (int r = 0; r < 3; ++r) kept[c][r] = select(mask, m[c][r], W(0.0));
    return kept;
}
[[nodiscard]] sym3<W> masked(const MaskOf<W>& mask, const sym3<W>& s) {
    const W zero(0.0);
    return {select(mask, s.xx, zero), select(mask, s.xy, zero), select(mask, s.xz, zero),
            select(mask, s.yy, zero), select(mask, s.yz, zero), select(mask, s.zz, zero)};
}

template <class T, class Shapes>
void project_image_backward(cpu::Threads& backend, const Sizes& sizes, const SplatArrays& splats,
                            const CameraArrays& cameras, const ProjectionSettings& settings,
                            const std::int32_t* all_radii, const ProjectedGradients& dL, const SplatGradients& out,
                            const CameraGradients& camera_out, std::size_t image) {
    const auto n = static_cast<std::size_t>(sizes.count), batch = image / static_cast<std::size_t>(sizes.cameras);
    const Camera<W> camera = cpu::detail::in_all_lanes<W>(camera_of<T>(cameras, image).template cast<double>());
    const ProjectionParams<double> params = params_of(settings);
    const T* const means = static_cast<const T*>(splats.means) + 3 * batch * n;
    const Shapes shapes(splats, batch, n);
    const std::size_t first = image * n, offset = batch * n;
    const auto at = [&](const void* array, std::size_t numbers) {
        return array ? static_cast<const T*>(array) + numbers * first : nullptr;
    };
    const std::int32_t* const radii = all_radii + 2 * first;
    const T *const dL_dmeans2d = at(dL.means2d, 2), *const dL_ddepths = at(dL.depths, 1),
                   *const dL_dconics = at(dL.conics, 3), *const dL_dcompensations = at(dL.compensations, 1),
                   *const dL_dopacities = at(dL.opacities, 1);
    const auto of_batch = [&](void* array, std::size_t numbers) {
        return array ? static_cast<T*>(array) + numbers * offset : nullptr;
    };
    T *const dL_dmeans = of_batch(out.means, 3), *const dL_dopacities_out = of_batch(out.opacities, 1);
    const T* const opacities = splats.opacities ? static_cast<const T*>(splats.opacities) + offset : nullptr;
    const bool first_camera = image % static_cast<std::size_t>(sizes.cameras) == 0;
    const bool with_camera = camera_out.viewmats || camera_out.Ks;
    std::vector<CameraGradient<double>> chunk_camera(with_camera ? chunk_count(n, grain) : 0);
    backend.for_chunks(n, grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        const W zero(0.0);
        CameraGradient<W> sum{mat3<W>(zero), vec3<W>(zero), zero, zero, zero, zero};
        if (first_camera) {
            const auto clear = [&](T* array, std::size_t numbers) {
                if (array) std::fill(array + numbers * begin, array + numbers * end, T(0));
            };
            clear(dL_dmeans, 3), clear(of_batch(out.quats, 4), 4), clear(of_batch(out.scales, 3), 3);
            clear(of_batch(out.covars, 6), 6), clear(dL_dopacities_out, 1);
        }
        for (std::size_t i = begin; i < end; i += W::width) {
            const Lanes lanes(i, end);
            const auto kept = lanes.visible(radii);
            if (!any(kept)) continue; // gradients of numbers of which the forward pass wrote zeros
            const auto load = [&](const T* from, std::size_t stride, std::size_t k) {
                return from ? select(kept, lanes.load(from, stride, k), zero) : zero;
            };
            const vec3<W> mean = lanes.load_vec3(means);
            const auto shape = shapes(lanes);
            Projection<W> dL_dp;
            dL_dp.mean2d = vec2<W>(load(dL_dmeans2d, 2, 0), load(dL_dmeans2d, 2, 1));
            dL_dp.depth = load(dL_ddepths, 1, 0);
            dL_dp.opacity_factor = load(dL_dcompensations, 1, 0);
            dL_dp.covariance = {zero, zero, zero};
            const bool with_factor = dL_dopacities && params.compensate_opacity;
            if (dL_dconics || with_factor) {
                const Projection<W> p = gsh::project(camera, mean, shape, params);
                if (with_factor) {
                    const W dL_dopacity = load(dL_dopacities, 1, 0);
                    dL_dp.opacity_factor += dL_dopacity * lanes.load(opacities, 1, 0);
                    if (dL_dopacities_out) lanes.add(dL_dopacity * p.opacity_factor, dL_dopacities_out, 1, 0);
                }
                const W inverse = W(1.0) / p.determinant;
                const sym2<W> conic{p.covariance.yy * inverse, -p.covariance.xy * inverse, p.covariance.xx * inverse};
                const sym2<W> dL_dconic{load(dL_dconics, 3, 0), load(dL_dconics, 3, 1), load(dL_dconics, 3, 2)};
                dL_dp.covariance = conic_backward(conic, dL_dconic);
            }
            if (dL_dopacities && !with_factor && dL_dopacities_out)
                lanes.add(load(dL_dopacities, 1, 0), dL_dopacities_out, 1, 0);
            vec3<W> dL_dmean(zero);
            auto dL_dshape = zero_of(shape);
            CameraGradient<W> of_camera{mat3<W>(zero), vec3<W>(zero), zero, zero, zero, zero};
            gsh::project_backward(camera, mean, shape, params, dL_dp, dL_dmean, dL_dshape,
                                  with_camera ? &of_camera : nullptr);
            if (dL_dmeans)
                for (int k = 0; k < 3; ++k)
                    lanes.add(select(kept, dL_dmean[k], zero), dL_dmeans, 3, static_cast<std::size_t>(k));
            add_shape(lanes, shapes, masked(kept, dL_dshape), out, offset);
            if (with_camera) {
                auto* const from = reinterpret_cast<const W*>(&of_camera);
                auto* const to = reinterpret_cast<W*>(&sum);
                for (std::size_t k = 0; k < sizeof(sum) / sizeof(W); ++k) to[k] += select(kept, from[k], zero);
            }
        }
        if (!with_camera) return;
        auto* const from = reinterpret_cast<const W*>(&sum);
        auto* const to = reinterpret_cast<double*>(&chunk_camera[chunk]);
        for (std::size_t k = 0; k < sizeof(sum) / sizeof(W); ++k)
            for (std::size_t lane = 0; lane < W::width; ++lane) to[k] += from[k][lane];
    });
    if (!with_camera) return;
    CameraGradient<double> sum;
    for (const CameraGradient<double>& share : chunk_camera) sum += share;
    if (camera_out.viewmats) {
        T* const m = static_cast<T*>(camera_out.viewmats) + 16 * image;
        for (int r = 0; r < 3; ++r) {
            for (int c = 0; c < 3; ++c) m[4 * r + c] = static_cast<T>(sum.dL_dR[c][r]);
            m[4 * r + 3] = static_cast<T>(sum.dL_dt[r]);
        }
        std::fill(m + 12, m + 16, T(0));
    }
    if (camera_out.Ks) {
        T* const K = static_cast<T*>(camera_out.Ks) + 9 * image;
        std::fill(K, K + 9, T(0));
        K[0] = static_cast<T>(sum.dL_dfx), K[4] = static_cast<T>(sum.dL_dfy);
        K[2] = static_cast<T>(sum.dL_dcx), K[5] = static_cast<T>(sum.dL_dcy);
    }
}

/// Calls work.template operator()<T, Shapes<T>>() for the caller's number type and kind of shape.
template <class Work>
void with_types(const Sizes& sizes, const SplatArrays& splats, const Work& work) {
    if (sizes.scalar_bytes == 4) {
        if (splats.covars) work.template operator()<float, CovarianceShapes<float>>();
        else work.template operator()<float, FactorShapes<float>>();
    } else {
        if (splats.covars) work.template operator()<double, CovarianceShapes<double>>();
        else work.template operator()<double, FactorShapes<double>>();
    }
}

} // namespace

int project(const Sizes& sizes, const SplatArrays& splats, const CameraArrays& cameras,
            const ProjectionSettings& settings, const ProjectedArrays& out) {
    return guarded([&] {
        gsh::check_value(settings.near_plane > 0, "near_plane", "must be above 0");
        gsh::check_value(settings.eps2d >= 0, "eps2d", "must not be negative");
        const auto images = static_cast<std::size_t>(sizes.batches * sizes.cameras);
        with_types(sizes, splats, [&]<class T, class Shapes>() {
            for (std::size_t image = 0; image < images; ++image)
                project_image<T, Shapes>(threads(sizes.threads), sizes, splats, cameras, settings, out, image);
        });
    });
}

int project_backward(const Sizes& sizes, const SplatArrays& splats, const CameraArrays& cameras,
                     const ProjectionSettings& settings, const std::int32_t* radii, const ProjectedGradients& dL,
                     const SplatGradients& out, const CameraGradients& camera_out) {
    return guarded([&] {
        const auto images = static_cast<std::size_t>(sizes.batches * sizes.cameras);
        with_types(sizes, splats, [&]<class T, class Shapes>() {
            for (std::size_t image = 0; image < images; ++image)
                project_image_backward<T, Shapes>(threads(sizes.threads), sizes, splats, cameras, settings, radii, dL,
                                                  out, camera_out, image);
        });
    });
}

} // namespace gsh_python
