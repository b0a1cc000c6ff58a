// SPDX-License-Identifier: Apache-2.0
/// @file  Rows of numbers of 16 bits, two to a word, which a thread reads or writes with one instruction.
#pragma once

#include <gsh/backend/cuda/half.cuh>
#include <gsh/core/span.hpp>
#include <gsh/field/cuda/row.cuh>

#include <cstddef>
#include <cstdint>

namespace gsh::cuda::detail {

/// N numbers of bf16.
template <std::size_t N>
    requires(N % 2 == 0)
struct alignas(row_alignment<std::uint16_t, N>()) Bf16Row {
    std::uint32_t words[N / 2];

    [[nodiscard]] __device__ static Bf16Row rounded(const Row<float, N>& row) {
        Bf16Row result;
        for (std::size_t i = 0; i < N; i += 2) result.words[i / 2] = pack_bf16(row[i], row[i + 1]);
        return result;
    }
    [[nodiscard]] __device__ Row<float, N> wide() const {
        Row<float, N> result;
        for (std::size_t i = 0; i < N; i += 2)
            result[i] = low_bf16(words[i / 2]), result[i + 1] = high_bf16(words[i / 2]);
        return result;
    }
};

/// N numbers of fp16.
template <std::size_t N>
    requires(N % 2 == 0)
struct alignas(row_alignment<std::uint16_t, N>()) Fp16Row {
    std::uint32_t words[N / 2];

    [[nodiscard]] __device__ static Fp16Row rounded(const Row<float, N>& row) {
        Fp16Row result;
        for (std::size_t i = 0; i < N; i += 2) result.words[i / 2] = pack_fp16(row[i], row[i + 1]);
        return result;
    }
    [[nodiscard]] __device__ Row<float, N> wide() const {
        Row<float, N> result;
        for (std::size_t i = 0; i < N; i += 2)
            result[i] = low_fp16(words[i / 2]), result[i + 1] = high_fp16(words[i / 2]);
        return result;
    }
};

/// The words of a Buffer as rows.
template <class HalfRow>
[[nodiscard]] Span<HalfRow> as_half_rows(Span<std::uint32_t> words) {
    return {reinterpret_cast<HalfRow*>(words.data()), words.size() * sizeof(std::uint32_t) / sizeof(HalfRow)};
}

/// A row as it is computed with.
template <class T, std::size_t N>
[[nodiscard]] __device__ const Row<T, N>& wide(const Row<T, N>& row) {
    return row;
}
template <class Half>
[[nodiscard]] __device__ auto wide(const Half& row) {
    return row.wide();
}
/// A row as it is stored.
template <class Stored, class T, std::size_t N>
[[nodiscard]] __device__ Stored stored(const Row<T, N>& row) {
    if constexpr (requires { Stored::rounded(row); })
        return Stored::rounded(row);
    else
        return row;
}

} // namespace gsh::cuda::detail
