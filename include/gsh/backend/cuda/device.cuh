// SPDX-License-Identifier: Apache-2.0
/// @file  The CUDA backend: an NVIDIA GPU and a stream on it.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/cuda/error.cuh>
#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/backend/cuda/memory.cuh>
#include <gsh/backend/cuda/recorder.cuh>
#include <gsh/backend/cuda/stream.cuh>
#include <gsh/backend/memory.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>

#include <cuda_runtime.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <exception>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>

namespace gsh::cuda {

/// Runs everything on one stream of one GPU, in order.
///
/// Calls return when the work is queued. download and synchronize wait for it and report its errors. A device belongs
/// to the thread that made it, and its buffers to the GPU that was current when they were made: a thread with devices
/// on several GPUs calls cudaSetDevice before it uses each.
///
/// Errors  DeviceError: no driver, no such GPU, no code for its architecture, another GPU is current, a kernel that
///         failed.
class Device {
public:
    template <class T>
    using Buffer = cuda::Buffer<T>;
    static constexpr bool host_memory = false;

    /// A new stream on GPU `ordinal`, counted from 0 as in CUDA_VISIBLE_DEVICES.
    explicit Device(int ordinal = 0) : ordinal_(ordinal) {
        check_ordinal();
        check(cudaSetDevice(ordinal), where);
        check_code();
        stream_ = owned_.emplace(where).get();
        resume();
    }
    /// The caller's stream, which must live longer than the device. Work is queued behind what is there already, and
    /// the caller's own later work on the stream comes after it. A capture that the caller has begun receives the
    /// work, provided that no buffer has to grow and nothing is downloaded: do the same work once before. A null
    /// pointer is the legacy default stream of the current GPU.
    explicit Device(cudaStream_t stream) : stream_(stream), callers_(std::in_place, stream) {
        int count = 0;
        check_driver(cudaGetDeviceCount(&count));
        check(cudaStreamGetDevice(stream, &ordinal_), where, "is it a stream of this process?");
        check(cudaSetDevice(ordinal_), where);
        check_code();
        resume();
    }
    Device(const Device&) = delete;
    Device& operator=(const Device&) = delete;
    ~Device() = default;

    [[nodiscard]] static constexpr std::string_view name() { return "cuda"; }
    [[nodiscard]] static bool available() {
        int count = 0;
        const bool found = cudaGetDeviceCount(&count) == cudaSuccess && count > 0;
        (void)cudaGetLastError();
        return found;
    }

    [[nodiscard]] int ordinal() const { return ordinal_; }
    [[nodiscard]] cudaStream_t stream() const { return stream_; }
    /// The name of the GPU, for instance "NVIDIA H100 80GB HBM3".
    [[nodiscard]] std::string gpu() const {
        cudaDeviceProp properties;
        check(cudaGetDeviceProperties(&properties, ordinal_), where);
        return properties.name;
    }

    /// Whether all of `bytes` is memory of this GPU.
    [[nodiscard]] bool owns(const void* memory, std::size_t bytes) const {
        return bytes == 0 || (is_here(memory) && is_here(static_cast<const unsigned char*>(memory) + bytes - 1));
    }

    /// Bytes of the GPU's memory that no process has taken.
    [[nodiscard]] std::uint64_t free_memory() const {
        std::size_t free = 0, total = 0;
        check(cudaMemGetInfo(&free, &total), where);
        return free;
    }

    /// The most bytes that buffers of this process have had at one time, on all GPUs together.
    [[nodiscard]] static std::uint64_t peak_memory() { return detail::MemoryUse::instance().peak(); }

    [[nodiscard]] Precision precision() const { return precision_; }
    /// Holds for later work. Mixed precision runs on tensor cores, from compute capability 8.0 on; before, it is slow.
    /// Forward and backward of one step must have the same.
    void set_precision(Precision precision) { precision_ = precision; }

