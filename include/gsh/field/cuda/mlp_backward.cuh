// SPDX-License-Identifier: Apache-2.0
/// @file  The kernel of the MLP's backward pass: gradients of a tile of rows go back through all layers.
#pragma once

#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/backend/cuda/reduce.cuh>
#include <gsh/backend/cuda/unroll.cuh>
#include <gsh/core/span.hpp>
#include <gsh/field/cuda/mlp_products.cuh>
#include <gsh/field/cuda/mlp_shape.cuh>
#include <gsh/field/cuda/mlp_sums.cuh>
#include <gsh/field/cuda/mlp_tile.cuh>
#include <gsh/field/cuda/row.cuh>
#include <gsh/field/features.hpp>

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
    Write mode; ///< of dL_dfeatures
    MlpRowInputs<T> inputs;
    Span<const Row<T, 4>> packed; ///< MlpShape::backward_offset
    Span<const Row<T, 4>> hidden; ///< as of MlpForward
    Span<const T> dL_doutputs;
    Span<T> sums;               ///< [blocks][shape.sums_size()]
    Span<Row<T, 4>> wide;       ///< [blocks][2][width][rows of a tile] if uses_wide
    MlpColumns<T> dL_dfeatures; ///< no columns: not wanted

    /// Whether a gradient must be kept outside of the tile: it does not fit, or is needed again after another has taken
    /// its place.
    [[nodiscard]] GSH_HD static bool uses_wide(const MlpShape& shape, std::size_t features) {
        return shape.layers > 1 && (shape.width > mlp_columns || features > mlp_columns);
    }

    __device__ void operator()(Shared& shared) const {
        for (unsigned tile = first_tile(blockIdx.x); tile < first_tile(blockIdx.x + 1); ++tile) {
            const bool first = tile == first_tile(blockIdx.x);
            for (unsigned layer = shape.layers; layer-- > 0;) {
                add_weights(shared, tile, layer, first);
                for (unsigned group = 0; group * mlp_columns < columns(layer); ++group)
                    run_layer(shared, tile, layer, group);
            }
        }
    }

