// SPDX-License-Identifier: Apache-2.0
/// @file  Last stage of the rasterizer on the CPU: from sums over tiles to gradients of splats and camera.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/render/cpu/project.hpp>
#include <gsh/render/projection.hpp>
#include <gsh/render/cpu/raster_scratch.hpp>
#include <gsh/render/raster_cache.hpp>

#include <cmath>
#include <cstddef>

namespace gsh::cpu::inline GSH_ISA {

namespace detail {

/// Sums over the pixels of a tile for each splat, with G = dL/d ln(alpha) at a pixel.
enum SlotEntry : int {
    slot_g,                           // sum G
    slot_u, slot_v,                   // sum G u, G v
    slot_uu, slot_uv, slot_vv,        // sum G u u, G u v, G v v
    slot_red, slot_green, slot_blue,  // sum weight * dL/d color of the pixel
    slot_depth                        // likewise for the depths, if there is such a gradient
};
template <bool Depth>
inline constexpr std::size_t slot_size = Depth ? 10 : 9;

/// A batch of splats, member by member and in double, so that the adjoint of their projection is a loop over plain
/// arrays.
struct ProjectionBackwardBatch {
    static constexpr std::size_t size = 64;

    std::size_t count = 0;
    std::size_t splat[size];
    alignas(64) double mean_x[size], mean_y[size], mean_z[size];
    alignas(64) double xx[size], xy[size], xz[size], yy[size], yz[size], zz[size];
    alignas(64) double u[size], v[size], uu[size], uv[size], vv[size], ux[size], uy[size], vy[size]; // moments; W
    alignas(64) double dL_ddepth[size], dL_dfactor[size], norm_square[size];
    alignas(64) double dL_dmean_x[size], dL_dmean_y[size], dL_dmean_z[size];
    alignas(64) double dL_dxx[size], dL_dxy[size], dL_dxz[size], dL_dyy[size], dL_dyz[size], dL_dzz[size];

    template <std::floating_point T>
    void add(std::size_t i, const SplatView<const T>& splats, const ScreenSplat<T>& s, const T* sum) {
        const std::size_t k = count++;
        const vec3<T>& m = splats.means[i];
        const sym3<T>& c = splats.covariances[i];
        splat[k] = i;
        mean_x[k] = m.x, mean_y[k] = m.y, mean_z[k] = m.z;
        xx[k] = c.xx, xy[k] = c.xy, xz[k] = c.xz, yy[k] = c.yy, yz[k] = c.yz, zz[k] = c.zz;
        u[k] = sum[slot_u], v[k] = sum[slot_v], uu[k] = sum[slot_uu], uv[k] = sum[slot_uv], vv[k] = sum[slot_vv];
        ux[k] = s.w.ux, uy[k] = s.w.uy, vy[k] = s.w.vy;
        dL_ddepth[k] = sum[slot_depth];
        dL_dfactor[k] = sum[slot_g] / s.opacity * splats.opacities[i];
    }

    template <std::floating_point T>
    [[nodiscard]] vec3<T> dL_dmean(std::size_t k) const {
        return vec3<T>(vec3<double>(dL_dmean_x[k], dL_dmean_y[k], dL_dmean_z[k]));
    }
    template <std::floating_point T>
    [[nodiscard]] sym3<T> dL_dcovariance(std::size_t k) const {
        return {T(dL_dxx[k]), T(dL_dxy[k]), T(dL_dxz[k]), T(dL_dyy[k]), T(dL_dyz[k]), T(dL_dzz[k])};
    }

