// SPDX-License-Identifier: Apache-2.0
/// @file  The part of the CUDA runtime that gsh calls, on the host: memory, streams, events, graphs, launches.
///
/// A stream's work waits in a queue until somebody waits for it. Code that reads a result too early, or changes what a
/// queued copy still has to read, therefore fails here every time, not only on a fast machine.
#pragma once

#include "support/cuda_emulation/block.hpp"
#include "support/guarded_memory.hpp"

#include <gsh/core/rng.hpp>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

enum cudaError_t {
    cudaSuccess = 0,
    cudaErrorInvalidValue = 1,
    cudaErrorMemoryAllocation = 2,
    cudaErrorInsufficientDriver = 35,
    cudaErrorNoDevice = 100,
    cudaErrorInvalidDevice = 101,
    cudaErrorNoKernelImageForDevice = 209,
    cudaErrorNotReady = 600,
    cudaErrorLaunchFailure = 719,
    cudaErrorStreamCaptureUnsupported = 900,
    cudaErrorStreamCaptureInvalidated = 901,
    cudaErrorUnknown = 999,
};
enum cudaMemcpyKind {
    cudaMemcpyHostToHost,
    cudaMemcpyHostToDevice,
    cudaMemcpyDeviceToHost,
    cudaMemcpyDeviceToDevice,
    cudaMemcpyDefault
};
enum cudaMemoryType { cudaMemoryTypeUnregistered, cudaMemoryTypeHost, cudaMemoryTypeDevice, cudaMemoryTypeManaged };
enum cudaStreamCaptureMode {
    cudaStreamCaptureModeGlobal,
    cudaStreamCaptureModeThreadLocal,
    cudaStreamCaptureModeRelaxed
};
enum cudaStreamUpdateCaptureDependenciesFlags { cudaStreamAddCaptureDependencies, cudaStreamSetCaptureDependencies };
enum cudaStreamCaptureStatus {
    cudaStreamCaptureStatusNone,
    cudaStreamCaptureStatusActive,
    cudaStreamCaptureStatusInvalidated
};
enum cudaDeviceAttr {
    cudaDevAttrClockRate = 13, // kHz
    cudaDevAttrMultiProcessorCount = 16,
    cudaDevAttrComputeCapabilityMajor = 75,
    cudaDevAttrComputeCapabilityMinor = 76
};
inline constexpr unsigned cudaStreamNonBlocking = 1, cudaEventDefault = 0, cudaEventRecordExternal = 1,
                          cudaEventDisableTiming = 2;

struct cudaPointerAttributes {
    cudaMemoryType type;
    int device;
    void* devicePointer;
    void* hostPointer;
};
struct cudaFuncAttributes {
    int numRegs;
    std::size_t localSizeBytes, sharedSizeBytes;
};
struct cudaDeviceProp {
    char name[256];
    int major, minor, multiProcessorCount;
    std::size_t totalGlobalMem;
};

namespace gsh::test {

/// One piece of queued work.
struct EmulatedWork {
    virtual ~EmulatedWork() = default;
    virtual void run() = 0;
    [[nodiscard]] virtual std::unique_ptr<EmulatedWork> copy() const = 0;
    /// The function's address, of a launch.
    [[nodiscard]] virtual const void* kernel() const { return nullptr; }
    /// Replaces a launch's arguments and sizes.
    virtual void set(dim3, dim3, void**) {}
};
struct FunctionWork : EmulatedWork {
    explicit FunctionWork(std::function<void()> work) : function(std::move(work)) {}
    void run() override { function(); }
    [[nodiscard]] std::unique_ptr<EmulatedWork> copy() const override { return std::make_unique<FunctionWork>(*this); }
    std::function<void()> function;
};

/// A captured stream. Each node depends on the one before it, unless cudaStreamUpdateCaptureDependencies says
/// otherwise.
struct EmulatedGraph {
    std::vector<std::unique_ptr<EmulatedWork>> nodes;
    std::vector<std::vector<std::size_t>> dependencies; // of each node, as indices
    std::vector<EmulatedWork*> next_dependencies;       // of the node to come

