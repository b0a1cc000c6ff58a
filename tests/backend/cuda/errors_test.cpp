// SPDX-License-Identifier: Apache-2.0
/// @file  What a user is told when there is no GPU, or another one than expected, or when it fails: on the emulation.
#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/step_graph.cuh>
#include <gsh/backend/memory.hpp>

#include <doctest/doctest.h>

#include <cstddef>
#include <string>
#include <vector>

namespace {

using namespace gsh;
using cuda::Device;
using test::CudaEmulation;

/// Sets the machine for the time of a test.
struct Machine {
    CudaEmulation& is = CudaEmulation::instance();
    ~Machine() {
        is.device_count = 1, is.device = 0, is.driver_is_missing = is.code_is_missing = false;
        is.capability_major = 9, is.capability_minor = 0;
        is.memory_limit = std::size_t(1) << 30;
        is.next_error = cudaSuccess;
    }
};

/// A stream of the caller's that is being captured.
struct Capture {
    cudaStream_t stream = nullptr;
    Capture() { REQUIRE(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking) == cudaSuccess); }
    void begin(cudaStreamCaptureMode mode = cudaStreamCaptureModeGlobal) const {
        REQUIRE(cudaStreamBeginCapture(stream, mode) == cudaSuccess);
    }
    cudaGraphExec_t end() const {
        cudaGraph_t graph = nullptr;
        cudaGraphExec_t executable = nullptr;
        REQUIRE(cudaStreamEndCapture(stream, &graph) == cudaSuccess);
        REQUIRE(cudaGraphInstantiate(&executable, graph, 0) == cudaSuccess);
        cudaGraphDestroy(graph);
        return executable;
    }
    ~Capture() { cudaStreamDestroy(stream); }
};

} // namespace

TEST_CASE("Without a driver or a GPU, the error says which of them is missing") {
    Machine machine;
    machine.is.driver_is_missing = true;
    CHECK_FALSE(Device::available());
    CHECK_THROWS_WITH_AS(
        Device(),
        "gsh::cuda::Device: cudaErrorInsufficientDriver: cudaErrorInsufficientDriver; the driver of the "
        "GPU is missing or older than this program's CUDA",
        DeviceError);
    machine.is.driver_is_missing = false;
    machine.is.device_count = 0;
    CHECK_FALSE(Device::available());
    CHECK_THROWS_WITH_AS(
        Device(),
        "gsh::cuda::Device: cudaErrorNoDevice: cudaErrorNoDevice; is there an NVIDIA GPU, and may this "
        "process use it?",
        DeviceError);
}

TEST_CASE("A GPU that is not there is refused by its number") {
    Machine machine;
    machine.is.device_count = 2;
    CHECK_THROWS_WITH_AS(Device(2), "gsh::cuda::Device: there is no GPU 2, expected one of 0 to 1", DeviceError);
    CHECK_THROWS_WITH_AS(Device(-1), "gsh::cuda::Device: there is no GPU -1, expected one of 0 to 1", DeviceError);
    CHECK(Device(1).ordinal() == 1);
}

TEST_CASE("A GPU for which the program has no code is named with its capability") {
    Machine machine;
    machine.is.code_is_missing = true;
    machine.is.capability_major = 8, machine.is.capability_minor = 7;
    CHECK_THROWS_WITH_AS(Device(), doctest::Contains("GPU 0 has compute capability 8.7; compile with nvcc -arch=sm_87"),
                         DeviceError);
    machine.is.capability_major = 7, machine.is.capability_minor = 0;
    CHECK_THROWS_WITH_AS(Device(), doctest::Contains("GPU 0 has compute capability 7.0; gsh needs 7.5 or later"),
                         DeviceError);
}

TEST_CASE("Too little device memory is told with what is needed, what is free, and what to lower") {
    Machine machine;
    machine.is.memory_limit = std::size_t(64) << 20;
    const Device device;
    CHECK_THROWS_WITH_AS(Device::Buffer<float>(std::size_t(25) << 20),
                         "gsh::cuda::Buffer::resize: 100.0 MiB of device memory are needed, 64.0 MiB of 64.0 MiB are "
                         "free; lower the number of Gaussians, the size of the images or that of the tables, or "
                         "TrainParams::photo_memory (--max-memory of the programs)",
                         DeviceError);
    machine.is.next_error = cudaErrorLaunchFailure; // of a kernel before
    CHECK_THROWS_WITH_AS(Device::Buffer<float>(1), doctest::Contains("cudaErrorLaunchFailure"), DeviceError);
}

