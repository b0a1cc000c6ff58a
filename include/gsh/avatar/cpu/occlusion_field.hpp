// SPDX-License-Identifier: Apache-2.0
/// @file  Ambient occlusion on the CPU: tiles of Gaussians pass the network within the first-level cache.
#pragma once

#include <gsh/avatar/occlusion_field.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/cpu/gemm.hpp>
#include <gsh/field/cpu/mlp.hpp>
#include <gsh/field/features.hpp>

#include <algorithm>
#include <concepts>
#include <cstddef>

namespace gsh {

template <CpuBackend B, std::floating_point T>
struct OcclusionFieldScratch<B, T> {
    typename B::template Buffer<T> packed;   // weights in the layout of the products
    typename B::template Buffer<T> tiles;    // working storage of each chunk: a tile of every layer
    typename B::template Buffer<T> partials; // [chunks, W] each chunk's sum of dL_dpose
};

namespace cpu::inline GSH_ISA {

namespace detail {

/// The pass of one chunk through the layers after the first, tile by tile. Only inputs and results leave the cache.
template <class T, class Network>
struct OcclusionTile {
    const MlpLayout<T, Network>& layout;
    Span<const T> neurons, pose; // [N, W], [W]

    [[nodiscard]] std::size_t width() const { return layout.in(0); }
    [[nodiscard]] std::size_t inputs_size() const { return mlp_tile_rows * layout.padded_in(0); }
    [[nodiscard]] std::size_t hidden_size() const { return layout.hidden_layers() * layout.pitch(mlp_tile_rows); }
    [[nodiscard]] std::size_t output_size() const { return mlp_tile_rows * layout.padded_out(layout.layers() - 1); }
    /// Length of the working storage of `forward`.
    [[nodiscard]] std::size_t size() const { return inputs_size() + hidden_size() + output_size(); }

    T* inputs;
    [[nodiscard]] T* hidden() const { return inputs + inputs_size(); }
    [[nodiscard]] T* output() const { return hidden() + hidden_size(); }
    [[nodiscard]] typename Gemm<T>::Right active() const { return {inputs, layout.padded_in(0)}; }

    /// Processes rows [first, first + count) of a chunk that ends at row `end`.
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
        mlp_tile_forward(layout, packed, active(), count, hidden(), layout.pitch(count), output(),
                         Ahead<T, RowsFrom>{view, {next}, next_count});
    }
};

/// Prefetches nothing, for any layer.
template <class T>
struct NothingAhead {
    typename Gemm<T>::Nothing operator[](std::size_t) const { return {}; }
};

} // namespace detail

/// logits[i] = network(relu(neurons[i] + pose)).
template <CpuBackend B, class Network, class T>
void occlusion_forward(B& backend, const Network& network, Span<const T> weights, Span<const T> neurons,
                       Span<const T> pose, Span<T> logits, OcclusionFieldScratch<B, T>& scratch) {
    const detail::MlpLayout<T, Network> layout{network};
    const detail::OcclusionTile<T, Network> sizes{layout, neurons, pose, nullptr};
    const std::size_t rows = logits.size(), grain = detail::mlp_chunk_rows(rows),
                      stride = layout.padded_out(layout.layers() - 1);
    scratch.packed.resize(layout.transposed_offset(layout.layers()));
    scratch.tiles.resize(chunk_count(rows, grain) * sizes.size());
    layout.pack_transposed(weights, scratch.packed.data());

    backend.for_chunks(rows, grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        const detail::OcclusionTile<T, Network> tile{layout, neurons, pose,
                                                     scratch.tiles.data() + chunk * sizes.size()};
        for (std::size_t first = begin; first < end; first += detail::mlp_tile_rows) {
            const std::size_t count = std::min(detail::mlp_tile_rows, end - first);
            tile.forward(scratch.packed.data(), first, count, end);
            for (std::size_t r = 0; r < count; ++r) logits[first + r] = tile.output()[r * stride];
        }
    });
}

/// Adjoint with respect to the contribution of the pose: adds to dL_dpose [W]. The forward pass is repeated tile by
/// tile, which is cheaper than storing its results.
template <CpuBackend B, class Network, class T>
void occlusion_backward(B& backend, const Network& network, Span<const T> weights, Span<const T> neurons,
                        Span<const T> pose, Span<const T> dL_dlogits, OcclusionFieldScratch<B, T>& scratch,
                        Span<T> dL_dpose) {
    const detail::MlpLayout<T, Network> layout{network};
    const detail::OcclusionTile<T, Network> sizes{layout, neurons, pose, nullptr};
    const std::size_t rows = dL_dlogits.size(), grain = detail::mlp_chunk_rows(rows), W = dL_dpose.size();
    const std::size_t forward_size = layout.transposed_offset(layout.layers()),
                      sums_size = layout.padded_offset(layout.layers());
    const std::size_t gradient_size = detail::mlp_tile_rows * layout.widest();
    const std::size_t work_size = sizes.size() + 2 * gradient_size + sums_size;
    scratch.packed.resize(forward_size + sums_size);
    scratch.tiles.resize(chunk_count(rows, grain) * work_size);
    scratch.partials.resize(chunk_count(rows, grain) * W);
    layout.pack_transposed(weights, scratch.packed.data());
    layout.pack_padded(weights, scratch.packed.data() + forward_size);

    backend.for_chunks(rows, grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        T* work = scratch.tiles.data() + chunk * work_size;
        const detail::OcclusionTile<T, Network> tile{layout, neurons, pose, work};
        T* const gradients[2] = {work + sizes.size(), work + sizes.size() + gradient_size};
        T* unused = work + sizes.size() + 2 * gradient_size; // sums of the gradient of the weights, not used
        T* sums = scratch.partials.data() + chunk * W;
        std::fill_n(unused, sums_size, T(0));
        std::fill_n(sums, W, T(0));
        for (std::size_t first = begin; first < end; first += detail::mlp_tile_rows) {
            const std::size_t count = std::min(detail::mlp_tile_rows, end - first);
            tile.forward(scratch.packed.data(), first, count, end);
            const T* dL_dx = detail::mlp_tile_backward(layout, scratch.packed.data() + forward_size, tile.active(),
                                                       {dL_dlogits.data() + first, 1}, count, tile.hidden(),
                                                       layout.pitch(count), gradients, unused, W,
                                                       detail::NothingAhead<T>{});
            for (std::size_t r = 0; r < count; ++r)
                for (std::size_t o = 0; o < W; ++o)
                    sums[o] +=
                        tile.inputs[r * layout.padded_in(0) + o] > T(0) ? dL_dx[r * layout.padded_in(0) + o] : T(0);
        }
    });
    for (std::size_t chunk = 0; chunk < chunk_count(rows, grain); ++chunk)
        for (std::size_t o = 0; o < W; ++o) dL_dpose[o] += scratch.partials[chunk * W + o];
}

} // namespace cpu

} // namespace gsh
