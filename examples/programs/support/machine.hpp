// SPDX-License-Identifier: Apache-2.0
/// @file  What a program takes of its machine, for reports.
#pragma once

#include <cstdint>
#include <string>

namespace gsh::examples {

/// Bytes of this process that are in memory now.
std::uint64_t resident_bytes();

/// The most that there have been.
std::uint64_t peak_memory_bytes();

/// What the machine calls its processor.
std::string processor_name();

} // namespace gsh::examples
