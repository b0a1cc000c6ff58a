// SPDX-License-Identifier: Apache-2.0
/// @file  Products of small matrices of bf16 with sums in float: by AMX where the machine has it, else in registers.
///
/// C[m, n] = sum over k of A[m, k] B[k, n]. Neighbours in k share a word (math/wide_bf16.hpp):
///
///     A  word (m, k/2) = A[m, k], A[m, k+1]
///     B  word (k/2, n) = B[k, n], B[k+1, n]
///
/// Sizes may be any; zeros pad the factors to multiples of 32, and C has room for as much. Registers compute rows in
/// fours or eights, whole registers of columns, and pairs of k. AMX computes 16 rows and columns, and 32 of k.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/math/wide_bf16.hpp>
#include <gsh/math/wide.hpp>
#include <gsh/math/wide_shuffle.hpp>

#include <cstddef>
#include <cstdint>

#if defined(__AMX_BF16__) && defined(__linux__)
#define GSH_AMX 1
#include <immintrin.h>
#include <sys/syscall.h>
#include <unistd.h>
#endif

namespace gsh::cpu::inline GSH_ISA::detail {

using Words = Wide<std::uint32_t>;

struct WordMatrix {
    const std::uint32_t* words;
    std::size_t stride; ///< words from row to row
};
struct FloatMatrix {
    float* numbers;
    std::size_t stride;
};
struct ProductSize {
    std::size_t m, n, k;
};

#if defined(GSH_AMX)
/// Linux gives a process the tiles when it first asks.
[[nodiscard]] inline bool amx_is_permitted() {
    static const bool permitted = [] {
        constexpr long request = 0x1023, tile_data = 18; // ARCH_REQ_XCOMP_PERM, XFEATURE_XTILEDATA
        return ::syscall(SYS_arch_prctl, request, tile_data) == 0;
    }();
    return permitted;
}

/// Eight tiles of 16 rows of 64 bytes. A constant, since GCC's intrinsic tells the compiler of the first eight bytes
/// that it reads only: stores to the others could be left out.
struct alignas(64) TileShapes {
    std::uint8_t palette = 1, start = 0, reserved[14] = {};
    std::uint16_t bytes_per_row[16] = {64, 64, 64, 64, 64, 64, 64, 64};
    std::uint8_t rows[16] = {16, 16, 16, 16, 16, 16, 16, 16};
};
inline constexpr TileShapes tile_shapes;
#endif

/// Products in one thread; holds the shapes of AMX's tiles while it lives.
class ProductBf16 {
public:
#if defined(GSH_AMX)
    ProductBf16() : amx_(amx_is_permitted()) {
        if (amx_) _tile_loadconfig(&tile_shapes);
    }
    ~ProductBf16() {
        if (amx_) _tile_release();
    }
#else
    ProductBf16() = default;
#endif
    ProductBf16(const ProductBf16&) = delete;

    /// Whether AMX computes the products. They are then so fast that reading their result from memory takes longer.
    [[nodiscard]] static bool on_tiles() {
#if defined(GSH_AMX)
        return amx_is_permitted();
#else
        return false;
#endif
    }

    /// Calls finish(m, n, sums) with the sums of a row from column n on, an array of registers. The array's length is
    /// even where the number of columns is a multiple of 32.
    template <class Finish>
    void operator()(ProductSize size, WordMatrix a, WordMatrix b, const Finish& finish) const {
#if defined(GSH_AMX)
        if (amx_) return blocks_of_tiles(size, a, b, finish);
#endif
        in_registers(size, {a.words, a.stride, 1}, b, [](std::size_t, std::size_t) { return Wide<float>(0.0f); },
                     finish);
    }

    /// C += A B, where A is transposed: word (k/2, m) = A[m, k], A[m, k+1]. k is at most 64.
    void add_transposed(ProductSize size, WordMatrix a, WordMatrix b, FloatMatrix c) const {
#if defined(GSH_AMX)
        if (amx_) return add_tiles(size, a, b, c);
#endif
        in_registers(
            size, {a.words, 1, a.stride}, b,
            [&](std::size_t m, std::size_t n) { return Wide<float>::load(c.numbers + m * c.stride + n); },
            [&](std::size_t m, std::size_t n, const auto& sums) {
                for (const Wide<float>& sum : sums) {
                    sum.store(c.numbers + m * c.stride + n);
                    n += Wide<float>::width;
                }
            });
    }

private:
    struct Left { ///< word (m, k/2) = words[m * row_stride + k/2 * inner_stride]
        const std::uint32_t* words;
        std::size_t row_stride, inner_stride;
    };

    /// Sums begin with start(m, n). Sixteen independent ones cover the latency of a dot product, or eight.
    template <class Start, class Finish>
    static void in_registers(ProductSize size, Left a, WordMatrix b, const Start& start, const Finish& finish) {
        for (std::size_t n = 0; n < size.n;) {
            const std::size_t registers = (size.n - n + Wide<float>::width - 1) / Wide<float>::width;
            if (registers >= 4) n += strip<4, 4>(size, a, b, n, start, finish);
            else if (registers >= 2) n += strip<8, 2>(size, a, b, n, start, finish);
            else n += strip<8, 1>(size, a, b, n, start, finish);
        }
    }

