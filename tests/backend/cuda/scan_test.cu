// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/scan.cuh>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"

#include <cstddef>
#include <cstdint>
#include <vector>

using namespace gsh;

namespace {

/// Running sums of one block's numbers, and their total.
template <unsigned Block>
struct ScanOneBlock {
    static constexpr unsigned block_size = Block;
    struct Shared {
        cuda::SharedArray<std::uint64_t, Block / cuda::warp_size> sums;
    };
    Span<const std::uint64_t> from;
    Span<std::uint64_t> to; // [Block + 1]

    __device__ void operator()(Shared& shared) const {
        std::uint64_t total;
        const std::uint64_t before = cuda::block_scan<Block>(shared.sums, from[threadIdx.x], total);
        to[threadIdx.x] = before;
        if (threadIdx.x == Block - 1) to[Block] = total;
    }
};

template <unsigned Block>
void check_scan() {
    cuda::Device device;
    std::vector<std::uint64_t> numbers(Block), found(Block + 1);
    for (std::size_t i = 0; i < Block; ++i) numbers[i] = (i * i * 7919 + 3) % 1000 + (std::uint64_t(i % 3) << 33);
    cuda::Buffer<std::uint64_t> from(Block), to(Block + 1);
    device.upload(Span<const std::uint64_t>(numbers), Span<std::uint64_t>(from));
    device.launch(1, ScanOneBlock<Block>{from, to});
    device.download(Span<const std::uint64_t>(to), Span<std::uint64_t>(found));
    std::uint64_t sum = 0;
    bool same = true;
    for (std::size_t i = 0; i <= Block; ++i) {
        same = same && found[i] == sum;
        if (i < Block) sum += numbers[i];
    }
    CHECK(same);
}

} // namespace

TEST_CASE("Running sums over a block of any number of warps") {
    if (test::skip_without_device()) return;
    check_scan<32>();
    check_scan<64>();
    check_scan<128>();
    check_scan<256>();
    check_scan<1024>();
}
