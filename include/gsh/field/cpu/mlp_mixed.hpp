// SPDX-License-Identifier: Apache-2.0
/// @file  The MLP on the CPU in mixed precision: operands in bf16, sums in float.
///
/// A tile of 64 rows passes through all layers within the first-level cache. Matrices of a tile have a row for each
/// feature, and its points are the columns, so that the result of a layer has the layout of the next one's operand.
/// Nothing but the outputs is stored: backward computes the activations again, which costs less than reading them.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/cpu/matrix_bf16.hpp>
#include <gsh/field/features.hpp>
#include <gsh/math/wide_bf16.hpp>
#include <gsh/math/wide.hpp>
#include <gsh/math/wide_shuffle.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>

namespace gsh::cpu::inline GSH_ISA::detail {

inline constexpr std::size_t mixed_tile = 64; ///< points

using Words = Wide<std::uint32_t>;

/// Words of a matrix of bf16, two features or two points to a word.
[[nodiscard]] constexpr std::size_t mixed_padded(std::size_t n) { return (n + 31) / 32 * 32; }

/// Sizes and offsets common to both passes. Inputs that all points share are a bias of the first layer, in float.
template <class Network>
struct MixedLayout {
    const Network& network;
    Span<const float> shared = {}; ///< the last of the network's inputs

    [[nodiscard]] std::size_t layers() const { return network.layer_count(); }
    /// Number of inputs that differ from point to point.
    [[nodiscard]] std::size_t row_inputs() const { return network.inputs() - shared.size(); }
    [[nodiscard]] std::size_t in(std::size_t layer) const { return layer ? network.layer_inputs(layer) : row_inputs(); }
    [[nodiscard]] std::size_t out(std::size_t layer) const { return network.layer_outputs(layer); }
    [[nodiscard]] std::size_t widest() const {
        return mixed_padded(std::max({in(0), out(0), out(layers() - 1)})); // all hidden layers are as wide
    }

    /// Weights in words: [out][in / 2] of each layer for forward, then [in][out / 2] for backward.
    [[nodiscard]] std::size_t packed_offset(std::size_t layer) const {
        std::size_t offset = 0;
        for (std::size_t l = 0; l < layer; ++l) offset += mixed_padded(out(l)) * mixed_padded(in(l)) / 2;
        return offset;
    }
    [[nodiscard]] std::size_t packed_size() const { return 2 * packed_offset(layers()); }
    [[nodiscard]] WordMatrix forward_matrix(const std::uint32_t* packed, std::size_t layer) const {
        return {packed + packed_offset(layer), mixed_padded(in(layer)) / 2};
    }
    [[nodiscard]] WordMatrix backward_matrix(const std::uint32_t* packed, std::size_t layer) const {
        return {packed + packed_offset(layers()) + packed_offset(layer), mixed_padded(out(layer)) / 2};
    }

    /// Sums of dL_dW: [out][in] of each layer. The first has a column more for the bias.
    [[nodiscard]] std::size_t padded_in(std::size_t layer) const {
        return (in(layer) + (layer == 0 && !shared.empty()) + 15) / 16 * 16;
    }
    [[nodiscard]] std::size_t padded_offset(std::size_t layer) const {
        std::size_t offset = 0;
        for (std::size_t l = 0; l < layer; ++l) offset += mixed_padded(out(l)) * padded_in(l);
        return offset;
    }