TEST_CASE("Memory of the host or of another GPU is refused where the GPU's own is due") {
    Machine machine;
    machine.is.device_count = 2;
    Device first(0);
    const Device::Buffer<float> here(10);
    Device second(1);
    const Device::Buffer<float> there(10);
    const std::vector<float> host(10);
    CHECK_NOTHROW(check_memory(first, "f", "x", Span<const float>(here)));
    CHECK_THROWS_AS(check_memory(first, "f", "x", Span<const float>(there)), MemoryError);
    CHECK_THROWS_AS(check_memory(second, "f", "x", Span<const float>(here)), MemoryError);
    CHECK_THROWS_AS(check_memory(second, "f", "x", Span<const float>(host)), MemoryError);
    CHECK_FALSE(first.owns(here.data(), 44)); // one element beyond the end
}

TEST_CASE("A stream decides which GPU is used") {
    Machine machine;
    machine.is.device_count = 2;
    REQUIRE(cudaSetDevice(1) == cudaSuccess);
    const Capture second;
    REQUIRE(cudaSetDevice(0) == cudaSuccess);
    const Device device(second.stream);
    CHECK(device.ordinal() == 1);
    const Device::Buffer<float> buffer(10); // on the GPU of the device made last
    CHECK(device.owns(buffer.data(), 40));
}

TEST_CASE("A device is refused while another GPU is current, on which its buffers would be made") {
    Machine machine;
    machine.is.device_count = 2;
    Device first(0);
    Device::Buffer<int> numbers(10);
    cuda::StepGraph step(first);
    std::vector<int> host(10, 7);
    const Device second(1);
    const auto told = doctest::Contains(
        "gsh::cuda::Device: GPU 1 is current in this thread, expected the device's, GPU 0; call cudaSetDevice(0)");
    CHECK_THROWS_WITH_AS(first.fill(Span<int>(numbers), 1), told, DeviceError);
    CHECK_THROWS_WITH_AS(first.upload(Span<const int>(host), Span<int>(numbers)), told, DeviceError);
    CHECK_THROWS_WITH_AS(first.download(Span<const int>(numbers), Span<int>(host)), told, DeviceError);
    CHECK_THROWS_WITH_AS(step.run([] {}), told, DeviceError);
    REQUIRE(cudaSetDevice(0) == cudaSuccess);
    step.run([&] { first.fill(Span<int>(numbers), 3); });
    first.download(Span<const int>(numbers), Span<int>(host));
    CHECK(host == std::vector<int>(10, 3));
}

TEST_CASE("Device fills, copies, uploads and downloads only the memory that each must have") {
    const Machine machine;
    Device device;
    Device::Buffer<float> here(10);
    std::vector<float> host(10), other(10);
    const Span<float> on_host(host);
    const auto told = [](const char* what) {
        return doctest::Contains((std::string(what) + " is not memory of the backend 'cuda'").c_str());
    };
    CHECK_THROWS_WITH_AS(device.fill(on_host, 1.0f), told("Device::fill: values"), MemoryError);
    CHECK_THROWS_WITH_AS(device.copy(Span<const float>(host), Span<float>(here)), told("Device::copy: from"),
                         MemoryError);
    CHECK_THROWS_WITH_AS(device.copy(Span<const float>(here), on_host), told("Device::copy: to"), MemoryError);
    CHECK_THROWS_WITH_AS(device.upload(Span<const float>(other), on_host), told("Device::upload: to"), MemoryError);
    CHECK_THROWS_WITH_AS(device.download(Span<const float>(host), Span<float>(other)), told("Device::download: from"),
                         MemoryError);
}

TEST_CASE("A device on the legacy default stream records steps, and a step that cannot begin leaves nothing behind") {
    Machine machine;
    Device device(cudaStream_t(nullptr));
    Device::Buffer<int> numbers(10);
    std::vector<int> host(10);
    cuda::StepGraph step(device);
    machine.is.next_error = cudaErrorLaunchFailure;
    CHECK_THROWS_AS(step.run([] {}), DeviceError);
    CHECK_FALSE(device.deferring());
    machine.is.next_error = cudaSuccess;
    for (int round = 1; round <= 3; ++round) {
        step.run([&] { device.fill(Span<int>(numbers), round); });
        device.download(Span<const int>(numbers), Span<int>(host));
        CHECK(host == std::vector<int>(10, round));
    }
    const std::size_t free = machine.is.free_memory();
    { const Device::Buffer<int> buffer(1000); }
    CHECK(machine.is.free_memory() == free); // no step holds what is given back
}