private:
    [[nodiscard]] __device__ unsigned first_tile(unsigned block) const {
        return mlp_first_tile(inputs.rows(), Tile::rows, block);
    }
    /// The number of a layer's inputs whose gradient is wanted.
    [[nodiscard]] __device__ unsigned columns(unsigned layer) const {
        return layer ? shape.width : dL_dfeatures.columns;
    }
    [[nodiscard]] __device__ static unsigned first_row(unsigned tile) { return tile * Tile::rows; }
    [[nodiscard]] __device__ unsigned hidden_offset(unsigned tile, unsigned layer, unsigned column) const {
        return ((tile * (shape.layers - 1) + layer) * shape.width + column) * (Tile::rows / 4);
    }
    /// Where the weights of groups of a layer's outputs and inputs begin, in fours.
    [[nodiscard]] __device__ unsigned weights_offset(unsigned layer, unsigned group, unsigned out) const {
        return shape.backward_offset(layer) / 4 + out * mlp_columns * mlp_groups(shape.in(layer)) * (mlp_columns / 4) +
               group * Tile::packed_group;
    }
    /// The gradient of a layer's outputs.
    [[nodiscard]] __device__ unsigned wide_offset(unsigned layer, unsigned column) const {
        return ((blockIdx.x * 2 + layer % 2) * shape.width + column) * (Tile::rows / 4);
    }

    /// The gradient of 64 outputs of a layer, or the rest.
    __device__ void load_gradient(Shared& shared, unsigned tile, unsigned layer, unsigned group) const {
        const unsigned count = mlp_count(shape.out(layer), group), first_column = group * mlp_columns;
        __syncthreads();
        if (layer + 1 < shape.layers) {
            load_columns<Tile::rows, Tile::stride, T>(shared.tile, wide, wide_offset(layer, first_column),
                                                      Tile::rows / 4, count, 8 * mlp_share(count));
            return;
        }
        for (MlpWalk at(count); at.row < Tile::rows;) {
            T numbers[8]; // all are read before the first is written
            MlpWalk from = at;
            for (T& number : numbers) {
                const unsigned row = first_row(tile) + from.row;
                const bool inside = from.row < Tile::rows && row < inputs.rows();
                number = inside ? dL_doutputs[row * shape.outputs + first_column + from.column] : T(0);
                from.step();
            }
            for (const T& number : numbers) {
                if (at.row < Tile::rows) shared.tile[at.column * Tile::stride + at.row] = number;
                at.step();
            }
        }
        for (unsigned e = threadIdx.x; e < Tile::rows * (8 * mlp_share(count) - count); e += block_size)
            shared.tile[(count + e / Tile::rows) * Tile::stride + e % Tile::rows] = T(0);
    }

    /// dL/dW[o, i] += sum over the rows of dL/dy[o] x[i].
    __device__ void add_weights(Shared& shared, unsigned tile, unsigned layer, bool first) const {
        const bool held = layer + 1 < shape.layers && shape.width <= mlp_columns; // from the layer after
        for (unsigned out = 0; out < mlp_groups(shape.out(layer)); ++out) {
            if (!held) load_gradient(shared, tile, layer, out);
            if (layer == 0 && shape.shared != 0) add_bias(shared, out, first);
            for (unsigned in = 0; in < mlp_groups(shape.in(layer)); ++in)
                add_piece(shared, tile, layer, out, in, first);
        }
    }

    __device__ void add_piece(Shared& shared, unsigned tile, unsigned layer, unsigned out, unsigned in,
                              bool first) const {
        const unsigned count = mlp_count(shape.in(layer), in), share = mlp_share(count),
                       output_share = mlp_share(mlp_count(shape.out(layer), out));
        typename Tile::WeightSums piece = {};
        if constexpr (Tile::by_matrices) {
            __syncthreads(); // the tile is complete
            if (layer == 0) {
                const auto column_of = [&](unsigned c) {
                    const auto column = inputs.column(in * mlp_columns + c);
                    const unsigned begin = first_row(tile), rows = c < count ? inputs.rows() : 0;
                    return [=](unsigned r) {
                        Row<T, 4> four{};
                        for (unsigned u = 0; u < 4; ++u)
                            if (begin + r + u < rows) four[u] = column[begin + r + u];
                        return four;
                    };
                };
                multiply_over_rows(shared, output_share, share, column_of, piece);
            } else {
                const unsigned begin = hidden_offset(tile, layer - 1, in * mlp_columns);
                const auto column_of = [&](unsigned c) {
                    return [from = hidden, top = begin + c * (Tile::rows / 4), wanted = c < count](unsigned r) {
                        return wanted ? from[top + r / 4] : Row<T, 4>{};
                    };
                };
                multiply_over_rows(shared, output_share, share, column_of, piece);
            }
        } else {
            for (unsigned r = 0; r < Tile::rows; r += Tile::depth) {
                __syncthreads();
                if (layer == 0)
                    inputs.template load<Tile::depth, Tile::side_stride>(shared.side, first_row(tile) + r,
                                                                         in * mlp_columns, count, 8 * share);
                else
                    load_columns<Tile::depth, Tile::side_stride, T>(
                        shared.side, hidden, hidden_offset(tile, layer - 1, in * mlp_columns) + r / 4, Tile::rows / 4,
                        count, 8 * share);
                __syncthreads();
                multiply_over_rows(shared, r, output_share, share, piece);
            }
        }
        // Each thread's numbers at a distance of the block, so that neighbouring threads write neighbouring numbers.
        const unsigned begin =
            blockIdx.x * shape.sums_size() +
            (shape.first_piece(layer) + out * mlp_groups(shape.in(layer)) + in) * mlp_columns * mlp_columns;
        T before[Tile::thread_weights] = {}; // all are read before the first is written
        const auto for_each = [&](const auto& body) {
            for (unsigned n = 0; n < Tile::thread_weights; ++n)
                if (Tile::has_weight(n, output_share, share)) body(n, sums[begin + n * block_size + threadIdx.x]);
        };
        if (!first) for_each([&](unsigned n, const T& sum) { before[n] = sum; });
        for_each([&](unsigned n, T& sum) { sum = before[n] + piece[n / 4][n % 4]; });
    }

    /// The gradient of the first layer's bias: a warp sums one column of the tile after the other. Lane k keeps the sum
    /// of the k-th, so that all of them wait for memory once.
    __device__ void add_bias(Shared& shared, unsigned group, bool first) const {
        constexpr unsigned warps = block_size / warp_size;
        static_assert(mlp_columns <= warps * warp_size);
        const unsigned count = mlp_count(shape.out(0), group), warp = threadIdx.x / warp_size,
                       lane = threadIdx.x % warp_size;
        __syncthreads();
        T of_lane = 0;
        for (unsigned k = 0; warp + k * warps < count; ++k) {
            T sum = 0;
            for (unsigned r = lane; r < Tile::rows; r += warp_size)
                sum += shared.tile[(warp + k * warps) * Tile::stride + r];
            sum = warp_sum(sum);
            if (lane == k) of_lane = sum;
        }
        const unsigned column = warp + lane * warps;
        if (column >= count) return; // no barrier follows before all threads are back
        T& sum = sums[blockIdx.x * shape.sums_size() + shape.piece_count() * mlp_columns * mlp_columns +
                      group * mlp_columns + column];
        sum = first ? of_lane : sum + of_lane;
    }

    /// dL/dx = dL/dy W for 64 columns of x, or the rest; through the ReLU that made x.
    __device__ void run_layer(Shared& shared, unsigned tile, unsigned layer, unsigned group) const {
        const unsigned share = mlp_share(mlp_count(columns(layer), group));
        typename Tile::Sums dL_dx = {};
        const bool held = group == 0 && shape.out(layer) <= mlp_columns; // from add_weights
        for (unsigned out = 0; out < mlp_groups(shape.out(layer)); ++out) {
            const unsigned inner = mlp_count(shape.out(layer), out);
            if (!held) load_gradient(shared, tile, layer, out);
            multiply<T>(shared, packed, weights_offset(layer, group, out),
                        mlp_groups(shape.in(layer)) * (mlp_columns / 4), inner, share, dL_dx);
        }
        const bool stays = layer == 0 || shape.width <= mlp_columns, saved = layer != 0 && !wide.empty();
        if (stays) __syncthreads(); // the tile is still read
        const unsigned first_column = group * mlp_columns, count = mlp_count(columns(layer), group);
        const unsigned thread = computed_anew(threadIdx.x); // places are not kept from layer to layer
        unrolled<Tile::thread_columns / 4>([&]<int group_of_four>() {
            constexpr unsigned first = 4 * group_of_four;
            if (first >= Tile::columns(share)) return;
            const auto place = [&](unsigned j) {
                return (Tile::column(j, share, thread) * Tile::rows + Tile::row(0, thread)) / 4;
            };
            Row<T, 4> x[4] = {}; // all are read before the first gradient is written
            for (unsigned j = 0; j < 4; ++j)
                if (layer != 0 && Tile::column(first + j, share, thread) < count)
                    x[j] = hidden[hidden_offset(tile, layer - 1, first_column) + place(first + j)];
            for (unsigned j = 0; j < 4; ++j) {
                if (first + j >= Tile::columns(share)) continue;
                const unsigned c = Tile::column(first + j, share, thread);
                Row<T, 4> four;
                for (unsigned i = 0; i < 4; ++i)
                    four[i] = layer == 0 || c >= count || x[j][i] > T(0) ? dL_dx[i][first + j] : T(0);
                if (stays)
                    for (unsigned i = 0; i < 4; ++i) shared.tile[c * Tile::stride + Tile::row(i, thread)] = four[i];
                if (saved && c < count) wide[wide_offset(layer - 1, first_column) + place(first + j)] = four;
            }
        });
        if (layer == 0) write_features(shared, tile, group * mlp_columns, count);
    }

    __device__ void write_features(Shared& shared, unsigned tile, unsigned first_column, unsigned count) const {
        __syncthreads();
        const unsigned thread = computed_anew(threadIdx.x), row = first_row(tile) + thread % Tile::rows;
        if (row >= inputs.rows()) return; // no barrier follows before all threads are back
        constexpr unsigned step = block_size / Tile::rows;
        const unsigned part = thread / Tile::rows;
        const auto value = [&](unsigned c) -> T { return shared.tile[c * Tile::stride + thread % Tile::rows]; };
        if (!dL_dfeatures.by_four.empty()) {
            for (unsigned c = 4 * part; c < count; c += 4 * step) {
                Row<T, 4>& to = dL_dfeatures.by_four[dL_dfeatures.index(row, first_column + c) / 4];
                Row<T, 4> four{};
                if (mode == Write::add) four = to;
                for (unsigned j = 0; j < 4; ++j) four[j] += value(c + j);
                to = four;
            }
            return;
        }
        for (unsigned c = part; c < count; c += step) {
            T& to = dL_dfeatures.values[dL_dfeatures.index(row, first_column + c)];
            to = mode == Write::add ? to + value(c) : value(c);
        }
    }
};

} // namespace gsh::cuda::detail