    /// Columns [n, n + returned width).
    template <std::size_t Rows, std::size_t Registers, class Start, class Finish>
    static std::size_t strip(ProductSize size, Left a, WordMatrix b, std::size_t n, const Start& start,
                             const Finish& finish) {
        constexpr std::size_t width = Wide<float>::width;
        const std::size_t inner = (size.k + 1) / 2;
        for (std::size_t m = 0; m < size.m; m += Rows) {
            Wide<float> sums[Rows][Registers];
            for (std::size_t r = 0; r < Rows; ++r)
                for (std::size_t i = 0; i < Registers; ++i) sums[r][i] = start(m + r, n + i * width);
            // A row of B is loaded one step ahead, so that compilers keep it in registers (as in gemm.hpp).
            const std::uint32_t* from = b.words + n;
            Words right[Registers];
            for (std::size_t i = 0; i < Registers; ++i) right[i] = Words::load(from + i * width);
            for (std::size_t k = 0; k < inner; ++k) {
                from += k + 1 < inner ? b.stride : 0;
                Words next[Registers];
                for (std::size_t i = 0; i < Registers; ++i) next[i] = Words::load(from + i * width);
                for (std::size_t r = 0; r < Rows; ++r) {
                    const Words left(a.words[(m + r) * a.row_stride + k * a.inner_stride]);
                    for (std::size_t i = 0; i < Registers; ++i) sums[r][i] = dot_bf16(sums[r][i], left, right[i]);
                }
                for (std::size_t i = 0; i < Registers; ++i) right[i] = next[i];
            }
            for (std::size_t r = 0; r < Rows; ++r) finish(m + r, n, sums[r]);
        }
        return Registers * width;
    }

#if defined(GSH_AMX)
    template <class Finish>
    static void blocks_of_tiles(ProductSize size, WordMatrix a, WordMatrix b, const Finish& finish) {
        constexpr std::size_t width = Wide<float>::width;
        alignas(64) float block[32 * 32];
        for (std::size_t m = 0; m < size.m; m += 32)
            for (std::size_t n = 0; n < size.n; n += 32) {
                const bool lower = m + 16 < size.m, right = n + 16 < size.n;
                _tile_zero(0);
                _tile_zero(1);
                _tile_zero(2);
                _tile_zero(3);
                add_products(size.k, {a.words + m * a.stride, a.stride}, {b.words + n, b.stride}, lower, right);
                store_tiles({block, 32}, lower, right);
                for (std::size_t r = 0; r < (lower ? 32 : 16); ++r) {
                    const Wide<float> left_sums[1] = {Wide<float>::load(block + r * 32)};
                    const Wide<float> sums[2] = {left_sums[0], Wide<float>::load(block + r * 32 + width)};
                    right ? finish(m + r, n, sums) : finish(m + r, n, left_sums);
                }
            }
    }

    static void add_tiles(ProductSize size, WordMatrix a, WordMatrix b, FloatMatrix c) {
        constexpr std::size_t width = Words::width, longest = 32; // words of k
        alignas(64) std::uint32_t rows[32 * longest];
        for (std::size_t m = 0; m < size.m; m += 32) {
            const bool lower = m + 16 < size.m;
            for (std::size_t r = 0; r < (lower ? 32 : 16); r += width)
                for (std::size_t k = 0; k < (size.k + 1) / 2; k += width) {
                    Words block[width];
                    for (std::size_t i = 0; i < width; ++i)
                        block[i] = Words::load(a.words + (k + i) * a.stride + m + r);
                    transpose(block);
                    for (std::size_t i = 0; i < width; ++i) block[i].store(rows + (r + i) * longest + k);
                }
            for (std::size_t n = 0; n < size.n; n += 32) {
                const bool right = n + 16 < size.n;
                const FloatMatrix to{c.numbers + m * c.stride + n, c.stride};
                _tile_loadd(0, to.numbers, to.stride * 4);
                if (right) _tile_loadd(1, to.numbers + 16, to.stride * 4);
                if (lower) _tile_loadd(2, to.numbers + 16 * to.stride, to.stride * 4);
                if (lower && right) _tile_loadd(3, to.numbers + 16 * to.stride + 16, to.stride * 4);
                add_products(size.k, {rows, longest}, {b.words + n, b.stride}, lower, right);
                store_tiles(to, lower, right);
            }
        }
    }

    /// Adds to two by two tiles of 16 × 16 sums; a tile of a factor holds 16 rows of 16 words.
    static void add_products(std::size_t inner, WordMatrix a, WordMatrix b, bool lower, bool right) {
        for (std::size_t k = 0; k < (inner + 1) / 2; k += 16) {
            _tile_loadd(4, a.words + k, a.stride * 4);
            _tile_loadd(6, b.words + k * b.stride, b.stride * 4);
            _tile_dpbf16ps(0, 4, 6);
            if (right) {
                _tile_loadd(7, b.words + k * b.stride + 16, b.stride * 4);
                _tile_dpbf16ps(1, 4, 7);
            }
            if (lower) {
                _tile_loadd(5, a.words + 16 * a.stride + k, a.stride * 4);
                _tile_dpbf16ps(2, 5, 6);
                if (right) _tile_dpbf16ps(3, 5, 7);
            }
        }
    }
    static void store_tiles(FloatMatrix to, bool lower, bool right) {
        _tile_stored(0, to.numbers, to.stride * 4);
        if (right) _tile_stored(1, to.numbers + 16, to.stride * 4);
        if (lower) _tile_stored(2, to.numbers + 16 * to.stride, to.stride * 4);
        if (lower && right) _tile_stored(3, to.numbers + 16 * to.stride + 16, to.stride * 4);
    }

    bool amx_;
#endif
};

} // namespace gsh::cpu::detail
