// SPDX-License-Identifier: Apache-2.0
/// @file  The MLP on the CPU in mixed precision: operands in bf16, sums in float.
///
/// A tile of 64 points passes through all layers within the first-level cache. Matrices of a tile have a row for each
/// point, with two features to a word, so that the result of a layer has the layout of the next one's operand.
/// Gradients of weights sum over points and take words of one feature of two points: two rows, zipped.
///
/// Activations of hidden layers are kept for backward as words, since on AVX-512 reading them takes less time than
/// computing them again. Where AMX computes the products it takes more, so nothing is kept.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/cpu/feature_rows.hpp>
#include <gsh/field/cpu/matrix_bf16.hpp>
#include <gsh/field/features.hpp>
#include <gsh/math/wide_bf16.hpp>
#include <gsh/math/wide.hpp>
#include <gsh/math/wide_shuffle.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>

namespace gsh::cpu::inline GSH_ISA::detail {

inline constexpr std::size_t mixed_tile = 64; ///< points

/// Rows and columns of a matrix of bf16 in memory.
[[nodiscard]] constexpr std::size_t mixed_padded(std::size_t n) { return (n + 31) / 32 * 32; }

/// Sizes and offsets common to both passes. Inputs that all points share are a bias of the first layer, in float.
template <class Network>
struct MixedLayout {
    const Network& network;
    Span<const float> shared = {}; ///< the last of the network's inputs

    [[nodiscard]] std::size_t layers() const { return network.layer_count(); }
    [[nodiscard]] std::size_t hidden_layers() const { return layers() - 1; }
    /// Number of inputs that differ from point to point.
    [[nodiscard]] std::size_t row_inputs() const { return network.inputs() - shared.size(); }
    [[nodiscard]] std::size_t in(std::size_t layer) const { return layer ? network.layer_inputs(layer) : row_inputs(); }
    [[nodiscard]] std::size_t out(std::size_t layer) const { return network.layer_outputs(layer); }
    [[nodiscard]] std::size_t widest() const {
        return mixed_padded(std::max({in(0), out(0), out(layers() - 1)})); // all hidden layers are as wide
    }
    /// Words of a point's inputs of a layer, and of its activations of a hidden layer.
    [[nodiscard]] std::size_t words_in(std::size_t layer) const { return mixed_padded(in(layer)) / 2; }
    [[nodiscard]] std::size_t hidden_words() const { return mixed_padded(out(0)) / 2; }

    /// Weights in words: [in / 2][out] of each layer for forward, then [out / 2][in] for backward.
    [[nodiscard]] std::size_t packed_offset(std::size_t layer) const {
        std::size_t offset = 0;
        for (std::size_t l = 0; l < layer; ++l) offset += mixed_padded(out(l)) * mixed_padded(in(l)) / 2;
        return offset;
    }
    [[nodiscard]] std::size_t packed_size() const { return 2 * packed_offset(layers()); }
    [[nodiscard]] WordMatrix forward_matrix(const std::uint32_t* packed, std::size_t layer) const {
        return {packed + packed_offset(layer), mixed_padded(out(layer))};
    }
    [[nodiscard]] WordMatrix backward_matrix(const std::uint32_t* packed, std::size_t layer) const {
        return {packed + packed_offset(layers()) + packed_offset(layer), mixed_padded(in(layer))};
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
            for (std::size_t i = 0; i < ins; i += 2)
                for (std::size_t o = 0; o < outs; ++o) *to++ = bf16_word(weight(o, i), weight(o, i + 1));
            to = packed + packed_offset(layers()) + packed_offset(l);
            for (std::size_t o = 0; o < outs; o += 2)
                for (std::size_t i = 0; i < ins; ++i) *to++ = bf16_word(weight(o, i), weight(o + 1, i));
        }
        for (std::size_t o = 0; o < mixed_padded(out(0)); ++o) {
            bias[o] = 0;
            for (std::size_t c = 0; o < out(0) && c < shared.size(); ++c)
                bias[o] += weights[o * network.inputs() + row_inputs() + c] * shared[c];
        }
    }
};

/// Activations of the hidden layers, of one tile or of all points: a row for each point, layer after layer.
struct MixedHidden {
    std::uint32_t* words;
    std::size_t stride, pitch; ///< words from point to point and from layer to layer

