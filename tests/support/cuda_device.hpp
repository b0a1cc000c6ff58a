// SPDX-License-Identifier: Apache-2.0
/// @file  Tests that run on a GPU if there is one, and on the emulation otherwise.
#pragma once

#include <gsh/backend/cuda/device.cuh>

#include "support/skip.hpp"

namespace gsh::test {

/// Steps of a long training: as many as show that nothing drifts on a GPU; fewer on the emulation, which takes a
/// thousand times as long.
#if defined(GSH_CUDA_EMULATION)
inline constexpr int long_training = 24;
#else
inline constexpr int long_training = 50;
#endif

/// Whether no GPU answers; then the running test case is reported as skipped. The emulation always answers.
[[nodiscard]] inline bool skip_without_device() {
    if (cuda::Device::available()) return false;
    skip("no GPU answers");
    return true;
}

} // namespace gsh::test
