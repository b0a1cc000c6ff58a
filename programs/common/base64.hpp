// SPDX-License-Identifier: Apache-2.0
/// @file  Base 64, in which pages hold pictures and data.
#pragma once

#include <string>
#include <string_view>

namespace gsh::programs {

/// Bytes in base 64.
[[nodiscard]] std::string base64(std::string_view bytes);

} // namespace gsh::programs