    /// Queues blocks of a kernel (backend/cuda/kernel.cuh).
    template <class Kernel>
    void launch(std::size_t blocks, const Kernel& kernel) {
        if (blocks == 0) return;
        check_value(blocks <= std::size_t(std::numeric_limits<int>::max()), "gsh::cuda::Device::launch",
                    "more blocks than a grid has");
        if (recorder_ != nullptr) {
            recorder_->launch(static_cast<unsigned>(blocks), kernel);
        } else {
            check_current();
            detail::launch_on(stream_, static_cast<unsigned>(blocks), kernel);
        }
    }
    /// Queues the work of another library on the stream. It must do the same whenever `key` is the same.
    void call(std::string_view key, const std::function<void(cudaStream_t)>& work) {
        if (recorder_ != nullptr) {
            recorder_->call(key, work);
        } else {
            check_current();
            work(stream_);
        }
    }

    template <class Body>
    void for_each(std::size_t n, const Body& body) {
        using Kernel = detail::ForEach<Body>;
        launch((n + Kernel::block_size - 1) / Kernel::block_size, Kernel{body, n});
    }
    /// Errors  MemoryError unless `values` is memory of this GPU.
    template <class T>
    void fill(Span<T> values, std::type_identity_t<T> value) {
        check_here("gsh::cuda::Device::fill", "values", values);
        if (recorder_ != nullptr && detail::ZeroFills::is_zero(value))
            recorder_->zero(values);
        else
            for_each(values.size(), detail::Fill<T>{values, value});
    }
    /// Errors  MemoryError unless both are memory of this GPU.
    template <class T>
    void copy(Span<const T> from, Span<std::type_identity_t<T>> to) {
        constexpr std::string_view function = "gsh::cuda::Device::copy";
        check_size(function, "destination", to.size(), from.size());
        check_here(function, "from", from);
        check_here(function, "to", to);
        for_each(from.size(), detail::Copy<T>{from, to});
    }

    /// gsh::for_each_branch. Outside a recorded step, the branches run one after the other.
    template <class Branch>
    void for_each_branch(std::size_t count, const Branch& branch) {
        if (recorder_ != nullptr) {
            recorder_->fork(count, branch);
        } else {
            for (std::size_t i = 0; i < count; ++i) branch(i);
        }
    }

    /// Queues a copy; `from` may change as soon as the call returns. A copy from page-locked memory is therefore waited
    /// for. Inside a capture of the caller's, 8 KiB at most.
    /// Errors  MemoryError unless `from` is host memory and `to` memory of this GPU.
    template <class T>
    void upload(Span<const T> from, Span<std::type_identity_t<T>> to) {
        constexpr std::string_view function = "gsh::cuda::Device::upload";
        check_size(function, "destination", to.size(), from.size());
        if (from.empty()) return;
        const cudaMemoryType kind = host_memory_kind(function, "from", from.data());
        check_here(function, "to", to);
        constexpr std::size_t most = most_small_uploads * detail::SmallUpload::capacity;
        const std::size_t bytes = from.size() * sizeof(T);
        if (bytes <= most && deferring()) {
            upload_small(reinterpret_cast<const unsigned char*>(from.data()), bytes,
                         reinterpret_cast<unsigned char*>(to.data()));
            return;
        }
        if (is_captured()) // a graph would keep the address, and read the memory in each of its launches
            throw DeviceError(std::string(function) + ": " + std::to_string(bytes) +
                              " bytes inside a capture of the caller's, expected at most " + std::to_string(most) +
                              "; upload them before the capture begins");
        const Cut cut(recorder_);
        check_current();
        check(cudaMemcpyAsync(to.data(), from.data(), bytes, cudaMemcpyHostToDevice, stream_), function);
        if (kind != cudaMemoryTypeUnregistered) // the copy reads it later, not through a buffer of the driver's
            check(cudaStreamSynchronize(stream_), function);
    }
    /// Waits for all work before it.
    /// Errors  MemoryError unless `from` is memory of this GPU and `to` host memory.
    template <class T>
    void download(Span<const T> from, Span<std::type_identity_t<T>> to) {
        constexpr std::string_view function = "gsh::cuda::Device::download";
        check_size(function, "destination", to.size(), from.size());
        if (from.empty()) return;
        (void)host_memory_kind(function, "to", to.data());
        check_here(function, "from", from);
        const Cut cut(recorder_);
        refuse_wait_in_capture(function);
        check_current();
        check(cudaMemcpyAsync(to.data(), from.data(), from.size() * sizeof(T), cudaMemcpyDeviceToHost, stream_),
              function);
        check(cudaStreamSynchronize(stream_), function);
    }
    void synchronize() {
        constexpr std::string_view function = "gsh::cuda::Device::synchronize";
        const Cut cut(recorder_);
        refuse_wait_in_capture(function);
        check(cudaStreamSynchronize(stream_), function);
    }

