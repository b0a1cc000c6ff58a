// SPDX-License-Identifier: Apache-2.0
/// @file  Arrays in host memory that a stream of their own brings to the GPU, beside the work that comes before them.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/error.cuh>
#include <gsh/backend/cuda/memory.cuh>
#include <gsh/backend/cuda/stream.cuh>
#include <gsh/backend/fetch_ahead.hpp>
#include <gsh/core/span.hpp>

#include <cuda_runtime.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <vector>

namespace gsh {

/// The arrays are copied to page-locked host memory once. Three slots in the device's memory take them in turns: one is
/// read by the work that runs, one is filled for the work that comes next, and the third lets the host queue more work
/// without waiting. All waits are on the device: a copy waits for the work that last read its slot, and the work that
/// reads a slot waits for its copy.
template <>
class FetchAhead<cuda::Device> {
public:
    using Bytes = Span<const std::uint8_t>;

    FetchAhead(cuda::Device& device, const std::vector<Bytes>& arrays) : device_(&device) {
        arrays_.reserve(arrays.size());
        for (const Bytes& bytes : arrays) arrays_.emplace_back(bytes);
        for (Slot& slot : slots_)
            for (cudaEvent_t* event : {&slot.filled.handle, &slot.read.handle})
                cuda::check(cudaEventCreateWithFlags(event, cudaEventDisableTiming), where);
    }

    [[nodiscard]] Bytes get(std::size_t array) {
        detail::check_fetched(array, arrays_.size());
        if (reading_ != nullptr) device_->record(reading_->read.handle); // all work on it has been queued
        Slot* slot = find(array);
        if (slot == nullptr) slot = &fill(array);
        device_->wait(slot->filled.handle);
        slot->last_use = ++uses_;
        reading_ = slot;
        return {slot->bytes.data(), arrays_[array].size()};
    }
    void fetch(std::size_t array) {
        detail::check_fetched(array, arrays_.size());
        if (find(array) == nullptr) (void)fill(array);
    }

private:
    static constexpr std::string_view where = "gsh::FetchAhead";
    static constexpr std::size_t nothing = ~std::size_t(0);

    struct Event {
        cudaEvent_t handle = nullptr;
        Event() = default;
        Event(const Event&) = delete;
        Event& operator=(const Event&) = delete;
        ~Event() {
            if (handle != nullptr) (void)cudaEventDestroy(handle);
        }
    };
    struct Slot {
        cuda::Buffer<std::uint8_t> bytes;
        Event filled, read; // `read` happens when the last work on the slot is done
        std::size_t array = nothing;
        std::uint64_t last_use = 0;
    };

    [[nodiscard]] Slot* find(std::size_t array) {
        const auto found =
            std::find_if(slots_.begin(), slots_.end(), [array](const Slot& slot) { return slot.array == array; });
        return found == slots_.end() ? nullptr : &*found;
    }
    /// Queues the copy of an array to the slot that was used longest ago, but for the one that is being read.
    Slot& fill(std::size_t array) {
        Slot* oldest = nullptr;
        for (Slot& slot : slots_)
            if (&slot != reading_ && (oldest == nullptr || slot.last_use < oldest->last_use)) oldest = &slot;
        Slot& slot = *oldest;
        slot.array = array;
        slot.last_use = ++uses_;
        const cuda::PinnedCopy& from = arrays_[array];
        slot.bytes.resize(from.size());
        cuda::check(cudaStreamWaitEvent(stream_.get(), slot.read.handle, 0), where);
        if (from.size() != 0)
            cuda::check(cudaMemcpyAsync(slot.bytes.data(), from.data(), from.size(), cudaMemcpyHostToDevice,
                                        stream_.get()),
                        where);
        cuda::check(cudaEventRecord(slot.filled.handle, stream_.get()), where);
        return slot;
    }

    cuda::Device* device_;
    std::vector<cuda::PinnedCopy> arrays_;
    std::array<Slot, 3> slots_;
    Slot* reading_ = nullptr;
    std::uint64_t uses_ = 0;
    cuda::detail::OwnedStream stream_{where}; // is destroyed first
};

} // namespace gsh
