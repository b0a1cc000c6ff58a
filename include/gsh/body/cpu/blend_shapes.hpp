// SPDX-License-Identifier: Apache-2.0
/// @file  Blend shapes on the CPU: directions stream past a chunk of vertices that stays in the first-level cache.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/blend_shapes.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstddef>

namespace gsh {

template <CpuBackend B, std::floating_point T>
struct BlendShapesScratch<B, T> {
    typename B::template Buffer<T> partials; ///< [chunks, C] each chunk's sums
};

namespace cpu::inline GSH_ISA {

/// Elements in a chunk of blend-shape work: their offsets stay in the first cache while the directions stream by.
inline constexpr std::size_t blend_shape_grain = 512;

/// offsets[v] += Σ_k coefficients[k] directions[k, v].
template <CpuBackend B, std::floating_point T>
void blend_shapes_forward(B& backend, Span<const vec3<T>> directions, Span<const T> coefficients,
                          Span<vec3<T>> offsets) {
    const std::size_t V = offsets.size();
    backend.for_chunks(V, blend_shape_grain, [&](std::size_t, std::size_t begin, std::size_t end) {
        T* const out = &offsets[begin].x;
        for (std::size_t k = 0; k < coefficients.size(); ++k) {
            const T c = coefficients[k];
            if (c == T(0)) continue; // betas at their initial values, an expression at rest: nothing to stream
            const T* const direction = &directions[k * V + begin].x;
            for (std::size_t n = 0; n < 3 * (end - begin); ++n) out[n] += c * direction[n];
        }
    });
}

/// dL_dcoefficients[k] += Σ_v <directions[k, v], dL_doffsets[v]>.
///
/// Deterministic: each chunk of vertices sums in 16 interleaved accumulators (a register's worth, so that the
/// compiler may vectorise a float sum), chunks are joined in order.
template <CpuBackend B, std::floating_point T>
void blend_shapes_backward(B& backend, Span<const vec3<T>> directions, Span<const vec3<T>> dL_doffsets,
                           Span<T> dL_dcoefficients, BlendShapesScratch<B, T>& scratch) {
    constexpr std::size_t width = 16;
    const std::size_t V = dL_doffsets.size(), C = dL_dcoefficients.size();
    const std::size_t chunks = chunk_count(V, blend_shape_grain);
    typename B::template Buffer<T>& partials = scratch.partials;
    partials.resize(chunks * C);
    backend.for_chunks(V, blend_shape_grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        const T* const gradient = &dL_doffsets[begin].x;
        const std::size_t count = 3 * (end - begin), whole = count / width * width;
        for (std::size_t k = 0; k < C; ++k) {
            const T* const direction = &directions[k * V + begin].x;
            T sums[width] = {};
            for (std::size_t n = 0; n < whole; n += width)
                for (std::size_t lane = 0; lane < width; ++lane)
                    sums[lane] += direction[n + lane] * gradient[n + lane];
            for (std::size_t n = whole; n < count; ++n) sums[n - whole] += direction[n] * gradient[n];
            T total = 0;
            for (const T sum : sums) total += sum;
            partials[chunk * C + k] = total;
        }
    });
    for (std::size_t k = 0; k < C; ++k) {
        T total = 0;
        for (std::size_t chunk = 0; chunk < chunks; ++chunk) total += partials[chunk * C + k];
        dL_dcoefficients[k] += total;
    }
}

} // namespace cpu

} // namespace gsh
