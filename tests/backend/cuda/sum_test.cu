// SPDX-License-Identifier: Apache-2.0
/// @file  Sums on the GPU: of an array, of a warp, of a block.
#include <gsh/backend/cuda/sum.cuh>
#include <gsh/backend/sum.hpp>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"
#include "support/gradient.hpp"

#include <cmath>
#include <cstddef>
#include <cstring>
#include <vector>

namespace {

using namespace gsh;
using cuda::Device;

template <class T>
Device::Buffer<T> upload(Device& device, const std::vector<T>& host) {
    Device::Buffer<T> buffer(host.size());
    device.upload(Span<const T>(host), Span<T>(buffer));
    return buffer;
}
template <class T>
std::vector<T> download(Device& device, const Device::Buffer<T>& buffer) {
    return downloaded(device, Span<const T>(buffer));
}

/// The sums of a warp and of a block, as each thread receives them.
template <class T>
struct SumsOfThreads {
    static constexpr unsigned block_size = 96;
    struct Shared {
        cuda::SharedArray<T, 3> warps;
    };
    Span<const T> values;
    Span<T> of_warp, of_block;

    __device__ void operator()(Shared& shared) const {
        const T value = values[threadIdx.x];
        of_warp[threadIdx.x] = cuda::warp_sum(value);
        of_block[threadIdx.x] = cuda::block_sum<block_size>(shared.warps, value);
        __syncthreads(); // the shared array may be used again
        of_block[threadIdx.x] += cuda::block_sum<block_size>(shared.warps, value);
    }
};

template <class T>
T number(test::Rng& rng) {
    if constexpr (std::floating_point<T>) return T(rng.uniform(-1, 1));
    else return T(rng.vec());
}
template <class T>
double difference(const T& a, const T& b) {
    if constexpr (std::floating_point<T>) return std::abs(double(a) - double(b));
    else return double(length(a - b));
}

} // namespace

TEST_CASE_TEMPLATE("the lanes of a warp and the threads of a block receive the sum, with the same bits", T, float,
                   double, vec3<float>, vec3<double>) {
    if (test::skip_without_device()) return;
    Device device;
    test::Rng rng(3);
    std::vector<T> values(96);
    for (T& value : values) value = number<T>(rng);
    Device::Buffer<T> warps(96), blocks(96);
    const auto input = upload(device, values);
    device.launch(1, SumsOfThreads<T>{input, warps, blocks});
    const auto of_warp = download(device, warps), of_block = download(device, blocks);
    T total(0);
    for (std::size_t warp = 0; warp < 3; ++warp) {
        T sum(0);
        for (std::size_t i = 32 * warp; i < 32 * warp + 32; ++i) sum += values[i];
        total += sum;
        for (std::size_t i = 32 * warp; i < 32 * warp + 32; ++i) {
            CHECK(difference(of_warp[i], sum) < 1e-5);
            CHECK(std::memcmp(&of_warp[i], &of_warp[32 * warp], sizeof(T)) == 0);
        }
    }
    for (const T& sum : of_block) {
        CHECK(difference(sum, T(total + total)) < 1e-5);
        CHECK(std::memcmp(&sum, of_block.data(), sizeof(T)) == 0);
    }
}

TEST_CASE_TEMPLATE("add_sum adds the sum", T, float, double, vec3<float>, vec3<double>) {
    if (test::skip_without_device()) return;
    Device device;
    test::Rng rng(1);
    Device::Buffer<T> partials;
    for (const std::size_t n : {0, 1, 31, 32, 33, 1023, 1024, 1025, 2048, 20001}) {
        CAPTURE(n);
        std::vector<T> values(n);
        T expected(1);
        for (T& value : values) expected += value = number<T>(rng);
        const auto input = upload(device, values);
        auto result = upload(device, std::vector<T>{T(1)});
        add_sum(device, Span<const T>(input), Span<T>(result), partials);
        const T once = download(device, result)[0];
        const double tolerance = alignof(T) == alignof(double) ? 1e-11 : 1e-3;
        CHECK(difference(once, expected) < tolerance);
        add_sum(device, Span<const T>(input), Span<T>(result), partials);
        CHECK(difference(T(download(device, result)[0] - once), T(once - T(1))) < tolerance);
    }
    Device::Buffer<T> two(2);
    CHECK_THROWS_AS(add_sum(device, Span<const T>(two), Span<T>(two), partials), ShapeError);
    const std::vector<T> host(3);
    CHECK_THROWS_AS(add_sum(device, Span<const T>(host), Span<T>(two).subspan(0, 1), partials), MemoryError);
}

#if defined(GSH_CUDA_EMULATION)
TEST_CASE("add_sum gives the same bits in any order of blocks and threads") {
    auto& machine = test::CudaEmulation::instance();
    test::Rng rng(2);
    std::vector<float> values(5000);
    for (float& value : values) value = number<float>(rng);
    const auto sum = [&](test::Order order, unsigned char fill) {
        machine.order = order, machine.fill = fill;
        Device device;
        Device::Buffer<float> partials;
        const auto input = upload(device, values);
        auto result = upload(device, std::vector<float>{0});
        add_sum(device, Span<const float>(input), Span<float>(result), partials);
        return download(device, result)[0];
    };
    const float expected = sum(test::Order::forward, 0xA5);
    CHECK(sum(test::Order::reverse, 0xA5) == expected);
    CHECK(sum(test::Order::random, 0xFF) == expected);
    machine.order = test::Order::forward, machine.fill = 0xA5;
}
#endif
