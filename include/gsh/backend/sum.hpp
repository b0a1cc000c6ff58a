// SPDX-License-Identifier: Apache-2.0
/// @file  The sum of an array, with one overload for each backend.
#pragma once

#include <gsh/backend/backend.hpp>

namespace gsh {

/// Fallback without the backend's overloads: fails to compile, and names the header to include.
template <Backend B, class... Arguments>
void add_sum(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>,
                  "add_sum: include its backend's overloads, <gsh/backend/cpu/sum.hpp> or <gsh/cpu.hpp>");
}

} // namespace gsh
