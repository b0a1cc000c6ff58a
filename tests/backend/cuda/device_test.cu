// SPDX-License-Identifier: Apache-2.0
/// @file  The CUDA backend: memory, launches, steps that are repeated as graphs.
#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/step_graph.cuh>
#include <gsh/backend/memory.hpp>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <new>
#include <numeric>
#include <vector>

namespace {

using namespace gsh;
using cuda::Device;

template <class T>
std::vector<T> fetch(Device& device, const Device::Buffer<T>& buffer) {
    return downloaded(device, Span<const T>(buffer));
}

/// to[i] = factor from[i] + i.
struct Line {
    Span<const float> from;
    Span<float> to;
    float factor;
    GSH_HD void operator()(std::size_t i) const { to[i] = factor * from[i] + static_cast<float>(i); }
};

struct Sum3 {
    Span<const float> a, b, c;
    Span<float> to;
    GSH_HD void operator()(std::size_t i) const { to[i] = a[i] + b[i] + c[i]; }
};

/// to[i] = factor or 2 factor. Three bytes after `twice` are padding.
struct Padded {
    Span<float> to;
    bool twice;
    float factor;
    GSH_HD void operator()(std::size_t i) const { to[i] = twice ? 2 * factor : factor; }
};

/// Sums of blocks of 64 numbers, through shared memory.
struct BlockSums {
    static constexpr unsigned block_size = 64;
    struct Shared {
        cuda::SharedArray<float, 64> values;
    };
    Span<const float> from;
    Span<float> to;

    __device__ void operator()(Shared& shared) const {
        const std::size_t i = std::size_t(blockIdx.x) * block_size + threadIdx.x;
        shared.values[threadIdx.x] = i < from.size() ? from[i] : 0.0f;
        __syncthreads();
        if (threadIdx.x != 0) return;
        float sum = 0;
        for (unsigned k = 0; k < block_size; ++k) sum += shared.values[k];
        to[blockIdx.x] = sum;
    }
};

} // namespace

TEST_CASE("Device moves, fills and computes arrays of any length") {
    if (test::skip_without_device()) return;
    Device device;
    for (const std::size_t n : {0u, 1u, 31u, 32u, 33u, 255u, 256u, 257u, 3000u}) {
        CAPTURE(n);
        std::vector<float> host(n);
        std::iota(host.begin(), host.end(), 1.0f);
        Device::Buffer<float> a(n), b(n), c(n);
        device.upload(Span<const float>(host), Span<float>(a));
        device.fill(Span<float>(b), 7.0f);
        device.for_each(n, Line{a, b, 2.0f});
        device.copy(Span<const float>(b), Span<float>(c));
        const std::vector<float> result = fetch(device, c);
        for (std::size_t i = 0; i < n; ++i) REQUIRE(result[i] == 2 * host[i] + static_cast<float>(i));
    }
}

TEST_CASE("A kernel with shared memory sums its blocks") {
    if (test::skip_without_device()) return;
    Device device;
    const std::size_t n = 150, blocks = 3;
    std::vector<float> host(n, 1.0f);
    Device::Buffer<float> from(n), to(blocks);
    device.upload(Span<const float>(host), Span<float>(from));
    device.launch(blocks, BlockSums{from, to});
    CHECK(fetch(device, to) == std::vector<float>{64, 64, 22});
}

TEST_CASE("Device distinguishes its memory from the host's") {
    if (test::skip_without_device()) return;
    Device device;
    Device::Buffer<float> buffer(10);
    const std::vector<float> host(10);
    CHECK(device.owns(buffer.data(), 40));
    CHECK_FALSE(device.owns(host.data(), 40));
    CHECK_THROWS_WITH_AS(check_memory(device, "f", "x", Span<const float>(host)),
                         "f: x is not memory of the backend 'cuda'; upload it into a Buffer of the backend first",
                         MemoryError);
}

TEST_CASE("A buffer keeps its memory when it shrinks and when it moves") {
    if (test::skip_without_device()) return;
    Device device;
    Device::Buffer<int> a(100);
    device.fill(Span<int>(a), 3);
    const int* const memory = a.data();
    a.resize(10);
    a.resize(100);
    CHECK(a.data() == memory);
    Device::Buffer<int> moved = std::move(a), other(5);
    CHECK(moved.data() == memory);
    other = std::move(moved);
    CHECK(other.data() == memory);
    CHECK(moved.empty());
    CHECK(fetch(device, other) == std::vector<int>(100, 3));
}

