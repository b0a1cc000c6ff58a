// SPDX-License-Identifier: Apache-2.0
/// @file  Storage of the CUDA backend: device memory, and page-locked host memory.
#pragma once

#include <gsh/backend/cuda/error.cuh>
#include <gsh/backend/cuda/stream.cuh>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>

#include <cuda_runtime.h>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

namespace gsh::cuda {

namespace detail {

/// Bytes that the buffers of the process have, on all GPUs together.
class MemoryUse {
public:
    static MemoryUse& instance() {
        static MemoryUse use;
        return use;
    }
    void add(std::uint64_t bytes) {
        const std::uint64_t now = now_ += bytes;
        std::uint64_t peak = peak_;
        while (peak < now && !peak_.compare_exchange_weak(peak, now)) {}
    }
    void remove(std::uint64_t bytes) { now_ -= bytes; }
    [[nodiscard]] std::uint64_t peak() const { return peak_; }

private:
    std::atomic<std::uint64_t> now_{0}, peak_{0};
};

/// Memory that was given back while a step is recorded. Kernels of the step may still use it, so it is freed when the
/// step has been handed to the device; cudaFree then waits for it.
class FreedMemory {
public:
    static FreedMemory& instance() {
        thread_local FreedMemory freed;
        return freed;
    }
    void hold() { ++holders_; }
    void release() {
        if (--holders_ != 0) return;
        for (const Memory& memory : waiting_) free_now(memory);
        waiting_.clear();
    }
    void free(void* memory, std::size_t bytes) {
        if (holders_ == 0)
            free_now({memory, bytes});
        else
            waiting_.push_back({memory, bytes});
    }

private:
    struct Memory {
        void* address;
        std::size_t bytes;
    };
    static void free_now(const Memory& memory) {
        (void)cudaFree(memory.address);
        MemoryUse::instance().remove(memory.bytes);
    }

    int holders_ = 0;
    std::vector<Memory> waiting_;
};

/// "12.5 MiB"; never 0 unless there are none.
[[nodiscard]] inline std::string in_mebibytes(std::size_t bytes) {
    const std::size_t tenths = (bytes * 10 + (std::size_t(1) << 20) - 1) >> 20;
    return std::to_string(tenths / 10) + "." + std::to_string(tenths % 10) + " MiB";
}

inline void refuse_growth_in_capture() {
    if (CallersStream::is_any_captured())
        throw DeviceError("gsh::cuda::Buffer::resize: a buffer must grow while a stream is captured; run the same work "
                          "once before the capture");
}
[[nodiscard]] inline void* allocate(std::size_t bytes) {
    constexpr std::string_view where = "gsh::cuda::Buffer::resize";
    void* memory = nullptr;
    const cudaError_t error = cudaMalloc(&memory, bytes);
    if (error == cudaSuccess) {
        MemoryUse::instance().add(bytes);
        return memory;
    }
    if (error == cudaErrorStreamCaptureUnsupported)
        check(error, where, "a capture of another stream forbids it"); // not one of a device of this thread
    if (error != cudaErrorMemoryAllocation) check(error, where); // of a kernel before, perhaps
    (void)cudaGetLastError();
    std::size_t free = 0, total = 0;
    (void)cudaMemGetInfo(&free, &total);
    throw DeviceError(std::string(where) + ": " + in_mebibytes(bytes) + " of device memory are needed, " +
                      in_mebibytes(free) + " of " + in_mebibytes(total) +
                      " are free; lower the number of Gaussians, the size of the images or that of the tables, or "
                      "TrainParams::photo_memory (--max-memory of the programs)");
}

} // namespace detail

/// Owning array of trivially copyable T in the memory of the current device. resize leaves the contents unspecified.
/// Shrinking keeps the memory, so a step that repeats its sizes allocates nothing. The host cannot access elements. It
/// cannot be copied, because a copy needs a place in the order of the work on a stream: Device::copy.
///
/// Errors  DeviceError: the device has too little free memory (the message gives both numbers), or memory would have to
///         grow inside a capture of the caller's.
template <class T>
    requires std::is_trivially_copyable_v<T>
class Buffer {
public:
    Buffer() = default;
    explicit Buffer(std::size_t size) { resize(size); }
    Buffer(Buffer&& other) noexcept { swap(other); }
    Buffer& operator=(Buffer&& other) noexcept {
        Buffer(std::move(other)).swap(*this);
        return *this;
    }
    ~Buffer() { clear(); }

    void resize(std::size_t size) {
        if (size > capacity_) {
            detail::refuse_growth_in_capture();
            clear(); // free first: the old and the new array never exist at the same time
            data_ = static_cast<T*>(detail::allocate(size * sizeof(T)));
            capacity_ = size;
        }
        size_ = size;
    }

    [[nodiscard]] T* data() { return data_; }
    [[nodiscard]] const T* data() const { return data_; }
    [[nodiscard]] std::size_t size() const { return size_; }
    [[nodiscard]] bool empty() const { return size_ == 0; }

    void swap(Buffer& other) noexcept {
        std::swap(data_, other.data_);
        std::swap(size_, other.size_);
        std::swap(capacity_, other.capacity_);
    }

private:
    void clear() {
        if (data_ != nullptr) detail::FreedMemory::instance().free(data_, capacity_ * sizeof(T));
        data_ = nullptr, size_ = 0, capacity_ = 0;
    }

    T* data_ = nullptr;
    std::size_t size_ = 0, capacity_ = 0;
};

/// A copy of an array of bytes in page-locked host memory, from which a copy to the device runs beside other work.
///
/// Errors  DeviceError: the system gives no page-locked memory of that size.
class PinnedCopy {
public:
    explicit PinnedCopy(Span<const std::uint8_t> from) : size_(from.size()) {
        if (size_ == 0) return;
        check(cudaMallocHost(&data_, size_), "gsh::cuda::PinnedCopy",
              detail::in_mebibytes(size_) + " of page-locked host memory are needed");
        std::memcpy(data_, from.data(), size_);
    }
    PinnedCopy(PinnedCopy&& other) noexcept
        : data_(std::exchange(other.data_, nullptr)), size_(std::exchange(other.size_, 0)) {}
    PinnedCopy& operator=(PinnedCopy&&) = delete;
    ~PinnedCopy() {
        if (data_ != nullptr) (void)cudaFreeHost(data_);
    }
    [[nodiscard]] const std::uint8_t* data() const { return data_; }
    [[nodiscard]] std::size_t size() const { return size_; }

private:
    std::uint8_t* data_ = nullptr;
    std::size_t size_ = 0;
};

} // namespace gsh::cuda
