// SPDX-License-Identifier: Apache-2.0
/// @file  The kernel of the MLP's backward pass: gradients of a tile of rows go back through all layers.
#pragma once

#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/core/span.hpp>
#include <gsh/field/cuda/mlp_shape.cuh>
#include <gsh/field/cuda/mlp_tile.cuh>
#include <gsh/field/cuda/row.cuh>

#include <cstddef>

namespace gsh::cuda::detail {

/// A block processes a fixed range of tiles and keeps its own sums of the weights' gradients, which a later kernel
/// joins. The sums are in global memory: three layers of them would take 80 registers a thread, and adding a tile's
/// share costs two instructions in a hundred.
///
/// The tile holds the gradient of a layer's outputs. From it and the layer's inputs come the gradients of the weights;
/// from it and the weights that of the inputs, which takes its place.
template <class T>
struct MlpBackward {
    using Tile = MlpTile<T>;
    using Shared = typename Tile::Shared;
    static constexpr unsigned block_size = Tile::threads, least_blocks = Tile::least_blocks;

    MlpShape shape;
    MlpRowInputs<T> inputs;
    Span<const Row<T, 4>> packed; ///< MlpShape::backward_offset
    Span<const Row<T, 4>> hidden; ///< as of MlpForward
    Span<const T> dL_doutputs;
    Span<T> sums;                 ///< [blocks][shape.sums_size()]
    Span<Row<T, 4>> wide;         ///< [blocks][2][width][rows of a tile] if uses_wide
    MlpColumns<T> dL_dfeatures;   ///< no columns: not wanted
    bool adds;                    ///< to dL_dfeatures
    unsigned tiles, blocks;

    /// Whether a gradient must be kept outside of the tile: it does not fit, or is needed again after another has taken
    /// its place.
    [[nodiscard]] GSH_HD static bool uses_wide(const MlpShape& shape, std::size_t features) {
        return shape.layers > 1 && (shape.width > mlp_columns || features > mlp_columns);
    }

    __device__ void operator()(Shared& shared) const {
        // Ranges differ by one tile at most.
        const unsigned begin = static_cast<unsigned>(std::size_t(tiles) * blockIdx.x / blocks),
                       end = static_cast<unsigned>(std::size_t(tiles) * (blockIdx.x + 1) / blocks);
        for (unsigned tile = begin; tile < end; ++tile) {
            unsigned held = nothing;
            for (unsigned layer = shape.layers; layer-- > 0;) {
                add_weights(shared, tile, layer, tile == begin, held);
                const unsigned columns = layer ? shape.width : dL_dfeatures.columns;
                for (unsigned group = 0; group < mlp_groups(columns); ++group)
                    with_width(count_of(columns, group), [&](auto width) {
                        run_layer<decltype(width)::value>(shared, tile, layer, group, count_of(columns, group), held);
                    });
            }
        }
    }

private:
    static constexpr unsigned nothing = ~0u;

    [[nodiscard]] __device__ static unsigned count_of(unsigned columns, unsigned group) {
        const unsigned rest = columns - group * mlp_columns;
        return rest < mlp_columns ? rest : mlp_columns;
    }
    [[nodiscard]] __device__ static unsigned padded(unsigned count) { return count > 32 ? 64 : count > 16 ? 32 : 16; }
    [[nodiscard]] __device__ static std::size_t first_row(unsigned tile) { return std::size_t(tile) * Tile::rows; }
    [[nodiscard]] __device__ std::size_t hidden_offset(unsigned tile, unsigned layer, unsigned column) const {
        return ((std::size_t(tile) * (shape.layers - 1) + layer) * shape.width + column) * (Tile::rows / 4);
    }
    /// The gradient of a layer's outputs.
    [[nodiscard]] __device__ std::size_t wide_offset(unsigned layer, unsigned column) const {
        return ((std::size_t(blockIdx.x) * 2 + layer % 2) * shape.width + column) * (Tile::rows / 4);
    }

