// SPDX-License-Identifier: Apache-2.0
/// @file  Memory that can be accessed only while a guard is open. Any other access is a crash with a stack trace.
#pragma once

#include <cxxabi.h>
#include <execinfo.h>
#include <signal.h>
#include <sys/mman.h>
#include <unistd.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <map>
#include <memory>
#include <new>
#include <string>
#include <type_traits>
#include <typeinfo>
#include <utility>
#include <vector>

namespace gsh::test {

/// One reserved range of addresses, in whole pages. Its pages have access rights only between open and close.
class GuardedMemory {
public:
    static GuardedMemory& instance() {
        static GuardedMemory* const memory = new GuardedMemory; // never destroyed: buffers may outlive any other static
        return *memory;
    }
    GuardedMemory(const GuardedMemory&) = delete;

    [[nodiscard]] void* allocate(std::size_t bytes) {
        const std::size_t size = (bytes + page_ - 1) / page_ * page_;
        char* memory = nullptr;
        if (auto& free = free_[size]; !free.empty()) {
            memory = free.back();
            free.pop_back();
        } else {
            if (size > reserved - used_) throw std::bad_alloc();
            memory = begin_ + used_;
            used_ += size;
        }
        if (depth_) protect(memory, size, PROT_READ | PROT_WRITE);
        return memory;
    }
    void release(void* memory, std::size_t bytes) noexcept {
        const std::size_t size = (bytes + page_ - 1) / page_ * page_;
        madvise(memory, size, MADV_DONTNEED); // the pages are zero afterwards; tests must not rely on that
        free_[size].push_back(static_cast<char*>(memory));
    }

    [[nodiscard]] bool owns(const void* memory, std::size_t bytes) const {
        const auto from = reinterpret_cast<std::uintptr_t>(memory), begin = reinterpret_cast<std::uintptr_t>(begin_);
        return from >= begin && bytes <= used_ && from - begin <= used_ - bytes;
    }

    void open() {
        if (depth_++ == 0) protect(begin_, used_, PROT_READ | PROT_WRITE);
    }
    void close() {
        if (--depth_ == 0) protect(begin_, used_, PROT_NONE);
    }
    [[nodiscard]] bool is_open() const { return depth_ != 0; }

    /// Whether there is memory of the process at an address, other than this range's. Heap, stacks and libraries lie
    /// above 0x5000…; below is what sanitizers map for themselves, where pairs of small numbers would seem to point.
    [[nodiscard]] bool is_host_address(std::uintptr_t address) const {
        if (address < 0x500000000000 || address >> 47 != 0) return false;
        if (address - reinterpret_cast<std::uintptr_t>(begin_) < reserved) return false;
        unsigned char resident;
        return mincore(reinterpret_cast<void*>(address / page_ * page_), page_, &resident) == 0;
    }

    /// Installs a signal handler. When a page is accessed while the guard is closed, it names the guard, prints a stack
    /// trace and calls the previous handler (of the test framework or a sanitizer). doctest sets its own handler for
    /// each test case, so this is called whenever a backend is made.
    void watch() {
        struct sigaction current;
        sigaction(SIGSEGV, nullptr, &current);
        if ((current.sa_flags & SA_SIGINFO) && current.sa_sigaction == &on_fault) return;
        void* warm_up[1];
        backtrace(warm_up, 1); // loads the unwinder now: a signal handler must not
        previous_ = current;
        struct sigaction mine = {};
        mine.sa_sigaction = &on_fault;
        mine.sa_flags = SA_SIGINFO | SA_ONSTACK;
        sigaction(SIGSEGV, &mine, nullptr);
    }

private:
    static constexpr std::size_t reserved = std::size_t(1) << 32; // bytes of address space, not of memory

