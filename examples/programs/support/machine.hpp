// SPDX-License-Identifier: Apache-2.0
/// @file  Memory of the process and the name of the processor, for reports.
#pragma once

#include <cstdint>
#include <string>

namespace gsh::examples {

/// Resident memory of this process, in bytes.
std::uint64_t resident_bytes();

/// Peak resident memory of this process, in bytes.
std::uint64_t peak_memory_bytes();

/// The name of the processor.
std::string processor_name();

} // namespace gsh::examples