TEST_CASE("Host memory may change as soon as an upload returns, whatever its kind") {
    if (test::skip_without_device()) return;
    Device device;
    const std::size_t n = 1 << 20;
    int* pinned = nullptr;
    REQUIRE(cudaMallocHost(&pinned, n * sizeof(int)) == cudaSuccess);
    std::vector<int> pageable(n);
    for (const Span<int> host : {Span<int>(pinned, n), Span<int>(pageable)}) {
        Device::Buffer<int> buffer(n);
        for (int round = 0; round < 3; ++round) {
            std::fill(host.begin(), host.end(), round);
            device.upload(Span<const int>(host), Span<int>(buffer));
            std::fill(host.begin(), host.end(), -1);
            CHECK(fetch(device, buffer) == std::vector<int>(n, round));
        }
    }
    REQUIRE(cudaFreeHost(pinned) == cudaSuccess);
}

TEST_CASE("Memory of the GPU is refused where the host's is due") {
    if (test::skip_without_device()) return;
    Device device;
    Device::Buffer<float> a(10), b(10);
    CHECK_THROWS_WITH_AS(device.upload(Span<const float>(a), Span<float>(b)),
                         "gsh::cuda::Device::upload: from is memory of a GPU, expected host memory; Device::copy copies "
                         "within the GPU",
                         MemoryError);
    CHECK_THROWS_WITH_AS(device.download(Span<const float>(a), Span<float>(b)),
                         doctest::Contains("download: to is memory of a GPU"), MemoryError);
}

TEST_CASE("Device works on the caller's stream and waits for its events") {
    if (test::skip_without_device()) return;
    cudaStream_t mine = nullptr;
    REQUIRE(cudaStreamCreateWithFlags(&mine, cudaStreamNonBlocking) == cudaSuccess);
    {
        Device device(mine), other;
        Device::Buffer<int> a(10), b(10);
        cudaEvent_t done = nullptr;
        REQUIRE(cudaEventCreateWithFlags(&done, cudaEventDisableTiming) == cudaSuccess);
        device.fill(Span<int>(a), 5);
        device.record(done);
        other.wait(done);
        other.copy(Span<const int>(a), Span<int>(b));
        CHECK(fetch(other, b) == std::vector<int>(10, 5));
        cudaEventDestroy(done);
    }
    CHECK(cudaStreamDestroy(mine) == cudaSuccess);
}

TEST_CASE("A repeated step is one graph, whose arguments follow the step") {
    if (test::skip_without_device()) return;
    Device device;
    const std::size_t n = 1000;
    Device::Buffer<float> a(n), b(n);
    Device::Buffer<float> table(3);
    cuda::StepGraph graph(device);
    device.fill(Span<float>(a), 1.0f);
    std::vector<float> expected(n, 1.0f);
    for (int step = 1; step <= 5; ++step) {
        const float factor = std::ldexp(1.0f, -step); // exact products: a GPU fuses them with sums
        graph.run([&] {
            const std::vector<float> rates(3, factor); // gone when the graph runs
            device.upload(Span<const float>(rates), Span<float>(table));
            device.for_each(n, Line{a, b, factor});
            device.copy(Span<const float>(b), Span<float>(a));
        });
        for (std::size_t i = 0; i < n; ++i) expected[i] = factor * expected[i] + static_cast<float>(i);
        CHECK(fetch(device, table) == std::vector<float>(3, factor));
    }
    CHECK(fetch(device, a) == expected);
    CHECK(graph.counts().captures == 1);
    CHECK(graph.counts().launches == 5);
    CHECK(graph.counts().updates == 8); // of two launches in four steps; the copy has the same arguments
}

TEST_CASE("Padding between the arguments of a kernel is not an argument") {
    if (test::skip_without_device()) return;
    Device device;
    Device::Buffer<float> a(100);
    cuda::StepGraph graph(device);
    for (int step = 0; step < 4; ++step)
        graph.run([&] {
            alignas(Padded) unsigned char bytes[sizeof(Padded)];
            std::memset(bytes, 16 * step, sizeof bytes);
            device.for_each(100, *new (bytes) Padded{a, true, 0.5f});
        });
    CHECK(fetch(device, a) == std::vector<float>(100, 1.0f));
#if defined(__has_builtin) && __has_builtin(__builtin_clear_padding)
    CHECK(graph.counts().updates == 0);
#endif
}