TEST_CASE("Inside the caller's capture a buffer does not grow even where CUDA allows it") {
    const Machine machine;
    const Capture capture;
    Device device(capture.stream);
    Device::Buffer<int> numbers(10);
    capture.begin(cudaStreamCaptureModeRelaxed);
    device.fill(Span<int>(numbers), 5);
    CHECK_THROWS_WITH_AS(numbers.resize(1000), doctest::Contains("a buffer must grow while a stream is captured"),
                         DeviceError);
    REQUIRE(numbers.size() == 10); // as it was
    const cudaGraphExec_t graph = capture.end();
    REQUIRE(cudaGraphLaunch(graph, capture.stream) == cudaSuccess);
    std::vector<int> host(10);
    device.download(Span<const int>(numbers), Span<int>(host));
    CHECK(host == std::vector<int>(10, 5));
    CHECK_NOTHROW(numbers.resize(1000));
    cudaGraphExecDestroy(graph);
}

TEST_CASE("Inside the caller's capture a buffer cannot grow, and the host neither waits nor lends its memory") {
    const Machine machine;
    const Capture capture;
    Device device(capture.stream);
    Device::Buffer<int> numbers(10), large(10000);
    std::vector<int> host(10, 1), many(10000, 1);
    capture.begin();
    CHECK(device.deferring());
    CHECK_THROWS_WITH_AS(
        Device::Buffer<int>(1000),
        doctest::Contains("a buffer must grow while a stream is captured; run the same work once before the capture"),
        DeviceError);
    CHECK_THROWS_WITH_AS(device.download(Span<const int>(numbers), Span<int>(host)),
                         "gsh::cuda::Device::download: the host cannot wait for the device inside a capture of the "
                         "caller's; wait after the graph has been launched",
                         DeviceError);
    CHECK_THROWS_WITH_AS(device.synchronize(), doctest::Contains("synchronize: the host cannot wait"), DeviceError);
    cuda::StepGraph step(device);
    CHECK_THROWS_WITH_AS(step.run([] {}), doctest::Contains("the caller captures the stream"), ValueError);
    CHECK_THROWS_WITH_AS(
        device.upload(Span<const int>(many), Span<int>(large)),
        "gsh::cuda::Device::upload: 40000 bytes inside a capture of the caller's, expected at most 8192; "
        "upload them before the capture begins",
        DeviceError);
    device.upload(Span<const int>(host), Span<int>(numbers));
    host.assign(10, 7); // the graph has its own copy
    const cudaGraphExec_t graph = capture.end();
    CHECK_FALSE(device.deferring());
    REQUIRE(cudaGraphLaunch(graph, capture.stream) == cudaSuccess);
    device.download(Span<const int>(numbers), Span<int>(host));
    CHECK(host == std::vector<int>(10, 1));
    cudaGraphExecDestroy(graph);
}

TEST_CASE("A kernel that fails is found at the next wait, and every call after it names the same error") {
    Machine machine;
    std::vector<int> host(10); // lives longer than the copies that wait in the queue
    Device device;
    Device::Buffer<int> numbers(10);
    device.fill(Span<int>(numbers), 1);
    machine.is.next_error = cudaErrorLaunchFailure;
    for (int call = 0; call < 2; ++call)
        CHECK_THROWS_WITH_AS(device.download(Span<const int>(numbers), Span<int>(host)),
                             "gsh::cuda::Device::download: cudaErrorLaunchFailure: cudaErrorLaunchFailure",
                             DeviceError);
    CHECK_THROWS_WITH_AS(device.synchronize(),
                         "gsh::cuda::Device::synchronize: cudaErrorLaunchFailure: cudaErrorLaunchFailure", DeviceError);
}

TEST_CASE("A kernel that fails inside a recorded step is one error, which gives the step up") {
    Machine machine;
    std::vector<int> host(10);
    Device device;
    Device::Buffer<int> numbers(10);
    cuda::StepGraph graph(device);
    const auto step = [&](bool fails) {
        device.fill(Span<int>(numbers), 1);
        if (fails) machine.is.next_error = cudaErrorLaunchFailure;
        device.download(Span<const int>(numbers), Span<int>(host)); // ends a graph; the next cannot begin
        device.fill(Span<int>(numbers), 2);
    };
    CHECK_THROWS_WITH_AS(graph.run([&] { step(true); }), doctest::Contains("download: cudaErrorLaunchFailure"),
                         DeviceError);
    CHECK_FALSE(device.deferring());
    machine.is.next_error = cudaSuccess;
    for (int k = 0; k < 2; ++k) graph.run([&] { step(false); });
    device.download(Span<const int>(numbers), Span<int>(host));
    CHECK(host == std::vector<int>(10, 2));
}