    void pack(Span<const float> weights, std::uint32_t* packed, float* bias) const {
        for (std::size_t l = 0; l < layers(); ++l) {
            const float* const matrix = weights.data() + network.layer_offset(l);
            const std::size_t stride = network.layer_inputs(l), ins = mixed_padded(in(l)), outs = mixed_padded(out(l));
            const auto weight = [&](std::size_t o, std::size_t i) {
                return o < out(l) && i < in(l) ? matrix[o * stride + i] : 0.0f;
            };
            std::uint32_t* to = packed + packed_offset(l);
            for (std::size_t o = 0; o < outs; ++o)
                for (std::size_t i = 0; i < ins; i += 2) *to++ = bf16_word(weight(o, i), weight(o, i + 1));
            to = packed + packed_offset(layers()) + packed_offset(l);
            for (std::size_t i = 0; i < ins; ++i)
                for (std::size_t o = 0; o < outs; o += 2) *to++ = bf16_word(weight(o, i), weight(o + 1, i));
        }
        for (std::size_t o = 0; o < mixed_padded(out(0)); ++o) {
            bias[o] = 0;
            for (std::size_t c = 0; o < out(0) && c < shared.size(); ++c)
                bias[o] += weights[o * network.inputs() + row_inputs() + c] * shared[c];
        }
    }
};

/// Matrices of one tile. Words of `pairs` hold two neighbouring features of a point, [features / 2][64]; words of
/// `rows` hold a feature of two neighbouring points, [features][32].
template <class Network>
class MixedTile {
public:
    using Layout = MixedLayout<Network>;

    [[nodiscard]] static std::size_t word_count(const Layout& layout) {
        return (layout.layers() + 1) * pairs_size(layout) + 3 * rows_size(layout) + mixed_tile / 2 * 32;
    }
    [[nodiscard]] static std::size_t number_count(const Layout& layout) { return layout.widest() * mixed_tile; }

    MixedTile(const Layout& layout, const std::uint32_t* packed, const float* bias, std::uint32_t* words,
              float* numbers)
        : layout_(layout), packed_(packed), bias_(bias), activations_(words),
          gradient_(words + layout.layers() * pairs_size(layout)), rows_(gradient_ + pairs_size(layout)),
          activation_rows_(rows_ + rows_size(layout)), columns_(activation_rows_ + rows_size(layout)),
          sums_{numbers, mixed_tile} {}

    /// Reads the inputs of points [first, first + count).
    void load(const MlpInputs<float>& inputs, std::size_t first, std::size_t count) {
        const FeatureView<const float>& features = inputs.features;
        const std::size_t own = layout_.row_inputs() - features.columns, padded = mixed_padded(layout_.row_inputs());
        std::size_t column = 0;
        if (features.block == 4 && count == mixed_tile)
            for (; column < features.columns; column += 4)
                load_four(features.column(column) + first * 4, activations_ + column / 2 * mixed_tile);
        const auto number = [&](std::size_t r, std::size_t c) {
            if (r >= count || c >= layout_.row_inputs()) return 0.0f;
            return c < features.columns ? features(first + r, c)
                                        : inputs.points[(first + r) * own + c - features.columns];
        };
        for (; column < padded; column += 2)
            for (std::size_t r = 0; r < mixed_tile; ++r)
                activations_[column / 2 * mixed_tile + r] = bf16_word(number(r, column), number(r, column + 1));
    }

    /// Computes the hidden layers.
    void hidden_layers() {
        for (std::size_t l = 0; l + 1 < layout_.layers(); ++l) {
            const std::size_t outs = mixed_padded(layout_.out(l));
            multiply(l);
            std::uint32_t* const to = activations(l + 1);
            for (std::size_t o = 0; o < outs; o += 2) {
                const Wide<float> bias[2] = {l ? 0.0f : bias_[o], l ? 0.0f : bias_[o + 1]};
                for (std::size_t r = 0; r < mixed_tile; r += Words::width)
                    bf16_words(max(sum(o, r) + bias[0], Wide<float>(0.0f)),
                               max(sum(o + 1, r) + bias[1], Wide<float>(0.0f)))
                        .store(to + o / 2 * mixed_tile + r);
            }
        }
    }
    /// Computes the outputs of `count` points, row-major.
    void outputs(std::size_t count, float* to) {
        const std::size_t last = layout_.layers() - 1, outs = layout_.out(last);
        multiply(last);
        constexpr std::size_t width = Wide<float>::width;
        for (std::size_t first = 0; first < count; first += width)
            for (std::size_t o = 0; o < outs; o += width) {
                Wide<float> block[width];
                for (std::size_t i = 0; i < width; ++i) block[i] = sum(o + i, first);
                if (last == 0)
                    for (std::size_t i = 0; i < width; ++i) block[i] += Wide<float>(bias_[o + i]);
                transpose(block);
                for (std::size_t r = first; r < std::min(first + width, count); ++r) {
                    if (o + width <= outs) {
                        block[r - first].store(to + r * outs + o);
                    } else {
                        for (std::size_t i = 0; o + i < outs; ++i) to[r * outs + o + i] = block[r - first][i];
                    }
                }
            }
    }