TEST_CASE("A step that changes is captured anew, from the first difference on") {
    if (test::skip_without_device()) return;
    Device device;
    Device::Buffer<float> a(100), b(100), total(10);
    const auto run = [&](bool direct) {
        cuda::StepGraph graph(device);
        device.fill(Span<float>(a), 1.0f);
        std::vector<float> result;
        for (int step = 0; step < 8; ++step) {
            const auto work = [&] {
                const std::size_t n = step < 4 ? 100 : 40; // other numbers of blocks
                device.for_each(n, Line{Span<const float>(a).subspan(0, n), b, 0.5f});
                if (step % 3 == 1) device.fill(Span<float>(a), 2.0f); // a kernel more
                device.launch(2, BlockSums{b, total});
                device.copy(Span<const float>(b), Span<float>(a));
            };
            if (direct) work();
            else graph.run(work);
        }
        const std::vector<float> of_a = fetch(device, a), of_total = fetch(device, total);
        result.insert(result.end(), of_a.begin(), of_a.end());
        result.insert(result.end(), of_total.begin(), of_total.begin() + 2);
        return result;
    };
    CHECK(run(true) == run(false));
}

TEST_CASE("Branches do not wait for each other, and what follows waits for all") {
    if (test::skip_without_device()) return;
    Device device;
    const std::size_t n = 100;
    Device::Buffer<float> start(n), middle(3 * n), ends(3 * n), sum(n);
    const auto part = [&](auto& buffer, std::size_t i) { return Span<float>(buffer).subspan(i * n, n); };
    const auto run = [&](bool direct) {
        cuda::StepGraph graph(device);
        std::vector<float> result;
        for (int step = 0; step < 8; ++step) {
            const auto work = [&] {
                device.fill(Span<float>(start), static_cast<float>(step));
                for_each_branch(device, step < 5 ? 3 : 2, [&](std::size_t i) {
                    const auto factor = static_cast<float>(i + 1);
                    device.for_each(n, Line{start, part(middle, i), factor});
                    if (i == 1 && step == 3) { // a download cuts the graph inside of a branch
                        float seen = 0;
                        device.download(Span<const float>(part(middle, i)).subspan(7, 1), Span<float>(&seen, 1));
                        CHECK(seen == 2.0f * static_cast<float>(step) + 7);
                    }
                    for_each_branch(device, 2, [&](std::size_t half) { // within a branch, one after the other
                        if (half == 0) device.for_each(n, Line{part(middle, i), part(ends, i), 0.5f});
                        if (half == 1) device.for_each(n, Line{part(ends, i), part(middle, i), 0.5f});
                    });
                });
                for_each_branch(device, 0, [](std::size_t) {});
                device.for_each(n, Sum3{part(middle, 0), part(middle, 1), part(middle, 2), sum});
                device.copy(Span<const float>(sum), part(middle, 2));
            };
            if (direct) work();
            else graph.run(work);
            const std::vector<float> of_sum = fetch(device, sum);
            result.insert(result.end(), of_sum.begin(), of_sum.end());
        }
        return result;
    };
    device.fill(Span<float>(middle), 0.0f);
    const std::vector<float> direct = run(true);
    device.fill(Span<float>(middle), 0.0f);
    CHECK(run(false) == direct);
}

TEST_CASE("A download, a large upload and a growing buffer are allowed in a step") {
    if (test::skip_without_device()) return;
    Device device;
    cuda::StepGraph graph(device);
    Device::Buffer<float> grows, large(20000);
    for (std::size_t step = 1; step <= 4; ++step) {
        float seen = 0;
        graph.run([&] {
            grows.resize(10 * step);
            device.fill(Span<float>(grows), 1.0f);
            grows.resize(1000 * step); // the memory that the kernel before uses must not be freed yet
            device.fill(Span<float>(grows), static_cast<float>(step));
            device.download(Span<const float>(grows).subspan(step, 1), Span<float>(&seen, 1));
            const std::vector<float> many(20000, seen + 1);
            device.upload(Span<const float>(many), Span<float>(large));
        });
        CHECK(seen == static_cast<float>(step));
        CHECK(fetch(device, large)[19999] == static_cast<float>(step + 1));
    }
}

TEST_CASE("The kernels of the last step are timed one by one, with their names and stages") {
    if (test::skip_without_device()) return;
    Device device;
    cuda::StepGraph graph(device);
    Device::Buffer<float> a(10), b(10), sums(1);
    const auto step = [&] {
        device.mark("prepare");
        device.fill(Span<float>(a), 1.0f);
        device.mark("compute");
        device.for_each(10, Line{a, b, 2.0f});
        std::vector<float> seen(10);
        device.download(Span<const float>(b), Span<float>(seen)); // cuts the graph
        device.launch(1, BlockSums{b, sums});
    };
    for (int k = 0; k < 2; ++k) {
        graph.run(step);
        const std::vector<cuda::KernelTime> times = graph.time_kernels(3);
        REQUIRE(times.size() == 3);
        CHECK(times[0].kernel == "Fill<float>");
        CHECK(times[0].stage == "prepare");
        CHECK(times[1].kernel == "Line");
        CHECK(times[1].stage == "compute");
        CHECK(times[2].kernel == "BlockSums");
        for (const cuda::KernelTime& time : times) CHECK(time.microseconds > 0);
    }
    CHECK(fetch(device, sums)[0] == 65.0f); // 2 · 1 + i, summed: the repeats have the arguments of the step
    graph.run(step);
    CHECK(fetch(device, sums)[0] == 65.0f);
}

