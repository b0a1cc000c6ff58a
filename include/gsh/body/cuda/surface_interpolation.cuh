// SPDX-License-Identifier: Apache-2.0
/// @file  The adjoint of interpolation on a surface on the GPU: eight lanes share the samples of a vertex.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/backend/cuda/lane_sums.cuh>
#include <gsh/body/surface_interpolation.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>
#include <cstdint>

namespace gsh::cuda {

namespace detail {

/// A body has about ten thousand vertices with some twenty to fifty samples each: one thread per vertex would leave
/// most of a large GPU idle and wait for its samples one after the other.
template <class T, class Vector>
struct ScatterSurface {
    static constexpr unsigned block_size = 128, lanes = 8, numbers = sizeof(Vector) / sizeof(T);
    gsh::detail::SurfaceScatter<T, Vector> element;

    __device__ void operator()() const {
        const std::size_t v = (std::size_t(blockIdx.x) * block_size + threadIdx.x) / lanes;
        Vector sum(T(0));
        if (v < element.dL_dvalues.size()) {
            const std::uint32_t end = element.starts[v + 1];
            for (std::uint32_t e = element.starts[v] + threadIdx.x % lanes; e < end; e += lanes) {
                const auto entry = element.entries[e];
                sum += element.dL_dpoints[entry.index] * entry.weight;
            }
        }
        T values[numbers];
        for (unsigned n = 0; n < numbers; ++n) values[n] = reinterpret_cast<const T*>(&sum)[n];
        sum_lanes<int(lanes)>(values, [&](unsigned n, T total) {
            if (v < element.dL_dvalues.size()) view_as<T>(element.dL_dvalues)[v * numbers + n] += total;
        });
    }
};

} // namespace detail

template <class T, class Vector>
void surface_scatter(Device& device, const gsh::detail::SurfaceScatter<T, Vector>& element) {
    using Kernel = detail::ScatterSurface<T, Vector>;
    device.launch(chunk_count(element.dL_dvalues.size() * Kernel::lanes, Kernel::block_size), Kernel{element});
}

} // namespace gsh::cuda
