// SPDX-License-Identifier: Apache-2.0
/// @file  Arrays that are brought to the GPU on a stream of their own, beside the work on those before.
#include <gsh/backend/cuda/fetch_ahead.cuh>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace {

using namespace gsh;
using cuda::Device;

/// The sum of an array's bytes.
struct AddBytes {
    Span<const std::uint8_t> bytes;
    Span<std::uint32_t> sums;
    std::size_t row;
    __device__ void operator()(std::size_t) const {
        std::uint32_t sum = 0;
        for (std::size_t i = 0; i < bytes.size(); ++i) sum += bytes[i];
        sums[row] = sum;
    }
};

/// Reads arrays in an order. Each is announced one read before, or another one in its place.
void check_reads(bool announce_the_next) {
    std::vector<std::vector<std::uint8_t>> arrays;
    std::vector<std::uint32_t> expected;
    for (std::size_t k = 0; k < 7; ++k) {
        arrays.emplace_back(3000 * (k % 3 + (k != 2)), static_cast<std::uint8_t>(k + 1)); // array 2 is shorter
        expected.push_back(static_cast<std::uint32_t>(arrays[k].size() * (k + 1)));
    }
    std::vector<std::size_t> order;
    for (std::size_t i = 0; i < 40; ++i) order.push_back((i * i + i / 3) % arrays.size());
    order.push_back(order.back()); // the same twice

    Device device;
    FetchAhead<Device> ahead(device, {arrays.begin(), arrays.end()});
    arrays.assign(arrays.size(), {}); // they were copied
    Device::Buffer<std::uint32_t> sums(order.size());
    for (std::size_t i = 0; i < order.size(); ++i) {
        device.for_each(1, AddBytes{ahead.get(order[i]), sums, i});
        const std::size_t next = i + 1 < order.size() ? order[i + 1] : 0;
        ahead.fetch(announce_the_next ? next : (next + 3) % arrays.size());
    }
    std::vector<std::uint32_t> found = downloaded(device, Span<const std::uint32_t>(sums));
    for (std::size_t i = 0; i < order.size(); ++i) {
        CAPTURE(i);
        CHECK(found[i] == expected[order[i]]);
    }
}

} // namespace

TEST_CASE("arrays arrive for the work that reads them, and no copy overwrites what queued work still reads") {
    if (test::skip_without_device()) return;
    check_reads(true);
    check_reads(false);
#if defined(GSH_CUDA_EMULATION)
    auto& machine = test::CudaEmulation::instance();
    machine.eager_streams = true; // copies run as early as their events allow, all other work as late as possible
    check_reads(true);
    check_reads(false);
    machine.eager_streams = false;
#endif
}

TEST_CASE("an array that does not exist is refused") {
    if (test::skip_without_device()) return;
    Device device;
    FetchAhead<Device> ahead(device, {{}, {}});
    CHECK(ahead.get(1).empty());
    CHECK_THROWS_WITH_AS((void)ahead.get(2), "FetchAhead: there is no array 2, expected one of 2", ValueError);
}