    /// The gradient of 64 outputs of a layer, unless the tile holds it.
    __device__ void load_gradient(Shared& shared, unsigned tile, unsigned layer, unsigned group,
                                  unsigned& held) const {
        if (held == 1024 * layer + group) return;
        held = 1024 * layer + group;
        const unsigned count = count_of(shape.out(layer), group), first_column = group * mlp_columns;
        __syncthreads();
        if (layer + 1 < shape.layers) {
            load_columns<Tile::rows, Tile::stride, T>(shared.tile, wide, wide_offset(layer, first_column),
                                                      Tile::rows / 4, count, padded(count));
            return;
        }
        for (unsigned e = threadIdx.x; e < Tile::rows * count; e += block_size) { // neighbouring numbers
            const unsigned r = e / count, c = e - r * count;
            shared.tile[c * Tile::stride + r] =
                first_row(tile) + r < inputs.rows()
                    ? dL_doutputs[(first_row(tile) + r) * shape.outputs + first_column + c]
                    : T(0);
        }
        for (unsigned e = threadIdx.x; e < Tile::rows * (padded(count) - count); e += block_size)
            shared.tile[(count + e / Tile::rows) * Tile::stride + e % Tile::rows] = T(0);
    }

    /// dL/dW[o, i] += sum over the rows of dL/dy[o] x[i].
    __device__ void add_weights(Shared& shared, unsigned tile, unsigned layer, bool first, unsigned& held) const {
        for (unsigned out = 0; out < mlp_groups(shape.out(layer)); ++out) {
            load_gradient(shared, tile, layer, out, held);
            if (layer == 0 && shape.shared != 0) add_bias(shared, out, first);
            for (unsigned in = 0; in < mlp_groups(shape.in(layer)); ++in)
                with_width(count_of(shape.out(layer), out), [&](auto outputs) {
                    with_width(count_of(shape.in(layer), in), [&](auto width) {
                        add_piece<decltype(outputs)::value, decltype(width)::value>(shared, tile, layer, out, in,
                                                                                    first);
                    });
                });
        }
    }

    template <unsigned Outputs, unsigned Inputs>
    __device__ void add_piece(Shared& shared, unsigned tile, unsigned layer, unsigned out, unsigned in,
                              bool first) const {
        constexpr unsigned N = Outputs / 16, M = Inputs / 8;
        const unsigned count = count_of(shape.in(layer), in);
        T piece[N][M] = {};
        for (unsigned r = 0; r < Tile::rows; r += Tile::depth) {
            __syncthreads();
            if (layer == 0)
                inputs.template load<Tile::depth, Tile::side_stride>(shared.side, first_row(tile) + r,
                                                                     in * mlp_columns, count, Inputs);
            else
                load_columns<Tile::depth, Tile::side_stride, T>(
                    shared.side, hidden, hidden_offset(tile, layer - 1, in * mlp_columns) + r / 4, Tile::rows / 4,
                    count, Inputs);
            __syncthreads();
            multiply_over_rows<T, Outputs, Inputs>(shared, r, piece);
        }
        // Each thread's numbers at a distance of the block, so that neighbouring threads write neighbouring numbers.
        const std::size_t begin =
            blockIdx.x * shape.sums_size() +
            std::size_t(shape.first_piece(layer) + out * mlp_groups(shape.in(layer)) + in) * mlp_columns * mlp_columns;
        for (unsigned i = 0; i < N; ++i)
            for (unsigned j = 0; j < M; ++j) {
                T& sum = sums[begin + (i * 8 + j) * block_size + threadIdx.x];
                sum = first ? piece[i][j] : sum + piece[i][j];
            }
    }

    /// The gradient of the first layer's bias: a warp sums one column of the tile after the other.
    __device__ void add_bias(Shared& shared, unsigned group, bool first) const {
        const std::size_t begin = blockIdx.x * shape.sums_size() +
                                  std::size_t(shape.piece_count()) * mlp_columns * mlp_columns + group * mlp_columns;
        __syncthreads();
        for (unsigned c = threadIdx.x / warp_size; c < count_of(shape.out(0), group); c += block_size / warp_size) {
            T sum = 0;
            for (unsigned r = threadIdx.x % warp_size; r < Tile::rows; r += warp_size)
                sum += shared.tile[c * Tile::stride + r];
            for (int distance = warp_size / 2; distance > 0; distance /= 2)
                sum += __shfl_xor_sync(all_lanes, sum, distance);
            if (threadIdx.x % warp_size == 0) sums[begin + c] = first ? sum : sums[begin + c] + sum;
        }
    }

