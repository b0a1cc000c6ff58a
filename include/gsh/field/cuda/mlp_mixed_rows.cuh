// SPDX-License-Identifier: Apache-2.0
/// @file  What both passes of a network in mixed precision do with a warp's rows: inputs, and hidden layers.
///
/// Features are in float, or already in bf16, as a hash grid writes them (field/cuda/hash_field.cuh).
#pragma once

#include <gsh/backend/cuda/half.cuh>
#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/backend/cuda/matrix.cuh>
#include <gsh/core/span.hpp>
#include <gsh/field/cuda/mlp_mixed_shape.cuh>
#include <gsh/field/cuda/mlp_tile.cuh>
#include <gsh/field/features.hpp>

#include <cstddef>
#include <cstdint>

namespace gsh::cuda::detail {

/// Features and points in float, which are rounded as they are read. Words have two neighbouring columns.
struct MixedFloatInputs {
    static constexpr unsigned least_blocks = 1; ///< a second one would leave too few registers for the indexes
    MlpRowInputs<float> numbers;

    /// Where the gradient of the features goes.
    struct Gradient {
        MlpColumns<float> features; ///< no columns: not wanted
        Write mode;

        [[nodiscard]] __device__ bool wanted() const { return features.columns != 0; }
        __device__ void write(unsigned row, unsigned column, float first, float second) const {
            write(row, column, first);
            write(row, column + 1, second);
        }

    private:
        __device__ void write(unsigned row, unsigned column, float value) const {
            if (column >= features.columns) return;
            float& to = features.values[features.index(row, column)];
            to = mode == Write::add ? to + value : value;
        }
    };

    [[nodiscard]] __device__ unsigned rows() const { return numbers.rows(); }
    /// Zeros from `columns` on.
    [[nodiscard]] __device__ std::uint32_t word(unsigned row, unsigned column, unsigned columns) const {
        const auto number = [&](unsigned c) { return row < rows() && c < columns ? numbers(row, c) : 0.0f; };
        return pack_bf16(number(column), number(column + 1));
    }
};

/// Features in bf16, [Columns / Block][rows][Block], and points in float.
template <unsigned Columns, unsigned Block>
    requires(Block % 2 == 0 && Columns % Block == 0)
struct MixedWordInputs {
    static constexpr unsigned least_blocks = 2; ///< one computes while the other loads
    /// Words of features, two numbers each.
    template <class Word>
    struct Words {
        Span<Word> values;
        std::size_t rows;

        [[nodiscard]] __device__ Word& operator()(unsigned row, unsigned column) const {
            return values[(column / Block * static_cast<unsigned>(rows) + row) * (Block / 2) + column % Block / 2];
        }
    };
    Words<const std::uint32_t> features;
    Span<const float> points;
    std::size_t own; ///< numbers of each point

    /// Where the gradient of the features goes: nothing else contributes to it.
    struct Gradient {
        Words<std::uint32_t> features;

        [[nodiscard]] __device__ static bool wanted() { return true; }
        __device__ void write(unsigned row, unsigned column, float first, float second) const {
            if (column < Columns) features(row, column) = pack_bf16(first, second);
        }
    };

    [[nodiscard]] __device__ unsigned rows() const { return static_cast<unsigned>(features.rows); }
    [[nodiscard]] __device__ std::uint32_t word(unsigned row, unsigned column, unsigned columns) const {
        if (row >= rows()) return 0;
        if (column < Columns) return features(row, column);
        const auto point = [&](unsigned c) {
            return c < columns ? points[row * static_cast<unsigned>(own) + (c - Columns)] : 0.0f;
        };
        return pack_bf16(point(column), point(column + 1));
    }
};

/// What both passes do with the 16 rows of a warp.
template <class Inputs>
struct MixedRows {
    static constexpr unsigned rows = 16, most_in_tiles = MixedShape::most_in_tiles(0);

    MixedShape shape;
    Inputs inputs;
    Span<const MatrixB2> packed;
    Span<const float> bias;

    [[nodiscard]] __device__ static unsigned group() { return threadIdx.x % warp_size / 4; }
    [[nodiscard]] __device__ static unsigned pair() { return 2 * (threadIdx.x % 4); }

    /// Columns [16 k, 16 k + 16) of the inputs.
    [[nodiscard]] __device__ MatrixA input_tile(unsigned first_row, unsigned k) const {
        MatrixA x;
        for (unsigned w = 0; w < 4; ++w)
            x.words[w] = inputs.word(first_row + group() + w % 2 * 8, 16 * k + w / 2 * 8 + pair(), shape.inputs);
        return x;
    }

    /// sums += x W over the first `inner` of x's tiles, for 16 columns; tile_of(k) is the place of W's k-th tile.
    ///
    /// There is a branch for two tiles, not for each: products wait for loads behind the same branch together.
    template <unsigned Tiles, class TileOf>
    __device__ void add_products(MatrixC (&sums)[2], const MatrixA (&x)[Tiles], unsigned inner,
                                 const TileOf& tile_of) const {
        const unsigned lane = computed_anew(threadIdx.x) % warp_size;
        for (unsigned k = 0; k < Tiles; k += 2) {
            if (k != 0 && k >= inner) continue; // not break: loops over arrays must have a constant length
            for (unsigned l = k; l < k + 2 && l < Tiles; ++l) {
                const MatrixB2 weights = packed[std::size_t(tile_of(l)) * warp_size + lane];
                for (unsigned n = 0; n < 2; ++n) multiply_add(sums[n], x[l], weights.halves[n]);
            }
        }
    }

    /// A hidden layer: its numbers of each row after ReLU, as the next layer's operand; zeros up to 64.
    template <unsigned Tiles>
    __device__ void hidden(unsigned layer, const MatrixA (&x)[Tiles], MatrixA (&y)[4]) const {
        for (unsigned tile = 0; tile < 4; ++tile) {
            y[tile] = {};
            if (tile >= shape.out_tiles(layer)) continue;
            MatrixC sums[2] = {};
            for (unsigned n = 0; layer == 0 && n < 2; ++n)
                for (unsigned i = 0; i < 2; ++i)
                    sums[n].values[i] = sums[n].values[i + 2] = bias_of(16 * tile + 8 * n + pair() + i);
            add_products(sums, x, shape.in_tiles(layer),
                         [&](unsigned k) { return MixedShape::forward_tile(layer, k, tile); });
            for (unsigned n = 0; n < 2; ++n)
                for (unsigned i = 0; i < 2; ++i)
                    y[tile].words[2 * n + i] =
                        pack_bf16(positive(sums[n].values[2 * i]), positive(sums[n].values[2 * i + 1]));
        }
    }

private:
    [[nodiscard]] __device__ float bias_of(unsigned output) const { return output < bias.size() ? bias[output] : 0.0f; }
    [[nodiscard]] __device__ static float positive(float x) { return x > 0.0f ? x : 0.0f; }
};

} // namespace gsh::cuda::detail