    /// Later work waits for an event of another stream.
    void wait(cudaEvent_t event) {
        const Cut cut(recorder_);
        check(cudaStreamWaitEvent(stream_, event, 0), "gsh::cuda::Device::wait");
    }
    /// The event happens when all work before it is done.
    void record(cudaEvent_t event) {
        const Cut cut(recorder_);
        check(cudaEventRecord(event, stream_), "gsh::cuda::Device::record");
    }

    /// Names the stage that later launches of a recorded step belong to, for StepGraph::time_kernels. The name is kept,
    /// not copied.
    void mark(std::string_view stage) {
        if (recorder_ != nullptr) recorder_->mark(stage);
    }

    /// Whether a step is being recorded (StepGraph), or the caller captures the stream: then components do not wait for
    /// the device to learn whether their input was accepted. What is wrong halts the device instead.
    [[nodiscard]] bool deferring() const { return recorder_ != nullptr || is_captured(); }

    /// One word of device memory: 0 while all is well. A kernel that cannot do its work in a recorded step (more pairs
    /// than the buffers hold, a number that is not finite) sets it to another number, and kernels that change what is
    /// learned (Adam, density control) do nothing while it is set. Queued steps therefore change nothing either, and
    /// the host finds everything as it was before the step that failed.
    [[nodiscard]] Span<std::uint32_t> halted() { return halted_; }
    /// Clears it.
    void resume() {
        halted_.resize(1);
        fill(Span<std::uint32_t>(halted_), 0u);
    }

    /// Repeated steps of `owner` follow (RepeatedStep). The word above is theirs until another owner's follow.
    /// Errors  ValueError if steps of another owner, which is still there, have failed and have not been settled.
    void begin_steps(const std::shared_ptr<const void>& owner) {
        const std::shared_ptr<const void> last = steps_of_.lock();
        if (last == owner) return;
        if (last == nullptr) resume();
        else
            check_value(!has_halted(*this), "gsh::RepeatedStep::run",
                        "steps of another trainer or fit on this device have failed; settle it first");
        steps_of_ = owner;
    }
    [[nodiscard]] bool runs_steps_of(const std::shared_ptr<const void>& owner) const {
        return steps_of_.lock() == owner;
    }

private:
    friend class StepGraph;

    static constexpr std::string_view where = "gsh::cuda::Device";
    static constexpr std::size_t most_small_uploads = 4;
    static constexpr int least_capability = 75; // the oldest that nvcc 13 compiles for

    /// Work that cannot be recorded runs during the lifetime of a cut. After an exception the step is given up
    /// (StepGraph), so nothing is resumed: on a device that has failed, this would throw a second exception.
    class Cut {
    public:
        explicit Cut(detail::Recorder* recorder) : recorder_(recorder), exceptions_(std::uncaught_exceptions()) {
            if (recorder_ != nullptr) recorder_->cut();
        }
        Cut(const Cut&) = delete;
        ~Cut() noexcept(false) {
            if (recorder_ != nullptr && std::uncaught_exceptions() == exceptions_) recorder_->resume();
        }

    private:
        detail::Recorder* recorder_;
        int exceptions_;
    };

