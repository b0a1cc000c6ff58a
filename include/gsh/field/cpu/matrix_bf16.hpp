// SPDX-License-Identifier: Apache-2.0
/// @file  Products of small matrices of bf16 with sums in float: by AMX where the machine has it, else in registers.
///
/// C[m, n] = sum over k of A[m, k] B[k, n]. Neighbours in k share a word (math/wide_bf16.hpp):
///
///     A  word (m, k/2) = A[m, k], A[m, k+1]
///     B  word (k/2, n) = B[k, n], B[k+1, n]
///
/// Sizes are multiples of 16, K one of 32; what pads a matrix is zero.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/math/wide_bf16.hpp>
#include <gsh/math/wide.hpp>

#include <cstddef>
#include <cstdint>

#if defined(__AMX_BF16__) && defined(__linux__)
#define GSH_AMX 1
#include <immintrin.h>
#include <sys/syscall.h>
#include <unistd.h>
#endif

namespace gsh::cpu::inline GSH_ISA::detail {

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

    /// C = A B, or with Add, C += A B.
    template <bool Add = false>
    void operator()(ProductSize size, WordMatrix a, WordMatrix b, FloatMatrix c) const {
#if defined(GSH_AMX)
        if (amx_) return on_tiles<Add>(size, a, b, c);
#endif
        for (std::size_t n = 0; n < size.n;) {
            const std::size_t registers = (size.n - n) / Wide<float>::width;
            if (registers >= 4) n += in_registers<4, Add>(size, a, b, c, n);
            else n += in_registers<1, Add>(size, a, b, c, n);
        }
    }

private:
    /// Columns [n, n + returned width). Four rows of as many registers are sixteen independent sums.
    template <std::size_t Registers, bool Add>
    static std::size_t in_registers(ProductSize size, WordMatrix a, WordMatrix b, FloatMatrix c, std::size_t n) {
        constexpr std::size_t rows = 4, width = Wide<float>::width;
        for (std::size_t m = 0; m < size.m; m += rows) {
            Wide<float> sums[rows][Registers];
            for (std::size_t r = 0; r < rows; ++r)
                for (std::size_t i = 0; i < Registers; ++i)
                    sums[r][i] = Add ? Wide<float>::load(c.numbers + (m + r) * c.stride + n + i * width) : 0.0f;
            for (std::size_t k = 0; k < size.k / 2; ++k) {
                Wide<std::uint32_t> right[Registers];
                for (std::size_t i = 0; i < Registers; ++i)
                    right[i] = Wide<std::uint32_t>::load(b.words + k * b.stride + n + i * width);
                for (std::size_t r = 0; r < rows; ++r) {
                    const Wide<std::uint32_t> left(a.words[(m + r) * a.stride + k]);
                    for (std::size_t i = 0; i < Registers; ++i) sums[r][i] = dot_bf16(sums[r][i], left, right[i]);
                }
            }
            for (std::size_t r = 0; r < rows; ++r)
                for (std::size_t i = 0; i < Registers; ++i)
                    sums[r][i].store(c.numbers + (m + r) * c.stride + n + i * width);
        }
        return Registers * width;
    }

#if defined(GSH_AMX)
    /// Two by two tiles of 16 × 16 sums; a tile of a factor holds 16 rows of 16 words.
    template <bool Add>
    static void on_tiles(ProductSize size, WordMatrix a, WordMatrix b, FloatMatrix c) {
        const std::size_t a_row = a.stride * 4, b_row = b.stride * 4, c_row = c.stride * 4; // bytes
        for (std::size_t m = 0; m < size.m; m += 32)
            for (std::size_t n = 0; n < size.n; n += 32) {
                const bool lower = m + 16 < size.m, right = n + 16 < size.n;
                float* const c00 = c.numbers + m * c.stride + n;
                float* const c10 = c00 + 16 * c.stride;
                if constexpr (Add) {
                    _tile_loadd(0, c00, c_row);
                    if (right) _tile_loadd(1, c00 + 16, c_row);
                    if (lower) _tile_loadd(2, c10, c_row);
                    if (lower && right) _tile_loadd(3, c10 + 16, c_row);
                } else {
                    _tile_zero(0);
                    _tile_zero(1);
                    _tile_zero(2);
                    _tile_zero(3);
                }
                for (std::size_t k = 0; k < size.k / 2; k += 16) {
                    _tile_loadd(4, a.words + m * a.stride + k, a_row);
                    _tile_loadd(6, b.words + k * b.stride + n, b_row);
                    _tile_dpbf16ps(0, 4, 6);
                    if (right) {
                        _tile_loadd(7, b.words + k * b.stride + n + 16, b_row);
                        _tile_dpbf16ps(1, 4, 7);
                    }
                    if (lower) {
                        _tile_loadd(5, a.words + (m + 16) * a.stride + k, a_row);
                        _tile_dpbf16ps(2, 5, 6);
                        if (right) _tile_dpbf16ps(3, 5, 7);
                    }
                }
                _tile_stored(0, c00, c_row);
                if (right) _tile_stored(1, c00 + 16, c_row);
                if (lower) _tile_stored(2, c10, c_row);
                if (lower && right) _tile_stored(3, c10 + 16, c_row);
            }
    }

    bool amx_;
#endif
};

} // namespace gsh::cpu::detail
