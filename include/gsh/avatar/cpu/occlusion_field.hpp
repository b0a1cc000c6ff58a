// SPDX-License-Identifier: Apache-2.0
/// @file  Ambient occlusion on the CPU: a tile of Gaussians at a time passes the network in the first-level cache.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/cpu/gemm.hpp>
#include <gsh/field/cpu/mlp.hpp>
#include <gsh/field/features.hpp>

#include <algorithm>
#include <cstddef>

namespace gsh::cpu {

namespace detail {

/// One chunk's way through the layers behind the first, tile by tile; nothing but its inputs and results leaves the
/// cache.
template <class T, class Network>
struct OcclusionTile {
    const MlpLayout<T, Network>& layout;
    Span<const T> neurons, pose; // [N, W], [W]

    [[nodiscard]] std::size_t width() const { return layout.in(0); }
    [[nodiscard]] std::size_t inputs_size() const { return mlp_tile_rows * layout.padded_in(0); }
    [[nodiscard]] std::size_t hidden_size() const { return layout.hidden_offset(mlp_tile_rows, 0, 0); }
    [[nodiscard]] std::size_t output_size() const { return mlp_tile_rows * layout.padded_out(layout.layers() - 1); }
    /// Numbers that `forward` works on.
    [[nodiscard]] std::size_t size() const { return inputs_size() + hidden_size() + output_size(); }

    T* inputs;
    [[nodiscard]] T* hidden() const { return inputs + inputs_size(); }
    [[nodiscard]] T* output() const { return hidden() + hidden_size(); }
    [[nodiscard]] typename Gemm<T>::Right active() const { return {inputs, layout.padded_in(0)}; }

    /// Rows [first, first + count) of [first, end).
    void forward(const T* packed, std::size_t first, std::size_t count, std::size_t end) const {
        const std::size_t stride = layout.padded_in(0), W = width();
        for (std::size_t r = 0; r < count; ++r) {
            const T* from = neurons.data() + (first + r) * W;
            T* row = inputs + r * stride;
            for (std::size_t o = 0; o < W; ++o) {
                const T sum = from[o] + pose[o];
                row[o] = sum > T(0) ? sum : T(0);
            }
            std::fill(row + W, row + stride, T(0));
        }
        const std::size_t next = first + count, next_count = std::min(mlp_tile_rows, end - next);
        const FeatureView<const T> view(neurons, neurons.size() / W, W, W);
        mlp_tile_forward(layout, packed, active(), count, hidden(), output(), Ahead<T>{view, next, next_count});
    }
};

/// Nothing is fetched ahead, whatever the layer.
template <class T>
struct NothingAhead {
    typename Gemm<T>::Nothing operator[](std::size_t) const { return {}; }
};

} // namespace detail

/// logits[i] = network(relu(neurons[i] + pose)).
template <CpuBackend B, class Network, class T, class Cache>
void occlusion_forward(B& backend, const Network& network, Span<const T> weights, Span<const T> neurons,
                       Span<const T> pose, Span<T> logits, Cache& cache) {
    const detail::MlpLayout<T, Network> layout{network};
    const detail::OcclusionTile<T, Network> sizes{layout, neurons, pose, nullptr};
    const std::size_t rows = logits.size(), grain = detail::mlp_chunk_rows(rows),
                      stride = layout.padded_out(layout.layers() - 1);
    cache.packed.resize(layout.transposed_offset(layout.layers()));
    cache.scratch.resize(chunk_count(rows, grain) * sizes.size());
    layout.pack_transposed(weights, cache.packed.data());

    backend.for_chunks(rows, grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        const detail::OcclusionTile<T, Network> tile{layout, neurons, pose,
                                                     cache.scratch.data() + chunk * sizes.size()};
        for (std::size_t first = begin; first < end; first += detail::mlp_tile_rows) {
            const std::size_t count = std::min(detail::mlp_tile_rows, end - first);
            tile.forward(cache.packed.data(), first, count, end);
            for (std::size_t r = 0; r < count; ++r) logits[first + r] = tile.output()[r * stride];
        }
    });
}

/// Adjoint with respect to what the pose brings: adds to dL_dpose [W]. The forward pass is run again tile by tile,
/// which is cheaper than keeping what it leaves.
template <CpuBackend B, class Network, class T, class Cache>
void occlusion_backward(B& backend, const Network& network, Span<const T> weights, Span<const T> neurons,
                        Span<const T> pose, Span<const T> dL_dlogits, Cache& cache, Span<T> dL_dpose) {
    const detail::MlpLayout<T, Network> layout{network};
    const detail::OcclusionTile<T, Network> sizes{layout, neurons, pose, nullptr};
    const std::size_t rows = dL_dlogits.size(), grain = detail::mlp_chunk_rows(rows), W = dL_dpose.size();
    const std::size_t forward_size = layout.transposed_offset(layout.layers()),
                      sums_size = layout.padded_offset(layout.layers());
    const std::size_t gradient_size = detail::mlp_tile_rows * layout.widest();
    const std::size_t scratch_size = sizes.size() + 2 * gradient_size + sums_size;
    cache.packed.resize(forward_size + sums_size);
    cache.scratch.resize(chunk_count(rows, grain) * scratch_size);
    cache.partials.resize(chunk_count(rows, grain) * W);
    layout.pack_transposed(weights, cache.packed.data());
    layout.pack_padded(weights, cache.packed.data() + forward_size);

    backend.for_chunks(rows, grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        T* scratch = cache.scratch.data() + chunk * scratch_size;
        const detail::OcclusionTile<T, Network> tile{layout, neurons, pose, scratch};
        T* const gradients[2] = {scratch + sizes.size(), scratch + sizes.size() + gradient_size};
        T* unused = scratch + sizes.size() + 2 * gradient_size; // sums of the weights' gradient: nobody asks for them
        T* sums = cache.partials.data() + chunk * W;
        std::fill_n(unused, sums_size, T(0));
        std::fill_n(sums, W, T(0));
        for (std::size_t first = begin; first < end; first += detail::mlp_tile_rows) {
            const std::size_t count = std::min(detail::mlp_tile_rows, end - first);
            tile.forward(cache.packed.data(), first, count, end);
            const T* dL_dx = detail::mlp_tile_backward(layout, cache.packed.data() + forward_size, tile.active(),
                                                       {dL_dlogits.data() + first, 1}, count, tile.hidden(), gradients,
                                                       unused, true, detail::NothingAhead<T>{});
            for (std::size_t r = 0; r < count; ++r)
                for (std::size_t o = 0; o < W; ++o)
                    sums[o] +=
                        tile.inputs[r * layout.padded_in(0) + o] > T(0) ? dL_dx[r * layout.padded_in(0) + o] : T(0);
        }
    });
    for (std::size_t chunk = 0; chunk < chunk_count(rows, grain); ++chunk)
        for (std::size_t o = 0; o < W; ++o) dL_dpose[o] += cache.partials[chunk * W + o];
}

} // namespace gsh::cpu