    /// ln(alpha) = ln(opacity) - ln(2) (u² + v²), (u, v) = W (pixel - mean2d), Σ⁻¹ = 2 ln(2) Wᵀ W, so that with the
    /// moments m = sum G (u, v), M = sum G (u, v) (u, v)ᵀ: dL_dmean2d = 2 ln(2) Wᵀ m, dL_dΣ = 2 ln(2)² Wᵀ M W.
    ///
    /// General is true where square roots or camera gradients are needed; these keep the loop from being vectorised.
    template <bool General>
    void project_backward(const Camera<double>& camera, ProjectionParams<double> params,
                          CameraGradient<double>* dL_dcamera) {
        if (!General) params.compensate_opacity = false, dL_dcamera = nullptr;
        constexpr double ln2 = 0.69314718055994530942, to_mean2d = 2 * ln2, to_covariance = 2 * ln2 * ln2;
        for (std::size_t k = 0; k < count; ++k) {
            Projection<double> dL;
            dL.mean2d = {to_mean2d * (ux[k] * u[k]), to_mean2d * (uy[k] * u[k] + vy[k] * v[k])};
            const double along_u = uy[k] * uu[k] + vy[k] * uv[k], along_v = uy[k] * uv[k] + vy[k] * vv[k];
            dL.covariance = {to_covariance * (ux[k] * ux[k] * uu[k]), to_covariance * (2 * ux[k] * along_u),
                             to_covariance * (uy[k] * along_u + vy[k] * along_v)};
            dL.depth = dL_ddepth[k];
            dL.opacity_factor = dL_dfactor[k];
            norm_square[k] = dL.mean2d.x * dL.mean2d.x + dL.mean2d.y * dL.mean2d.y;

            const vec3<double> mean(mean_x[k], mean_y[k], mean_z[k]);
            const sym3<double> covariance{xx[k], xy[k], xz[k], yy[k], yz[k], zz[k]};
            vec3<double> m(0);
            sym3<double> d{};
            gsh::project_backward(camera, mean, covariance, params, dL, m, d, dL_dcamera);
            dL_dmean_x[k] = m.x, dL_dmean_y[k] = m.y, dL_dmean_z[k] = m.z;
            dL_dxx[k] = d.xx, dL_dxy[k] = d.xy, dL_dxz[k] = d.xz, dL_dyy[k] = d.yy, dL_dyz[k] = d.yz, dL_dzz[k] = d.zz;
        }
    }
};

} // namespace detail

/// Second stage: sums the slots of each splat, and carries the gradient through the projection.
template <CpuBackend B, std::floating_point T>
void project_splats_backward(B& backend, const Camera<T>& camera, const SplatView<const T>& splats,
                             const RasterParams<T>& params, RasterCache<B, T>& cache,
                             const SplatView<T>& dL_dsplats, Span<CameraGradient<T>> dL_dcamera) {
    using namespace detail;
    RasterScratch<B, T>& scratch = cache.scratch;
    const std::size_t n = splats.size(), chunks = chunk_count(n, splat_grain);
    const Camera<double> wide_camera = camera.template cast<double>();
    const ProjectionParams<double> projection_params = params.template cast<double>();
    const bool general = !dL_dcamera.empty() || params.compensate_opacity;
    cache.screen_gradient_norms.resize(n);
    cache.screen_radii.resize(n);
    scratch.chunk_camera.resize(dL_dcamera.empty() ? 0 : chunks);

    backend.for_chunks(n, splat_grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        CameraGradient<double> chunk_camera;
        ProjectionBackwardBatch batch;
        const auto flush = [&] {
            if (general)
                batch.project_backward<true>(wide_camera, projection_params,
                                             dL_dcamera.empty() ? nullptr : &chunk_camera);
            else
                batch.project_backward<false>(wide_camera, projection_params, nullptr);
            for (std::size_t k = 0; k < batch.count; ++k) {
                const std::size_t i = batch.splat[k];
                cache.screen_gradient_norms[i] = static_cast<T>(std::sqrt(batch.norm_square[k]));
                if (!dL_dsplats.means.empty()) dL_dsplats.means[i] += batch.dL_dmean<T>(k);
                if (!dL_dsplats.covariances.empty()) dL_dsplats.covariances[i] += batch.dL_dcovariance<T>(k);
            }
            batch.count = 0;
        };
        for (std::size_t i = begin; i < end; ++i) {
            cache.screen_gradient_norms[i] = cache.screen_radii[i] = T(0);
            if (!cache.visible[i]) continue;
            T sum[slot_size<true>] = {};
            for (std::size_t slot = scratch.slot_begin[i]; slot < scratch.slot_begin[i + 1]; ++slot)
                for (std::size_t k = 0; k < scratch.slot_size; ++k)
                    sum[k] += scratch.slots[slot * scratch.slot_size + k];
            const ScreenSplat<T>& s = scratch.splats[i];
            cache.screen_radii[i] = static_cast<T>(screen_radius(s.w));
            if (!dL_dsplats.opacities.empty()) {
                const T factor = params.compensate_opacity ? s.opacity / splats.opacities[i] : T(1);
                dL_dsplats.opacities[i] += sum[slot_g] / s.opacity * factor;
            }
            if (!dL_dsplats.colors.empty())
                dL_dsplats.colors[i] += vec3<T>(sum[slot_red], sum[slot_green], sum[slot_blue]);
            batch.add(i, splats, s, sum);
            if (batch.count == batch.size) flush();
        }
        flush();
        if (!dL_dcamera.empty()) scratch.chunk_camera[chunk] = chunk_camera;
    });
    if (dL_dcamera.empty()) return;
    CameraGradient<double> sum;
    for (const CameraGradient<double>& share : scratch.chunk_camera) sum += share;
    CameraGradient<T>& out = dL_dcamera[0];
    out += CameraGradient<T>{mat3<T>(sum.dL_dR), vec3<T>(sum.dL_dt), T(sum.dL_dfx),
                             T(sum.dL_dfy),      T(sum.dL_dcx),      T(sum.dL_dcy)};
}

} // namespace gsh::cpu
