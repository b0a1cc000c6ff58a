// SPDX-License-Identifier: Apache-2.0
/// @file  CUDA events that keep the time.
#pragma once

#include <gsh/backend/cuda/error.cuh>

#include <cuda_runtime.h>

#include <cstddef>
#include <string_view>
#include <vector>

namespace gsh::cuda {

/// Events of the current device whose times of arrival can be compared. `Device::record` puts one into a stream.
class TimingEvents {
public:
    /// Errors  DeviceError.
    explicit TimingEvents(std::size_t count) : events_(count, nullptr) {
        for (cudaEvent_t& event : events_)
            if (const cudaError_t error = cudaEventCreate(&event); error != cudaSuccess) {
                destroy();
                check(error, where);
            }
    }
    TimingEvents(const TimingEvents&) = delete;
    TimingEvents& operator=(const TimingEvents&) = delete;
    ~TimingEvents() { destroy(); }

    [[nodiscard]] std::size_t size() const { return events_.size(); }
    [[nodiscard]] cudaEvent_t operator[](std::size_t i) const { return events_[i]; }
    [[nodiscard]] cudaEvent_t back() const { return events_.back(); }

    /// The time from event `from` to event `to`, which have both been reached.
    [[nodiscard]] double microseconds(std::size_t from, std::size_t to) const {
        float ms = 0;
        check(cudaEventElapsedTime(&ms, events_[from], events_[to]), where);
        return 1000 * static_cast<double>(ms);
    }

private:
    static constexpr std::string_view where = "gsh::cuda::TimingEvents";

    void destroy() noexcept {
        for (cudaEvent_t event : events_)
            if (event != nullptr) (void)cudaEventDestroy(event);
    }

    std::vector<cudaEvent_t> events_;
};

} // namespace gsh::cuda
