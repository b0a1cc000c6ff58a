// SPDX-License-Identifier: Apache-2.0
/// @file  The emulation of a GPU finds the mistakes that kernels make: each is planted here.
#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/step_graph.cuh>

#include <doctest/doctest.h>

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace {

using namespace gsh;
using cuda::Device;
using cuda::SharedArray;
using test::CudaEmulation;
using test::KernelFault;
using test::Order;

/// A kernel whose body is a function without state.
template <class Body, class SharedMemory, unsigned Threads = 64>
struct Planted {
    static constexpr unsigned block_size = Threads;
    using Shared = SharedMemory;
    Span<unsigned> out;
    void operator()(Shared& shared) const { Body{}(shared, out); }
};

struct Words {
    SharedArray<unsigned, 64> words;
    SharedArray<unsigned, 1> total;
};

/// Runs a body on 64 threads in each order; returns the message of the fault, or an empty string.
template <unsigned Threads = 64, class Body>
std::string fault_of(const Body&, unsigned blocks = 1) {
    std::string message;
    for (const Order order : {Order::forward, Order::reverse, Order::random}) {
        CudaEmulation::instance().order = order;
        Device device;
        Device::Buffer<unsigned> out(64);
        device.fill(Span<unsigned>(out), 0u);
        device.launch(blocks, Planted<Body, Words, Threads>{out});
        try {
            device.synchronize();
        } catch (const KernelFault& fault) {
            message = fault.what();
        }
    }
    CudaEmulation::instance().order = Order::forward;
    return message;
}

bool contains(const std::string& text, const char* part) {
    return text.find(part) != std::string::npos;
}

} // namespace

TEST_CASE("A correct kernel has no fault and the same result in every order") {
    struct Reverse {
        void operator()(Words& shared, Span<unsigned> out) const {
            shared.words[threadIdx.x] = threadIdx.x;
            __syncthreads();
            const unsigned other = shared.words[63 - threadIdx.x];
            __syncthreads();
            shared.words[threadIdx.x] = other;
            unsigned sum = other;
            for (int d = 16; d > 0; d /= 2) sum += __shfl_xor_sync(cuda::all_lanes, sum, d);
            out[threadIdx.x] = sum + __popc(__ballot_sync(cuda::all_lanes, other % 3 == 0));
        }
    };
    std::vector<unsigned> first;
    for (const Order order : {Order::forward, Order::reverse, Order::random}) {
        CudaEmulation::instance().order = order;
        Device device;
        Device::Buffer<unsigned> out(64);
        device.launch(1, Planted<Reverse, Words>{out});
        std::vector<unsigned> result(64);
        device.download(Span<const unsigned>(out), Span<unsigned>(result));
        if (first.empty()) first = result;
        CHECK(result == first);
        CHECK(result[0] == (32 + 63) * 16 + 11); // words 63 … 32; 33, 36, …, 63 are multiples of three
        CHECK(result[32] == 31 * 16 + 11);       // 0, 3, …, 30
    }
    CudaEmulation::instance().order = Order::forward;
}

TEST_CASE("Accesses beyond an array are found") {
    struct BeyondShared {
        void operator()(Words& shared, Span<unsigned>) const { shared.words[threadIdx.x + 1] = 1; }
    };
    CHECK(contains(fault_of(BeyondShared{}), "shared memory of 64 elements, index 64"));
    struct BeyondGlobal {
        void operator()(Words&, Span<unsigned> out) const { out[threadIdx.x + 1] = 1; }
    };
    CHECK(contains(fault_of(BeyondGlobal{}), "a span of 64 elements, index 64"));
}

