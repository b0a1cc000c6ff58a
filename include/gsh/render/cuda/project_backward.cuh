// SPDX-License-Identifier: Apache-2.0
/// @file  Last stage of the rasterizer on a GPU: from sums over tiles to gradients of splats and camera.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/reduce.cuh>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/render/cuda/blend_tiles_backward.cuh>
#include <gsh/render/cuda/raster_scratch.cuh>
#include <gsh/render/projection.hpp>
#include <gsh/render/splat_moments.hpp>
#include <gsh/render/tiles.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>

namespace gsh::cuda::detail {

/// A camera's gradient in shared memory, which may not have a constructor.
template <std::floating_point T>
struct CameraNumbers {
    vec3<T> dL_dR[3], dL_dt;
    T intrinsics[4];
};

/// The sum of a camera's gradient over a thread block, on every thread. All threads take part.
template <unsigned Block, class T, std::size_t Warps>
[[nodiscard]] __device__ CameraGradient<T> block_sum_of(SharedArray<CameraNumbers<T>, Warps>& shared,
                                                        const CameraGradient<T>& value) {
    CameraNumbers<T> of_warp;
    for (int c = 0; c < 3; ++c) of_warp.dL_dR[c] = warp_sum(value.dL_dR[c]);
    of_warp.dL_dt = warp_sum(value.dL_dt);
    of_warp.intrinsics[0] = warp_sum(value.dL_dfx), of_warp.intrinsics[1] = warp_sum(value.dL_dfy);
    of_warp.intrinsics[2] = warp_sum(value.dL_dcx), of_warp.intrinsics[3] = warp_sum(value.dL_dcy);
    if (threadIdx.x % warp_size == 0) shared[threadIdx.x / warp_size] = of_warp;
    __syncthreads();
    CameraGradient<T> sum;
    for (std::size_t warp = 0; warp < Warps; ++warp) {
        const CameraNumbers<T> next = shared[warp];
        for (int c = 0; c < 3; ++c) sum.dL_dR[c] += next.dL_dR[c];
        sum.dL_dt += next.dL_dt;
        sum.dL_dfx += next.intrinsics[0], sum.dL_dfy += next.intrinsics[1];
        sum.dL_dcx += next.intrinsics[2], sum.dL_dcy += next.intrinsics[3];
    }
    return sum;
}

/// One thread per splat. Unlike positions, gradients are no small differences of large numbers, so plain float is
/// enough. Those of factors are: along a needle, what remains is small, so they are computed in FloatPair.
template <std::floating_point T, bool WithCamera, bool Factored>
struct ProjectSplatsBackward {
    static constexpr unsigned block_size = splats_of_block;
    static constexpr unsigned warps = block_size / warp_size;
    struct Shared {
        SharedArray<CameraNumbers<T>, WithCamera ? warps : 1> camera;
    };

    Span<const std::uint32_t> refused;
    SplatView<const T> splats;
    ProjectionParams<T> params;
    Span<const ScreenSplat<T>> screen;
    Span<const std::uint8_t> visible;
    Span<const std::uint32_t> slot_begin;
    Span<const Slot<T>> slots;
    SplatView<T> dL_dsplats;
    Span<T> gradient_norms, radii;
    Span<CameraGradient<T>> block_camera;
    Deferred<Camera<T>> camera;

    __device__ void operator()(Shared& shared) const {
        if (refused[0] != 0) return;
        const std::size_t i = std::size_t(blockIdx.x) * block_size + threadIdx.x;
        CameraGradient<T> dL_dcamera;
        if (i < splats.size()) add_splat(i, WithCamera ? &dL_dcamera : nullptr);
        if constexpr (WithCamera) {
            const CameraGradient<T> sum = block_sum_of<block_size>(shared.camera, dL_dcamera);
            if (threadIdx.x == 0) block_camera[blockIdx.x] = sum;
        }
    }

private:
    __device__ void add_splat(std::size_t i, CameraGradient<T>* dL_dcamera) const {
        if (visible[i] == 0) {
            gradient_norms[i] = radii[i] = T(0);
            return;
        }
        T sum[slot_entries] = {};
        for (std::uint32_t slot = slot_begin[i], end = slot_begin[i + 1]; slot < end; ++slot) {
            const Slot<T> of_tile = slots[slot];
            for (unsigned k = 0; k < slot_entries; ++k) sum[k] += of_tile.entries[k];
        }
        const ScreenSplat<T> s = screen[i];
        const T opacity = splats.opacities[i], g = sum[slot_g] / s.opacity;
        if (!dL_dsplats.opacities.empty())
            dL_dsplats.opacities[i] += params.compensate_opacity ? g * (s.opacity / opacity) : g;
        if (!dL_dsplats.colors.empty()) dL_dsplats.colors[i] += vec3<T>(sum[slot_red], sum[slot_green], sum[slot_blue]);

        radii[i] = screen_radius(Whitening<T>{s.ux, s.uy, s.vy});
        if constexpr (Factored)
            add_factored(i, s, sum, g * opacity, dL_dcamera);
        else
            add_plain(i, s, sum, g * opacity, dL_dcamera);
    }

