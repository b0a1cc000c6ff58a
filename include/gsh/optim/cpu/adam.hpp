// SPDX-License-Identifier: Apache-2.0
/// @file  Adam on the CPU, in runs of contiguous elements that the compiler vectorises.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/wide.hpp>
#include <gsh/optim/adam.hpp>

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

/// The rows follow each other without a gap, so that registers cross from one row to the next.
template <CpuBackend B, class T>
void adam_step_columns(B& backend, const gsh::detail::AdamStep<T>& first_step,
                       const gsh::detail::AdamStep<T>& other_step, std::size_t rows, std::size_t width,
                       std::size_t first) {
    using W = Wide<T>;
    const W columns(static_cast<T>(width)), first_columns(static_cast<T>(first));
    const W advance(static_cast<T>(W::width % width));
    const W first_size(first_step.coefficients.step_size), other_size(other_step.coefficients.step_size);
    backend.for_chunks(rows, 1024, [&](std::size_t, std::size_t begin, std::size_t end) {
        const gsh::detail::AdamStep<T> step = first_step;
        W column = W::generate([&](std::size_t lane) { return static_cast<T>(lane % width); });
        std::size_t i = begin * width;
        for (; i + W::width <= end * width; i += W::width) {
            W parameter = W::load(&step.parameters[i]), m = W::load(&step.m[i]), v = W::load(&step.v[i]);
            const W gradient = W::load(&step.gradients[i]);
            gsh::detail::adam_update(parameter, gradient, m, v, step.coefficients,
                                     select(column < first_columns, first_size, other_size));
            parameter.store(&step.parameters[i]), m.store(&step.m[i]), v.store(&step.v[i]);
            if (step.zero_gradients) W(T(0)).store(&step.gradients[i]);
            column += advance;
            column = select(column < columns, column, column - columns);
        }
        for (; i < end * width; ++i) (i % width < first ? first_step : other_step)(i);
    });
}

} // namespace gsh::cpu