TEST_CASE("Reads of uninitialised memory are found") {
    struct Never {
        void operator()(Words& shared, Span<unsigned> out) const { out[threadIdx.x] = shared.words[threadIdx.x]; }
    };
    CHECK(contains(fault_of(Never{}), "uninitialised shared memory is read"));
    struct OfAnotherBlock { // written by block 0, read by block 1
        void operator()(Words& shared, Span<unsigned> out) const {
            if (blockIdx.x == 0) shared.words[threadIdx.x] = 1;
            __syncthreads();
            if (blockIdx.x == 1) out[threadIdx.x] = shared.words[threadIdx.x];
        }
    };
    CHECK(contains(fault_of(OfAnotherBlock{}, 2), "uninitialised shared memory is read"));

    // Global memory: its first contents differ between two runs, and so does a result that depends on them.
    struct CopyOne {
        Span<const unsigned> from;
        Span<unsigned> to;
        void operator()(std::size_t i) const { to[i] = from[i]; }
    };
    std::vector<unsigned> results;
    for (const unsigned char fill : {0xA5, 0x5A}) {
        CudaEmulation::instance().fill = fill;
        Device device;
        Device::Buffer<unsigned> from(1), to(1);
        device.for_each(1, CopyOne{from, to});
        results.resize(results.size() + 1);
        device.download(Span<const unsigned>(to), Span<unsigned>(&results.back(), 1));
    }
    CudaEmulation::instance().fill = 0xA5;
    CHECK(results[0] != results[1]);
}

TEST_CASE("Races in shared memory are found") {
    struct NoBarrier {
        void operator()(Words& shared, Span<unsigned> out) const {
            shared.words[threadIdx.x] = 1;
            out[threadIdx.x] = shared.words[63 - threadIdx.x];
        }
    };
    const std::string no_barrier = fault_of(NoBarrier{}); // a thread that comes first reads what is not written yet
    CHECK((contains(no_barrier, "race in shared memory") || contains(no_barrier, "uninitialised")));
    struct ReadThenWrite {
        void operator()(Words& shared, Span<unsigned> out) const {
            shared.words[threadIdx.x] = 1;
            __syncthreads();
            out[threadIdx.x] = shared.words[63 - threadIdx.x];
            shared.words[threadIdx.x] = 2;
        }
    };
    CHECK(contains(fault_of(ReadThenWrite{}), "race in shared memory"));
    struct SameElement {
        void operator()(Words& shared, Span<unsigned>) const { shared.total[0] = threadIdx.x; }
    };
    CHECK(contains(fault_of(SameElement{}), "race in shared memory: a write"));
    struct WithinWarp {
        void operator()(Words& shared, Span<unsigned> out) const {
            shared.words[threadIdx.x] = threadIdx.x;
            out[threadIdx.x] = shared.words[threadIdx.x ^ 1u];
        }
    };
    const std::string within = fault_of(WithinWarp{});
    CHECK((contains(within, "race in shared memory") || contains(within, "uninitialised")));
    struct WarpBarrierAcrossWarps { // __syncwarp orders the lanes of one warp, not two warps
        void operator()(Words& shared, Span<unsigned> out) const {
            shared.words[threadIdx.x] = 1;
            __syncthreads();
            if (threadIdx.x < 32) shared.words[threadIdx.x] = 2;
            __syncwarp();
            out[threadIdx.x] = shared.words[threadIdx.x ^ 32u];
        }
    };
    CHECK(contains(fault_of(WarpBarrierAcrossWarps{}), "race in shared memory"));
    struct WarpBarrier {
        void operator()(Words& shared, Span<unsigned> out) const {
            for (unsigned i = 0; i < 3; ++i) {
                shared.words[threadIdx.x] = i;
                __syncwarp();
                out[threadIdx.x] += shared.words[threadIdx.x ^ 1u];
                __syncwarp();
            }
        }
    };
    CHECK(fault_of(WarpBarrier{}) == "");
    struct AtomicSum {
        void operator()(Words& shared, Span<unsigned> out) const {
            if (threadIdx.x == 0) shared.total[0] = 0;
            __syncthreads();
            shared.total.atomic(0, [](unsigned v) { return v + 1; });
            __syncthreads();
            out[threadIdx.x] = shared.total[0];
        }
    };
    CHECK(fault_of(AtomicSum{}) == "");
    struct AtomicAndRead {
        void operator()(Words& shared, Span<unsigned> out) const {
            if (threadIdx.x == 0) shared.total[0] = 0;
            __syncthreads();
            shared.total.atomic(0, [](unsigned v) { return v + 1; });
            out[threadIdx.x] = shared.total[0];
        }
    };
    CHECK(contains(fault_of(AtomicAndRead{}), "race in shared memory"));
}