    template <class W>
    __device__ static SplatMoments<W> moments_of(const T* sum) {
        return {W(sum[slot_u]), W(sum[slot_v]), W(sum[slot_uu]), W(sum[slot_uv]), W(sum[slot_vv])};
    }

    __device__ void add_plain(std::size_t i, const ScreenSplat<T>& s, const T* sum, T dL_dopacity_factor,
                              CameraGradient<T>* dL_dcamera) const {
        Projection<T> dL;
        moments_backward(Whitening<T>{s.ux, s.uy, s.vy}, moments_of<T>(sum), dL);
        dL.depth = sum[slot_depth];
        dL.opacity_factor = dL_dopacity_factor;
        gradient_norms[i] = sqrt(dL.mean2d.x * dL.mean2d.x + dL.mean2d.y * dL.mean2d.y);

        vec3<T> dL_dmean(T(0));
        sym3<T> dL_dcovariance{};
        project_backward(camera(), splats.means[i], splats.covariances[i], params, dL, dL_dmean, dL_dcovariance,
                         dL_dcamera);
        if (!dL_dsplats.means.empty()) dL_dsplats.means[i] += dL_dmean;
        if (!dL_dsplats.covariances.empty()) dL_dsplats.covariances[i] += dL_dcovariance;
    }

    __device__ void add_factored(std::size_t i, const ScreenSplat<T>& s, const T* sum, T dL_dopacity_factor,
                                 CameraGradient<T>* dL_dcamera) const {
        using W = Wider<T>;
        Projection<W> dL;
        moments_backward(Whitening<W>{W(s.ux), W(s.uy), W(s.vy)}, moments_of<W>(sum), dL);
        dL.depth = W(sum[slot_depth]);
        dL.opacity_factor = W(dL_dopacity_factor);
        const T x = rounded(dL.mean2d.x), y = rounded(dL.mean2d.y);
        gradient_norms[i] = sqrt(x * x + y * y);

        const W zero(T(0));
        const vec3<T> mean = splats.means[i];
        const vec3<W> wide_mean(W(mean.x), W(mean.y), W(mean.z));
        vec3<W> dL_dmean(zero);
        mat3<W> dL_dfactor(zero);
        CameraGradient<W> of_camera{mat3<W>(zero), vec3<W>(zero), zero, zero, zero, zero};
        project_backward(camera().template cast<W>(), wide_mean, widened<W>(splats.factors[i]), params, dL, dL_dmean,
                         dL_dfactor, dL_dcamera != nullptr ? &of_camera : nullptr);
        const auto narrowed = [](const vec3<W>& w) { return vec3<T>(rounded(w.x), rounded(w.y), rounded(w.z)); };
        if (!dL_dsplats.means.empty()) dL_dsplats.means[i] += narrowed(dL_dmean);
        if (!dL_dsplats.factors.empty())
            for (int c = 0; c < 3; ++c) dL_dsplats.factors[i][c] += narrowed(dL_dfactor[c]);
        if (dL_dcamera == nullptr) return;
        for (int c = 0; c < 3; ++c) dL_dcamera->dL_dR[c] += narrowed(of_camera.dL_dR[c]);
        dL_dcamera->dL_dt += narrowed(of_camera.dL_dt);
        dL_dcamera->dL_dfx += rounded(of_camera.dL_dfx), dL_dcamera->dL_dfy += rounded(of_camera.dL_dfy);
        dL_dcamera->dL_dcx += rounded(of_camera.dL_dcx), dL_dcamera->dL_dcy += rounded(of_camera.dL_dcy);
    }
};

/// Adds the sums over tiles and thread blocks to the gradients of the background's colour and of the camera. One thread
/// block: each thread adds every 256th, then the threads are joined.
template <std::floating_point T>
struct AddSharedGradients {
    static constexpr unsigned block_size = 256;
    static constexpr unsigned warps = block_size / warp_size;
    struct Shared {
        SharedArray<vec3<T>, warps> background;
        SharedArray<CameraNumbers<T>, warps> camera;
    };

    Span<const std::uint32_t> refused;
    Span<const vec3<T>> tile_background;
    Span<const CameraGradient<T>> block_camera;
    Span<vec3<T>> dL_dbackground;       // [1] or empty
    Span<CameraGradient<T>> dL_dcamera; // [1] or empty

    __device__ void operator()(Shared& shared) const {
        if (refused[0] != 0) return;
        if (!dL_dbackground.empty()) {
            vec3<T> sum(T(0));
            for (std::size_t i = threadIdx.x; i < tile_background.size(); i += block_size) sum += tile_background[i];
            sum = block_sum<block_size>(shared.background, sum);
            if (threadIdx.x == 0) dL_dbackground[0] += sum;
        }
        if (!dL_dcamera.empty()) {
            CameraGradient<T> sum;
            for (std::size_t i = threadIdx.x; i < block_camera.size(); i += block_size) sum += block_camera[i];
            sum = block_sum_of<block_size>(shared.camera, sum);
            if (threadIdx.x == 0) dL_dcamera[0] += sum;
        }
    }
};

} // namespace gsh::cuda::detail