    /// Reads dL_doutputs of `count` points.
    void load_gradient(const float* dL_doutputs, std::size_t count) {
        constexpr std::size_t width = Words::width;
        const std::size_t outs = layout_.out(layout_.layers() - 1);
        for (std::size_t first = 0; first < mixed_tile; first += width)
            for (std::size_t o = 0; o < mixed_padded(outs); o += 2 * width) {
                Words block[width];
                for (std::size_t i = 0; i < width; ++i) {
                    float numbers[2 * width] = {};
                    if (first + i < count && o < outs)
                        std::copy_n(dL_doutputs + (first + i) * outs + o, std::min(2 * width, outs - o), numbers);
                    block[i] = bf16_neighbours(Wide<float>::load(numbers), Wide<float>::load(numbers + width));
                }
                transpose(block);
                for (std::size_t i = 0; i < width; ++i) block[i].store(gradient_ + (o / 2 + i) * mixed_tile + first);
            }
    }
    /// Adds to `sums` (MixedLayout::padded_offset). The gradient of the inputs is then in the tile, if wanted.
    void backward(float* sums, bool wants_inputs) {
        for (std::size_t l = layout_.layers(); l-- > 0;) {
            const std::size_t outs = mixed_padded(layout_.out(l)), ins = mixed_padded(layout_.in(l));
            to_rows(gradient_, outs, rows_);
            to_rows(activations(l), ins, activation_rows_);
            const std::size_t stride = layout_.widest() + 32;
            to_columns(activation_rows_, ins, stride);
            if (l == 0 && !layout_.shared.empty()) append_one(stride);
            product_.operator()<true>({outs, layout_.padded_in(l), mixed_tile}, {rows_, mixed_tile / 2},
                                      {columns_, stride}, {sums + layout_.padded_offset(l), layout_.padded_in(l)});
            if (l == 0 && !wants_inputs) return;
            product_({ins, mixed_tile, outs}, layout_.backward_matrix(packed_, l), {gradient_, mixed_tile}, sums_);
            if (l != 0) through_relu(activations(l), ins);
        }
    }
    /// Writes the gradient of the features of `count` points from `first` on.
    void store_features(const FeatureView<float>& to, std::size_t first, std::size_t count, Write mode) const {
        std::size_t column = 0;
        if (to.block == 4 && count == mixed_tile)
            for (; column < to.columns; column += 4)
                for (std::size_t r = 0; r < mixed_tile; r += Wide<float>::width)
                    store_four(column, r, to.column(column) + (first + r) * 4, mode);
        for (; column < to.columns; ++column)
            for (std::size_t r = 0; r < count; ++r) {
                float& number = to(first + r, column);
                const float gradient = sums_.numbers[column * mixed_tile + r];
                number = mode == Write::add ? number + gradient : gradient;
            }
    }

private:
    [[nodiscard]] static std::size_t pairs_size(const Layout& layout) { return layout.widest() / 2 * mixed_tile; }
    [[nodiscard]] static std::size_t rows_size(const Layout& layout) { return layout.widest() * mixed_tile / 2; }

    [[nodiscard]] std::uint32_t* activations(std::size_t layer) const {
        return activations_ + layer * pairs_size(layout_);
    }
    [[nodiscard]] Wide<float> sum(std::size_t row, std::size_t column) const {
        return Wide<float>::load(sums_.numbers + row * mixed_tile + column);
    }
    void multiply(std::size_t layer) const {
        product_({mixed_padded(layout_.out(layer)), mixed_tile, mixed_padded(layout_.in(layer))},
                 layout_.forward_matrix(packed_, layer), {activations(layer), mixed_tile}, sums_);
    }

