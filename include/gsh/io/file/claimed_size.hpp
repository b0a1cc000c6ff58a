// SPDX-License-Identifier: Apache-2.0
/// @file  How much memory a file may ask for: the bound on counts that its bytes do not back one by one.
#pragma once

#include <gsh/core/error.hpp>

#include <cstddef>
#include <cstdint>
#include <string>

namespace gsh::detail {

/// A compressed stream, a sparse array or an array of zeros takes fewer bytes in a file than in memory. Up to 64 MiB,
/// any file may ask for it. Above, the file must hold a 200th of what it asks for: arrays of real models inflate at
/// most 150 times.
inline constexpr std::uint64_t unquestioned_memory = std::uint64_t(64) << 20, most_inflation = 200;

/// Whether a file, or a part of one, of `file_bytes` may take `memory_bytes`.
[[nodiscard]] constexpr bool may_take(std::uint64_t memory_bytes, std::uint64_t file_bytes) {
    return memory_bytes <= unquestioned_memory || memory_bytes / most_inflation <= file_bytes;
}

/// Throws IoError, beginning with `what`, unless `file_bytes` may take `memory_bytes`. Call it before memory is
/// allocated.
inline void check_claim(const std::string& what, std::uint64_t memory_bytes, std::uint64_t file_bytes) {
    if (may_take(memory_bytes, file_bytes)) return;
    throw IoError(what + " inflates from " + std::to_string(file_bytes) + " to " + std::to_string(memory_bytes) +
                  " bytes, more than " + std::to_string(most_inflation) +
                  " times; it is damaged or made to exhaust memory");
}

/// The same for the poses of a rig: joints that do not move take no bytes in a file, nor do frames between key frames,
/// and each takes 96 in memory. A quarter of an hour of a usual rig is never questioned.
inline void check_claimed_poses(const std::string& what, std::size_t joints, std::size_t frames,
                                std::uint64_t file_bytes) {
    if (may_take(48 * std::uint64_t(joints) * frames, file_bytes)) return;
    throw IoError(what + " holds " + std::to_string(frames) + " frames of " + std::to_string(joints) + " joints in " +
                  std::to_string(file_bytes) + " bytes; it is damaged or made to exhaust memory");
}

} // namespace gsh::detail
