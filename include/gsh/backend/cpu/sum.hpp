// SPDX-License-Identifier: Apache-2.0
/// @file  The sum of an array on the CPU, bit-identical at any thread count.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>

#include <cstddef>

namespace gsh::cpu::inline GSH_ISA {

/// result[0] += sum of values. Chunks of fixed length are summed separately, and their sums added in order.
///
/// Shapes  values [N]; result [1]; partials is scratch that the caller keeps, so that a repeated sum allocates nothing.
template <CpuBackend B, class T>
void add_sum(B& backend, Span<const T> values, Span<T> result, typename B::template Buffer<T>& partials) {
    check_size("add_sum", "result", result.size(), 1);
    constexpr std::size_t grain = 4096; // long compared with the cost of a task, short enough to balance the threads
    const std::size_t chunks = chunk_count(values.size(), grain);
    partials.resize(chunks);
    backend.for_chunks(values.size(), grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        T sum = values[begin];
        for (std::size_t i = begin + 1; i < end; ++i) sum += values[i];
        partials[chunk] = sum;
    });
    for (std::size_t chunk = 0; chunk < chunks; ++chunk) result[0] += partials[chunk];
}

} // namespace gsh::cpu
