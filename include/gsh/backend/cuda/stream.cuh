// SPDX-License-Identifier: Apache-2.0
/// @file  Streams of gsh's own, and those of callers, which may be captured.
#pragma once

#include <gsh/backend/cuda/error.cuh>

#include <cuda_runtime.h>

#include <algorithm>
#include <string_view>
#include <vector>

namespace gsh::cuda::detail {

/// Whether a capture of the stream has begun. The legacy default stream, a null pointer, cannot be captured.
[[nodiscard]] inline bool is_capturing(cudaStream_t stream) {
    if (stream == nullptr) return false;
    cudaStreamCaptureStatus status;
    check(cudaStreamIsCapturing(stream, &status), "gsh::cuda");
    return status != cudaStreamCaptureStatusNone;
}

/// A stream that waits for no other one, on the current device. Its destructor waits for its work, since what the work
/// reads and writes is often freed next.
class OwnedStream {
public:
    explicit OwnedStream(std::string_view where) {
        check(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking), where);
    }
    OwnedStream(const OwnedStream&) = delete;
    OwnedStream& operator=(const OwnedStream&) = delete;
    ~OwnedStream() {
        (void)cudaStreamSynchronize(stream_);
        (void)cudaStreamDestroy(stream_);
    }
    [[nodiscard]] cudaStream_t get() const { return stream_; }

private:
    cudaStream_t stream_ = nullptr;
};

/// A stream of the caller's on which a device of this thread works. While it is captured, no buffer of the thread may
/// give memory back: the caller's graph may use it whenever it is launched. CUDA itself refuses to allocate memory in
/// most captures, but not in those of cudaStreamCaptureModeRelaxed.
class CallersStream {
public:
    explicit CallersStream(cudaStream_t stream) : stream_(stream) { all().push_back(stream); }
    CallersStream(const CallersStream&) = delete;
    CallersStream& operator=(const CallersStream&) = delete;
    ~CallersStream() { all().erase(std::find(all().begin(), all().end(), stream_)); }

    [[nodiscard]] static bool is_any_captured() { return std::any_of(all().begin(), all().end(), is_capturing); }

private:
    static std::vector<cudaStream_t>& all() {
        thread_local std::vector<cudaStream_t> streams;
        return streams;
    }
    cudaStream_t stream_;
};

} // namespace gsh::cuda::detail
