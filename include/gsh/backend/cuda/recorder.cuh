// SPDX-License-Identifier: Apache-2.0
/// @file  Repeats a sequence of kernels as CUDA graphs, with the arguments that they have each time.
#pragma once

#include <gsh/backend/cuda/error.cuh>
#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/backend/cuda/memory.cuh>

#include <cuda_runtime.h>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

namespace gsh::cuda::detail {

/// Launches a kernel on a stream.
template <class Kernel>
void launch_on(cudaStream_t stream, unsigned blocks, const Kernel& kernel) {
    cudaLaunchConfig_t config{};
    config.gridDim = dim3(blocks);
    config.blockDim = dim3(Kernel::block_size);
    config.stream = stream;
    check(cudaLaunchKernelEx(&config, &run_kernel<Kernel>, kernel), "gsh::cuda::Device::launch");
}

/// Records the kernels of a step while its host code runs, and repeats them as one CUDA graph.
///
/// Host code runs in every step, as it would without a recorder, and decides what the step does: camera, photograph,
/// rates. In the first step the stream captures its kernels. In later steps each launch is compared with the recorded
/// one. If its arguments differ, the node of the graph receives the new ones; if they are the same, the launch costs a
/// comparison of a few hundred bytes. At the end one call launches all kernels. If the sequence itself differs (another
/// kernel, another number of blocks), the rest of it is captured anew.
///
/// Work that cannot be part of a graph, such as a download, cuts the sequence: what comes before is launched, then the
/// work is done, and a second graph begins. Results are therefore those of direct launches in every case; only speed
/// depends on the number of cuts.
class Recorder {
public:
    explicit Recorder(cudaStream_t stream) : stream_(stream) {}
    Recorder(const Recorder&) = delete;
    ~Recorder() { abandon(); }

    struct Counts {
        std::uint64_t captures = 0; ///< graphs built
        std::uint64_t updates = 0;  ///< arguments of kernels replaced
        std::uint64_t launches = 0; ///< graphs launched
    };
    [[nodiscard]] const Counts& counts() const { return counts_; }

    /// Begins a step; all launches go through the recorder until end.
    void begin() {
        FreedMemory::instance().hold();
        recording_ = true;
        segment_ = 0;
        begin_segment();
    }
    /// Launches the rest of the step.
    void end() {
        cut_segment();
        segments_.resize(segment_); // those of a longer step before
        recording_ = false;
        FreedMemory::instance().release();
    }
    /// Forgets the unfinished step after an exception.
    void abandon() noexcept {
        if (!recording_) return;
        if (capturing_) {
            cudaGraph_t graph = nullptr;
            (void)cudaStreamEndCapture(stream_, &graph);
            if (graph != nullptr) (void)cudaGraphDestroy(graph);
            capturing_ = false;
        }
        segments_.clear();
        recording_ = false;
        FreedMemory::instance().release();
    }

    template <class Kernel>
    void launch(unsigned blocks, const Kernel& kernel) {
        static_assert(std::is_trivially_copyable_v<Kernel>);
        const void* const function = reinterpret_cast<const void*>(&run_kernel<Kernel>);
        if (!capturing_) {
            Segment& segment = segments_[segment_];
            if (next_ < segment.nodes.size()) {
                Node& node = segment.nodes[next_];
                if (node.function == function && node.blocks == blocks) {
                    ++next_;
                    unsigned char* const known = segment.arguments.data() + node.first;
                    if (std::memcmp(known, &kernel, sizeof kernel) == 0) return;
                    std::memcpy(known, &kernel, sizeof kernel);
                    set_arguments(segment, node, known, Kernel::block_size);
                    return;
                }
            }
            capture_again();
        }
        launch_on(stream_, blocks, kernel);
        Segment& segment = segments_[segment_];
        const std::size_t first = segment.arguments.size();
        segment.arguments.resize(first + (sizeof kernel + 15) / 16 * 16);
        std::memcpy(segment.arguments.data() + first, &kernel, sizeof kernel);
        segment.nodes.push_back({function, blocks, first, last_node(), &launch_copy<Kernel>, {}, {}});
    }

    /// Work of another library on the stream, which is the same as before if `key` is.
    void call(std::string_view key, const std::function<void(cudaStream_t)>& work) {
        if (!capturing_) {
            Segment& segment = segments_[segment_];
            if (next_ < segment.nodes.size()) {
                const Node& node = segment.nodes[next_];
                if (node.function == nullptr && node.key == key) {
                    ++next_;
                    return;
                }
            }
            capture_again();
        }
        work(stream_);
        segments_[segment_].nodes.push_back({nullptr, 0, 0, nullptr, nullptr, std::string(key), work});
    }

