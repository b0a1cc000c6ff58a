// SPDX-License-Identifier: Apache-2.0
/// @file  The exit codes of all programs.
#pragma once

namespace gsh::programs {

/// Bad input and a full disk share a code, because the user can fix both.
enum Exit { exit_done = 0, exit_bad_input = 2, exit_interrupted = 130 };

} // namespace gsh::programs
