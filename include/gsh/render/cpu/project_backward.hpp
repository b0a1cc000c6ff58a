// SPDX-License-Identifier: Apache-2.0
/// @file  Last stage of the rasterizer on the CPU: from sums over tiles to gradients of splats and camera.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/prefetch.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/math/sym.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/math/wide.hpp>
#include <gsh/render/cpu/project.hpp>
#include <gsh/render/projection.hpp>
#include <gsh/render/cpu/raster_scratch.hpp>
#include <gsh/render/raster_cache.hpp>
#include <gsh/render/splat_moments.hpp>

#include <algorithm>
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
    // Then, for ScreenGradient::absolute_means2d: sum |G u|, sum |G (uy u + vy v)|
};
template <bool Depth, bool Absolute = false>
inline constexpr std::size_t slot_size = (Depth ? 10 : 9) + (Absolute ? 2 : 0);

/// Adds the first `count` entries of the slots of a splat.
template <class Scratch, std::floating_point T>
GSH_INLINE void add_slots(const Scratch& scratch, std::size_t splat, std::size_t count, T* sum) {
    const auto slot_of = [&](std::size_t pair) {
        return scratch.slots.data() + scratch.pair_places[pair] * scratch.slot_size;
    };
    const std::size_t pairs = scratch.pair_places.size();
    for (std::size_t pair = scratch.pair_begin[splat]; pair < scratch.pair_begin[splat + 1]; ++pair) {
        constexpr std::size_t ahead = 32; // the slots of a splat are scattered in memory
        if (pair + ahead < pairs) prefetch(slot_of(pair + ahead)), prefetch(slot_of(pair + ahead) + slot_blue);
        const T* const share = slot_of(pair);
        for (std::size_t k = 0; k < slot_size<false>; ++k) sum[k] += share[k];
        for (std::size_t k = slot_size<false>; k < count; ++k) sum[k] += share[k];
    }
}

/// Carries the gradients of visible splats through their projection in batches, in registers and in double.
template <std::floating_point T, class W = Wide<double>>
class ProjectionBackwardBatch {
public:
    static constexpr std::size_t size = 64;

    /// `factored`: the splats have factors instead of covariances. With dL_dcamera, the camera's gradient is computed,
    /// too.
    ProjectionBackwardBatch(const Camera<double>& camera, const RasterParams<T>& params, bool factored,
                            bool with_camera)
        : camera_(camera), params_(params.template cast<double>()), factored_(factored), with_camera_(with_camera) {}

    std::size_t count = 0;
    std::size_t splat[size];
    // After project_backward: |dL_dmean2d|, and screen_radius.
    alignas(64) T gradient_norm[size], radius[size];

    /// `sum` [slot_size<true>]: the splat's sums over all tiles.
    void add(std::size_t i, const SplatView<const T>& splats, const ScreenSplat<T>& s, const T* sum) {
        const std::size_t k = count++;
        const vec3<T>& m = splats.means[i];
        splat[k] = i;
        const T numbers[others] = {
            m.x,          m.y,          m.z,          sum[slot_u],     sum[slot_v],
            sum[slot_uu], sum[slot_uv], sum[slot_vv], sum[slot_depth], sum[slot_g] / s.opacity * splats.opacities[i]};
        for (std::size_t n = 0; n < others; ++n) in_[n][k] = numbers[n];
        if (factored_) {
            const mat3<T>& F = splats.factors[i];
            for (int n = 0; n < 9; ++n) in_[others + static_cast<std::size_t>(n)][k] = F[n / 3][n % 3];
        } else {
            const sym3<T>& c = splats.covariances[i];
            const T shape[6] = {c.xx, c.xy, c.xz, c.yy, c.yz, c.zz};
            for (std::size_t n = 0; n < 6; ++n) in_[others + n][k] = shape[n];
        }
        ux_[k] = s.w.ux, uy_[k] = s.w.uy, vy_[k] = s.w.vy;
    }