TEST_CASE("Divergent and missing barriers are found") {
    struct TwoPlaces {
        void operator()(Words&, Span<unsigned>) const {
            if (threadIdx.x % 2)
                __syncthreads();
            else
                __syncthreads();
        }
    };
    const std::string two = fault_of(TwoPlaces{});
    CHECK(contains(two, "wait for each other: 32 wait at __syncthreads (emulation_test.cpp:"));
    struct OneEnds {
        void operator()(Words&, Span<unsigned>) const {
            if (threadIdx.x == 5) return;
            __syncthreads();
        }
    };
    const std::string one = fault_of(OneEnds{});
    CHECK(contains(one, "1 have ended"));
    CHECK(contains(one, "63 wait at __syncthreads"));
    struct WarpAgainstBlock {
        void operator()(Words&, Span<unsigned>) const {
            if (threadIdx.x < 16) __syncwarp();
            __syncthreads();
        }
    };
    CHECK(contains(fault_of(WarpAgainstBlock{}), "16 wait at __syncwarp"));
}

TEST_CASE("Wrong masks of a warp are found") {
    struct NotInOwnMask {
        void operator()(Words&, Span<unsigned> out) const { out[threadIdx.x] = __ballot_sync(0xFFFEu, 1); }
    };
    CHECK(contains(fault_of(NotInOwnMask{}), "is not in its own mask"));
    struct HalfIsMissing {
        void operator()(Words&, Span<unsigned> out) const {
            if (threadIdx.x % 32 < 16) out[threadIdx.x] = __shfl_xor_sync(cuda::all_lanes, threadIdx.x, 1);
        }
    };
    CHECK(contains(fault_of(HalfIsMissing{}), "wait at __shfl_xor_sync"));
    struct FromOutside {
        void operator()(Words&, Span<unsigned> out) const {
            if (threadIdx.x % 32 < 16) out[threadIdx.x] = __shfl_sync(0xFFFFu, threadIdx.x, 20);
        }
    };
    CHECK(contains(fault_of(FromOutside{}), "takes the value of lane 20, which is not in the mask"));
    struct HalfAWarp { // of a block with 48 threads
        void operator()(Words&, Span<unsigned> out) const { out[threadIdx.x] = __ballot_sync(cuda::all_lanes, 1); }
    };
    CHECK(contains(fault_of<48>(HalfAWarp{}), "wait at __ballot_sync"));
}

TEST_CASE("A kernel that receives the address of host memory is found, and so is a host that reads device memory") {
    struct Store {
        Span<unsigned> to;
        void operator()(std::size_t i) const { to[i] = 1; }
    };
    Device device;
#if __has_builtin(__builtin_clear_padding)
    std::vector<unsigned> host(1);
    device.for_each(1, Store{host});
    CHECK_THROWS_WITH_AS(device.synchronize(), doctest::Contains("holds the address of host memory"), KernelFault);
#endif

    Device::Buffer<unsigned> buffer(1);
    device.fill(Span<unsigned>(buffer), 1u);
    device.synchronize();
    const pid_t child = fork();
    if (child == 0) { // the access is a crash: doctest and the sanitizers would report it
        signal(SIGSEGV, SIG_DFL);
        _exit(static_cast<int>(*const_cast<const volatile unsigned*>(buffer.data())));
    }
    int status = 0;
    waitpid(child, &status, 0);
    CHECK(WIFSIGNALED(status));
    CHECK(WTERMSIG(status) == SIGSEGV);
}

