// SPDX-License-Identifier: Apache-2.0
/// @file  The rasterizer's backward pass on the CPU, as far as the image plane.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/render/cpu/composite_backward.hpp>
#include <gsh/render/cpu/project_backward.hpp>
#include <gsh/render/screen_gradient.hpp>
#include <gsh/render/splat_moments.hpp>
#include <gsh/render/target.hpp>

#include <cstddef>

namespace gsh::cpu::inline GSH_ISA {

/// Adjoint of the blend; see Rasterizer::backward_to_screen.
template <CpuBackend B, std::floating_point T>
void composite_backward_to_screen(B& backend, const Background<T>& background, const RasterParams<T>& params,
                                  const RenderGradient<T>& dL_dtarget, RasterCache<B, T>& cache,
                                  const ScreenGradient<T>& dL_dscreen, const BackgroundGradient<T>& dL_dbackground) {
    using namespace detail;
    const bool absolute = !dL_dscreen.absolute_means2d.empty();
    if (absolute) blend_tiles_backward<true>(backend, background, params, dL_dtarget, cache, dL_dbackground);
    else blend_tiles_backward(backend, background, params, dL_dtarget, cache, dL_dbackground);

    const RasterScratch<B, T>& scratch = cache.scratch;
    backend.for_chunks(cache.splat_count, splat_grain, [&](std::size_t, std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            if (!cache.visible[i]) continue;
            T sum[slot_size<true, true>] = {};
            add_slots(scratch, i, scratch.slot_size, sum);
            const T* const absolute_sum = sum + scratch.slot_size - 2;
            const ScreenSplat<T>& s = scratch.splats[i];
            const SplatMoments<double> moments{double(sum[slot_u]), double(sum[slot_v]), double(sum[slot_uu]),
                                               double(sum[slot_uv]), double(sum[slot_vv])};
            Projection<double> dL;
            moments_backward(s.w, moments, dL);
            if (!dL_dscreen.means2d.empty()) dL_dscreen.means2d[i] += vec2<T>(dL.mean2d);
            if (!dL_dscreen.conics.empty()) {
                const sym2<double> conic = conic_gradient(s.w, moments);
                sym2<T>& out = dL_dscreen.conics[i];
                out.xx += T(conic.xx), out.xy += T(conic.xy), out.yy += T(conic.yy);
            }
            if (!dL_dscreen.depths.empty() && dL_dtarget.has_depth()) dL_dscreen.depths[i] += sum[slot_depth];
            if (!dL_dscreen.opacities.empty()) dL_dscreen.opacities[i] += sum[slot_g] / s.opacity;
            if (!dL_dscreen.colors.empty())
                dL_dscreen.colors[i] += vec3<T>(sum[slot_red], sum[slot_green], sum[slot_blue]);
            if (!absolute) continue;
            constexpr double to_mean2d = 2 * 0.69314718055994530942; // as in moments_backward
            dL_dscreen.absolute_means2d[i] +=
                vec2<T>(T(to_mean2d * s.w.ux * double(absolute_sum[0])), T(to_mean2d * double(absolute_sum[1])));
        }
    });
}

} // namespace gsh::cpu