    void project_backward() {
        for (std::size_t k = 0; k < count; k += W::width) project_backward(k);
    }

    [[nodiscard]] vec3<T> dL_dmean(std::size_t k) const { return {out_[0][k], out_[1][k], out_[2][k]}; }
    [[nodiscard]] sym3<T> dL_dcovariance(std::size_t k) const {
        return {out_[3][k], out_[4][k], out_[5][k], out_[6][k], out_[7][k], out_[8][k]};
    }
    [[nodiscard]] mat3<T> dL_dfactor(std::size_t k) const {
        const auto column = [&](std::size_t n) { return vec3<T>(out_[n][k], out_[n + 1][k], out_[n + 2][k]); };
        return {column(3), column(6), column(9)};
    }
    /// Adds the camera's gradient of all batches so far.
    void add_camera(CameraGradient<double>& dL_dcamera) const {
        const Span<double> numbers = view_as<double>(Span<CameraGradient<double>>(&dL_dcamera, 1));
        for (std::size_t n = 0; n < camera_numbers; ++n)
            for (std::size_t lane = 0; lane < W::width; ++lane) numbers[n] += of_camera_[n * W::width + lane];
    }

private:
    static constexpr std::size_t others = 10; // inputs besides a shape of 6 or 9 numbers
    alignas(64) T in_[others + 9][size] = {}; // as in add; numbers beyond `count` are those of earlier splats
    alignas(64) double ux_[size] = {}, uy_[size] = {}, vy_[size] = {};
    alignas(64) T out_[3 + 9][size];
    Camera<double> camera_;
    ProjectionParams<double> params_;
    bool factored_, with_camera_;
    static constexpr std::size_t camera_numbers = sizeof(CameraGradient<double>) / sizeof(double);
    alignas(64) double of_camera_[camera_numbers * W::width] = {}; // lane by lane

    void project_backward([[maybe_unused]] std::size_t k) {
#if !defined(__CUDA_ARCH__) // as in ProjectionBatch
        const W zero(0.0);
        const auto in = [&](std::size_t n) { return widened(in_[n] + k); };
        const Whitening<W> whitening{W::load(ux_ + k), W::load(uy_ + k), W::load(vy_ + k)};
        Projection<W> dL;
        moments_backward(whitening, SplatMoments<W>{in(3), in(4), in(5), in(6), in(7)}, dL);
        dL.depth = in(8);
        dL.opacity_factor = in(9);
        store_narrowed(sqrt(dL.mean2d.x * dL.mean2d.x + dL.mean2d.y * dL.mean2d.y), gradient_norm + k);
        store_narrowed(screen_radius(whitening), radius + k);

        vec3<W> dL_dmean(zero);
        const vec3<W> mean(in(0), in(1), in(2));
        const Camera<W> camera = in_all_lanes<W>(camera_);
        CameraGradient<W> of_camera{mat3<W>(zero), vec3<W>(zero), zero, zero, zero, zero};
        CameraGradient<W>* const dL_dcamera = with_camera_ ? &of_camera : nullptr;
        if (factored_) {
            const auto column = [&](std::size_t n) { return vec3<W>(in(n), in(n + 1), in(n + 2)); };
            const mat3<W> F(column(others), column(others + 3), column(others + 6));
            mat3<W> dL_dF(zero);
            gsh::project_backward(camera, mean, F, params_, dL, dL_dmean, dL_dF, dL_dcamera);
            for (int n = 0; n < 9; ++n) store_narrowed(dL_dF[n / 3][n % 3], out_[3 + n] + k);
        } else {
            const sym3<W> covariance{in(others),     in(others + 1), in(others + 2),
                                     in(others + 3), in(others + 4), in(others + 5)};
            sym3<W> c{zero, zero, zero, zero, zero, zero};
            gsh::project_backward(camera, mean, covariance, params_, dL, dL_dmean, c, dL_dcamera);
            const W results[6] = {c.xx, c.xy, c.xz, c.yy, c.yz, c.zz};
            for (std::size_t n = 0; n < 6; ++n) store_narrowed(results[n], out_[3 + n] + k);
        }
        for (int n = 0; n < 3; ++n) store_narrowed(dL_dmean[n], out_[n] + k);
        if (!with_camera_) return;
        static_assert(sizeof of_camera == camera_numbers * sizeof(W));
        const auto* const numbers = reinterpret_cast<const W*>(&of_camera);
        const W lane = W::load(lane_numbers), splats(static_cast<double>(count - k)); // other lanes hold no splat
        for (std::size_t n = 0; n < camera_numbers; ++n) {
            double* const sum = of_camera_ + n * W::width;
            (W::load(sum) + select(lane < splats, numbers[n], zero)).store(sum);
        }
#endif
    }
    alignas(64) static constexpr double lane_numbers[] = {0, 1, 2, 3, 4, 5, 6, 7};
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
    const Camera<double> camera_in_double = camera.template cast<double>();
    const bool skips_dark = params.gradient_transmittance_min > T(0);
    cache.screen_gradient_norms.resize(n);
    cache.screen_radii.resize(n);
    scratch.chunk_camera.resize(dL_dcamera.empty() ? 0 : chunks);

