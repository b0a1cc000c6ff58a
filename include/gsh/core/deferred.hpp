// SPDX-License-Identifier: Apache-2.0
/// @file  A value for work on a backend: known to the host, or computed in the backend's memory.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/span.hpp>

#include <concepts>

namespace gsh {

/// An input of a component that may be the result of other work on the backend, so that the host does not wait for it:
/// a refined camera, for instance, and its centre. A plain value converts to it.
template <class T>
struct Deferred {
    T known{};                    ///< the value unless it is computed
    Span<const T> computed = {};  ///< [1] in the backend's memory, or empty; replaces `known`

    Deferred() = default;
    Deferred(const T& value) : known(value) {}
    /// From the arguments of T's constructor, so that a caller may write {x, y, z} for a vector.
    template <class A, class B, class... More>
        requires std::constructible_from<T, A, B, More...>
    Deferred(const A& a, const B& b, const More&... more) : known(a, b, more...) {}
    Deferred(const T& fallback, Span<const T> value) : known(fallback), computed(value) {}

    /// The value, for code that runs on the backend.
    [[nodiscard]] GSH_HD const T& operator()() const { return computed.empty() ? known : computed[0]; }
};

} // namespace gsh