    void add(std::unique_ptr<EmulatedWork> work) {
        std::vector<std::size_t>& of_node = dependencies.emplace_back();
        for (std::size_t i = 0; i < nodes.size(); ++i)
            if (std::ranges::find(next_dependencies, nodes[i].get()) != next_dependencies.end()) of_node.push_back(i);
        next_dependencies = {work.get()};
        nodes.push_back(std::move(work));
    }
    /// The indices of the nodes in an order that the dependencies allow. Among those whose turn it can be, `choose`
    /// takes one.
    template <class Choose>
    [[nodiscard]] std::vector<std::size_t> in_order(const Choose& choose) const {
        std::vector<std::size_t> result, ready;
        std::vector<bool> done(nodes.size(), false);
        const auto is_done = [&](std::size_t i) { return bool(done[i]); };
        while (result.size() < nodes.size()) {
            ready.clear();
            for (std::size_t i = 0; i < nodes.size(); ++i)
                if (!done[i] && std::ranges::all_of(dependencies[i], is_done)) ready.push_back(i);
            result.push_back(ready[choose(ready.size())]);
            done[result.back()] = true;
        }
        return result;
    }
    /// Of an executable graph: the one it is made from, whose nodes name its own. It may be gone, unless its nodes are
    /// set.
    const EmulatedGraph* captured = nullptr;
};

struct EmulatedStream {
    int device = 0;
    std::deque<std::unique_ptr<EmulatedWork>> queue;
    std::uint64_t queued = 0, finished = 0; // pieces of work so far
    std::unique_ptr<EmulatedGraph> capture;
    bool strict = false; // the mode of the capture
    bool eager = false;  // see CudaEmulation::eager_streams
};

struct EmulatedEvent {
    using Clock = std::chrono::steady_clock;

    EmulatedStream* stream = nullptr;
    std::uint64_t position = 0; // the event has happened when the stream has finished so much
    bool recorded = false;
    std::shared_ptr<Clock::time_point> time = std::make_shared<Clock::time_point>(); // when it happened
};

/// The machine: its devices, its memory, and what a test wants of it.
class CudaEmulation {
public:
    static CudaEmulation& instance() {
        static CudaEmulation* const emulation = new CudaEmulation; // never destroyed, as its memory
        return *emulation;
    }

    // What a test may set.
    int device_count = 1;
    int capability_major = 9, capability_minor = 0;
    bool code_is_missing = false;                    // the program has no code for this architecture
    std::size_t memory_limit = std::size_t(1) << 30; // bytes on each device
    bool driver_is_missing = false;
    Order order = Order::forward;
    unsigned char fill = 0xA5;            // bytes of new memory: results must not depend on it
    cudaError_t next_error = cudaSuccess; // of the next wait: the device has failed
    std::uint64_t life = ~std::uint64_t(0); // the device fails at the wait of this number
    std::uint64_t seed = 1;               // of Order::random
    bool eager_streams = false;           // all streams but the oldest do their work as soon as it is queued

    // What a test may ask.
    std::uint64_t launches = 0, graph_launches = 0, captures = 0, waits = 0, allocations = 0;

    int device = 0; // current
    EmulatedStream default_stream;

    // Memory ----------------------------------------------------------------------------------------------------------

