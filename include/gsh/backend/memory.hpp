// SPDX-License-Identifier: Apache-2.0
/// @file  A check that an argument lies in its backend's memory: host memory is refused, not read by a device.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>

#include <string>
#include <string_view>

namespace gsh {

/// Throws MemoryError unless the backend reaches the span: "where: argument lies in host memory; upload it …". Of an
/// argument with several arrays, `part` names the one. Costs nothing on a backend whose memory is the host's; empty
/// spans pass.
///
/// Views have overloads of the same form beside their definitions, so that a component writes one line per argument.
template <Backend B, class T>
void check_memory([[maybe_unused]] const B& backend, [[maybe_unused]] std::string_view where,
                  [[maybe_unused]] std::string_view argument, [[maybe_unused]] Span<T> memory,
                  [[maybe_unused]] std::string_view part = {}) {
    if constexpr (!B::host_memory) {
        if (memory.empty() || backend.owns(memory.data(), memory.size() * sizeof(T))) return;
        std::string message = std::string(where).append(": ").append(argument);
        if (!part.empty()) message.append(".").append(part);
        throw MemoryError(message.append(" is not memory of the backend '").append(B::name())
                              .append("'; upload it into a Buffer of the backend first"));
    }
}

} // namespace gsh