    backend.for_chunks(n, splat_grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        ProjectionBackwardBatch<T> batch(camera_in_double, params, splats.is_factored(), !dL_dcamera.empty());
        const auto flush = [&] {
            batch.project_backward();
            for (std::size_t k = 0; k < batch.count; ++k) {
                const std::size_t i = batch.splat[k];
                cache.screen_gradient_norms[i] = batch.gradient_norm[k];
                cache.screen_radii[i] = batch.radius[k];
                if (!dL_dsplats.means.empty()) dL_dsplats.means[i] += batch.dL_dmean(k);
                if (!dL_dsplats.covariances.empty()) dL_dsplats.covariances[i] += batch.dL_dcovariance(k);
                if (!dL_dsplats.factors.empty()) dL_dsplats.factors[i] += batch.dL_dfactor(k);
            }
            batch.count = 0;
        };
        for (std::size_t i = begin; i < end; ++i) {
            cache.screen_gradient_norms[i] = cache.screen_radii[i] = T(0);
            constexpr std::size_t splats_ahead = 64; // arrays of many bytes a splat; their gradients are written later
            prefetch(scratch.splats.data() + i + splats_ahead);
            if (!splats.covariances.empty()) prefetch(splats.covariances.data() + i + splats_ahead);
            if (!dL_dsplats.covariances.empty()) prefetch_for_write(dL_dsplats.covariances.data() + i);
            if (!dL_dsplats.means.empty()) prefetch_for_write(dL_dsplats.means.data() + i);
            if (!cache.visible[i]) continue;
            T sum[slot_size<true>] = {};
            add_slots(scratch, i, scratch.slot_size, sum);
            const ScreenSplat<T>& s = scratch.splats[i];
            if (skips_dark && std::all_of(sum, sum + slot_size<true>, [](T number) { return number == T(0); })) {
                cache.screen_radii[i] = static_cast<T>(screen_radius(s.w));
                continue;
            }
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
        if (dL_dcamera.empty()) return;
        scratch.chunk_camera[chunk] = {};
        batch.add_camera(scratch.chunk_camera[chunk]);
    });
    if (dL_dcamera.empty()) return;
    CameraGradient<double> sum;
    for (const CameraGradient<double>& share : scratch.chunk_camera) sum += share;
    CameraGradient<T>& out = dL_dcamera[0];
    out += CameraGradient<T>{mat3<T>(sum.dL_dR), vec3<T>(sum.dL_dt), T(sum.dL_dfx),
                             T(sum.dL_dfy),      T(sum.dL_dcx),      T(sum.dL_dcy)};
}

} // namespace gsh::cpu