    cudaError_t allocate(void** memory, std::size_t bytes) {
        if (strict_captures_ != 0) return cudaErrorStreamCaptureUnsupported;
        if (next_error != cudaSuccess) return next_error; // sticky
        if (bytes > memory_limit - std::min(used_[device], memory_limit)) return cudaErrorMemoryAllocation;
        ++allocations;
        GuardedMemory::instance().watch();
        *memory = GuardedMemory::instance().allocate(bytes);
        const OpenGuard guard;
        std::memset(*memory, fill, bytes);
        device_memory_[reinterpret_cast<std::uintptr_t>(*memory)] = {bytes, device};
        used_[device] += bytes;
        return cudaSuccess;
    }
    cudaError_t release(void* memory) {
        if (!memory) return cudaSuccess;
        const auto found = device_memory_.find(reinterpret_cast<std::uintptr_t>(memory));
        if (found == device_memory_.end()) return cudaErrorInvalidValue;
        finish_all(); // as cudaFree does
        used_[found->second.device] -= found->second.bytes;
        GuardedMemory::instance().release(memory, found->second.bytes);
        device_memory_.erase(found);
        return cudaSuccess;
    }
    cudaError_t allocate_pinned(void** memory, std::size_t bytes) {
        *memory = ::operator new(bytes);
        pinned_[reinterpret_cast<std::uintptr_t>(*memory)] = {bytes, device};
        return cudaSuccess;
    }
    cudaError_t release_pinned(void* memory) {
        finish_all();
        pinned_.erase(reinterpret_cast<std::uintptr_t>(memory));
        ::operator delete(memory);
        return cudaSuccess;
    }
    [[nodiscard]] cudaPointerAttributes attributes(const void* memory) const {
        void* const address = const_cast<void*>(memory);
        if (const auto* block = find(device_memory_, memory))
            return {cudaMemoryTypeDevice, block->device, address, nullptr};
        if (const auto* block = find(pinned_, memory)) return {cudaMemoryTypeHost, block->device, address, address};
        return {cudaMemoryTypeUnregistered, -1, nullptr, address};
    }
    [[nodiscard]] bool is_device(const void* memory, std::size_t bytes) const {
        const auto* block = find(device_memory_, memory);
        return block && find(device_memory_, static_cast<const char*>(memory) + bytes - 1) == block;
    }
    [[nodiscard]] bool is_pinned(const void* memory) const { return find(pinned_, memory) != nullptr; }
    [[nodiscard]] std::size_t free_memory() { return memory_limit - std::min(memory_limit, used_[device]); }

    // Streams ---------------------------------------------------------------------------------------------------------

    EmulatedStream& stream(EmulatedStream* stream) { return stream ? *stream : default_stream; }
    void add(EmulatedStream* stream) { streams_.push_back(stream); }
    [[nodiscard]] bool has_streams() const { return !streams_.empty(); }
    /// The stream's work is done. Queued work of other streams and events still name it, so it is kept.
    void remove(EmulatedStream* stream) {
        std::erase(streams_, stream);
        removed_.emplace_back(stream);
    }

    void queue(EmulatedStream& stream, std::unique_ptr<EmulatedWork> work) {
        if (stream.capture) {
            stream.capture->add(std::move(work));
            return;
        }
        stream.queue.push_back(std::move(work));
        ++stream.queued;
        if (stream.eager) finish(stream);
    }
    void queue(EmulatedStream& stream, std::function<void()> work) {
        queue(stream, std::make_unique<FunctionWork>(std::move(work)));
    }
    /// Runs what is queued, up to a position. A device that has failed does none of it.
    void finish(EmulatedStream& stream, std::uint64_t position = ~std::uint64_t(0)) {
        while (!stream.queue.empty() && stream.finished < position) {
            const std::unique_ptr<EmulatedWork> work = std::move(stream.queue.front());
            stream.queue.pop_front();
            ++stream.finished;
            if (next_error == cudaSuccess) work->run();
        }
    }
    void finish_all() {
        finish(default_stream);
        for (EmulatedStream* stream : streams_) finish(*stream);
    }
    /// While a stream is captured in a strict mode, memory cannot be allocated.
    void count_strict_captures(int change) { strict_captures_ += change; }

    void count_wait() {
        if (++waits >= life) next_error = cudaErrorLaunchFailure;
    }
    /// The error of a wait: one that a test has set, or success.
    cudaError_t wait(EmulatedStream& stream) {
        count_wait();
        if (stream.capture) return cudaErrorStreamCaptureUnsupported;
        if (next_error != cudaSuccess) return next_error; // sticky
        finish(stream);
        return cudaSuccess;
    }

    // Copies ----------------------------------------------------------------------------------------------------------

