// SPDX-License-Identifier: Apache-2.0
/// @file  The allocations of a program of tests: counted, and failing where a test asks for it.
#include "failures/failing_allocations.hpp"

#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdlib>
#include <new>

namespace {

std::atomic<bool> counting{false}, failed{false};
std::atomic<std::size_t> count{0}, fail_at{0};
std::atomic<std::ptrdiff_t> live_blocks{0};

bool must_fail() {
    if (!counting.load(std::memory_order_relaxed)) return false;
    if (count.fetch_add(1, std::memory_order_relaxed) + 1 != fail_at.load(std::memory_order_relaxed)) return false;
    failed = true;
    return true;
}

} // namespace

void gsh::test::allocations::begin(std::size_t at) {
    count = 0, failed = false, fail_at = at;
    counting = true;
}
std::size_t gsh::test::allocations::end() {
    counting = false;
    return count;
}
bool gsh::test::allocations::one_failed() {
    return failed;
}
std::ptrdiff_t gsh::test::allocations::live() {
    return live_blocks;
}

#define GSH_OWN_MALLOC 1
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#undef GSH_OWN_MALLOC
#define GSH_OWN_MALLOC 0
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#undef GSH_OWN_MALLOC
#define GSH_OWN_MALLOC 0
#endif
#endif

#if GSH_OWN_MALLOC
// glibc's own functions, under the names by which a replacement reaches them.
extern "C" {
void* __libc_malloc(std::size_t bytes);
void* __libc_calloc(std::size_t count, std::size_t bytes);
void* __libc_realloc(void* memory, std::size_t bytes);
void* __libc_memalign(std::size_t alignment, std::size_t bytes);
}
#endif

namespace {
void* allocate(std::size_t bytes, std::size_t alignment) noexcept {
    if (must_fail()) return nullptr;
#if GSH_OWN_MALLOC
    void* const memory = __libc_memalign(alignment, bytes ? bytes : 1);
#else
    void* memory = nullptr;
    if (::posix_memalign(&memory, alignment, bytes ? bytes : 1) != 0) return nullptr;
#endif
    live_blocks += memory != nullptr;
    return memory;
}
void* allocate_or_throw(std::size_t bytes, std::size_t alignment) {
    if (void* const memory = allocate(bytes, alignment)) return memory;
    throw std::bad_alloc();
}
void release(void* memory) noexcept {
    if (memory) --live_blocks;
    std::free(memory);
}
constexpr std::size_t usual = alignof(std::max_align_t);
} // namespace

// Not inlined: GCC would warn that new and free do not match.
[[gnu::noinline]] void* operator new(std::size_t bytes) {
    return allocate_or_throw(bytes, usual);
}
[[gnu::noinline]] void* operator new[](std::size_t bytes) {
    return allocate_or_throw(bytes, usual);
}
[[gnu::noinline]] void* operator new(std::size_t bytes, std::align_val_t alignment) {
    return allocate_or_throw(bytes, static_cast<std::size_t>(alignment));
}
[[gnu::noinline]] void* operator new[](std::size_t bytes, std::align_val_t alignment) {
    return allocate_or_throw(bytes, static_cast<std::size_t>(alignment));
}
[[gnu::noinline]] void* operator new(std::size_t bytes, const std::nothrow_t&) noexcept {
    return allocate(bytes, usual);
}
[[gnu::noinline]] void* operator new[](std::size_t bytes, const std::nothrow_t&) noexcept {
    return allocate(bytes, usual);
}
[[gnu::noinline]] void operator delete(void* memory) noexcept {
    release(memory);
}
[[gnu::noinline]] void operator delete[](void* memory) noexcept {
    release(memory);
}
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept {
    release(memory);
}
[[gnu::noinline]] void operator delete[](void* memory, std::size_t) noexcept {
    release(memory);
}
[[gnu::noinline]] void operator delete(void* memory, const std::nothrow_t&) noexcept {
    release(memory);
}
[[gnu::noinline]] void operator delete[](void* memory, const std::nothrow_t&) noexcept {
    release(memory);
}
[[gnu::noinline]] void operator delete(void* memory, std::align_val_t) noexcept {
    release(memory);
}
[[gnu::noinline]] void operator delete[](void* memory, std::align_val_t) noexcept {
    release(memory);
}
[[gnu::noinline]] void operator delete(void* memory, std::size_t, std::align_val_t) noexcept {
    release(memory);
}
[[gnu::noinline]] void operator delete[](void* memory, std::size_t, std::align_val_t) noexcept {
    release(memory);
}

#if GSH_OWN_MALLOC
extern "C" {
void* malloc(std::size_t bytes) {
    return must_fail() ? (errno = ENOMEM, nullptr) : __libc_malloc(bytes);
}
void* calloc(std::size_t number, std::size_t bytes) {
    return must_fail() ? (errno = ENOMEM, nullptr) : __libc_calloc(number, bytes);
}
void* realloc(void* memory, std::size_t bytes) {
    return bytes > 0 && must_fail() ? (errno = ENOMEM, nullptr) : __libc_realloc(memory, bytes);
}
void* memalign(std::size_t alignment, std::size_t bytes) {
    return must_fail() ? (errno = ENOMEM, nullptr) : __libc_memalign(alignment, bytes);
}
void* aligned_alloc(std::size_t alignment, std::size_t bytes) {
    return memalign(alignment, bytes);
}
int posix_memalign(void** memory, std::size_t alignment, std::size_t bytes) {
    void* const found = memalign(alignment, bytes);
    if (found) *memory = found;
    return found ? 0 : ENOMEM;
}
}
#endif
