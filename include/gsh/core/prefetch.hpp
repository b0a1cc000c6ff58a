// SPDX-License-Identifier: Apache-2.0
/// @file  A hint that loads memory into the cache before it is needed.
#pragma once

namespace gsh {

/// Loads the cache line at `address` into the cache. Any address is allowed, and there is no other effect.
///
/// The empty asm statement emits no instruction. Without it GCC 12 treats a function that contains a prefetch as one
/// without other effects, and removes calls to it although the function also writes memory (seen at -O1, where the
/// function is not inlined).
[[gnu::always_inline]] inline void prefetch(const void* address) {
    __builtin_prefetch(address);
    asm volatile("");
}

/// The same for a line that is about to be written.
[[gnu::always_inline]] inline void prefetch_for_write(const void* address) {
    __builtin_prefetch(address, 1);
    asm volatile("");
}

} // namespace gsh