    cudaError_t copy(void* to, const void* from, std::size_t bytes, cudaMemcpyKind kind, EmulatedStream& stream) {
        if (bytes == 0) return cudaSuccess;
        const bool from_device = find(device_memory_, from), to_device = find(device_memory_, to);
        if ((kind == cudaMemcpyHostToDevice && (from_device || !to_device)) ||
            (kind == cudaMemcpyDeviceToHost && (!from_device || to_device)) ||
            (kind == cudaMemcpyDeviceToDevice && (!from_device || !to_device)))
            return cudaErrorInvalidValue;
        if ((from_device && !is_device(from, bytes)) || (to_device && !is_device(to, bytes)))
            return cudaErrorInvalidValue;
        const auto move = [to, bytes](const void* source) {
            const OpenGuard guard;
            std::memcpy(to, source, bytes);
        };
        if (from_device || stream.capture) {
            queue(stream, [=] { move(from); });
        } else if (is_pinned(from)) { // read when the copy runs: it must not change until then
            queue(stream, [=, sum = checksum(from, bytes)] {
                if (checksum(from, bytes) != sum)
                    throw KernelFault("the host memory of a queued copy has changed before the copy ran; wait for it, "
                                      "or use another buffer");
                move(from);
            });
        } else { // staged at once
            const char* const first = static_cast<const char*>(from);
            queue(stream, [=, staged = std::vector<char>(first, first + bytes)] { move(staged.data()); });
        }
        if (from_device && !to_device && !is_pinned(to) && !stream.capture) return wait(stream); // pageable: it waits
        return cudaSuccess;
    }

    // Launches --------------------------------------------------------------------------------------------------------

    /// Runs a kernel's blocks one after the other.
    void run_blocks(dim3 grid, dim3 block, const std::function<void()>& kernel) {
        const OpenGuard guard;
        ++launches;
        std::vector<unsigned> turns(grid.x);
        for (unsigned b = 0; b < grid.x; ++b) turns[b] = order == Order::reverse ? grid.x - 1 - b : b;
        if (order == Order::random) Block::shuffle(turns, seed + launches);
        gridDim = grid, blockDim = block;
        for (const unsigned b : turns) {
            blockIdx = {b, 0, 0};
            Block(block, order, random_bits(seed + launches, b)).run(kernel);
        }
    }

private:
    struct Allocation {
        std::size_t bytes;
        int device;
    };
    using Allocations = std::map<std::uintptr_t, Allocation>;

    static const Allocation* find(const Allocations& all, const void* memory) {
        const auto address = reinterpret_cast<std::uintptr_t>(memory);
        auto after = all.upper_bound(address);
        if (after == all.begin()) return nullptr;
        --after;
        return address < after->first + after->second.bytes ? &after->second : nullptr;
    }
    static std::uint64_t checksum(const void* memory, std::size_t bytes) {
        std::uint64_t sum = 1469598103934665603ull;
        for (std::size_t i = 0; i < bytes; ++i)
            sum = (sum ^ static_cast<const unsigned char*>(memory)[i]) * 1099511628211ull;
        return sum;
    }

    Allocations device_memory_, pinned_;
    std::map<int, std::size_t> used_;
    std::vector<EmulatedStream*> streams_;
    std::vector<std::unique_ptr<EmulatedStream>> removed_;
    int strict_captures_ = 0;
};

} // namespace gsh::test

// The functions of the runtime ----------------------------------------------------------------------------------------

using cudaStream_t = gsh::test::EmulatedStream*;
using cudaEvent_t = gsh::test::EmulatedEvent*;
using cudaGraph_t = gsh::test::EmulatedGraph*;
using cudaGraphExec_t = gsh::test::EmulatedGraph*;
using cudaGraphNode_t = gsh::test::EmulatedWork*;

struct cudaLaunchConfig_t {
    dim3 gridDim, blockDim;
    std::size_t dynamicSmemBytes = 0;
    cudaStream_t stream = nullptr;
    void* attrs = nullptr;
    unsigned numAttrs = 0;
};
struct cudaKernelNodeParams {
    void* func;
    dim3 gridDim, blockDim;
    unsigned sharedMemBytes;
    void** kernelParams;
    void** extra;
};
struct cudaGraphEdgeData {};

