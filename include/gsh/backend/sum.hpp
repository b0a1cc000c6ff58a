// SPDX-License-Identifier: Apache-2.0
/// @file  The sum of an array: each backend has an overload of its own.
#pragma once

#include <gsh/backend/backend.hpp>

namespace gsh {

/// Where a backend's overloads are not included.
template <Backend B, class... Arguments>
void add_sum(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>,
                  "add_sum: include its backend's overloads, <gsh/backend/cpu/sum.hpp> or <gsh/cpu.hpp>");
}

} // namespace gsh