    [[nodiscard]] std::uint32_t* layer(std::size_t l) const { return words + l * pitch; }
    [[nodiscard]] MixedHidden from(std::size_t point) const { return {words + point * stride, stride, pitch}; }
};

/// Matrices of one tile.
template <class Network>
class MixedTile {
public:
    using Layout = MixedLayout<Network>;

    [[nodiscard]] static std::size_t word_count(const Layout& layout) {
        return inputs_size(layout) + layout.hidden_layers() * hidden_size(layout) + 2 * gradient_size(layout) +
               2 * pairs_size(layout);
    }
    [[nodiscard]] static std::size_t number_count(const Layout& layout) { return layout.widest() * mixed_tile; }

    MixedTile(const Layout& layout, const std::uint32_t* packed, const float* bias, std::uint32_t* words,
              float* numbers)
        : layout_(layout), packed_(packed), bias_(bias), inputs_(words),
          own_hidden_{inputs_ + inputs_size(layout), layout.hidden_words(), hidden_size(layout)}, hidden_(own_hidden_),
          gradients_{own_hidden_.words + layout.hidden_layers() * hidden_size(layout),
                     own_hidden_.words + layout.hidden_layers() * hidden_size(layout) + gradient_size(layout)},
          input_pairs_(gradients_[1] + gradient_size(layout)), gradient_pairs_(input_pairs_ + pairs_size(layout)),
          numbers_{numbers, layout.widest()} {
        std::fill_n(inputs_, inputs_size(layout), 0u); // what pads the inputs stays 0
    }

    /// Reads the inputs of points [first, first + count).
    void load(const MlpInputs<float>& inputs, std::size_t first, std::size_t count) {
        const FeatureView<const float>& features = inputs.features;
        const std::size_t own = layout_.row_inputs() - features.columns, stride = layout_.words_in(0);
        std::size_t column = 0;
        if (count == mixed_tile) {
            if (features.block == 4)
                for (; column + 4 * Quads::width <= features.columns; column += 4 * Quads::width)
                    load_blocks_of_four(features, first, column);
            if (column == features.columns && own % 2 == 0) {
                load_points(inputs.points.data() + first * own, own, inputs_ + column / 2);
                return;
            }
        }
        const auto number = [&](std::size_t r, std::size_t c) {
            if (r >= count || c >= layout_.row_inputs()) return 0.0f;
            return c < features.columns ? features(first + r, c)
                                        : inputs.points[(first + r) * own + c - features.columns];
        };
        for (std::size_t r = 0; r < mixed_tile; ++r)
            for (std::size_t c = column; c < layout_.row_inputs(); c += 2)
                inputs_[r * stride + c / 2] = bf16_word(number(r, c), number(r, c + 1));
    }

    /// Lets the activations of this tile's points lie elsewhere.
    void use_hidden(const MixedHidden& hidden) { hidden_ = hidden; }
    /// Copies the activations of a list of points.
    void copy_hidden(const MixedHidden& hidden, const RowsOf& rows, std::size_t count) {
        hidden_ = own_hidden_;
        for (std::size_t l = 0; l < layout_.hidden_layers(); ++l) {
            std::uint32_t* const to = hidden_.layer(l);
            copy_rows<std::uint32_t>(hidden.layer(l), hidden.stride, rows, count, to);
            std::fill(to + count * hidden.stride, to + mixed_tile * hidden.stride, 0u);
        }
    }
    /// Computes the activations of the hidden layers. Calls ahead(row, count) once for every few rows, to prefetch.
    template <class Ahead>
    void compute_hidden(const Ahead& ahead) {
        for (std::size_t l = 0; l < layout_.hidden_layers(); ++l) {
            const auto activate = [&](std::size_t r, std::size_t o, const auto& sums) {
                if (l == 0 && o == 0 && r % rows_ahead == 0) ahead(r, rows_ahead);
                const auto active = [&](std::size_t i) {
                    const Wide<float> zero(0.0f);
                    return max(sums[i] + (l ? zero : Wide<float>::load(bias_ + o + i * width)), zero);
                };
                for_pairs(sums, [&](std::size_t i) {
                    bf16_neighbours(active(i), active(i + 1))
                        .store(hidden_.layer(l) + r * hidden_.stride + (o + i * width) / 2);
                });
            };
            product_({mixed_tile, mixed_padded(layout_.out(l)), layout_.in(l)}, inputs_of(l),
                     layout_.forward_matrix(packed_, l), activate);
        }
    }
    /// Computes the outputs of `count` points, row-major.
    void outputs(std::size_t count, float* to) {
        const std::size_t last = layout_.layers() - 1, outs = layout_.out(last);
        product_({mixed_tile, outs, layout_.in(last)}, inputs_of(last), layout_.forward_matrix(packed_, last),
                 [&](std::size_t r, std::size_t o, const auto& sums) {
                     for (const Wide<float>& sum : sums) {
                         (last ? sum : sum + Wide<float>::load(bias_ + o)).store(number(r, o));
                         o += width;
                     }
                 });
        for (std::size_t r = 0; r < count; ++r) std::copy_n(number(r, 0), outs, to + r * outs);
    }

