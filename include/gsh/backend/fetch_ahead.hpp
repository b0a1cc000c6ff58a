// SPDX-License-Identifier: Apache-2.0
/// @file  Arrays in host memory that come into a backend's memory one by one, ahead of the work that reads them.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

namespace detail {

inline void check_fetched(std::size_t array, std::size_t count) {
    check_value(array < count, "FetchAhead",
                "there is no array " + std::to_string(array) + ", expected one of " + std::to_string(count));
}

} // namespace detail

/// Host arrays of bytes that are read one after the other, in an order that is known a little ahead. get returns one in
/// the backend's memory. fetch announces the next one. A device specialises this class: its copies then run beside the
/// work in between. This version copies in get.
///
/// Shapes  any number of arrays of any length; empty ones stay empty.
/// Errors  ValueError for an array that does not exist.
template <Backend B>
class FetchAhead {
public:
    using Bytes = Span<const std::uint8_t>;

    /// The arrays must outlive this object.
    FetchAhead(B& backend, std::vector<Bytes> arrays) : backend_(&backend), arrays_(std::move(arrays)) {}

    /// The array, for work that is queued before the next call of get. Not inside a repeated step (RepeatedStep).
    [[nodiscard]] Bytes get(std::size_t array) {
        detail::check_fetched(array, arrays_.size());
        copy_.resize(arrays_[array].size());
        backend_->upload(arrays_[array], Span<std::uint8_t>(copy_));
        return copy_;
    }
    /// Announces the array that the next call of get returns. The work on the present one has been queued.
    void fetch(std::size_t array) { detail::check_fetched(array, arrays_.size()); }

private:
    B* backend_;
    std::vector<Bytes> arrays_;
    typename B::template Buffer<std::uint8_t> copy_;
};

} // namespace gsh