inline const char* cudaGetErrorName(cudaError_t error) {
    switch (error) {
    case cudaSuccess:
        return "cudaSuccess";
    case cudaErrorMemoryAllocation:
        return "cudaErrorMemoryAllocation";
    case cudaErrorInsufficientDriver:
        return "cudaErrorInsufficientDriver";
    case cudaErrorNoDevice:
        return "cudaErrorNoDevice";
    case cudaErrorInvalidDevice:
        return "cudaErrorInvalidDevice";
    case cudaErrorNoKernelImageForDevice:
        return "cudaErrorNoKernelImageForDevice";
    case cudaErrorLaunchFailure:
        return "cudaErrorLaunchFailure";
    case cudaErrorStreamCaptureUnsupported:
        return "cudaErrorStreamCaptureUnsupported";
    default:
        return "cudaErrorInvalidValue";
    }
}
inline const char* cudaGetErrorString(cudaError_t error) {
    return cudaGetErrorName(error);
}
inline cudaError_t cudaGetLastError() {
    return cudaSuccess;
}
inline cudaError_t cudaPeekAtLastError() {
    return cudaSuccess;
}

inline cudaError_t cudaGetDeviceCount(int* count) {
    const auto& machine = gsh::test::CudaEmulation::instance();
    *count = machine.driver_is_missing ? 0 : machine.device_count;
    if (machine.driver_is_missing) return cudaErrorInsufficientDriver;
    return *count ? cudaSuccess : cudaErrorNoDevice;
}
inline cudaError_t cudaSetDevice(int device) {
    auto& machine = gsh::test::CudaEmulation::instance();
    if (device < 0 || device >= machine.device_count) return cudaErrorInvalidDevice;
    machine.device = device;
    return cudaSuccess;
}
inline cudaError_t cudaGetDevice(int* device) {
    *device = gsh::test::CudaEmulation::instance().device;
    return cudaSuccess;
}
inline cudaError_t cudaDeviceGetAttribute(int* value, cudaDeviceAttr attribute, int) {
    const auto& machine = gsh::test::CudaEmulation::instance();
    *value = attribute == cudaDevAttrComputeCapabilityMajor   ? machine.capability_major
             : attribute == cudaDevAttrComputeCapabilityMinor ? machine.capability_minor
             : attribute == cudaDevAttrClockRate              ? 1'000'000
                                                              : 4;
    return cudaSuccess;
}
inline cudaError_t cudaGetDeviceProperties(cudaDeviceProp* properties, int) {
    const auto& machine = gsh::test::CudaEmulation::instance();
    *properties = {"emulated device", machine.capability_major, machine.capability_minor, 4, machine.memory_limit};
    return cudaSuccess;
}
inline cudaError_t cudaMemGetInfo(std::size_t* free, std::size_t* total) {
    auto& machine = gsh::test::CudaEmulation::instance();
    *free = machine.free_memory(), *total = machine.memory_limit;
    return cudaSuccess;
}

template <class Kernel>
cudaError_t cudaFuncGetAttributes(cudaFuncAttributes* attributes, Kernel*) {
    *attributes = {};
    return gsh::test::CudaEmulation::instance().code_is_missing ? cudaErrorNoKernelImageForDevice : cudaSuccess;
}

template <class T>
cudaError_t cudaMalloc(T** memory, std::size_t bytes) {
    return gsh::test::CudaEmulation::instance().allocate(reinterpret_cast<void**>(memory), bytes);
}
inline cudaError_t cudaFree(void* memory) {
    return gsh::test::CudaEmulation::instance().release(memory);
}
template <class T>
cudaError_t cudaMallocHost(T** memory, std::size_t bytes) {
    return gsh::test::CudaEmulation::instance().allocate_pinned(reinterpret_cast<void**>(memory), bytes);
}
inline cudaError_t cudaFreeHost(void* memory) {
    return gsh::test::CudaEmulation::instance().release_pinned(memory);
}
inline cudaError_t cudaPointerGetAttributes(cudaPointerAttributes* attributes, const void* memory) {
    *attributes = gsh::test::CudaEmulation::instance().attributes(memory);
    return cudaSuccess;
}

