// SPDX-License-Identifier: Apache-2.0
/// @file  Adam on the GPU: as many bytes per access as the addresses allow. Nothing changes on a halted device.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/pack.cuh>
#include <gsh/core/span.hpp>
#include <gsh/optim/adam.hpp>

#include <cstddef>
#include <cstdint>

namespace gsh::cuda {

namespace detail {

/// `Count` consecutive elements of one step. The kernels move at most 32 bytes per element and compute little, so they
/// are as fast as memory. The word that is set on a halted device is loaded together with the numbers (or the row), not
/// before them: one wait instead of two.
template <class T, unsigned Count>
struct AdamRun {
    Pack<T, Count> parameters, gradients, m, v;

    __device__ AdamRun(const gsh::detail::AdamStep<T>& step, std::size_t first)
        : parameters(load_pack<Count>(Span<const T>(step.parameters), first)),
          gradients(load_pack<Count>(Span<const T>(step.gradients), first)),
          m(load_pack<Count>(Span<const T>(step.m), first)), v(load_pack<Count>(Span<const T>(step.v), first)) {}

    __device__ void update(unsigned i, const gsh::detail::AdamCoefficients<T>& coefficients) {
        gsh::detail::adam_update(parameters[i], gradients[i], m[i], v[i], coefficients);
    }
    __device__ void store(const gsh::detail::AdamStep<T>& step, std::size_t first) const {
        store_pack(step.parameters, first, parameters);
        store_pack(step.m, first, m);
        store_pack(step.v, first, v);
        if (step.zero_gradients) store_pack(step.gradients, first, Pack<T, Count>{});
    }
};

/// Whether all arrays of a step can be accessed in packs.
template <unsigned Count, class T>
[[nodiscard]] bool are_aligned(const gsh::detail::AdamStep<T>& step) {
    return is_aligned<Count>(step.parameters) && is_aligned<Count>(step.gradients) && is_aligned<Count>(step.m) &&
           is_aligned<Count>(step.v);
}

/// A table whose first columns have one step size and the others another. Without a width, all have the first.
/// A thread has `Count` elements; at the end of the table, they are updated one by one.
template <class T, unsigned Count>
struct AdamColumns {
    static constexpr unsigned block_size = 256;
    gsh::detail::AdamStep<T> step;
    Span<const std::uint32_t> halted;
    std::size_t count, width, first_columns;
    T other_step_size;

    __device__ void operator()() const {
        const std::size_t first = (std::size_t(blockIdx.x) * block_size + threadIdx.x) * Count;
        if (first + Count <= count) {
            run<Count>(first);
        } else if (Count > 1) {
            for (std::size_t i = first; i < count; ++i) run<1>(i);
        }
    }

private:
    template <unsigned Run>
    __device__ void run(std::size_t first) const {
        AdamRun<T, Run> elements(step, first);
        if (halted[0] != 0) return;
        gsh::detail::AdamCoefficients<T> coefficients = step.coefficients;
        std::size_t column = width == 0 ? 0 : first % width;
        for (unsigned i = 0; i < Run; ++i) {
            if (width != 0) {
                coefficients.step_size = column < first_columns ? step.coefficients.step_size : other_step_size;
                if (++column == width) column = 0;
            }
            elements.update(i, coefficients);
        }
        elements.store(step, first);
    }
};

/// Some rows of a table. A thread has `Count` elements of one row; `parts` of them are a row.
template <class T, unsigned Count>
struct AdamRows {
    static constexpr unsigned block_size = 256;
    gsh::detail::AdamStep<T> step;
    Span<const std::uint32_t> halted, rows;
    std::size_t parts;

    __device__ void operator()() const {
        const std::size_t i = std::size_t(blockIdx.x) * block_size + threadIdx.x;
        if (i >= rows.size() * parts) return;
        const std::size_t slot = parts == 1 ? i : i / parts;
        const std::size_t first = (rows[slot] * parts + (i - slot * parts)) * Count;
        AdamRun<T, Count> elements(step, first);
        if (halted[0] != 0) return;
        for (unsigned k = 0; k < Count; ++k) elements.update(k, step.coefficients);
        elements.store(step, first);
    }
};

template <class T>
void adam_columns(Device& device, const gsh::detail::AdamStep<T>& step, std::size_t count, std::size_t width,
                  std::size_t first_columns, T other_step_size) {
    const auto launch = [&]<unsigned Count>() {
        const std::size_t in_block = Count * AdamColumns<T, Count>::block_size;
        device.launch((count + in_block - 1) / in_block,
                      AdamColumns<T, Count>{step, device.halted(), count, width, first_columns, other_step_size});
    };
    are_aligned<widest_pack<T>>(step) ? launch.template operator()<widest_pack<T>>() : launch.template operator()<1>();
}

} // namespace detail

template <class T>
void adam_step(Device& device, const gsh::detail::AdamStep<T>& step, std::size_t count) {
    detail::adam_columns(device, step, count, 0, 0, step.coefficients.step_size);
}

/// Ascending rows are the fastest: neighbouring threads then share the sectors that they load.
template <class T>
void adam_step_rows(Device& device, const gsh::detail::AdamStep<T>& step, Span<const std::uint32_t> rows,
                    std::size_t width) {
    const auto launch = [&]<unsigned Count>() {
        if (width % Count != 0 || !detail::are_aligned<Count>(step)) return false;
        using Kernel = detail::AdamRows<T, Count>;
        const std::size_t threads = rows.size() * (width / Count);
        device.launch((threads + Kernel::block_size - 1) / Kernel::block_size,
                      Kernel{step, device.halted(), rows, width / Count});
        return true;
    };
    if (launch.template operator()<widest_pack<T>>()) return;
    if (launch.template operator()<2>()) return;
    launch.template operator()<1>();
}

/// The two steps differ in their step size alone.
template <class T>
void adam_step_columns(Device& device, const gsh::detail::AdamStep<T>& first_step,
                       const gsh::detail::AdamStep<T>& other_step, std::size_t rows, std::size_t width,
                       std::size_t first) {
    detail::adam_columns(device, first_step, rows * width, width, first, other_step.coefficients.step_size);
}

} // namespace gsh::cuda
