// SPDX-License-Identifier: Apache-2.0
/// @file  Products of small matrices of bf16 or float by a warp, with sums in float, on tensor cores from sm_80 on.
///
/// A word holds two numbers of bf16 (backend/cuda/half.cuh). In what follows, lane = 4 g + t.
#pragma once

#include <gsh/backend/cuda/half.cuh>
#include <gsh/backend/cuda/kernel.cuh>

#include <cstddef>
#include <cstdint>

#if !defined(GSH_CUDA_EMULATION) && defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
#define GSH_TENSOR_CORES
#endif

namespace gsh::cuda {

/// The left operand, 16 x 16: words (row g, columns 2t and 2t + 1), (row g + 8, the same), (row g, columns 2t + 8 and
/// 2t + 9), (row g + 8, the same).
struct MatrixA {
    std::uint32_t words[4];
};
/// The right operand, 16 x 8: words (rows 2t and 2t + 1, column g), (rows 2t + 8 and 2t + 9, column g).
struct MatrixB {
    std::uint32_t words[2];
};
/// Two right operands side by side, 16 x 16. A lane reads its part from memory in one piece.
struct alignas(16) MatrixB2 {
    MatrixB halves[2];
};
/// The result, 16 x 8: (row g, column 2t), (row g, column 2t + 1), (row g + 8, column 2t), (row g + 8, column 2t + 1).
/// Two results side by side, packed, have the layout of a MatrixA.
struct MatrixC {
    float values[4];
};

namespace detail {

/// A lane's part of both operands.
struct MatrixOperands {
    MatrixA a;
    MatrixB b;
};

/// c += a b for this lane. of_lane(l, word) is word(operands of lane l); `word` reads the same word in all lanes.
template <class OfLane>
__device__ void multiply_add_lane(MatrixC& c, const OfLane& of_lane) {
    const unsigned g = threadIdx.x % warp_size / 4, t = threadIdx.x % 4;
    for (unsigned k = 0; k < 8; ++k) { // pairs of inner numbers
        std::uint32_t rows[2], columns[2];
        for (unsigned i = 0; i < 2; ++i) {
            rows[i] = of_lane(4 * g + k % 4, [&](const MatrixOperands& o) { return o.a.words[i + k / 4 * 2]; });
            columns[i] = of_lane(4 * (2 * t + i) + k % 4, [&](const MatrixOperands& o) { return o.b.words[k / 4]; });
        }
        for (unsigned i = 0; i < 4; ++i)
            c.values[i] +=
                low_bf16(rows[i / 2]) * low_bf16(columns[i % 2]) + high_bf16(rows[i / 2]) * high_bf16(columns[i % 2]);
    }
}

/// The same for devices without the instruction: lanes exchange word by word.
__device__ inline void multiply_add_by_shuffles(MatrixC& c, const MatrixA& a, const MatrixB& b) {
    const MatrixOperands mine{a, b};
    multiply_add_lane(c, [&](unsigned lane, const auto& word) {
        return __shfl_sync(all_lanes, word(mine), static_cast<int>(lane));
    });
}

} // namespace detail

/// c += a b. All lanes take part.
__device__ inline void multiply_add(MatrixC& c, const MatrixA& a, const MatrixB& b) {
#if defined(GSH_TENSOR_CORES)
    asm("mma.sync.aligned.m16n8k16.row.col.f32.bf16.bf16.f32 {%0, %1, %2, %3}, {%4, %5, %6, %7}, {%8, %9}, "
        "{%0, %1, %2, %3};"
        : "+f"(c.values[0]), "+f"(c.values[1]), "+f"(c.values[2]), "+f"(c.values[3])
        : "r"(a.words[0]), "r"(a.words[1]), "r"(a.words[2]), "r"(a.words[3]), "r"(b.words[0]), "r"(b.words[1]));
#elif defined(GSH_CUDA_EMULATION) // one exchange instead of 32, which take most of the time of tests
    const auto lanes = test::values_of_warp(detail::MatrixOperands{a, b});
    detail::multiply_add_lane(c, [&](unsigned lane, const auto& word) { return word(lanes[lane]); });
#else
    detail::multiply_add_by_shuffles(c, a, b);
#endif
}

namespace detail {

/// A float as the sum of two numbers of TF32, which has the range of float and 11 bits of mantissa; to 2^-22 of it.
struct SplitFloat {
    static constexpr std::uint32_t bits = 0xFFFFE000u; // of a float that the instruction reads
    std::uint32_t high, low;

