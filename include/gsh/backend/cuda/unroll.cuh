// SPDX-License-Identifier: Apache-2.0
/// @file  Loops without a loop, for arrays that must stay in registers.
#pragma once

#include <cuda_runtime.h>

#include <utility>

namespace gsh::cuda {

namespace detail {
template <class Body, int... I>
__device__ void call_in_order(const Body& body, std::integer_sequence<int, I...>) {
    (body.template operator()<I>(), ...);
}
} // namespace detail

/// Calls body.operator()<0>() to body.operator()<Count - 1>(), in order. An array that is indexed by constants alone
/// stays in registers, and a branch on a constant disappears; a compiler may decide otherwise about a loop.
template <int Count, class Body>
__device__ void unrolled(const Body& body) {
    detail::call_in_order(body, std::make_integer_sequence<int, Count>());
}

} // namespace gsh::cuda
