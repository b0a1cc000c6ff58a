// SPDX-License-Identifier: Apache-2.0
/// @file  Adam on the CPU, in runs of contiguous elements that the compiler vectorises.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>

#include <cstddef>
#include <cstdint>

namespace gsh::cpu::inline GSH_ISA {

namespace detail {

/// step(i) for i in [begin, end). The step is passed by value: behind a reference, the compiler would have to assume
/// that every store may change its coefficients.
template <class Step>
void adam_run(Step step, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) step(i);
}

} // namespace detail

template <CpuBackend B, class Step>
void adam_step(B& backend, const Step& step, std::size_t count) {
    backend.for_chunks(count, 16384, [&](std::size_t, std::size_t begin, std::size_t end) {
        detail::adam_run(step, begin, end);
    });
}

template <CpuBackend B, class Step>
void adam_step_rows(B& backend, const Step& step, Span<const std::uint32_t> rows, std::size_t width) {
    backend.for_chunks(rows.size(), 4096, [&](std::size_t, std::size_t begin, std::size_t end) {
        while (begin < end) {
            const std::size_t first = rows[begin];
            std::size_t count = 1;
            while (begin + count < end && rows[begin + count] == first + count) ++count;
            detail::adam_run(step, first * width, (first + count) * width);
            begin += count;
        }
    });
}

template <CpuBackend B, class Step>
void adam_step_columns(B& backend, const Step& first_step, const Step& other_step, std::size_t rows, std::size_t width,
                       std::size_t first) {
    backend.for_chunks(rows, 1024, [&](std::size_t, std::size_t begin, std::size_t end) {
        for (std::size_t row = begin; row < end; ++row) {
            detail::adam_run(first_step, row * width, row * width + first);
            detail::adam_run(other_step, row * width + first, (row + 1) * width);
        }
    });
}

} // namespace gsh::cpu