    /// Reads dL_doutputs of a tile's points.
    template <class Rows>
    void load_gradient(const float* dL_doutputs, const Rows& rows, std::size_t count) {
        const std::size_t outs = layout_.out(layout_.layers() - 1), padded = mixed_padded(outs);
        for (std::size_t r = 0; r < mixed_tile; ++r) {
            float* const row = number(r, 0);
            float* const rest = r < count ? std::copy_n(dL_doutputs + rows(r) * outs, outs, row) : row;
            std::fill(rest, row + padded, 0.0f);
        }
        for (std::size_t r = 0; r < mixed_tile; ++r)
            for (std::size_t o = 0; o < padded; o += 2 * width)
                bf16_neighbours(Wide<float>::load(number(r, o)), Wide<float>::load(number(r, o + width)))
                    .store(gradients_[0] + (r * padded + o) / 2);
    }
    /// Adds to `sums` (MixedLayout::padded_offset). Returns dL_dx of the first `wanted` inputs, a row for each point.
    /// Calls ahead(layer, row, count) once for every few rows when the inputs of the layer are no longer needed.
    template <class Ahead>
    FloatMatrix backward(float* sums, std::size_t wanted, const Ahead& ahead) {
        std::uint32_t *dL_dy = gradients_[0], *dL_dx = gradients_[1];
        for (std::size_t l = layout_.layers(); l-- > 0;) {
            const std::size_t ins = mixed_padded(layout_.in(l)), stride = pairs_stride(layout_);
            const WordMatrix x = inputs_of(l), gradient{dL_dy, mixed_padded(layout_.out(l)) / 2},
                             matrix = layout_.backward_matrix(packed_, l);
            zip_rows(gradient, gradient_pairs_);
            zip_rows(x, input_pairs_);
            if (l == 0 && !layout_.shared.empty()) append_one();
            product_.add_transposed({layout_.out(l), layout_.padded_in(l), mixed_tile}, {gradient_pairs_, stride},
                                    {input_pairs_, stride}, {sums + layout_.padded_offset(l), layout_.padded_in(l)});
            const auto prefetch_ahead = [&](std::size_t r, std::size_t c) {
                if (c == 0 && r % rows_ahead == 0) ahead(l, r, rows_ahead);
            };
            if (l == 0) {
                if (wanted)
                    product_({mixed_tile, wanted, layout_.out(l)}, gradient, matrix,
                             [&](std::size_t r, std::size_t c, const auto& g) {
                                 prefetch_ahead(r, c);
                                 for (const Wide<float>& part : g) {
                                     part.store(number(r, c));
                                     c += width;
                                 }
                             });
                break;
            }
            // through max(x, 0), where it gave more than 0
            product_({mixed_tile, ins, layout_.out(l)}, gradient, matrix,
                     [&](std::size_t r, std::size_t c, const auto& g) {
                         prefetch_ahead(r, c);
                         for_pairs(g, [&](std::size_t i) {
                             const std::size_t at = r * x.stride + (c + i * width) / 2;
                             (bf16_neighbours(g[i], g[i + 1]) & positive(Words::load(x.words + at))).store(dL_dx + at);
                         });
                     });
            std::swap(dL_dy, dL_dx);
        }
        return numbers_;
    }

private:
    static constexpr std::size_t width = Wide<float>::width, rows_ahead = 4;
    using Quads = Wide<std::uint64_t>; ///< four features to a number

