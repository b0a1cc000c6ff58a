// SPDX-License-Identifier: Apache-2.0
/// @file  The reference backend: one thread, in order.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/host_buffer.hpp>
#include <gsh/core/error.hpp>

#include <algorithm>
#include <string_view>
#include <type_traits>

namespace gsh::cpu::inline GSH_ISA {

namespace detail {
/// What all backends with host memory have in common.
class HostBackend {
public:
    template <class T>
    using Buffer = cpu::Buffer<T>;
    static constexpr bool host_memory = true;

    [[nodiscard]] Precision precision() const { return precision_; }
    /// Holds for later work. Forward and backward of one step must have the same.
    void set_precision(Precision precision) { precision_ = precision; }

    template <class T>
    void fill(Span<T> values, std::type_identity_t<T> value) {
        std::fill(values.begin(), values.end(), value);
    }
    template <class T>
    void copy(Span<const T> from, Span<std::type_identity_t<T>> to) {
        check_size("backend copy", "destination", to.size(), from.size());
        std::copy(from.begin(), from.end(), to.begin());
    }
    template <class T>
    void upload(Span<const T> from, Span<std::type_identity_t<T>> to) {
        copy(from, to);
    }
    template <class T>
    void download(Span<const T> from, Span<std::type_identity_t<T>> to) {
        copy(from, to);
    }
    void synchronize() {}

private:
    Precision precision_ = Precision::fp32;
};
} // namespace detail

/// Runs everything on the calling thread. Its results are the reference for every other backend.
class Serial : public detail::HostBackend {
public:
    [[nodiscard]] static constexpr std::string_view name() { return "serial"; }
    [[nodiscard]] static bool available() { return true; }
    [[nodiscard]] std::size_t thread_count() const { return 1; }

    template <class Body>
    void for_each(std::size_t n, const Body& body) {
        for (std::size_t i = 0; i < n; ++i) body(i);
    }

    template <class Body>
    void for_chunks(std::size_t n, std::size_t grain, const Body& body) {
        for (std::size_t chunk = 0, begin = 0; begin < n; ++chunk, begin += grain)
            body(chunk, begin, std::min(begin + grain, n));
    }
};
static_assert(CpuBackend<Serial>);

} // namespace gsh::cpu
