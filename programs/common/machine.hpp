// SPDX-License-Identifier: Apache-2.0
/// @file  The machine that a program runs on: its threads and its GPU, the processor's name, memory of the process.
#pragma once

#include "common/backend_option.hpp"

#include <gsh/backend/threads.hpp>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

namespace gsh::cuda {
class Device;
}

namespace gsh::programs {

/// Where a program computes. Readers, checks and the judging of pictures run on the host's threads. What trains and
/// renders runs on the GPU of --backend cuda, otherwise on the threads, too.
class Machine {
public:
    /// Errors  ValueError for --device without cuda. DeviceError for cuda in a program without CUDA, without a driver or
    ///         without the GPU that --device names.
    explicit Machine(const BackendOption& option);

    [[nodiscard]] cpu::Threads& host() { return host_; }
    [[nodiscard]] bool has_gpu() const { return gpu_ != nullptr; }
    /// The GPU on which the program trains and renders; null without --backend cuda.
    [[nodiscard]] cuda::Device* gpu() { return gpu_.get(); }
    /// Where the program trains and renders.
    [[nodiscard]] const ComputedOn& computed_on() const { return computed_on_; }
    /// The most bytes that the program has taken of the GPU's memory; nothing without a GPU.
    [[nodiscard]] std::optional<std::uint64_t> peak_gpu_memory() const;

private:
    cpu::Threads host_;
    std::shared_ptr<cuda::Device> gpu_;
    ComputedOn computed_on_;
};

/// Resident memory of this process, in bytes.
std::uint64_t resident_bytes();

/// Peak resident memory of this process, in bytes.
std::uint64_t peak_memory_bytes();

/// Memory that this machine has, or that this process's control group may use, in bytes.
std::uint64_t memory_of_machine();

/// The name of the processor.
std::string processor_name();

} // namespace gsh::programs