    /// dL/dx = dL/dy W for 64 columns of x, or the rest; through the ReLU that made x.
    template <unsigned Columns>
    __device__ void run_layer(Shared& shared, unsigned tile, unsigned layer, unsigned group, unsigned count,
                              unsigned& held) const {
        constexpr unsigned N = Tile::thread_rows, M = Columns / 8;
        const unsigned length = mlp_groups(shape.in(layer)) * (mlp_columns / 4);
        T dL_dx[N][M] = {};
        for (unsigned out = 0; out < mlp_groups(shape.out(layer)); ++out) {
            const unsigned inner = count_of(shape.out(layer), out);
            load_gradient(shared, tile, layer, out, held);
            for (unsigned k = 0; k < inner; k += Tile::depth) {
                const unsigned depth = inner - k < Tile::depth ? inner - k : Tile::depth;
                __syncthreads();
                load_weights<T>(shared.side, packed,
                                shape.backward_offset(layer) / 4 +
                                    std::size_t(out * mlp_columns + k) * length + group * (mlp_columns / 4),
                                length, depth);
                __syncthreads();
                multiply<T, Columns>(shared, k, depth, dL_dx);
            }
        }
        const bool stays = layer == 0 || shape.width <= mlp_columns, saved = layer != 0 && !wide.empty();
        if (stays) __syncthreads(); // the tile is still read
        for (unsigned j = 0; j < M; ++j) {
            const unsigned c = Tile::template column<Columns>(j);
            for (unsigned i = 0; i < N; i += 4) {
                Row<T, 4> four{};
                for (unsigned u = 0; u < 4; ++u) four[u] = dL_dx[i + u][j];
                if (layer != 0 && c < count) {
                    const Row<T, 4> x =
                        hidden[hidden_offset(tile, layer - 1, group * mlp_columns + c) + Tile::row(i) / 4];
                    for (unsigned u = 0; u < 4; ++u) four[u] = x[u] > T(0) ? four[u] : T(0);
                }
                if (stays)
                    for (unsigned u = 0; u < 4; ++u) shared.tile[c * Tile::stride + Tile::row(i) + u] = four[u];
                if (saved && c < count)
                    wide[wide_offset(layer - 1, group * mlp_columns + c) + Tile::row(i) / 4] = four;
            }
        }
        if (layer == 0) write_features(shared, tile, group * mlp_columns, count);
        if (stays) held = layer == 0 ? nothing : 1024 * (layer - 1);
    }

    __device__ void write_features(Shared& shared, unsigned tile, unsigned first_column, unsigned count) const {
        __syncthreads();
        const std::size_t row = first_row(tile) + threadIdx.x % Tile::rows;
        if (row >= inputs.rows()) return; // no barrier follows before all threads are back
        constexpr unsigned step = block_size / Tile::rows;
        const unsigned part = threadIdx.x / Tile::rows;
        const auto value = [&](unsigned c) -> T { return shared.tile[c * Tile::stride + threadIdx.x % Tile::rows]; };
        if (!dL_dfeatures.by_four.empty()) {
            for (unsigned c = 4 * part; c < count; c += 4 * step) {
                Row<T, 4>& to = dL_dfeatures.by_four[dL_dfeatures.index(row, first_column + c) / 4];
                Row<T, 4> four{};
                if (adds) four = to;
                for (unsigned j = 0; j < 4; ++j) four[j] += value(c + j);
                to = four;
            }
            return;
        }
        for (unsigned c = part; c < count; c += step) {
            T& to = dL_dfeatures.values[dL_dfeatures.index(row, first_column + c)];
            to = adds ? to + value(c) : value(c);
        }
    }
};

} // namespace gsh::cuda::detail