inline cudaError_t cudaStreamCreateWithFlags(cudaStream_t* stream, unsigned) {
    auto& machine = gsh::test::CudaEmulation::instance();
    *stream = new gsh::test::EmulatedStream;
    (*stream)->device = machine.device;
    (*stream)->eager = machine.eager_streams && machine.has_streams();
    machine.add(*stream);
    return cudaSuccess;
}
inline cudaError_t cudaStreamDestroy(cudaStream_t stream) {
    auto& machine = gsh::test::CudaEmulation::instance();
    machine.finish(*stream);
    machine.remove(stream);
    return cudaSuccess;
}
inline cudaError_t cudaStreamGetDevice(cudaStream_t stream, int* device) {
    *device = gsh::test::CudaEmulation::instance().stream(stream).device;
    return cudaSuccess;
}
inline cudaError_t cudaStreamSynchronize(cudaStream_t stream) {
    auto& machine = gsh::test::CudaEmulation::instance();
    return machine.wait(machine.stream(stream));
}

inline cudaError_t cudaMemcpyAsync(void* to, const void* from, std::size_t bytes, cudaMemcpyKind kind,
                                   cudaStream_t stream) {
    auto& machine = gsh::test::CudaEmulation::instance();
    return machine.copy(to, from, bytes, kind, machine.stream(stream));
}
inline cudaError_t cudaMemsetAsync(void* memory, int value, std::size_t bytes, cudaStream_t stream) {
    auto& machine = gsh::test::CudaEmulation::instance();
    if (bytes != 0 && !machine.is_device(memory, bytes)) return cudaErrorInvalidValue;
    machine.queue(machine.stream(stream), [=] {
        const gsh::test::OpenGuard guard;
        std::memset(memory, value, bytes);
    });
    return cudaSuccess;
}

inline cudaError_t cudaEventCreateWithFlags(cudaEvent_t* event, unsigned) {
    *event = new gsh::test::EmulatedEvent;
    return cudaSuccess;
}
inline cudaError_t cudaEventDestroy(cudaEvent_t event) {
    delete event;
    return cudaSuccess;
}
inline cudaError_t cudaEventCreate(cudaEvent_t* event) {
    return cudaEventCreateWithFlags(event, cudaEventDefault);
}
/// With cudaEventRecordExternal, the event becomes a node of the graph that is captured, and happens in each launch.
inline cudaError_t cudaEventRecordWithFlags(cudaEvent_t event, cudaStream_t stream_or_default, unsigned flags) {
    auto& machine = gsh::test::CudaEmulation::instance();
    auto& stream = machine.stream(stream_or_default);
    if ((stream.capture != nullptr) != (flags == cudaEventRecordExternal)) return cudaErrorInvalidValue;
    machine.queue(stream, [time = event->time] { *time = gsh::test::EmulatedEvent::Clock::now(); });
    event->stream = &stream, event->position = stream.queued, event->recorded = true;
    return cudaSuccess;
}
inline cudaError_t cudaEventRecord(cudaEvent_t event, cudaStream_t stream) {
    return cudaEventRecordWithFlags(event, stream, cudaEventDefault);
}
inline cudaError_t cudaStreamWaitEvent(cudaStream_t stream, cudaEvent_t event, unsigned = 0) {
    auto& machine = gsh::test::CudaEmulation::instance();
    if (!event->recorded) return cudaSuccess;
    machine.queue(machine.stream(stream),
                  [&machine, before = *event] { machine.finish(*before.stream, before.position); });
    return cudaSuccess;
}
inline cudaError_t cudaEventSynchronize(cudaEvent_t event) {
    auto& machine = gsh::test::CudaEmulation::instance();
    machine.count_wait();
    if (machine.next_error != cudaSuccess) return machine.next_error;
    if (event->recorded) machine.finish(*event->stream, event->position);
    return cudaSuccess;
}
inline cudaError_t cudaEventQuery(cudaEvent_t event) {
    return !event->recorded || event->stream->finished >= event->position ? cudaSuccess : cudaErrorNotReady;
}
inline cudaError_t cudaEventElapsedTime(float* milliseconds, cudaEvent_t from, cudaEvent_t to) {
    if (!from->recorded || !to->recorded) return cudaErrorInvalidValue;
    if (cudaEventQuery(from) != cudaSuccess || cudaEventQuery(to) != cudaSuccess) return cudaErrorNotReady;
    *milliseconds = std::chrono::duration<float, std::milli>(*to->time - *from->time).count();
    return cudaSuccess;
}
inline cudaError_t cudaLaunchHostFunc(cudaStream_t stream, void (*function)(void*), void* data) {
    auto& machine = gsh::test::CudaEmulation::instance();
    machine.queue(machine.stream(stream), [=] { function(data); });
    return cudaSuccess;
}