    GuardedMemory() : page_(static_cast<std::size_t>(sysconf(_SC_PAGESIZE))) {
        void* range = mmap(nullptr, reserved, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
        if (range == MAP_FAILED) throw std::bad_alloc();
        begin_ = static_cast<char*>(range);
    }
    void protect(void* memory, std::size_t size, int rights) {
        if (size && mprotect(memory, size, rights) != 0) throw std::bad_alloc();
    }

    static void on_fault(int, siginfo_t* info, void*) {
        if (instance().owns(info->si_addr, 1)) {
            static constexpr char message[] =
                "\nguarded memory: the host touched a buffer of the backend outside the backend's own work;\n"
                "fetch it with download, or make what touches it part of the backend. Called from:\n";
            (void)!write(STDERR_FILENO, message, sizeof message - 1);
            void* frames[64];
            backtrace_symbols_fd(frames, backtrace(frames, 64), STDERR_FILENO);
        }
        sigaction(SIGSEGV, &instance().previous_, nullptr); // the access fails again and reaches the previous handler
    }

    std::size_t page_;
    char* begin_ = nullptr;
    std::size_t used_ = 0;
    int depth_ = 0;
    std::map<std::size_t, std::vector<char*>> free_; // by size
    struct sigaction previous_ = {};
};

/// A device receives the bytes of an argument, and an address of host memory among them is invalid there: names the
/// first such address, or returns an empty string. Arguments that are not trivially copyable (caches, networks) stay on
/// the host and are not checked. Nothing is checked if the compiler cannot clear the gaps between members, which may
/// contain old addresses.
template <class T>
[[nodiscard]] std::string host_address_in([[maybe_unused]] const T& argument) {
#if __has_builtin(__builtin_clear_padding)
    if constexpr (std::is_trivially_copyable_v<T> && sizeof(T) >= sizeof(void*)) {
        T copy(argument);
        __builtin_clear_padding(&copy);
        std::array<std::uintptr_t, sizeof(T) / sizeof(std::uintptr_t)> words;
        std::memcpy(words.data(), static_cast<const void*>(&copy), sizeof words);
        for (std::size_t i = 0; i < words.size(); ++i) {
            if (i + 1 < words.size() && words[i + 1] == 0) continue; // a span of no elements
            if (!GuardedMemory::instance().is_host_address(words[i])) continue;
            const std::unique_ptr<char, void (*)(void*)> name(
                abi::__cxa_demangle(typeid(T).name(), nullptr, nullptr, nullptr), &std::free);
            return (name ? name.get() : typeid(T).name()) + std::string(" holds the address of host memory (8 bytes at ") +
                   std::to_string(8 * i) + ")";
        }
    }
#endif
    return {};
}

/// Opens the guard during its lifetime.
class OpenGuard {
public:
    OpenGuard() { GuardedMemory::instance().open(); }
    OpenGuard(const OpenGuard&) = delete;
    ~OpenGuard() { GuardedMemory::instance().close(); }
};

/// An array in guarded memory. New elements are filled with the byte 0xA5, so that results which depend on
/// uninitialised elements are visibly wrong.
template <class T>
    requires std::is_trivially_copyable_v<T>
class GuardedBuffer {
public:
    GuardedBuffer() = default;
    explicit GuardedBuffer(std::size_t size) { resize(size); }
    GuardedBuffer(const GuardedBuffer& other) : GuardedBuffer(other.size_) {
        const OpenGuard guard;
        if (size_) std::memcpy(static_cast<void*>(data_), other.data_, size_ * sizeof(T));
    }
    GuardedBuffer(GuardedBuffer&& other) noexcept { swap(other); }
    GuardedBuffer& operator=(GuardedBuffer other) noexcept {
        swap(other);
        return *this;
    }
    ~GuardedBuffer() {
        if (data_) GuardedMemory::instance().release(data_, capacity_ * sizeof(T));
    }

    void resize(std::size_t size) {
        if (size > capacity_) {
            GuardedBuffer larger;
            larger.data_ = static_cast<T*>(GuardedMemory::instance().allocate(size * sizeof(T)));
            larger.capacity_ = size;
            swap(larger);
        }
        if (size != size_ && size) {
            const OpenGuard guard;
            std::memset(static_cast<void*>(data_), 0xA5, size * sizeof(T));
        }
        size_ = size;
    }

    [[nodiscard]] T* data() { return data_; }
    [[nodiscard]] const T* data() const { return data_; }
    [[nodiscard]] std::size_t size() const { return size_; }
    [[nodiscard]] bool empty() const { return size_ == 0; }
    [[nodiscard]] T* begin() { return data_; }
    [[nodiscard]] T* end() { return data_ + size_; }
    [[nodiscard]] const T* begin() const { return data_; }
    [[nodiscard]] const T* end() const { return data_ + size_; }
    [[nodiscard]] T& operator[](std::size_t i) { return data_[i]; }
    [[nodiscard]] const T& operator[](std::size_t i) const { return data_[i]; }

    void swap(GuardedBuffer& other) noexcept {
        std::swap(data_, other.data_);
        std::swap(size_, other.size_);
        std::swap(capacity_, other.capacity_);
    }

private:
    T* data_ = nullptr;
    std::size_t size_ = 0, capacity_ = 0;
};

} // namespace gsh::test
