// SPDX-License-Identifier: Apache-2.0
/// @file  Neighbouring numbers that a thread reads or writes with one instruction.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>

#include <cstddef>
#include <cstdint>
#include <string_view>
#include <type_traits>

namespace gsh::cuda::detail {

/// The largest power of two that divides the size of a row, up to the 16 bytes of one instruction.
template <class T, std::size_t N>
constexpr std::size_t row_alignment() {
    const std::size_t bytes = N * sizeof(T), factor = bytes & (~bytes + 1);
    return factor < 16 ? factor : 16;
}

template <class T, std::size_t N>
struct alignas(row_alignment<T, N>()) Row {
    T values[N];
    [[nodiscard]] GSH_HD T& operator[](std::size_t i) { return values[i]; }
    [[nodiscard]] GSH_HD const T& operator[](std::size_t i) const { return values[i]; }
};

template <std::size_t N, class T>
using RowOf = std::conditional_t<std::is_const_v<T>, const Row<std::remove_const_t<T>, N>, Row<T, N>>;

/// Whether `values` can be read as rows of N. Buffers and their subspans from a multiple of N on can.
template <std::size_t N, class T>
[[nodiscard]] bool has_rows(Span<T> values) {
    return values.size() % N == 0 && reinterpret_cast<std::uintptr_t>(values.data()) % alignof(RowOf<N, T>) == 0;
}

/// `values` as rows of N.
/// Errors  ValueError for memory that begins within a row.
template <std::size_t N, class T>
[[nodiscard]] Span<RowOf<N, T>> as_rows(std::string_view where, Span<T> values) {
    check_value(has_rows<N>(values), where,
                "an array begins at an address that is not a multiple of a row's size; Buffers begin at one");
    return {reinterpret_cast<RowOf<N, T>*>(values.data()), values.size() / N};
}

} // namespace gsh::cuda::detail
