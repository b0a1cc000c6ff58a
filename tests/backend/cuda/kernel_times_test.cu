// SPDX-License-Identifier: Apache-2.0
/// @file  Times of launches: one for each, in order, of as many repeats as were asked for.
#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/kernel_times.cuh>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace cuda_kernel_times { // joined builds: other tests have helpers of the same names

using namespace gsh;
using cuda::Device;

namespace {

/// Adds 1, by one thread.
struct AddOne {
    static constexpr unsigned block_size = 32;
    Span<std::uint32_t> sum;
    __device__ void operator()() const {
        if (threadIdx.x == 0) sum[0] += 1;
    }
};

std::vector<cuda::detail::TimedLaunch> launches_of(const Span<std::uint32_t>& sum, std::size_t count) {
    return std::vector<cuda::detail::TimedLaunch>(count, {"AddOne", "adding", [sum](cudaStream_t stream) {
                                                              cuda::detail::launch_on(stream, 1, AddOne{sum});
                                                          }});
}

} // namespace

TEST_CASE("each launch runs once a repeat and has a time, also where more are queued than a stream holds") {
    if (test::skip_without_device()) return;
    Device device;
    for (const std::size_t count : {std::size_t(0), std::size_t(1), std::size_t(450)}) {
        Device::Buffer<std::uint32_t> sum(1);
        device.fill(Span<std::uint32_t>(sum), 0u);
        const auto times = cuda::detail::time_launches(device.stream(), launches_of(sum, count), 3);
        REQUIRE(times.size() == count);
        for (const cuda::KernelTime& time : times) {
            CHECK(time.kernel == "AddOne");
            CHECK(time.stage == "adding");
            CHECK(time.microseconds > 0);
        }
        std::uint32_t runs = 0;
        device.download(Span<const std::uint32_t>(sum), Span<std::uint32_t>(&runs, 1));
        CHECK(runs == 3 * count);
    }
}

TEST_CASE("without repeats nothing runs, and times are zero") {
    if (test::skip_without_device()) return;
    Device device;
    Device::Buffer<std::uint32_t> sum(1);
    device.fill(Span<std::uint32_t>(sum), 0u);
    const auto times = cuda::detail::time_launches(device.stream(), launches_of(sum, 2), 0);
    REQUIRE(times.size() == 2);
    CHECK(times[1].microseconds == 0);
    std::uint32_t runs = 0;
    device.download(Span<const std::uint32_t>(sum), Span<std::uint32_t>(&runs, 1));
    CHECK(runs == 0);
}

TEST_CASE("work behind a gate has run when the gate is gone") {
    if (test::skip_without_device()) return;
    Device device;
    Device::Buffer<std::uint32_t> sum(1);
    device.fill(Span<std::uint32_t>(sum), 0u);
    {
        cuda::detail::StreamGate gate(device.stream());
        cuda::detail::launch_on(device.stream(), 1, AddOne{sum});
    } // opens it, and waits
    std::uint32_t runs = 0;
    device.download(Span<const std::uint32_t>(sum), Span<std::uint32_t>(&runs, 1));
    CHECK(runs == 1);
}

} // namespace cuda_kernel_times