TEST_CASE("A host buffer that is used again too early is found") {
    Device device;
    Device::Buffer<unsigned> buffer(1);
    unsigned* pinned = nullptr;
    REQUIRE(cudaMallocHost(&pinned, sizeof *pinned) == cudaSuccess);
    *pinned = 1;
    REQUIRE(cudaMemcpyAsync(buffer.data(), pinned, sizeof *pinned, cudaMemcpyHostToDevice, device.stream()) ==
            cudaSuccess);
    *pinned = 2;
    CHECK_THROWS_WITH_AS(device.synchronize(), doctest::Contains("has changed before the copy ran"), KernelFault);
    cudaFreeHost(pinned);

    unsigned pageable = 1, result = 0; // such memory is staged at once, as the runtime does
    device.upload(Span<const unsigned>(&pageable, 1), Span<unsigned>(buffer));
    pageable = 2;
    device.download(Span<const unsigned>(buffer), Span<unsigned>(&result, 1));
    CHECK(result == 1);
}

TEST_CASE("A graph keeps the arguments of its capture until they are replaced") {
    Device device;
    Device::Buffer<unsigned> buffer(1);
    cudaGraph_t graph = nullptr;
    cudaGraphExec_t executable = nullptr;
    unsigned result = 0;
    REQUIRE(cudaStreamBeginCapture(device.stream(), cudaStreamCaptureModeGlobal) == cudaSuccess);
    unsigned value = 1;
    device.fill(Span<unsigned>(buffer), value);
    value = 2;
    REQUIRE(cudaStreamEndCapture(device.stream(), &graph) == cudaSuccess);
    REQUIRE(cudaGraphInstantiate(&executable, graph, 0) == cudaSuccess);
    REQUIRE(cudaGraphLaunch(executable, device.stream()) == cudaSuccess);
    device.download(Span<const unsigned>(buffer), Span<unsigned>(&result, 1));
    CHECK(result == 1);
    cudaGraphExecDestroy(executable);
    cudaGraphDestroy(graph);
}

TEST_CASE("Branches of a graph take their turns in each order, and mistakes show") {
    // Two branches of two fills each, and a copy of what they leave. `shared` is the mistake: both write one number.
    const auto run = [](Order order, bool shared) {
        CudaEmulation::instance().order = order;
        Device device;
        Device::Buffer<unsigned> numbers(2), result(2);
        cuda::StepGraph graph(device);
        for (int step = 0; step < 2; ++step)
            graph.run([&] {
                device.fill(Span<unsigned>(numbers), 9u);
                for_each_branch(device, 2, [&](std::size_t i) {
                    const Span<unsigned> mine = Span<unsigned>(numbers).subspan(shared ? 0 : i, 1);
                    device.fill(mine, 5u);
                    device.fill(mine, static_cast<unsigned>(i));
                });
                device.copy(Span<const unsigned>(numbers), Span<unsigned>(result));
            });
        std::vector<unsigned> host(2);
        device.download(Span<const unsigned>(result), Span<unsigned>(host));
        CudaEmulation::instance().order = Order::forward;
        return host;
    };
    for (const Order order : {Order::forward, Order::reverse, Order::random})
        CHECK(run(order, false) == std::vector<unsigned>{0, 1});
    CHECK(run(Order::forward, true)[0] == 1);
    CHECK(run(Order::reverse, true)[0] == 0);
}

TEST_CASE("Results that depend on the order of blocks or threads differ between the orders") {
    struct LastWins {
        void operator()(Words&, Span<unsigned> out) const { out[0] = blockIdx.x; }
    };
    std::vector<unsigned> results;
    for (const Order order : {Order::forward, Order::reverse}) {
        CudaEmulation::instance().order = order;
        Device device;
        Device::Buffer<unsigned> out(64);
        device.launch(3, Planted<LastWins, Words>{out});
        std::vector<unsigned> result(64);
        device.download(Span<const unsigned>(out), Span<unsigned>(result));
        results.push_back(result[0]);
    }
    CudaEmulation::instance().order = Order::forward;
    CHECK(results[0] != results[1]);
}
