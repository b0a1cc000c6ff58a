// SPDX-License-Identifier: Apache-2.0
/// @file  A view of contiguous elements: a pointer and a count, passed to kernels by value.
#pragma once

#include <gsh/core/config.hpp>

#include <array> // std::data and std::size, as in <iterator>, which takes four times as long to compile
#include <concepts>
#include <cstddef>
#include <type_traits>

namespace gsh {

#if defined(GSH_CHECK_SPANS)
namespace detail {
/// What happens when an index is outside of a span: the definition is the program's, and does not return.
[[noreturn]] void index_outside_span(std::size_t index, std::size_t size);
} // namespace detail
#endif

/// View of `size` contiguous elements in host or device memory; `Span<const T>` is an input.
///
/// Trivially copyable, so it can be passed to a kernel by value. Unlike std::span, it needs no extra compiler flag in
/// device code. Any object with contiguous `data()` and `size()` converts to it implicitly: std::vector, std::span, a
/// backend's Buffer.
template <class T>
class Span {
public:
    using element_type = T;

    constexpr Span() = default;
    GSH_HD constexpr Span(T* data, std::size_t size) : data_(data), size_(size) {}

    template <class Range>
        requires(!std::same_as<std::remove_cvref_t<Range>, Span> &&
                 requires(Range& range) {
                     { std::data(range) } -> std::convertible_to<T*>;
                     { std::size(range) } -> std::convertible_to<std::size_t>;
                     requires std::is_same_v<std::remove_cv_t<std::remove_pointer_t<decltype(std::data(range))>>,
                                             std::remove_cv_t<T>>;
                 })
    constexpr Span(Range&& range) : data_(std::data(range)), size_(std::size(range)) {}

    /// A writable view converts to a read-only one.
    template <class U>
        requires(std::is_same_v<const U, T> && !std::is_const_v<U>)
    GSH_HD constexpr Span(Span<U> other) : data_(other.data()), size_(other.size()) {}

    [[nodiscard]] GSH_HD constexpr T* data() const { return data_; }
    [[nodiscard]] GSH_HD constexpr std::size_t size() const { return size_; }
    [[nodiscard]] GSH_HD constexpr bool empty() const { return size_ == 0; }
    /// Not checked, unless the program is compiled with GSH_CHECK_SPANS.
    [[nodiscard]] GSH_HD constexpr T& operator[](std::size_t i) const {
#if defined(GSH_CHECK_SPANS)
        if (i >= size_) detail::index_outside_span(i, size_);
#endif
        return data_[i];
    }
    [[nodiscard]] GSH_HD constexpr T* begin() const { return data_; }
    [[nodiscard]] GSH_HD constexpr T* end() const { return data_ + size_; }
    [[nodiscard]] GSH_HD constexpr Span subspan(std::size_t offset, std::size_t count) const {
        return {data_ + offset, count};
    }

private:
    T* data_ = nullptr;
    std::size_t size_ = 0;
};

} // namespace gsh