    __device__ explicit SplitFloat(float x) {
        high = (__float_as_uint(x) + 0x1000u) & bits;     // to the nearest
        low = __float_as_uint(x - __uint_as_float(high)); // the instruction ignores what is beyond its bits
    }
};

/// sums += a b for this lane, rows from `first` on. left(l, m, i) is a[m][i] of lane l, and right(l, n, i) is b[n][i];
/// m, n and i are the same in all lanes.
template <unsigned M, std::size_t Rows, std::size_t Columns, class Left, class Right>
__device__ void multiply_add_lane(float (&sums)[Rows][Columns], unsigned first, const Left& left, const Right& right) {
    const unsigned g = threadIdx.x % warp_size / 4, t = threadIdx.x % 4;
    for (unsigned k = 0; k < 8; ++k) {
        float row[Columns];
        for (unsigned j = 0; j < Columns; ++j) row[j] = right(4 * (2 * t + j % 2) + k % 4, j / 2, k / 4);
        for (unsigned i = 0; i < 2 * M; ++i) {
            const float x = left(4 * g + k % 4, i / 2, k / 4 * 2 + i % 2);
            for (unsigned j = 0; j < Columns; ++j) sums[first + i][j] += x * row[j];
        }
    }
}

/// The product of floats for devices without the instruction: lanes exchange number by number.
template <unsigned M, unsigned N, std::size_t Rows>
__device__ void multiply_add_by_shuffles(float (&sums)[Rows][2 * N], const float (&a)[M][4], const float (&b)[N][2],
                                         unsigned first = 0) {
    multiply_add_lane<M>(
        sums, first,
        [&](unsigned lane, unsigned m, unsigned i) { return __shfl_sync(all_lanes, a[m][i], static_cast<int>(lane)); },
        [&](unsigned lane, unsigned n, unsigned i) { return __shfl_sync(all_lanes, b[n][i], static_cast<int>(lane)); });
}

} // namespace detail

/// c += a b for 2 M x 2 N numbers of each lane, where a are M matrices of 16 x 8 and b are N of 8 x 8, on tensor cores
/// to about 2^-21 of each product: a number is the sum of two of TF32, and the product of the small parts is left out.
/// c are the rows of `sums` from `first` on, which must be a constant for the compiler.
///
/// With lane = 4 g + t, a[m] has (row g, column t), (g + 8, t), (g, t + 4), (g + 8, t + 4); b[n] has (row t, column g),
/// (t + 4, g); c[2 m + h][2 n + e] is (row g + 8 h, column 2 t + e) of the product of a[m] and b[n]. All lanes take
/// part.
template <unsigned M, unsigned N, std::size_t Rows>
    requires(2 * M <= Rows)
__device__ void multiply_add(float (&sums)[Rows][2 * N], const float (&a)[M][4], const float (&b)[N][2],
                             unsigned first = 0) {
#if defined(GSH_TENSOR_CORES)
    using detail::SplitFloat;
    const auto multiply = [&](unsigned m, unsigned n, const std::uint32_t (&left)[4], const std::uint32_t (&right)[2]) {
        asm("mma.sync.aligned.m16n8k8.row.col.f32.tf32.tf32.f32 {%0, %1, %2, %3}, {%4, %5, %6, %7}, {%8, %9}, "
            "{%0, %1, %2, %3};"
            : "+f"(sums[first + 2 * m][2 * n]), "+f"(sums[first + 2 * m][2 * n + 1]),
              "+f"(sums[first + 2 * m + 1][2 * n]), "+f"(sums[first + 2 * m + 1][2 * n + 1])
            : "r"(left[0]), "r"(left[1]), "r"(left[2]), "r"(left[3]), "r"(right[0]), "r"(right[1]));
    };
    std::uint32_t high[M][4], low[M][4], right_high[N][2], right_low[N][2];
    for (unsigned m = 0; m < M; ++m)
        for (unsigned i = 0; i < 4; ++i) {
            const SplitFloat split(a[m][i]);
            high[m][i] = split.high, low[m][i] = split.low;
        }
    for (unsigned n = 0; n < N; ++n)
        for (unsigned i = 0; i < 2; ++i) {
            const SplitFloat split(b[n][i]);
            right_high[n][i] = split.high, right_low[n][i] = split.low;
        }
    // Products of the same sum are far apart, because each waits for the one before.
    const auto multiply_all = [&](const std::uint32_t (&left)[M][4], const std::uint32_t (&right)[N][2]) {
        for (unsigned n = 0; n < N; ++n)
            for (unsigned m = 0; m < M; ++m) multiply(m, n, left[m], right[n]);
    };
    multiply_all(low, right_high), multiply_all(high, right_low), multiply_all(high, right_high);
#elif defined(GSH_CUDA_EMULATION) // the same three products of what the instruction reads; a sum is rounded otherwise
    struct Operands {
        float a[M][4], b[N][2];
    } mine;
    for (unsigned i = 0; i < 4 * M; ++i) mine.a[i / 4][i % 4] = a[i / 4][i % 4];
    for (unsigned i = 0; i < 2 * N; ++i) mine.b[i / 2][i % 2] = b[i / 2][i % 2];
    const auto lanes = test::values_of_warp(mine);
    const auto part = [](float x, bool high) {
        const detail::SplitFloat split(x);
        return __uint_as_float((high ? split.high : split.low) & detail::SplitFloat::bits);
    };
    const auto multiply_all = [&](bool left_high, bool right_high) {
        detail::multiply_add_lane<M>(
            sums, first,
            [&](unsigned lane, unsigned m, unsigned i) { return part(lanes[lane].a[m][i], left_high); },
            [&](unsigned lane, unsigned n, unsigned i) { return part(lanes[lane].b[n][i], right_high); });
    };
    multiply_all(false, true), multiply_all(true, false), multiply_all(true, true);
#else
    detail::multiply_add_by_shuffles(sums, a, b, first);
#endif
}

/// The transposes of four 8 x 8 matrices in shared memory, of which lane 8 m + r gives the index of row r of matrix m:
/// a multiple of 4, where four words begin. Word m has (row g, columns 2t and 2t + 1) of the m-th transpose, so that a
/// result has the layout of a MatrixA. All lanes take part.
template <std::size_t N>
[[nodiscard]] __device__ MatrixA load_transposed(const SharedArray<std::uint32_t, N>& array, unsigned index) {
    MatrixA result;
#if !defined(GSH_CUDA_EMULATION)
    asm volatile("ldmatrix.sync.aligned.m8n8.x4.trans.shared.b16 {%0, %1, %2, %3}, [%4];"
                 : "=r"(result.words[0]), "=r"(result.words[1]), "=r"(result.words[2]), "=r"(result.words[3])
                 : "r"(static_cast<unsigned>(__cvta_generic_to_shared(&array[index])))
                 : "memory");
#else
    const MatrixA row{{array[index], array[index + 1], array[index + 2], array[index + 3]}};
    const auto rows = test::values_of_warp(row);
    const unsigned g = threadIdx.x % warp_size / 4, t = threadIdx.x % 4;
    const auto number = [&](unsigned r) { return rows[r].words[g / 2] >> (16 * (g % 2)) & 0xFFFFu; };
    for (unsigned m = 0; m < 4; ++m)
        result.words[m] = number(8 * m + 2 * t) | number(8 * m + 2 * t + 1) << 16;
#endif
    return result;
}

} // namespace gsh::cuda

#undef GSH_TENSOR_CORES
