// SPDX-License-Identifier: Apache-2.0
/// @file  Arrays on their way to and from any backend, distances between results, and the orders of the emulation.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>

#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <cstring>
#include <vector>

#if defined(GSH_CUDA_EMULATION)
#include "support/cuda_emulation/runtime.hpp"
#endif

namespace gsh::test {

/// A copy on the host of a buffer.
template <class B, class Buffer>
[[nodiscard]] auto fetched(B& backend, const Buffer& buffer) {
    using T = std::remove_cvref_t<decltype(*buffer.data())>;
    return downloaded(backend, Span<const T>(buffer));
}

/// The numbers that an array of vectors, matrices, … consists of, in double.
template <class T, class Element>
[[nodiscard]] std::vector<double> numbers(const std::vector<Element>& values) {
    const T* const first = reinterpret_cast<const T*>(values.data());
    return std::vector<double>(first, first + values.size() * sizeof(Element) / sizeof(T));
}

/// The sum of the products of two lists of numbers.
[[nodiscard]] inline double inner(const std::vector<double>& a, const std::vector<double>& b) {
    REQUIRE(a.size() == b.size());
    double sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
    return sum;
}

/// |a - b| / |b|, or |a - b| if b is zero.
template <class T = double, class U = double>
[[nodiscard]] double relative_distance(const std::vector<T>& a, const std::vector<U>& b) {
    REQUIRE(a.size() == b.size());
    double difference = 0, size = 0;
    for (std::size_t i = 0; i < a.size(); ++i) {
        const double x = static_cast<double>(a[i]), y = static_cast<double>(b[i]);
        difference += (x - y) * (x - y), size += y * y;
    }
    return std::sqrt(difference) / (size > 0 ? std::sqrt(size) : 1);
}

/// The largest relative_distance of arrays that follow each other in a and b: the distance of the whole would hide an
/// error in one that is small beside the others.
template <class T, class U>
[[nodiscard]] double largest_distance(const std::vector<T>& a, const std::vector<U>& b,
                                      const std::vector<std::size_t>& sizes) {
    REQUIRE(a.size() == b.size());
    double largest = 0;
    std::size_t first = 0;
    for (const std::size_t size : sizes) {
        REQUIRE(first + size <= a.size());
        const double distance = relative_distance(std::vector<T>(a.data() + first, a.data() + first + size),
                                                  std::vector<U>(b.data() + first, b.data() + first + size));
        largest = distance <= largest ? largest : distance; // a NaN stays
        first += size;
    }
    REQUIRE(first == a.size());
    return largest;
}

template <class T>
[[nodiscard]] bool same_bits(const std::vector<T>& a, const std::vector<T>& b) {
    return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

/// Calls check(result) with the result of run() in the usual order of blocks and threads, then in others and with
/// another content of new memory. On a GPU, whose order nobody chooses, it runs a few times.
template <class Run, class Check>
void in_every_order(const Run& run, const Check& check) {
    const auto expected = run();
#if defined(GSH_CUDA_EMULATION)
    CudaEmulation& emulation = CudaEmulation::instance();
    for (const Order order : {Order::forward, Order::reverse, Order::random}) {
        emulation.order = order, emulation.fill = order == Order::reverse ? 0xFF : 0x3C;
        check(run(), expected);
    }
    emulation.order = Order::forward, emulation.fill = 0xA5;
#else
    for (int k = 0; k < 3; ++k) check(run(), expected);
#endif
}

} // namespace gsh::test