    static void check_driver(cudaError_t error) {
        check(error, where,
              error == cudaErrorInsufficientDriver
                  ? "the driver of the GPU is missing or older than this program's CUDA"
                  : "is there an NVIDIA GPU, and may this process use it?");
    }
    void check_ordinal() const {
        int count = 0;
        check_driver(cudaGetDeviceCount(&count));
        if (ordinal_ < 0 || ordinal_ >= count)
            throw DeviceError("gsh::cuda::Device: there is no GPU " + std::to_string(ordinal_) +
                              ", expected one of 0 to " + std::to_string(count - 1));
    }
    /// Buffers are made on the current GPU, and launches on a stream of another one fail.
    void check_current() const {
        int current = 0;
        check(cudaGetDevice(&current), where);
        if (current != ordinal_)
            throw DeviceError("gsh::cuda::Device: GPU " + std::to_string(current) +
                              " is current in this thread, expected the device's, GPU " + std::to_string(ordinal_) +
                              "; call cudaSetDevice(" + std::to_string(ordinal_) + ") before the device is used");
    }
    /// A recorded step does without this check, which takes time of the host: components check their arguments.
    template <class T>
    void check_here(std::string_view function, std::string_view argument, Span<T> memory) const {
        if (recorder_ == nullptr) check_memory(*this, function, argument, memory);
    }
    void refuse_wait_in_capture(std::string_view function) const {
        if (is_captured())
            throw DeviceError(std::string(function) +
                              ": the host cannot wait for the device inside a capture of the caller's; wait after the "
                              "graph has been launched");
    }
    /// The program must contain code for this GPU.
    void check_code() const {
        cudaFuncAttributes attributes;
        const cudaError_t error =
            cudaFuncGetAttributes(&attributes, &detail::run_kernel<detail::ForEach<gsh::detail::NoOp>>);
        if (error == cudaSuccess) return;
        int major = 0, minor = 0;
        (void)cudaDeviceGetAttribute(&major, cudaDevAttrComputeCapabilityMajor, ordinal_);
        (void)cudaDeviceGetAttribute(&minor, cudaDevAttrComputeCapabilityMinor, ordinal_);
        const int capability = 10 * major + minor;
        check(error, where,
              "GPU " + std::to_string(ordinal_) + " has compute capability " + std::to_string(major) + "." +
                  std::to_string(minor) + "; " +
                  (capability < least_capability ? "gsh needs 7.5 or later"
                                                 : "compile with nvcc -arch=sm_" + std::to_string(capability)));
    }
    /// Those of unregistered memory where CUDA does not answer.
    [[nodiscard]] static cudaPointerAttributes attributes_of(const void* memory) {
        cudaPointerAttributes attributes{};
        if (cudaPointerGetAttributes(&attributes, memory) == cudaSuccess) return attributes;
        (void)cudaGetLastError();
        return cudaPointerAttributes{};
    }
    [[nodiscard]] bool is_here(const void* memory) const {
        const cudaPointerAttributes attributes = attributes_of(memory);
        return attributes.type == cudaMemoryTypeDevice && attributes.device == ordinal_;
    }
    /// What kind of host memory it is.
    /// Errors  MemoryError for memory of a GPU.
    static cudaMemoryType host_memory_kind(std::string_view function, std::string_view argument, const void* memory) {
        const cudaMemoryType kind = attributes_of(memory).type;
        if (kind == cudaMemoryTypeDevice)
            throw MemoryError(std::string(function) + ": " + std::string(argument) +
                              " is memory of a GPU, expected host memory; Device::copy copies within the GPU");
        return kind;
    }
    /// Whether the caller captures the stream.
    [[nodiscard]] bool is_captured() const { return recorder_ == nullptr && detail::is_capturing(stream_); }
    void upload_small(const unsigned char* from, std::size_t bytes, unsigned char* to) {
        for (std::size_t first = 0; first < bytes; first += detail::SmallUpload::capacity) {
            detail::SmallUpload kernel{};
            kernel.to = to + first;
            kernel.count = static_cast<unsigned>(std::min(bytes - first, detail::SmallUpload::capacity));
            std::memcpy(kernel.bytes, from + first, kernel.count);
            launch(1, kernel);
        }
    }

    /// Steps are recorded on a stream of their own: the caller's may be one that cannot be captured.
    [[nodiscard]] cudaStream_t recording_stream() {
        if (!recording_) recording_.emplace(where);
        return recording_->get();
    }

    int ordinal_ = 0;
    cudaStream_t stream_ = nullptr;
    std::optional<detail::OwnedStream> owned_, recording_;
    std::optional<detail::CallersStream> callers_;
    Precision precision_ = Precision::fp32;
    Buffer<std::uint32_t> halted_;
    std::weak_ptr<const void> steps_of_; // whose steps were the last
    detail::Recorder* recorder_ = nullptr;
};
static_assert(Backend<Device> && !CpuBackend<Device>);

} // namespace gsh::cuda
