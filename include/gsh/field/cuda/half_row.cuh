// SPDX-License-Identifier: Apache-2.0
/// @file  Rows of numbers of 16 bits, two to a word, which a thread reads or writes with one instruction.
#pragma once

#include <gsh/backend/cuda/half.cuh>
#include <gsh/core/span.hpp>
#include <gsh/field/cuda/row.cuh>

#include <cstddef>
#include <cstdint>

namespace gsh::cuda::detail {

/// The two 16-bit formats: how two numbers become a word, and the first and second of a word.
struct Bf16 {
    [[nodiscard]] __device__ static std::uint32_t pack(float first, float second) { return pack_bf16(first, second); }
    [[nodiscard]] __device__ static float first(std::uint32_t word) { return low_bf16(word); }
    [[nodiscard]] __device__ static float second(std::uint32_t word) { return high_bf16(word); }
};
struct Fp16 {
    [[nodiscard]] __device__ static std::uint32_t pack(float first, float second) { return pack_fp16(first, second); }
    [[nodiscard]] __device__ static float first(std::uint32_t word) { return low_fp16(word); }
    [[nodiscard]] __device__ static float second(std::uint32_t word) { return high_fp16(word); }
};

/// N numbers of a 16-bit format.
template <class Format, std::size_t N>
    requires(N % 2 == 0)
struct alignas(row_alignment<std::uint16_t, N>()) HalfRow {
    std::uint32_t words[N / 2];

    [[nodiscard]] __device__ static HalfRow rounded(const Row<float, N>& row) {
        HalfRow result;
        for (std::size_t i = 0; i < N; i += 2) result.words[i / 2] = Format::pack(row[i], row[i + 1]);
        return result;
    }
    [[nodiscard]] __device__ Row<float, N> wide() const {
        Row<float, N> result;
        for (std::size_t i = 0; i < N; i += 2)
            result[i] = Format::first(words[i / 2]), result[i + 1] = Format::second(words[i / 2]);
        return result;
    }
};
template <std::size_t N>
using Bf16Row = HalfRow<Bf16, N>;
template <std::size_t N>
using Fp16Row = HalfRow<Fp16, N>;

/// The words of a Buffer as rows.
template <class R>
[[nodiscard]] Span<R> as_half_rows(Span<std::uint32_t> words) {
    return {reinterpret_cast<R*>(words.data()), words.size() * sizeof(std::uint32_t) / sizeof(R)};
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
