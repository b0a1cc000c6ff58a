// SPDX-License-Identifier: Apache-2.0
/// @file  Storage of the CPU backends: aligned and uninitialised.
#pragma once

#include <gsh/core/span.hpp>

#include <algorithm>
#include <cstddef>
#include <memory>
#include <new>
#include <type_traits>

#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace gsh::cpu::inline GSH_ISA {

namespace detail {

/// Asks the system to back memory by pages of 2 MiB instead of 4 KiB, so that random accesses to a large array find the
/// page's address in the processor's own table of them. Where the system does not do so, nothing else changes.
inline void use_large_pages([[maybe_unused]] void* memory, [[maybe_unused]] std::size_t bytes) {
#if defined(MADV_HUGEPAGE)
    static_cast<void>(::madvise(memory, bytes, MADV_HUGEPAGE)); // advice: an error is no error
#endif
}

} // namespace detail

/// Owning array of trivially copyable T, aligned to a cache line. resize leaves the contents unspecified. Shrinking
/// keeps the memory, so a step that repeats its sizes allocates nothing. An array that grows a second time takes a
/// quarter more than before, so that sizes which vary from step to step soon fit.
template <class T>
    requires std::is_trivially_copyable_v<T>
class Buffer {
public:
    static constexpr std::size_t alignment = 64; // bytes: a cache line, and the widest register
    static constexpr std::size_t large_page = std::size_t(2) << 20;

    Buffer() = default;
    explicit Buffer(std::size_t size) { resize(size); }
    Buffer(const Buffer& other) : Buffer(other.size_) { std::copy(other.begin(), other.end(), data()); }
    Buffer(Buffer&& other) noexcept { swap(other); }
    Buffer& operator=(Buffer other) noexcept {
        swap(other);
        return *this;
    }

    void resize(std::size_t size) {
        if (size > capacity_) {
            storage_.reset(); // free first: the old and the new array never exist at the same time
            const std::size_t room = std::max(size, capacity_ + capacity_ / 4);
            capacity_ = 0, size_ = 0;
            const std::size_t bytes = room * sizeof(T), align = bytes < large_page ? alignment : large_page;
            storage_ = {static_cast<T*>(::operator new(bytes, std::align_val_t(align))), Free{align}};
            if (align == large_page) detail::use_large_pages(data(), bytes);
            capacity_ = room;
        }
        size_ = size;
    }

    [[nodiscard]] T* data() { return storage_.get(); }
    [[nodiscard]] const T* data() const { return storage_.get(); }
    [[nodiscard]] std::size_t size() const { return size_; }
    [[nodiscard]] bool empty() const { return size_ == 0; }
    [[nodiscard]] T* begin() { return data(); }
    [[nodiscard]] T* end() { return data() + size_; }
    [[nodiscard]] const T* begin() const { return data(); }
    [[nodiscard]] const T* end() const { return data() + size_; }
    [[nodiscard]] T& operator[](std::size_t i) { return storage_.get()[i]; }
    [[nodiscard]] const T& operator[](std::size_t i) const { return storage_.get()[i]; }

    void swap(Buffer& other) noexcept {
        std::swap(storage_, other.storage_);
        std::swap(size_, other.size_);
        std::swap(capacity_, other.capacity_);
    }

private:
    struct Free {
        std::size_t align = alignment;
        void operator()(T* memory) const { ::operator delete(memory, std::align_val_t(align)); }
    };
    std::unique_ptr<T[], Free> storage_;
    std::size_t size_ = 0;
    std::size_t capacity_ = 0;
};

} // namespace gsh::cpu
