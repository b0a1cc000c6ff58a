// SPDX-License-Identifier: Apache-2.0
/// @file  Memory that a program sets aside, so that what runs after a failed allocation finds some.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdlib>
#include <new>

namespace gsh::programs {

inline std::atomic<void*> memory_reserve{nullptr}; ///< what is set aside

/// The new-handler: the first failed allocation gives the reserve back and is tried again, the next one throws.
inline void give_reserve_back() {
    void* const reserve = memory_reserve.exchange(nullptr);
    if (!reserve) throw std::bad_alloc();
    std::free(reserve);
}

/// Sets memory aside until an allocation fails. Some destructors allocate, such as those of nlohmann-json: without
/// memory, they end the program in place of an error.
inline void set_memory_aside() {
    constexpr std::size_t bytes = std::size_t(256) << 10;
    if (memory_reserve.load()) return;
    void* const reserve = std::malloc(bytes);
    void* none = nullptr;
    if (reserve && !memory_reserve.compare_exchange_strong(none, reserve)) std::free(reserve);
    std::set_new_handler(give_reserve_back);
}

} // namespace gsh::programs
