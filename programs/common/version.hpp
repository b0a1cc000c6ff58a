// SPDX-License-Identifier: Apache-2.0
/// @file  What --version prints.
#pragma once

#include <string>

namespace gsh::programs {

/// "gsh-render 0.1.0 (instructions: avx2; backends: threads, cuda)".
[[nodiscard]] std::string version_line(const std::string& program);

} // namespace gsh::programs
