// SPDX-License-Identifier: Apache-2.0
/// @file  The emulation of a GPU finds the mistakes that kernels make: each is planted here.
#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/step_graph.cuh>

#include <doctest/doctest.h>

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <utility>
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

constexpr Order orders[] = {Order::forward, Order::reverse, Order::random};

/// Runs a body on 64 threads in an order; returns the message of the fault, or an empty string.
template <unsigned Threads, class Body>
std::string fault_of(Order order, unsigned blocks) {
    std::string message;
    CudaEmulation::instance().order = order;
    {
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

bool contains(const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos;
}

/// The body has a fault in each order, whose message has this part.
template <unsigned Threads = 64, class Body>
void check_fault(const Body&, const std::string& part, unsigned blocks = 1) {
    CAPTURE(cuda::detail::kernel_name<Body>());
    for (const Order order : orders) {
        CAPTURE(int(order));
        const std::string message = fault_of<Threads, Body>(order, blocks);
        CAPTURE(message);
        CHECK(contains(message, part));
    }
}
/// The body races in each order: forward and reverse at this operation, where these messages go on as given.
template <class Body>
void check_race(const Body& body, const std::string& forward, const std::string& reverse) {
    check_fault(body, "race in shared memory: ");
    CAPTURE(cuda::detail::kernel_name<Body>());
    const std::string in_forward = fault_of<64, Body>(Order::forward, 1);
    const std::string in_reverse = fault_of<64, Body>(Order::reverse, 1);
    CAPTURE(in_forward);
    CAPTURE(in_reverse);
    CHECK(contains(in_forward, "race in shared memory: " + forward));
    CHECK(contains(in_reverse, "race in shared memory: " + reverse));
}
template <class Body>
void check_no_fault(const Body&) {
    CAPTURE(cuda::detail::kernel_name<Body>());
    for (const Order order : orders) {
        CAPTURE(int(order));
        CHECK(fault_of<64, Body>(order, 1) == "");
    }
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
    for (const Order order : orders) {
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
    check_fault(BeyondShared{}, "shared memory of 64 elements, index 64");
    struct BeyondGlobal {
        void operator()(Words&, Span<unsigned> out) const { out[threadIdx.x + 1] = 1; }
    };
    check_fault(BeyondGlobal{}, "a span of 64 elements, index 64");
}

TEST_CASE("Reads of uninitialised memory are found") {
    struct Never {
        void operator()(Words& shared, Span<unsigned> out) const { out[threadIdx.x] = shared.words[threadIdx.x]; }
    };
    check_fault(Never{}, "uninitialised shared memory is read");
    struct TooEarly { // a thread that comes first reads what is not written yet
        void operator()(Words& shared, Span<unsigned> out) const {
            shared.words[threadIdx.x] = 1;
            out[threadIdx.x] = shared.words[63 - threadIdx.x];
        }
    };
    check_fault(TooEarly{}, "uninitialised shared memory is read");
    struct OfAnotherBlock { // written by block 0, read by block 1
        void operator()(Words& shared, Span<unsigned> out) const {
            if (blockIdx.x == 0) shared.words[threadIdx.x] = 1;
            __syncthreads();
            if (blockIdx.x == 1) out[threadIdx.x] = shared.words[threadIdx.x];
        }
    };
    check_fault(OfAnotherBlock{}, "uninitialised shared memory is read", 2);

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

TEST_CASE("Races in shared memory are found across warps") {
    struct NoBarrier {
        void operator()(Words& shared, Span<unsigned> out) const {
            shared.words[threadIdx.x] = 0;
            __syncthreads();
            shared.words[threadIdx.x] = 1;
            out[threadIdx.x] = shared.words[63 - threadIdx.x];
        }
    };
    check_race(NoBarrier{}, "a write and a read of thread 31 ", "a write and a read of thread 32 ");
    struct ReadThenWrite {
        void operator()(Words& shared, Span<unsigned> out) const {
            shared.words[threadIdx.x] = 1;
            __syncthreads();
            out[threadIdx.x] = shared.words[63 - threadIdx.x];
            shared.words[threadIdx.x] = 2;
        }
    };
    check_race(ReadThenWrite{}, "a read and a write of thread 31 ", "a read and a write of thread 32 ");
    struct SameElement {
        void operator()(Words& shared, Span<unsigned>) const {
            if (threadIdx.x % 32 == 7) shared.total[0] = threadIdx.x;
        }
    };
    check_race(SameElement{}, "a write and a write of thread 7 ", "a write and a write of thread 39 ");
    struct ReadByBothWarps { // also by the thread that writes then
        void operator()(Words& shared, Span<unsigned> out) const {
            if (threadIdx.x == 0) shared.total[0] = 0;
            __syncthreads();
            if (threadIdx.x == 7) out[0] = shared.total[0];
            __syncwarp();
            if (threadIdx.x == 39) out[1] = shared.total[0];
            if (threadIdx.x == 39) shared.total[0] = 1;
        }
    };
    check_race(ReadByBothWarps{}, "a write and a read of thread 7 ", "a write and a read of thread 7 ");
    struct WarpBarrierAcrossWarps { // __syncwarp orders the lanes of one warp, not two warps
        void operator()(Words& shared, Span<unsigned> out) const {
            shared.words[threadIdx.x] = 1;
            __syncthreads();
            if (threadIdx.x < 32) shared.words[threadIdx.x] = 2;
            __syncwarp();
            out[threadIdx.x] = shared.words[threadIdx.x ^ 32u];
        }
    };
    check_race(WarpBarrierAcrossWarps{}, "a read and a write of thread 0 ", "a read and a write of thread 31 ");
}

TEST_CASE("Races in shared memory are found within a warp") {
    // Words of each warp, which have values before; no thread accesses a word of the other warp.
    struct NoBarrier { // odd words are written and read
        void operator()(Words& shared, Span<unsigned> out) const {
            shared.words[threadIdx.x] = 0;
            __syncthreads();
            if (threadIdx.x % 2 == 1) shared.words[threadIdx.x] = 1;
            else out[threadIdx.x] = shared.words[threadIdx.x + 1];
        }
    };
    check_race(NoBarrier{}, "a write and a read of thread 0 ", "a read and a write of thread 63 ");
    struct SameElement {
        void operator()(Words& shared, Span<unsigned>) const { shared.words[threadIdx.x / 32] = threadIdx.x; }
    };
    check_race(SameElement{}, "a write and a write of thread 0 ", "a write and a write of thread 63 ");
    struct ReadByTwoLanes { // also by the one that writes then
        void operator()(Words& shared, Span<unsigned> out) const {
            shared.words[threadIdx.x] = 0;
            __syncthreads();
            const unsigned lane = threadIdx.x % 32, first = threadIdx.x - lane;
            if (lane == 3 || lane == 5) out[threadIdx.x] = shared.words[first];
            if (lane == 5) shared.words[first] = 1;
        }
    };
    check_race(ReadByTwoLanes{}, "a write and a read of thread 3 ", "a read and a write of thread 37 ");
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
    check_no_fault(WarpBarrier{});
    struct NoBarrierAfterReads {
        void operator()(Words& shared, Span<unsigned> out) const {
            for (unsigned i = 0; i < 3; ++i) {
                shared.words[threadIdx.x] = i;
                __syncwarp();
                out[threadIdx.x] += shared.words[threadIdx.x ^ 1u];
            }
        }
    };
    check_race(NoBarrierAfterReads{}, "a read and a write of thread 0 ", "a read and a write of thread 63 ");
    struct NoBarrierAfterWrites {
        void operator()(Words& shared, Span<unsigned> out) const {
            shared.words[threadIdx.x] = 0;
            __syncthreads();
            for (unsigned i = 0; i < 3; ++i) {
                shared.words[threadIdx.x] = i;
                out[threadIdx.x] += shared.words[threadIdx.x ^ 1u];
                __syncwarp();
            }
        }
    };
    check_race(NoBarrierAfterWrites{}, "a write and a read of thread 0 ", "a write and a read of thread 63 ");
    struct ShuffleIsNoBarrier {
        void operator()(Words& shared, Span<unsigned> out) const {
            shared.words[threadIdx.x] = 1;
            out[threadIdx.x] = __shfl_xor_sync(cuda::all_lanes, threadIdx.x, 1);
            out[threadIdx.x] += shared.words[threadIdx.x ^ 1u];
        }
    };
    check_race(ShuffleIsNoBarrier{}, "a read and a write of thread 1 ", "a read and a write of thread 62 ");
}

TEST_CASE("A barrier of some lanes of a warp orders these lanes and no others") {
    struct Pairs {
        void operator()(Words& shared, Span<unsigned> out) const {
            const unsigned lanes = 3u << (threadIdx.x % 32 / 2 * 2);
            for (unsigned i = 0; i < 3; ++i) {
                shared.words[threadIdx.x] = i;
                __syncwarp(lanes);
                out[threadIdx.x] += shared.words[threadIdx.x ^ 1u];
                __syncwarp(lanes);
            }
        }
    };
    check_no_fault(Pairs{});
    struct OfAnotherPair {
        void operator()(Words& shared, Span<unsigned> out) const {
            shared.words[threadIdx.x] = 1;
            __syncwarp(3u << (threadIdx.x % 32 / 2 * 2));
            out[threadIdx.x] = shared.words[threadIdx.x ^ 2u];
        }
    };
    check_race(OfAnotherPair{}, "a read and a write of thread 2 ", "a read and a write of thread 61 ");
    struct LaneOutside { // lanes 0 to 15 wait for each other, and read what lane 20 writes
        void operator()(Words& shared, Span<unsigned> out) const {
            const unsigned lane = threadIdx.x % 32, first = threadIdx.x - lane;
            shared.words[threadIdx.x] = 0;
            __syncthreads();
            if (lane == 20) shared.words[threadIdx.x] = 1;
            if (lane < 16) __syncwarp(0xFFFFu);
            if (lane < 16) out[threadIdx.x] = shared.words[first + 20];
        }
    };
    check_race(LaneOutside{}, "a read and a write of thread 20 ", "a read and a write of thread 52 ");
    struct Relay { // lane 0 tells lane 1, which tells lane 2
        void operator()(Words& shared, Span<unsigned> out) const {
            const unsigned lane = threadIdx.x % 32, first = threadIdx.x - lane;
            if (lane == 0) shared.words[first] = 1;
            if (lane == 0 || lane == 1) __syncwarp(0x3u);
            if (lane == 1 || lane == 2) __syncwarp(0x6u);
            if (lane == 2) out[threadIdx.x] = shared.words[first];
        }
    };
    check_no_fault(Relay{});
    struct RelayBackwards { // lane 1 tells lane 2 before it knows itself
        void operator()(Words& shared, Span<unsigned> out) const {
            const unsigned lane = threadIdx.x % 32, first = threadIdx.x - lane;
            if (lane == 0) shared.words[first] = 1;
            if (lane == 1 || lane == 2) __syncwarp(0x6u);
            if (lane == 0 || lane == 1) __syncwarp(0x3u);
            __shfl_sync(cuda::all_lanes, lane, 0); // lane 2 reads last
            if (lane == 2) out[threadIdx.x] = shared.words[first];
        }
    };
    check_race(RelayBackwards{}, "a read and a write of thread 0 ", "a read and a write of thread 32 ");
    struct ReadersOutside { // lanes 0 and 1 read; only lane 1 waits for lane 2, which writes
        void operator()(Words& shared, Span<unsigned> out) const {
            const unsigned lane = threadIdx.x % 32, first = threadIdx.x - lane;
            shared.words[threadIdx.x] = 0;
            __syncthreads();
            if (lane < 2) out[threadIdx.x] = shared.words[first];
            if (lane == 1 || lane == 2) __syncwarp(0x6u);
            if (lane == 2) shared.words[first] = 1;
        }
    };
    check_race(ReadersOutside{}, "a write and a read of thread 0 ", "a write and a read of thread 32 ");
}

TEST_CASE("Atomic operations in shared memory race with other accesses, and not with each other") {
    const auto add_one = [](unsigned v) { return v + 1; };
    using AddOne = decltype(add_one);
    struct Sum {
        void operator()(Words& shared, Span<unsigned> out) const {
            if (threadIdx.x == 0) shared.total[0] = 0;
            __syncthreads();
            shared.total.atomic(0, AddOne{});
            __syncthreads();
            out[threadIdx.x] = shared.total[0];
        }
    };
    check_no_fault(Sum{});
    struct Uninitialised {
        void operator()(Words& shared, Span<unsigned>) const { shared.total.atomic(0, AddOne{}); }
    };
    check_fault(Uninitialised{}, "atomic operation on uninitialised shared memory");
    struct ThenRead {
        void operator()(Words& shared, Span<unsigned> out) const {
            if (threadIdx.x == 0) shared.total[0] = 0;
            __syncthreads();
            shared.total.atomic(0, AddOne{});
            out[threadIdx.x] = shared.total[0];
        }
    };
    check_race(ThenRead{}, "an atomic operation and a read of thread 0 ",
               "an atomic operation and a read of thread 63 ");
    struct ReadByAnother { // the only read comes after the atomic operations, in a forward order
        void operator()(Words& shared, Span<unsigned> out) const {
            if (threadIdx.x == 0) shared.total[0] = 0;
            __syncthreads();
            if (threadIdx.x < 31) shared.total.atomic(0, AddOne{});
            if (threadIdx.x == 31) out[0] = shared.total[0];
        }
    };
    check_race(ReadByAnother{}, "a read and an atomic operation of thread 0 ",
               "an atomic operation and a read of thread 31 ");
    struct AndWrite {
        void operator()(Words& shared, Span<unsigned>) const {
            if (threadIdx.x == 0) shared.total[0] = 0;
            __syncthreads();
            if (threadIdx.x < 31) shared.total.atomic(0, AddOne{});
            if (threadIdx.x == 31) shared.total[0] = 0;
        }
    };
    check_race(AndWrite{}, "a write and an atomic operation of thread 0 ",
               "an atomic operation and a write of thread 31 ");
    struct WriteIsHidden { // one thread's write, then atomic operations of it and of another
        void operator()(Words& shared, Span<unsigned>) const {
            if (threadIdx.x == 0) shared.total[0] = 0;
            __syncthreads();
            if (threadIdx.x == 1) shared.total[0] = 5;
            if (threadIdx.x == 1 || threadIdx.x == 2) shared.total.atomic(0, AddOne{});
        }
    };
    check_race(WriteIsHidden{}, "an atomic operation and a write of thread 1 ",
               "a write and an atomic operation of thread 2 ");
}

/// Whether a kernel with an atomic operation on numbers of this type compiles: each of them, and any of them.
template <class T>
concept HasAllAtomics = requires(T* number, T value, SharedArray<T, 1>& shared) {
    atomicAdd(number, value);
    atomicMax(number, value);
    atomicMin(number, value);
    atomicOr(number, value);
    atomicExch(number, value);
    atomicCAS(number, value, value);
    shared.atomic(0, [](T v) { return v; });
};
template <class T>
concept HasAnAtomic = requires(T* number, T value) { atomicAdd(number, value); } ||
                      requires(T* number, T value) { atomicMax(number, value); } ||
                      requires(T* number, T value) { atomicMin(number, value); } ||
                      requires(T* number, T value) { atomicOr(number, value); } ||
                      requires(T* number, T value) { atomicExch(number, value); } ||
                      requires(T* number, T value) { atomicCAS(number, value, value); } ||
                      requires(SharedArray<T, 1>& shared) { shared.atomic(0, [](T v) { return v; }); };

TEST_CASE("No kernel compiles that has an atomic operation on floating-point numbers") {
    static_assert(HasAllAtomics<int> && HasAllAtomics<unsigned> && HasAllAtomics<unsigned long long>);
    static_assert(!HasAnAtomic<float> && !HasAnAtomic<double>);
}

TEST_CASE("Divergent and missing barriers are found") {
    struct TwoPlaces {
        void operator()(Words&, Span<unsigned>) const {
            if (threadIdx.x % 2) __syncthreads();
            else __syncthreads();
        }
    };
    check_fault(TwoPlaces{}, "wait for each other: 32 wait at __syncthreads (emulation_test.cpp:");
    struct OneEnds {
        void operator()(Words&, Span<unsigned>) const {
            if (threadIdx.x == 5) return;
            __syncthreads();
        }
    };
    check_fault(OneEnds{}, "1 have ended");
    check_fault(OneEnds{}, "63 wait at __syncthreads");
    struct WarpAgainstBlock {
        void operator()(Words&, Span<unsigned>) const {
            if (threadIdx.x < 16) __syncwarp();
            __syncthreads();
        }
    };
    check_fault(WarpAgainstBlock{}, "16 wait at __syncwarp");
}

TEST_CASE("Wrong masks of a warp are found") {
    struct NotInOwnMask {
        void operator()(Words&, Span<unsigned> out) const { out[threadIdx.x] = __ballot_sync(0xFFFEu, 1); }
    };
    check_fault(NotInOwnMask{}, "is not in its own mask");
    struct HalfIsMissing {
        void operator()(Words&, Span<unsigned> out) const {
            if (threadIdx.x % 32 < 16) out[threadIdx.x] = __shfl_xor_sync(cuda::all_lanes, threadIdx.x, 1);
        }
    };
    check_fault(HalfIsMissing{}, "wait at __shfl_xor_sync");
    struct FromOutside {
        void operator()(Words&, Span<unsigned> out) const {
            if (threadIdx.x % 32 < 16) out[threadIdx.x] = __shfl_sync(0xFFFFu, threadIdx.x, 20);
        }
    };
    check_fault(FromOutside{}, "takes the value of lane 20, which is not in the mask");
    struct HalfAWarp { // of a block with 48 threads
        void operator()(Words&, Span<unsigned> out) const { out[threadIdx.x] = __ballot_sync(cuda::all_lanes, 1); }
    };
    check_fault<48>(HalfAWarp{}, "wait at __ballot_sync");
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
    for (const Order order : orders)
        CHECK(run(order, false) == std::vector<unsigned>{0, 1});
    CHECK(run(Order::forward, true)[0] == 1);
    CHECK(run(Order::reverse, true)[0] == 0);
    std::set<unsigned> found;
    for (int i = 0; i < 20; ++i) found.insert(run(Order::random, true)[0]);
    CHECK(found == std::set<unsigned>{0, 1});
}

TEST_CASE("Results that depend on the order of blocks or threads differ between the orders") {
    struct LastThread {
        void operator()(Words&, Span<unsigned> out) const { out[0] = threadIdx.x; }
    };
    struct LastBlock {
        void operator()(Words&, Span<unsigned> out) const { out[0] = blockIdx.x; }
    };
    const auto result_of = []<class Body>(const Body&, Order order, unsigned blocks) {
        CudaEmulation::instance().order = order;
        Device device;
        Device::Buffer<unsigned> out(64);
        device.launch(blocks, Planted<Body, Words>{out});
        std::vector<unsigned> result(64);
        device.download(Span<const unsigned>(out), Span<unsigned>(result));
        CudaEmulation::instance().order = Order::forward;
        return result[0];
    };
    CHECK(result_of(LastThread{}, Order::forward, 1) == 63);
    CHECK(result_of(LastThread{}, Order::reverse, 1) == 0);
    CHECK(result_of(LastBlock{}, Order::forward, 3) == 2);
    CHECK(result_of(LastBlock{}, Order::reverse, 3) == 0);
    std::set<unsigned> threads, blocks;
    for (int i = 0; i < 100; ++i) {
        threads.insert(result_of(LastThread{}, Order::random, 1));
        blocks.insert(result_of(LastBlock{}, Order::random, 3));
    }
    CHECK(threads.size() > 40); // of 64, about 51 are to be expected
    CHECK(blocks.size() == 3);
}

/// Each thread enters its number in a list at the next free place, before a barrier and again after it.
struct Enter {
    static constexpr unsigned block_size = 64, blocks = 4;
    Span<unsigned> count; // [1]
    Span<unsigned> list;  // [blocks, 2, block_size] in the order of the blocks
    void operator()() const {
        for (int round = 0; round < 2; ++round) {
            list[atomicAdd(&count[0], 1u)] = blockIdx.x * block_size + threadIdx.x;
            __syncthreads();
        }
    }
    static std::vector<unsigned> run(Order order) {
        CudaEmulation::instance().order = order;
        Device device;
        Device::Buffer<unsigned> count(1), list(2 * blocks * block_size);
        device.fill(Span<unsigned>(count), 0u);
        device.launch(blocks, Enter{count, list});
        std::vector<unsigned> result = downloaded(device, Span<const unsigned>(list));
        CudaEmulation::instance().order = Order::forward;
        return result;
    }
};

/// The sum of (count - expected)^2 / expected is that of counts with equal chances, to 6 standard deviations of it on
/// either side: a shuffle that is too regular is none either.
void check_equal_chances(const std::vector<double>& counts, double expected) {
    double sum = 0;
    for (const double count : counts) sum += (count - expected) * (count - expected) / expected;
    const double mean = double(counts.size()), deviation = std::sqrt(2 * mean);
    CHECK(sum > mean - 6 * deviation);
    CHECK(sum < mean + 6 * deviation);
}

TEST_CASE("Blocks and threads take their turns as they should in each order, also after a barrier") {
    constexpr unsigned n = Enter::block_size, blocks = Enter::blocks;
    std::vector<unsigned> forward;
    for (unsigned b = 0; b < blocks; ++b)
        for (unsigned round = 0; round < 2; ++round)
            for (unsigned t = 0; t < n; ++t) forward.push_back(b * n + t);
    CHECK(Enter::run(Order::forward) == forward);
    CHECK(Enter::run(Order::reverse) == std::vector<unsigned>(forward.rbegin(), forward.rend()));

    // In a random order, each order of the blocks has the same chance. So has each place of a thread, and each thread
    // to come after another one: a random start, or a fixed order from there on, would not do.
    std::map<std::vector<unsigned>, int> orders_of_blocks;
    std::vector<double> places(n * n), neighbours(n * n);
    constexpr int runs = 400;
    for (int run = 0; run < runs; ++run) {
        const std::vector<unsigned> list = Enter::run(Order::random);
        std::vector<unsigned> order, sorted = list;
        std::ranges::sort(sorted);
        bool complete = true, same_after_barrier = true;
        for (std::size_t i = 0; i < sorted.size(); ++i) complete = complete && sorted[i] == i / 2;
        for (std::size_t part = 0; part < 2 * blocks; ++part) {
            const unsigned block = list[part * n] / n;
            if (part % 2 == 0) order.push_back(block);
            for (std::size_t i = 0; i < n; ++i) {
                const unsigned thread = list[part * n + i];
                complete = complete && thread / n == block;
                if (part % 2 == 0) continue;
                same_after_barrier = same_after_barrier && thread == list[(part - 1) * n + i];
                places[i * n + thread % n] += 1;
                if (i > 0) neighbours[list[part * n + i - 1] % n * n + thread % n] += 1;
            }
        }
        REQUIRE(complete); // no thread is left out, and blocks follow each other
        CHECK(same_after_barrier);
        ++orders_of_blocks[order];
    }
    CHECK(orders_of_blocks.size() == 24);
    std::vector<double> counts;
    for (const auto& [order, count] : orders_of_blocks) counts.push_back(count);
    check_equal_chances(counts, runs / 24.0);
    check_equal_chances(places, runs * blocks / double(n));
    std::vector<double> of_two;
    for (unsigned i = 0; i < n * n; ++i)
        if (i / n != i % n) of_two.push_back(neighbours[i]);
    check_equal_chances(of_two, runs * blocks / double(n));

    // The same launch of the same seed can be run again.
    const auto again = [](std::uint64_t seed, std::uint64_t launches) {
        auto& machine = CudaEmulation::instance();
        const std::uint64_t before = std::exchange(machine.seed, seed);
        machine.launches = launches;
        const std::vector<unsigned> result = Enter::run(Order::random);
        machine.seed = before;
        return result;
    };
    CHECK(again(1, 1000) == again(1, 1000));
    CHECK(again(1, 1000) != again(1, 1010));
    CHECK(again(1, 1000) != again(50, 1000));
}