    /// Launches what has been recorded so far; then other work may use the stream directly, until `resume`.
    void cut() { cut_segment(); }
    void resume() { begin_segment(); }

private:
    struct Node {
        const void* function; // null: work of another library
        unsigned blocks;
        std::size_t first; // its arguments begin here
        cudaGraphNode_t node;
        void (*launch)(cudaStream_t, unsigned, const unsigned char*);
        std::string key;
        std::function<void(cudaStream_t)> work;
    };
    /// Kernels without a cut between them.
    struct Segment {
        std::vector<Node> nodes;
        std::vector<unsigned char> arguments;
        cudaGraph_t graph = nullptr;
        cudaGraphExec_t executable = nullptr;

        Segment() = default;
        Segment(Segment&& other) noexcept { swap(other); }
        Segment& operator=(Segment&& other) noexcept {
            swap(other);
            return *this;
        }
        ~Segment() {
            if (executable != nullptr) (void)cudaGraphExecDestroy(executable);
            if (graph != nullptr) (void)cudaGraphDestroy(graph);
        }
        void swap(Segment& other) noexcept {
            std::swap(nodes, other.nodes);
            std::swap(arguments, other.arguments);
            std::swap(graph, other.graph);
            std::swap(executable, other.executable);
        }
    };

    template <class Kernel>
    static void launch_copy(cudaStream_t stream, unsigned blocks, const unsigned char* bytes) {
        alignas(Kernel) unsigned char copy[sizeof(Kernel)];
        std::memcpy(copy, bytes, sizeof copy);
        launch_on(stream, blocks, *reinterpret_cast<const Kernel*>(copy));
    }

    void begin_segment() {
        next_ = 0;
        if (segment_ < segments_.size()) return; // compare with the one of the step before
        segments_.emplace_back();
        begin_capture();
    }
    void begin_capture() {
        // Relaxed, because buffers may grow in between.
        check(cudaStreamBeginCapture(stream_, cudaStreamCaptureModeRelaxed), "gsh::cuda::Recorder");
        capturing_ = true;
    }
    /// The step differs from the one before, from the kernel `next_` on.
    void capture_again() {
        Segment old;
        old.swap(segments_[segment_]);
        segments_.resize(segment_);
        segments_.emplace_back();
        begin_capture();
        Segment& segment = segments_.back();
        segment.arguments = old.arguments;
        for (std::size_t i = 0; i < next_; ++i) {
            Node& node = old.nodes[i];
            if (node.function != nullptr) {
                node.launch(stream_, node.blocks, old.arguments.data() + node.first);
                node.node = last_node();
            } else {
                node.work(stream_);
            }
            segment.nodes.push_back(std::move(node));
        }
    }
    void cut_segment() {
        if (!capturing_ && next_ != segments_[segment_].nodes.size()) capture_again();
        Segment& segment = segments_[segment_];
        if (capturing_) {
            capturing_ = false;
            check(cudaStreamEndCapture(stream_, &segment.graph), "gsh::cuda::Recorder");
            ++counts_.captures;
            if (!segment.nodes.empty())
                check(cudaGraphInstantiate(&segment.executable, segment.graph, 0), "gsh::cuda::Recorder");
        }
        if (!segment.nodes.empty()) {
            check(cudaGraphLaunch(segment.executable, stream_), "gsh::cuda::Recorder");
            ++counts_.launches;
        }
        ++segment_;
    }

    void set_arguments(Segment& segment, const Node& node, void* kernel, unsigned block_size) {
        void* arguments[] = {kernel};
        cudaKernelNodeParams parameters{};
        parameters.func = const_cast<void*>(node.function);
        parameters.gridDim = dim3(node.blocks);
        parameters.blockDim = dim3(block_size);
        parameters.kernelParams = arguments;
        check(cudaGraphExecKernelNodeSetParams(segment.executable, node.node, &parameters), "gsh::cuda::Recorder");
        ++counts_.updates;
    }

    /// The node that the last launch became.
    [[nodiscard]] cudaGraphNode_t last_node() const {
        cudaStreamCaptureStatus status;
        unsigned long long id = 0;
        cudaGraph_t graph = nullptr;
        const cudaGraphNode_t* nodes = nullptr;
        const cudaGraphEdgeData* edges = nullptr;
        std::size_t count = 0;
        check(cudaStreamGetCaptureInfo(stream_, &status, &id, &graph, &nodes, &edges, &count), "gsh::cuda::Recorder");
        return count == 1 ? nodes[0] : nullptr;
    }

    cudaStream_t stream_;
    std::vector<Segment> segments_; // in order
    std::size_t segment_ = 0;       // the current one
    std::size_t next_ = 0;          // the node of it that the next launch is compared with
    bool recording_ = false, capturing_ = false;
    Counts counts_;
};

} // namespace gsh::cuda::detail
