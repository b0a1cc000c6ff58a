// SPDX-License-Identifier: Apache-2.0
/// @file  Measures the stages of training steps on a GPU, with events.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/error.cuh>
#include <gsh/backend/cuda/stream.cuh>
#include <gsh/backend/cuda/timing_events.cuh>
#include <gsh/train/stage.hpp>

#include <cuda_runtime.h>

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace gsh {

/// On a GPU, events between the stages are part of the step's graph (about 1 µs each). They keep the times of the last
/// step:
///
///     StageTimer<cuda::Device> timer(device);
///     for (...) {
///         trainer.step(progress, timer);
///         if (now and then) timer.sample();
///     }
template <>
class StageTimer<cuda::Device> {
public:
    explicit StageTimer(cuda::Device& device) : device_(&device) {}

    void enter(Stage stage) {
        const auto s = static_cast<std::size_t>(stage);
        device_->mark(stage_names[s]);
        device_->call(keys_[s], [event = events_[s]](cudaStream_t stream) {
            const bool in_graph = cuda::detail::is_capturing(stream);
            cuda::check(cudaEventRecordWithFlags(event, stream, in_graph ? cudaEventRecordExternal : cudaEventDefault),
                        where);
        });
    }
    /// Ends the step.
    void leave() {
        device_->record(events_.back());
        finished_ = true;
    }

    /// Waits for the device and adds the times of the last step.
    void sample() {
        if (!finished_) return;
        cuda::check(cudaEventSynchronize(events_.back()), where);
        for (std::size_t s = 0; s < seconds_.size(); ++s) seconds_[s] += 1e-6 * events_.microseconds(s, s + 1);
        ++steps_;
        finished_ = false;
    }

    /// Seconds in each stage over all sampled steps, in the order of Stage.
    [[nodiscard]] const std::array<double, stage_names.size()>& seconds() const { return seconds_; }
    /// The number of sampled steps.
    [[nodiscard]] std::uint64_t steps() const { return steps_; }

private:
    static constexpr std::string_view where = "gsh::StageTimer";

    /// Names of the stages that no other timer has: a recorded step must not keep the events of another timer.
    [[nodiscard]] static std::array<std::string, stage_names.size()> new_keys() {
        static std::atomic<std::uint64_t> timers{0};
        const std::string timer = " (timer " + std::to_string(++timers) + ")";
        std::array<std::string, stage_names.size()> keys;
        for (std::size_t s = 0; s < keys.size(); ++s) keys[s] = std::string(stage_names[s]) + timer;
        return keys;
    }

    cuda::Device* device_;
    std::array<std::string, stage_names.size()> keys_ = new_keys();
    cuda::TimingEvents events_{stage_names.size() + 1}; // at the beginning of each stage, and at the end
    std::array<double, stage_names.size()> seconds_{};
    std::uint64_t steps_ = 0;
    bool finished_ = false; // a step that no sample has seen
};

} // namespace gsh
