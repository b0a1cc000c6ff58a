// SPDX-License-Identifier: Apache-2.0
/// @file  Errors of the CUDA runtime as exceptions.
#pragma once

#include <gsh/core/error.hpp>

#include <cuda_runtime.h>

#include <string>
#include <string_view>

namespace gsh::cuda {

/// Throws DeviceError unless a call of the runtime succeeded: "where: cudaErrorLaunchFailure: …". After an error in a
/// kernel, all later calls of the process return the same error.
inline void check(cudaError_t error, std::string_view where, std::string_view hint = {}) {
    if (error == cudaSuccess) return;
    (void)cudaGetLastError(); // otherwise the next check would report this error again
    std::string message(where);
    message.append(": ").append(cudaGetErrorName(error)).append(": ").append(cudaGetErrorString(error));
    if (!hint.empty()) message.append("; ").append(hint);
    throw DeviceError(message);
}

} // namespace gsh::cuda