    /// Four features of 64 points, point after point.
    static void load_four(const float* from, std::uint32_t* to) {
        constexpr std::size_t width = Wide<float>::width;
        for (std::size_t r = 0; r < mixed_tile; r += width, from += 4 * width) {
            const auto words = [&](std::size_t at) {
                return bf16_neighbours(Wide<float>::load(from + at), Wide<float>::load(from + at + width));
            };
            const WidePair<std::uint32_t> both = unzip(words(0), words(2 * width));
            both.first.store(to + r), both.second.store(to + mixed_tile + r);
        }
    }
    void store_four(std::size_t column, std::size_t r, float* to, Write mode) const {
        const WidePair<float> even = zip(sum(column, r), sum(column + 2, r)),
                              odd = zip(sum(column + 1, r), sum(column + 3, r)),
                              low = zip(even.first, odd.first), high = zip(even.second, odd.second);
        constexpr std::size_t width = Wide<float>::width;
        const Wide<float> four[4] = {low.first, low.second, high.first, high.second};
        for (std::size_t i = 0; i < 4; ++i) {
            float* const at = to + i * width;
            (mode == Write::add ? Wide<float>::load(at) + four[i] : four[i]).store(at);
        }
    }

    static void to_rows(const std::uint32_t* pairs, std::size_t features, std::uint32_t* rows) {
        constexpr std::size_t width = Words::width, points = mixed_tile / 2; // words of a row
        const Words low(0xffffu), high(0xffff0000u);
        for (std::size_t f = 0; f < features; f += 2)
            for (std::size_t r = 0; r < points; r += width) {
                const std::uint32_t* const from = pairs + f / 2 * mixed_tile + 2 * r;
                const WidePair<std::uint32_t> both = unzip(Words::load(from), Words::load(from + width));
                ((both.first & low) | both.second << 16).store(rows + f * points + r);
                (both.first >> 16 | (both.second & high)).store(rows + (f + 1) * points + r);
            }
    }
    void to_columns(const std::uint32_t* rows, std::size_t features, std::size_t stride) const {
        constexpr std::size_t width = Words::width, points = mixed_tile / 2;
        for (std::size_t f = 0; f < features; f += width)
            for (std::size_t r = 0; r < points; r += width) {
                Words block[width];
                for (std::size_t i = 0; i < width; ++i) block[i] = Words::load(rows + (f + i) * points + r);
                transpose(block);
                for (std::size_t i = 0; i < width; ++i) block[i].store(columns_ + (r + i) * stride + f);
            }
    }
    /// The column behind the inputs is 1: its sum is the gradient of the bias.
    void append_one(std::size_t stride) const {
        const std::size_t own = layout_.row_inputs();
        for (std::size_t r = 0; r < mixed_tile / 2; ++r) {
            std::uint32_t* const row = columns_ + r * stride;
            std::fill(row + own, row + layout_.padded_in(0), 0u);
            row[own] = 0x3f803f80u; // 1, 1
        }
    }
    /// The adjoint of max(x, 0), where it gave `active`.
    void through_relu(const std::uint32_t* active, std::size_t features) {
        for (std::size_t f = 0; f < features; f += 2)
            for (std::size_t r = 0; r < mixed_tile; r += Words::width) {
                const std::size_t at = f / 2 * mixed_tile + r;
                const Words words = Words::load(active + at);
                const Wide<float> zero(0.0f);
                bf16_words(select(low_bf16(words) > zero, sum(f, r), zero),
                           select(high_bf16(words) > zero, sum(f + 1, r), zero))
                    .store(gradient_ + at);
            }
    }

    const Layout& layout_;
    const std::uint32_t* packed_;
    const float* bias_;
    std::uint32_t *activations_, *gradient_, *rows_, *activation_rows_, *columns_;
    FloatMatrix sums_;
    ProductBf16 product_;
};

} // namespace gsh::cpu::detail