namespace gsh::test {

/// A launch with its arguments.
template <class... Parameters>
struct KernelWork : EmulatedWork {
    void (*function)(Parameters...);
    std::tuple<std::remove_cvref_t<Parameters>...> arguments;
    dim3 grid, block;

    template <class... Arguments>
    KernelWork(void (*run_one)(Parameters...), dim3 grid_size, dim3 block_size, Arguments&&... values)
        : function(run_one), arguments(std::forward<Arguments>(values)...), grid(grid_size), block(block_size) {}
    void run() override {
        const auto check = [](const auto& argument) {
            if (const std::string found = host_address_in(argument); !found.empty()) throw KernelFault(found);
        };
        std::apply([&](const auto&... argument) { (check(argument), ...); }, arguments);
        CudaEmulation::instance().run_blocks(grid, block, [this] { std::apply(function, arguments); });
    }
    [[nodiscard]] std::unique_ptr<EmulatedWork> copy() const override { return std::make_unique<KernelWork>(*this); }
    [[nodiscard]] const void* kernel() const override { return reinterpret_cast<const void*>(function); }
    void set(dim3 grid_size, dim3 block_size, void** values) override {
        grid = grid_size, block = block_size;
        const auto assign = [&](auto& argument) {
            argument = *static_cast<std::remove_reference_t<decltype(argument)>*>(*values++);
        };
        std::apply([&](auto&... argument) { (assign(argument), ...); }, arguments);
    }
};

} // namespace gsh::test

/// Queues a kernel. Its arguments are copied now, as the runtime does.
template <class... Parameters, class... Arguments>
cudaError_t cudaLaunchKernelEx(const cudaLaunchConfig_t* config, void (*kernel)(Parameters...),
                               Arguments&&... arguments) {
    auto& machine = gsh::test::CudaEmulation::instance();
    const dim3 grid = config->gridDim, block = config->blockDim;
    if (grid.x == 0 || grid.y != 1 || grid.z != 1 || block.x == 0 || block.x * block.y * block.z > 1024)
        return cudaErrorInvalidValue; // gsh uses one-dimensional grids
    machine.queue(machine.stream(config->stream), std::make_unique<gsh::test::KernelWork<Parameters...>>(
                                                      kernel, grid, block, std::forward<Arguments>(arguments)...));
    return cudaSuccess;
}

