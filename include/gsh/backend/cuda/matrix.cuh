// SPDX-License-Identifier: Apache-2.0
/// @file  Products of small matrices by a warp: bf16 operands, sums in float, on tensor cores from sm_80 on.
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
