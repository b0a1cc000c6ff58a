// SPDX-License-Identifier: Apache-2.0
/// @file  Steps that are repeated on a GPU: each is one CUDA graph, and none waits for the host.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/recorder.cuh>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <string_view>
#include <vector>

namespace gsh {

namespace cuda {

/// A step that is repeated: its kernels become one CUDA graph, which each run updates and launches.
///
///     StepGraph graph(device);
///     for (...) graph.run([&] { rasterizer.forward(...); ...; adam.step(...); });
class StepGraph {
public:
    explicit StepGraph(Device& device)
        : device_(&device), recorder_(device.stream(), device.recording_stream()) {}

    /// Runs step() with the same results as without the graph. step() may do anything; what cannot be part of a graph
    /// (a download, an upload of more than 8 KiB) cuts it in two. Components do not wait for the device inside a step,
    /// so an error is found later (Device::halted).
    /// Errors  ValueError inside another step, or in a capture of the caller's.
    template <class Step>
    void run(const Step& step) {
        constexpr std::string_view where = "gsh::cuda::StepGraph::run";
        check_value(device_->recorder_ == nullptr, where, "a step is already being recorded");
        check_value(!device_->deferring(), where, "the caller captures the stream; its graph cannot follow the step");
        device_->check_current();
        const Use use{*device_, recorder_};
        recorder_.begin();
        device_->recorder_ = &recorder_;
        step();
        recorder_.end();
    }
    [[nodiscard]] const detail::Recorder::Counts& counts() const { return recorder_.counts(); }

    /// Runs the kernels of the last step `repeats` times more, one after the other, and returns the median time of
    /// each. A step that learns has then learned so much more from the same input.
    [[nodiscard]] std::vector<KernelTime> time_kernels(int repeats = 20) { return recorder_.time_kernels(repeats); }

private:
    struct Use {
        Device& device;
        detail::Recorder& recorder;
        ~Use() {
            device.recorder_ = nullptr;
            recorder.abandon(); // does nothing after end
        }
    };

    Device* device_;
    detail::Recorder recorder_;
};

namespace detail {

/// Counts a step, unless the device has halted.
struct CountStep {
    Span<const std::uint32_t> halt;
    Span<std::uint32_t> count; // [1]
    __device__ void operator()(std::size_t) const {
        if (halt[0] == 0) ++count[0];
    }
};

} // namespace detail

} // namespace cuda

/// On a GPU, the first step of each kind runs directly: it waits for the device, so buffers take the size that they
/// need. All others are recorded.
template <>
class RepeatedStep<cuda::Device> {
public:
    explicit RepeatedStep(cuda::Device& device) : device_(&device), finished_(1) { restart(); }

    /// Errors  ValueError if steps of another object on this device have failed and have not been settled.
    template <class Step>
    void run(std::uint64_t kind, const Step& step) {
        device_->begin_steps(token_);
        std::unique_ptr<cuda::StepGraph>& graph = graphs_[kind];
        const auto counted = [&] {
            step();
            device_->for_each(1, cuda::detail::CountStep{device_->halted(), finished_});
        };
        if (graph != nullptr) {
            graph->run(counted);
            last_ = graph.get();
        } else {
            counted();
            graph = std::make_unique<cuda::StepGraph>(*device_);
        }
        ++queued_;
    }
    /// StepGraph::time_kernels of the last step, which must not have been the first of its kind. The repeated steps are
    /// not counted.
    /// Errors  ValueError if a repeated step halts the device: its kernels then did not do their work.
    [[nodiscard]] std::vector<cuda::KernelTime> time_kernels(int repeats = 20) {
        check_value(last_ != nullptr, "gsh::RepeatedStep::time_kernels", "no step has been recorded yet");
        const std::uint64_t lost = settle();
        check_value(lost == 0, "gsh::RepeatedStep::time_kernels", "the last steps failed; settle first");
        std::vector<cuda::KernelTime> times = last_->time_kernels(repeats);
        const bool halted = has_halted(*device_);
        restart();
        check_value(!halted, "gsh::RepeatedStep::time_kernels", "a repeated step halted the device");
        return times;
    }
    [[nodiscard]] std::uint64_t settle() {
        std::uint32_t finished = 0;
        device_->download(Span<const std::uint32_t>(finished_), Span<std::uint32_t>(&finished, 1));
        const std::uint64_t lost = queued_ - finished;
        restart();
        return lost;
    }
    void forget() {
        graphs_.clear();
        last_ = nullptr;
    }

private:
    void restart() {
        if (device_->runs_steps_of(token_)) device_->resume();
        device_->fill(Span<std::uint32_t>(finished_), 0u);
        queued_ = 0;
    }

    cuda::Device* device_;
    std::shared_ptr<const void> token_ = std::make_shared<char>(); // what the device knows this object by
    cuda::Buffer<std::uint32_t> finished_; // [1] steps since the last settle that the device has finished
    std::uint64_t queued_ = 0;             // steps since then that were handed to it
    std::map<std::uint64_t, std::unique_ptr<cuda::StepGraph>> graphs_;
    cuda::StepGraph* last_ = nullptr; // of the last recorded step
};

} // namespace gsh
