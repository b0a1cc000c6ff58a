// SPDX-License-Identifier: Apache-2.0
/// @file  Asking for memory before it is needed.
#pragma once

namespace gsh {

/// Brings the cache line at `address` nearer; any address is allowed, nothing else happens.
///
/// The empty statement behind it has no instruction, but GCC 12 takes a function that prefetches for one that does
/// nothing else, and drops calls to it together with what they wrote (seen at -O1, where it calls the function).
[[gnu::always_inline]] inline void prefetch(const void* address) {
    __builtin_prefetch(address);
    asm volatile("");
}

} // namespace gsh