    [[nodiscard]] static std::size_t inputs_size(const Layout& layout) { return mixed_tile * layout.words_in(0); }
    [[nodiscard]] static std::size_t hidden_size(const Layout& layout) { return mixed_tile * layout.hidden_words(); }
    [[nodiscard]] static std::size_t gradient_size(const Layout& layout) { return mixed_tile * layout.widest() / 2; }
    [[nodiscard]] static std::size_t pairs_stride(const Layout& layout) { return layout.widest() + 32; }
    [[nodiscard]] static std::size_t pairs_size(const Layout& layout) { return mixed_tile / 2 * pairs_stride(layout); }

    [[nodiscard]] WordMatrix inputs_of(std::size_t layer) const {
        return {layer ? hidden_.layer(layer - 1) : inputs_, layout_.words_in(layer)};
    }
    [[nodiscard]] float* number(std::size_t r, std::size_t c) const {
        return numbers_.numbers + r * numbers_.stride + c;
    }

    /// Calls f with the first of every two registers.
    template <std::size_t Registers, class F>
    static void for_pairs(const Wide<float> (&)[Registers], const F& f) {
        for (std::size_t i = 0; i + 1 < Registers; i += 2) f(i);
    }
    /// All bits of the halves of a word that are more than 0.
    [[nodiscard]] static Words positive(Words words) {
        const Wide<float> zero(0.0f);
        return bits_as<Words>(select(low_bf16(words) > zero, bits_as<Wide<float>>(Words(0xffffu)), zero)) |
               bits_as<Words>(select(high_bf16(words) > zero, bits_as<Wide<float>>(Words(0xffff0000u)), zero));
    }

    /// Features from `column` on of 64 points, of as many blocks of four as a register has numbers of 64 bits.
    void load_blocks_of_four(const FeatureView<const float>& features, std::size_t first, std::size_t column) {
        for (std::size_t r = 0; r < mixed_tile; r += Quads::width) {
            Quads block[Quads::width];
            for (std::size_t i = 0; i < Quads::width; ++i) {
                const float* const from = features.column(column + 4 * i) + (first + r) * 4;
                block[i] = bits_as<Quads>(bf16_neighbours(Wide<float>::load(from), Wide<float>::load(from + width)));
            }
            transpose(block);
            for (std::size_t i = 0; i < Quads::width; ++i)
                bits_as<Words>(block[i]).store(inputs_ + (r + i) * layout_.words_in(0) + column / 2);
        }
    }
    /// Further inputs of 64 points. Numbers become words in a row; then the words go to the points.
    void load_points(const float* from, std::size_t own, std::uint32_t* to) {
        std::uint32_t* const words = gradients_[0];
        for (std::size_t i = 0; i < mixed_tile * own; i += 2 * width)
            bf16_neighbours(Wide<float>::load(from + i), Wide<float>::load(from + i + width)).store(words + i / 2);
        for (std::size_t r = 0; r < mixed_tile; ++r)
            for (std::size_t i = 0; i < own / 2; ++i) to[r * layout_.words_in(0) + i] = words[r * own / 2 + i];
    }

    /// Words of a feature of two points, [32][features].
    void zip_rows(WordMatrix rows, std::uint32_t* to) const {
        for (std::size_t r = 0; r < mixed_tile; r += 2, to += pairs_stride(layout_))
            for (std::size_t i = 0; i < rows.stride; i += Words::width) {
                const std::uint32_t* const from = rows.words + r * rows.stride + i;
                const WidePair<std::uint32_t> both = zip_bf16(Words::load(from), Words::load(from + rows.stride));
                both.first.store(to + 2 * i), both.second.store(to + 2 * i + Words::width);
            }
    }
    /// The column behind the inputs is 1: its sum is the gradient of the bias.
    void append_one() const {
        const std::size_t own = layout_.row_inputs();
        for (std::size_t r = 0; r < mixed_tile / 2; ++r) {
            std::uint32_t* const row = input_pairs_ + r * pairs_stride(layout_);
            std::fill(row + own, row + layout_.padded_in(0), 0u);
            row[own] = 0x3f803f80u; // 1, 1
        }
    }

    const Layout& layout_;
    const std::uint32_t* packed_;
    const float* bias_;
    std::uint32_t* inputs_;
    MixedHidden own_hidden_, hidden_; ///< the tile's own memory, and where the activations are
    std::uint32_t *gradients_[2], *input_pairs_, *gradient_pairs_;
    FloatMatrix numbers_;
    ProductBf16 product_;
};

} // namespace gsh::cpu::detail