TEST_CASE("Arrays that a step zeroes one after the other share a launch") {
    if (test::skip_without_device()) return;
    Device device;
    cuda::StepGraph graph(device);
    Device::Buffer<float> a(10), b(10), large(5000), empty;
    Device::Buffer<double> wide(3);
    Device::Buffer<std::uint8_t> bytes(7);
    std::vector<Device::Buffer<float>> many;
    for (std::size_t i = 0; i < 9; ++i) many.emplace_back(1024 + i);
    for (int k = 0; k < 3; ++k) {
        for (auto* buffer : {&a, &b, &large}) device.fill(Span<float>(*buffer), 5.0f);
        for (auto& buffer : many) device.fill(Span<float>(buffer), 6.0f);
        device.fill(Span<double>(wide), 7.0);
        graph.run([&] {
            device.fill(Span<float>(a).subspan(1, 8), 0.0f);
            device.fill(Span<float>(empty), 0.0f);
            device.fill(Span<double>(wide), 0.0);
            device.fill(Span<float>(large), 0.0f);
            device.for_each(10, Line{a, b, 2.0f}); // reads zeros
            device.fill(Span<float>(a), -0.0f);    // has a bit that is set
            device.fill(Span<std::uint8_t>(bytes), std::uint8_t(0)); // no words
            for (auto& buffer : many) device.fill(Span<float>(buffer), 0.0f);
            device.for_each_branch(2, [&](std::size_t branch) {
                device.fill(Span<float>(large).subspan(branch, 1), 0.0f);
            });
        });
        CHECK(fetch(device, b)[0] == 10.0f); // 2 · 5 + 0
        CHECK(fetch(device, b)[5] == 5.0f);  // 2 · 0 + 5
        const std::vector<cuda::KernelTime> times = graph.time_kernels(1);
        std::vector<std::string> names;
        for (const cuda::KernelTime& time : times) names.push_back(time.kernel);
        CHECK(names == std::vector<std::string>{"ZeroFills", "Line", "Fill<float>", "Fill<unsigned char>", "ZeroFills",
                                                "ZeroFills", "ZeroFills", "ZeroFills"}); // 8 arrays, 1, a branch each
        CHECK(fetch(device, wide) == std::vector<double>(3, 0.0));
        CHECK(fetch(device, large) == std::vector<float>(5000, 0.0f));
        for (auto& buffer : many) CHECK(fetch(device, buffer) == std::vector<float>(buffer.size(), 0.0f));
    }
}

TEST_CASE("An exception inside a step leaves the device usable") {
    if (test::skip_without_device()) return;
    Device device;
    cuda::StepGraph graph(device);
    Device::Buffer<int> a(10);
    for (int step = 0; step < 3; ++step) {
        const auto work = [&] {
            device.fill(Span<int>(a), step);
            if (step == 1) throw ValueError("planted");
        };
        if (step == 1) CHECK_THROWS_AS(graph.run(work), ValueError);
        else graph.run(work);
    }
    CHECK(fetch(device, a) == std::vector<int>(10, 2));
}

namespace {

/// Adds one to all numbers, unless the device has halted.
struct AddOne {
    Span<const std::uint32_t> halt;
    Span<int> numbers;
    GSH_HD void operator()(std::size_t i) const {
        if (!is_halted(halt)) ++numbers[i];
    }
};
/// Halts the device.
struct Halt {
    Span<std::uint32_t> halt;
    GSH_HD void operator()(std::size_t) const { halt[0] = 1; }
};

} // namespace

TEST_CASE("After a step that halts the device, queued steps change nothing, and settle counts them") {
    if (test::skip_without_device()) return;
    Device device;
    Device::Buffer<int> numbers(3);
    device.fill(Span<int>(numbers), 0);
    RepeatedStep<Device> repeated(device);
    const auto step = [&](bool fails) {
        repeated.run(fails, [&] {
            if (fails) device.for_each(1, Halt{device.halted()});
            device.for_each(3, AddOne{halt_word(device), numbers});
        });
    };
    for (int i = 0; i < 5; ++i) step(false);
    CHECK(repeated.settle() == 0);
    step(false);
    step(true);
    step(false);
    step(false);
    CHECK(fetch(device, numbers) == std::vector<int>(3, 6));
    CHECK(repeated.settle() == 3);
    step(false);
    CHECK(repeated.settle() == 0);
    CHECK(fetch(device, numbers) == std::vector<int>(3, 7));
}
