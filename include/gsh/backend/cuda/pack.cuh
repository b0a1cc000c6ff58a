// SPDX-License-Identifier: Apache-2.0
/// @file  Consecutive numbers that a thread loads or stores with one instruction.
#pragma once

#include <gsh/core/span.hpp>

#include <cstddef>
#include <cstdint>

namespace gsh::cuda {

/// `Count` numbers with the alignment of one access, at most 16 bytes.
template <class T, unsigned Count>
struct alignas(Count * sizeof(T)) Pack {
    static_assert(Count * sizeof(T) <= 16 && (Count & (Count - 1)) == 0);
    T values[Count];
    [[nodiscard]] __device__ T& operator[](unsigned i) { return values[i]; }
    [[nodiscard]] __device__ const T& operator[](unsigned i) const { return values[i]; }
};

/// The largest pack of T.
template <class T>
inline constexpr unsigned widest_pack = 16 / sizeof(T);

/// Whether packs may be loaded from an array at multiples of `Count`.
template <unsigned Count, class T>
[[nodiscard]] bool is_aligned(Span<T> values) {
    return reinterpret_cast<std::uintptr_t>(values.data()) % (Count * sizeof(T)) == 0;
}

/// values[first, first + Count), whose address must be aligned.
template <unsigned Count, class T>
[[nodiscard]] __device__ Pack<T, Count> load_pack(Span<const T> values, std::size_t first) {
    (void)values[first + Count - 1]; // checked in the emulation
    return *reinterpret_cast<const Pack<T, Count>*>(&values[first]);
}
template <unsigned Count, class T>
__device__ void store_pack(Span<T> values, std::size_t first, const Pack<T, Count>& pack) {
    (void)values[first + Count - 1];
    *reinterpret_cast<Pack<T, Count>*>(&values[first]) = pack;
}

} // namespace gsh::cuda
