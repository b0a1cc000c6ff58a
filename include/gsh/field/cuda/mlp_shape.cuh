// SPDX-License-Identifier: Apache-2.0
/// @file  Sizes and offsets that the kernels of the MLP share.
#pragma once

#include <gsh/core/config.hpp>

namespace gsh::cuda::detail {

/// Columns of a layer are processed in groups of 64.
inline constexpr unsigned mlp_columns = 64;

[[nodiscard]] GSH_HD constexpr unsigned mlp_groups(unsigned columns) {
    return (columns + mlp_columns - 1) / mlp_columns;
}
/// Inner numbers of a product, with zeros up to the step of a matrix instruction.
[[nodiscard]] GSH_HD constexpr unsigned mlp_padded(unsigned inner) {
    return (inner + 7) / 8 * 8;
}

/// A network without the inputs that all rows share: their contribution to the first layer is the same for every row,
/// and becomes its bias.
///
/// Layers between the first and the last have the same size, so offsets need no loop.
struct MlpShape {
    unsigned inputs = 0; ///< numbers that differ from row to row
    unsigned outputs = 0, width = 0, layers = 1;
    unsigned shared = 0; ///< numbers of the first layer's inputs beside them

    [[nodiscard]] GSH_HD unsigned in(unsigned layer) const { return layer ? width : inputs; }
    [[nodiscard]] GSH_HD unsigned out(unsigned layer) const { return layer + 1 < layers ? width : outputs; }

    /// The caller's weights: rows of in(layer) numbers, and of the shared inputs' in the first layer.
    [[nodiscard]] GSH_HD unsigned weights_stride(unsigned layer) const { return in(layer) + (layer ? 0 : shared); }
    [[nodiscard]] GSH_HD unsigned weights_offset(unsigned layer) const {
        return layer ? (weights_stride(0))*out(0) + (layer - 1) * width * width : 0;
    }

    /// Right operand of forward, [padded in][groups of out * 64].
    [[nodiscard]] GSH_HD unsigned forward_size(unsigned layer) const {
        return mlp_padded(in(layer)) * mlp_groups(out(layer)) * mlp_columns;
    }
    [[nodiscard]] GSH_HD unsigned forward_offset(unsigned layer) const {
        return layer ? forward_size(0) + (layer - 1) * middle_size() : 0;
    }
    /// Right operand of backward, [padded out][groups of in * 64].
    [[nodiscard]] GSH_HD unsigned backward_size(unsigned layer) const {
        return mlp_padded(out(layer)) * mlp_groups(in(layer)) * mlp_columns;
    }
    [[nodiscard]] GSH_HD unsigned backward_offset(unsigned layer) const {
        return layer ? backward_size(0) + (layer - 1) * middle_size() : 0;
    }

    /// Pieces of 64 x 64 weights, layer after layer, whose gradients a block sums.
    [[nodiscard]] GSH_HD unsigned pieces(unsigned layer) const {
        return mlp_groups(in(layer)) * mlp_groups(out(layer));
    }
    [[nodiscard]] GSH_HD unsigned first_piece(unsigned layer) const {
        return layer ? pieces(0) + (layer - 1) * mlp_groups(width) * mlp_groups(width) : 0;
    }
    [[nodiscard]] GSH_HD unsigned piece_count() const { return first_piece(layers - 1) + pieces(layers - 1); }
    /// Numbers that a block sums: the pieces, then the gradient of the bias.
    [[nodiscard]] GSH_HD unsigned sums_size() const {
        return (piece_count())*mlp_columns * mlp_columns + (shared ? mlp_groups(out(0)) * mlp_columns : 0);
    }

    /// The layer of which the index-th number is, where the first layer has `first` numbers and each in the middle has
    /// `middle`.
    template <class Size>
    [[nodiscard]] GSH_HD unsigned layer_of(Size index, Size first, Size middle) const {
        if (layers == 1 || index < first) return 0;
        if (layers == 2) return 1;
        const Size layer = 1 + (index - first) / middle;
        return static_cast<unsigned>(layer < layers - 1 ? layer : layers - 1);
    }
    [[nodiscard]] GSH_HD unsigned middle_size() const { return mlp_padded(width) * mlp_groups(width) * mlp_columns; }
};

} // namespace gsh::cuda::detail