inline cudaError_t cudaStreamBeginCapture(cudaStream_t stream, cudaStreamCaptureMode mode) {
    auto& machine = gsh::test::CudaEmulation::instance();
    if (machine.next_error != cudaSuccess) return machine.next_error;
    if (!stream || stream->capture) return cudaErrorStreamCaptureUnsupported;
    stream->capture = std::make_unique<gsh::test::EmulatedGraph>();
    ++machine.captures;
    stream->strict = mode != cudaStreamCaptureModeRelaxed;
    machine.count_strict_captures(stream->strict);
    return cudaSuccess;
}
inline cudaError_t cudaStreamEndCapture(cudaStream_t stream, cudaGraph_t* graph) {
    if (!stream->capture) return cudaErrorInvalidValue;
    gsh::test::CudaEmulation::instance().count_strict_captures(-int(stream->strict));
    *graph = stream->capture.release();
    return cudaSuccess;
}
inline cudaError_t cudaStreamIsCapturing(cudaStream_t stream, cudaStreamCaptureStatus* status) {
    *status = gsh::test::CudaEmulation::instance().stream(stream).capture ? cudaStreamCaptureStatusActive
                                                                          : cudaStreamCaptureStatusNone;
    return cudaSuccess;
}
/// The nodes that the next one depends on.
inline cudaError_t cudaStreamGetCaptureInfo(cudaStream_t stream, cudaStreamCaptureStatus* status,
                                            unsigned long long* = nullptr, cudaGraph_t* graph = nullptr,
                                            const cudaGraphNode_t** nodes = nullptr,
                                            const cudaGraphEdgeData** edges = nullptr, std::size_t* count = nullptr) {
    cudaStreamIsCapturing(stream, status);
    if (edges) *edges = nullptr;
    if (!stream->capture) return cudaSuccess;
    if (graph) *graph = stream->capture.get();
    if (nodes) *nodes = stream->capture->next_dependencies.data();
    if (count) *count = stream->capture->next_dependencies.size();
    return cudaSuccess;
}
inline cudaError_t cudaStreamUpdateCaptureDependencies(cudaStream_t stream, cudaGraphNode_t* nodes,
                                                       const cudaGraphEdgeData* edges, std::size_t count,
                                                       unsigned flags) {
    if (!stream->capture || edges || flags != cudaStreamSetCaptureDependencies) return cudaErrorInvalidValue;
    stream->capture->next_dependencies.assign(nodes, nodes + count);
    return cudaSuccess;
}
inline cudaError_t cudaGraphInstantiate(cudaGraphExec_t* executable, cudaGraph_t graph, unsigned long long = 0) {
    *executable = new gsh::test::EmulatedGraph;
    (*executable)->captured = graph;
    (*executable)->dependencies = graph->dependencies;
    for (const auto& node : graph->nodes) (*executable)->nodes.push_back(node->copy());
    return cudaSuccess;
}
inline cudaError_t cudaGraphDestroy(cudaGraph_t graph) {
    delete graph;
    return cudaSuccess;
}
inline cudaError_t cudaGraphExecDestroy(cudaGraphExec_t graph) {
    delete graph;
    return cudaSuccess;
}
/// Queues the nodes with the arguments that they have now. Those that do not depend on each other take their turns in
/// CudaEmulation::order.
inline cudaError_t cudaGraphLaunch(cudaGraphExec_t graph, cudaStream_t stream) {
    auto& machine = gsh::test::CudaEmulation::instance();
    ++machine.graph_launches;
    std::uint64_t choices = 0;
    const auto choose = [&](std::size_t count) -> std::size_t {
        if (machine.order == gsh::test::Order::forward) return 0;
        if (machine.order == gsh::test::Order::reverse) return count - 1;
        return gsh::random_bits(machine.seed + machine.graph_launches, choices++) % count;
    };
    for (const std::size_t i : graph->in_order(choose))
        machine.queue(machine.stream(stream), graph->nodes[i]->copy());
    return cudaSuccess;
}
/// Changes a launch in launches of the graph from now on. `node` is of the graph that was captured.
inline cudaError_t cudaGraphExecKernelNodeSetParams(cudaGraphExec_t graph, cudaGraphNode_t node,
                                                    const cudaKernelNodeParams* parameters) {
    const auto& captured = graph->captured->nodes;
    for (std::size_t i = 0; i < captured.size(); ++i) {
        if (captured[i].get() != node) continue;
        if (node->kernel() != parameters->func) return cudaErrorInvalidValue;
        graph->nodes[i]->set(parameters->gridDim, parameters->blockDim, parameters->kernelParams);
        return cudaSuccess;
    }
    return cudaErrorInvalidValue;
}
