// SPDX-License-Identifier: Apache-2.0
/// @file  A check that an argument lies in the memory of its backend.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>

#include <string>
#include <string_view>

namespace gsh {

/// Throws MemoryError unless the backend can access the span: "where: argument is not memory of the backend …; upload
/// it …". `part` names one of the arrays of an argument that has several. The check costs nothing on a backend with
/// host memory. Empty spans pass.
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
