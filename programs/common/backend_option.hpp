// SPDX-License-Identifier: Apache-2.0
/// @file  The options that choose where a program trains and renders: --backend, --device, --precision, --threads.
#pragma once

#include <cstddef>
#include <optional>
#include <string>

namespace gsh::programs {

struct BackendOption {
    std::string backend = "threads"; ///< or "cuda"
    std::optional<int> device;       ///< number of the GPU, for cuda only; without one, GPU 0
    std::string precision = "fp32";  ///< of fields, or "mixed"
    std::size_t threads = 0;         ///< 0: all threads of the machine
};

/// Where something was computed, for reports.
struct ComputedOn {
    std::string backend = "threads";
    std::string device = {}; ///< the name of the GPU; empty for threads
    std::string precision = "fp32";
    std::size_t threads = 0;          ///< of the host
    std::string instruction_set = {}; ///< of the host's code (GSH_ISA); empty for results of older versions

    /// "4 threads", or the name of the GPU.
    [[nodiscard]] std::string text() const { return device.empty() ? std::to_string(threads) + " threads" : device; }
};

} // namespace gsh::programs
