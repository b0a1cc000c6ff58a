// SPDX-License-Identifier: Apache-2.0
/// @file  The body of a user who names none: a file in the user's cache, which gsh-body makes.
#pragma once

#include <filesystem>

namespace gsh::programs {

/// $XDG_CACHE_HOME/gsh/body.npz, or ~/.cache/gsh/body.npz; empty if neither XDG_CACHE_HOME nor HOME is set.
[[nodiscard]] std::filesystem::path default_body();

/// The body that was given, else the default one; it has been read once.
///
/// Errors  ValueError with the commands that make the default body, if it does not exist; those of load_body_model.
[[nodiscard]] std::filesystem::path body_or_default(const std::filesystem::path& given);

} // namespace gsh::programs
