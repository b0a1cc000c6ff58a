// SPDX-License-Identifier: Apache-2.0
/// @file  Small matrix products in vector registers, for the MLP on the CPU.
///
/// All three products of a layer have the shape C[r, :] += sum_k A(r, k) B[k, :]. C and B are row-major with rows
/// padded to whole registers. A is read one number at a time with any two strides. Sums run over k in order, with fused
/// multiply-add where the machine has it, so a result depends on the operands alone.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/math/wide.hpp>

#include <cstddef>
#include <utility>

namespace gsh::cpu::inline GSH_ISA::detail {

template <class T>
struct Gemm {
    using W = Wide<T>;
    static constexpr std::size_t width = W::width;

    /// Length of a row of `columns` numbers padded to whole registers.
    [[nodiscard]] static constexpr std::size_t padded(std::size_t columns) {
        return (columns + width - 1) / width * width;
    }

    struct Left { ///< A(r, k) = data[r * row_stride + k * inner_stride]
        const T* data;
        std::size_t row_stride, inner_stride;
    };
    struct Right { ///< B[k, c] = data[k * stride + c]
        const T* data;
        std::size_t stride;
    };
    struct Result { ///< C[r, c] = data[r * stride + c]
        T* data;
        std::size_t stride;
    };

    // Epilogues, applied to a register of sums at element `offset` of C.
    struct Assign {
        W operator()(W sum, const T*, std::size_t) const { return sum; }
    };
    struct Add {
        W operator()(W sum, const T* c, std::size_t) const { return W::load(c) + sum; }
    };
    struct Relu {
        W operator()(W sum, const T*, std::size_t) const { return where_positive(sum, sum); }
    };
    struct WhereActive { ///< the adjoint of Relu: keeps a sum where `activations`, laid out as C, are positive
        const T* activations;
        W operator()(W sum, const T*, std::size_t offset) const {
            return where_positive(W::load(activations + offset), sum);
        }
    };

    struct Nothing {
        void operator()(std::size_t, std::size_t) const {}
    };

    /// C[0..rows, 0..padded(columns)] = epilogue(sum over k in [0, inner) of A(r, k) B[k, :]). Calls ahead(row, count)
    /// once for every few rows, to prefetch data for the work after this product.
    template <class Epilogue, class Ahead = Nothing>
    static void product(std::size_t rows, std::size_t columns, std::size_t inner, Left a, Right b, Result c,
                        const Epilogue& epilogue, const Ahead& ahead = {}) {
        const std::size_t end = padded(columns);
        // Sixteen independent sums cover twice the latency of fma, and leave registers for the operands.
        std::size_t column = 0;
        while (column < end) {
            const std::size_t registers = (end - column) / width;
            const auto strip_of = [&](const auto& ahead_of_strip) {
                if (registers >= 4)
                    column += strip<4, 4>(rows, inner, a, b, c, column, epilogue, ahead_of_strip);
                else if (registers >= 2)
                    column += strip<8, 2>(rows, inner, a, b, c, column, epilogue, ahead_of_strip);
                else
                    column += strip<8, 1>(rows, inner, a, b, c, column, epilogue, ahead_of_strip);
            };
            column == 0 ? strip_of(ahead) : strip_of(Nothing{});
        }
    }

private:
    /// value where condition > 0, else 0.
    static W where_positive(W condition, W value) { return select(condition > W(T(0)), value, W(T(0))); }

    /// Columns [column, column + returned width) of all rows.
    template <std::size_t Rows, std::size_t Registers, class Epilogue, class Ahead>
    static std::size_t strip(std::size_t rows, std::size_t inner, Left a, Right b, Result c, std::size_t column,
                             const Epilogue& epilogue, const Ahead& ahead) {
        std::size_t row = 0;
        for (; row + Rows <= rows; row += Rows) {
            ahead(row, Rows);
            block<Rows, Registers>(inner, a, b, c, row, column, epilogue, std::make_index_sequence<Rows * Registers>());
        }
        for (; row < rows; ++row)
            block<1, Registers>(inner, a, b, c, row, column, epilogue, std::make_index_sequence<Registers>());
        return Registers * width;
    }

    template <std::size_t Rows, std::size_t Registers, class Epilogue, std::size_t... I>
    static void block(std::size_t inner, Left a, Right b, Result c, std::size_t row, std::size_t column,
                      const Epilogue& epilogue, std::index_sequence<I...>) {
        W sums[Rows * Registers] = {(static_cast<void>(I), W(T(0)))...};
        const T* a_k = a.data + row * a.row_stride;
        const T* b_k = b.data + column;
        // A row of B is loaded one step ahead. Held in registers, it costs one load per register. Without this,
        // compilers fold the load into every fma that uses it, and the loads exceed what a core can issue.
        W b_row[Rows * Registers] = {W::load(b_k + I % Registers * width)...};
        for (std::size_t k = 0; k < inner; ++k, a_k += a.inner_stride) {
            b_k += k + 1 < inner ? b.stride : 0;
            const W b_next[Rows * Registers] = {W::load(b_k + I % Registers * width)...};
            ((sums[I] = multiply_add(W(a_k[I / Registers * a.row_stride]), b_row[I % Registers], sums[I])), ...);
            ((b_row[I] = b_next[I]), ...);
        }
        const std::size_t first = row * c.stride + column;
        const auto store = [&](W sum, std::size_t offset) {
            epilogue(sum, c.data + offset, offset).store(c.data + offset);
        };
        (store(sums[I], first + I / Registers * c.stride + I % Registers * width), ...);
    }
};

} // namespace gsh::cpu::detail
