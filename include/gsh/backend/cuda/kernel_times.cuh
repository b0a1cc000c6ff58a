// SPDX-License-Identifier: Apache-2.0
/// @file  Times of launches, each measured alone: for benches.
#pragma once

#include <gsh/backend/cuda/error.cuh>
#include <gsh/backend/cuda/timing_events.cuh>

#include <cuda_runtime.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace gsh::cuda {

/// The time of one kernel of a recorded step.
struct KernelTime {
    std::string kernel;      ///< its type, "BlendBackward<float>"
    std::string stage;       ///< Device::mark, if it was called
    double microseconds = 0; ///< on the device, with about 1 µs for the event that ends it
};

namespace detail {

/// Holds a stream until it is opened. Its destructor opens it and waits.
class StreamGate {
public:
    explicit StreamGate(cudaStream_t stream) : stream_(stream) {
        check(cudaLaunchHostFunc(stream, &wait, &is_open_), "gsh::cuda::StreamGate");
    }
    StreamGate(const StreamGate&) = delete;
    ~StreamGate() {
        open();
        (void)cudaStreamSynchronize(stream_);
    }
    void open() {
        is_open_.store(true);
        is_open_.notify_one();
    }

private:
    static void wait(void* is_open) { static_cast<std::atomic<bool>*>(is_open)->wait(false); }

    cudaStream_t stream_;
    std::atomic<bool> is_open_{false};
};

/// A kernel, or work of another library, that is repeated for its time.
struct TimedLaunch {
    std::string kernel, stage; ///< as in KernelTime
    std::function<void(cudaStream_t)> launch;
};

/// Runs the launches `repeats` times, each after the one before it, and returns the median time of each. Waits.
[[nodiscard]] inline std::vector<KernelTime> time_launches(cudaStream_t stream,
                                                           const std::vector<TimedLaunch>& launches, int repeats) {
    constexpr std::size_t most_queued = 200;
    constexpr std::string_view where = "gsh::cuda::time_launches";
    const TimingEvents events(launches.size() + 1);
    std::vector<std::vector<double>> runs(launches.size());
    for (int run = 0; run < repeats; ++run) {
        StreamGate gate(stream); // the host is slower than short kernels: the device begins when all are queued
        check(cudaEventRecord(events[0], stream), where);
        for (std::size_t i = 0; i < launches.size(); ++i) {
            launches[i].launch(stream);
            check(cudaEventRecord(events[i + 1], stream), where);
            if (i + 1 == most_queued) gate.open(); // a full queue would block the host
        }
        gate.open();
        check(cudaStreamSynchronize(stream), where);
        for (std::size_t i = 0; i < launches.size(); ++i) runs[i].push_back(events.microseconds(i, i + 1));
    }
    std::vector<KernelTime> times;
    for (std::size_t i = 0; i < launches.size(); ++i) {
        times.push_back({launches[i].kernel, launches[i].stage, 0});
        std::vector<double>& of = runs[i];
        if (of.empty()) continue;
        const auto middle = of.begin() + static_cast<std::ptrdiff_t>(of.size() / 2);
        std::nth_element(of.begin(), middle, of.end());
        times.back().microseconds = *middle;
    }
    return times;
}

} // namespace detail

} // namespace gsh::cuda
