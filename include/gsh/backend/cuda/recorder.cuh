// SPDX-License-Identifier: Apache-2.0
/// @file  Repeats a sequence of kernels as CUDA graphs, with the arguments that they have each time.
#pragma once

#include <gsh/backend/cuda/error.cuh>
#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/backend/cuda/kernel_times.cuh>
#include <gsh/backend/cuda/memory.cuh>
#include <gsh/backend/cuda/zero_fills.cuh>

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

/// Zeroes the bytes between the members of a kernel, which any copy may have filled with anything. A compiler that has
/// no means for it leaves them: the recorder then replaces arguments that are the same.
///
/// GCC 12 clears the wrong bytes where a gap follows an array whose elements have gaps: a kernel with such an array
/// must have no gap behind it.
template <class Kernel>
void clear_padding([[maybe_unused]] Kernel& kernel) {
#if defined(__has_builtin)
#if __has_builtin(__builtin_clear_padding)
    __builtin_clear_padding(&kernel);
#endif
#endif
}

/// Records the kernels of a step while its host code runs, and repeats them as one CUDA graph.
///
/// Host code runs in every step, as it would without a recorder, and decides what the step does: camera, photograph,
/// rates. In the first step a second stream captures its kernels. In later steps each launch is compared with the
/// recorded one. If its arguments differ, the node of the graph receives the new ones; if they are the same, the launch
/// costs a comparison of a few hundred bytes. At the end one call launches all kernels. If the sequence itself differs
/// (another kernel, another number of blocks), the rest of it is captured anew.
///
/// A fork makes branches of the graph that do not wait for each other. What follows waits for all of them.
///
/// Work that cannot be part of a graph, such as a download, cuts the sequence: what comes before is launched, then the
/// work is done, and a second graph begins. Results are therefore those of direct launches in every case; only speed
/// depends on the number of cuts.
class Recorder {
public:
    /// Graphs are launched on `stream`. `capturing` may be captured, and has no other work while a step is recorded.
    Recorder(cudaStream_t stream, cudaStream_t capturing) : stream_(stream), capture_(capturing) {}
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
        recording_ = true; // from now on, abandon gives the memory free
        stage_ = {};
        segment_ = 0;
        place_ = {};
        forks_ = 0;
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
            (void)cudaStreamEndCapture(capture_, &graph);
            if (graph != nullptr) (void)cudaGraphDestroy(graph);
            capturing_ = false;
        }
        segments_.clear();
        zero_fills_ = {};
        recording_ = false;
        FreedMemory::instance().release();
    }

    template <class Kernel>
    void launch(unsigned blocks, const Kernel& kernel) {
        launch_zero_fills();
        add(blocks, kernel);
    }
    /// Sets an array to zero. Arrays without other work between them share a launch.
    template <class T>
    void zero(Span<T> values) {
        if (zero_fills_.full()) launch_zero_fills();
        zero_fills_.add(values);
    }

    /// Work of another library on the stream, which is the same as before if `key` is.
    void call(std::string_view key, const std::function<void(cudaStream_t)>& work) {
        launch_zero_fills();
        if (!capturing_) {
            Segment& segment = segments_[segment_];
            if (next_ < segment.nodes.size()) {
                const Node& node = segment.nodes[next_];
                if (node.function == nullptr && node.key == key && node.place == place_) {
                    ++next_;
                    return;
                }
            }
            capture_again();
        }
        enter(place_);
        work(capture_);
        Segment& segment = segments_[segment_];
        segment.nodes.push_back(
            {nullptr, 0, segment.arguments.size(), nullptr, nullptr, nullptr, stage_, std::string(key), work, place_});
    }

    /// What branch(i) launches is a branch, for each i below count. Forks do not nest: a fork inside a branch is a part
    /// of it.
    template <class Branch>
    void fork(std::size_t count, const Branch& branch) {
        const bool is_nested = place_.fork != 0;
        const auto move_to = [&](const Place& place) {
            if (is_nested) return;
            launch_zero_fills(); // where they were asked for
            place_ = place;
        };
        if (!is_nested) ++forks_;
        for (std::size_t i = 0; i < count; ++i) {
            move_to({forks_, i});
            branch(i);
        }
        move_to({});
    }

    /// Later launches belong to this stage. A literal, since it is kept.
    void mark(std::string_view stage) {
        launch_zero_fills();
        stage_ = stage;
    }

    /// Launches what has been recorded so far; then other work may use the stream directly, until `resume`.
    void cut() { cut_segment(); }
    void resume() { begin_segment(); }

    /// Runs the kernels of the last step `repeats` times more, each after the one before it as in the graph, and
    /// returns the median time of each. What a cut did in between is left out.
    [[nodiscard]] std::vector<KernelTime> time_kernels(int repeats) {
        std::vector<TimedLaunch> launches;
        for (const Segment& segment : segments_)
            for (const Node& node : segment.nodes) {
                const unsigned char* const kernel = segment.arguments.data() + node.first;
                const std::string stage(node.stage);
                if (node.function != nullptr)
                    launches.push_back({node.name(), stage, [&node, kernel](cudaStream_t stream) {
                                            node.launch(stream, node.blocks, kernel);
                                        }});
                else
                    launches.push_back({node.key, stage, node.work});
            }
        return time_launches(stream_, launches, repeats);
    }

private:
    /// Where a kernel is: fork 0 is outside of all forks.
    struct Place {
        std::size_t fork = 0, branch = 0;
        bool operator==(const Place&) const = default;
    };
    struct Node {
        const void* function; // null: work of another library
        unsigned blocks;
        std::size_t first; // its arguments begin here; those of the nodes before it end here
        cudaGraphNode_t node;
        void (*launch)(cudaStream_t, unsigned, const unsigned char*);
        std::string (*name)();
        std::string_view stage;
        std::string key;
        std::function<void(cudaStream_t)> work;
        Place place;
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

    template <class Kernel>
    void add(unsigned blocks, Kernel kernel) {
        static_assert(std::is_trivially_copyable_v<Kernel>);
        clear_padding(kernel); // for the comparison of bytes
        const void* const function = reinterpret_cast<const void*>(&run_kernel<Kernel>);
        if (!capturing_) {
            Segment& segment = segments_[segment_];
            if (next_ < segment.nodes.size()) {
                Node& node = segment.nodes[next_];
                if (node.function == function && node.blocks == blocks && node.place == place_) {
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
        enter(place_);
        launch_on(capture_, blocks, kernel);
        Segment& segment = segments_[segment_];
        const std::size_t first = segment.arguments.size();
        segment.arguments.resize(first + (sizeof kernel + 15) / 16 * 16);
        std::memcpy(segment.arguments.data() + first, &kernel, sizeof kernel);
        segment.nodes.push_back(
            {function, blocks, first, last_node(), &launch_copy<Kernel>, &kernel_name<Kernel>, stage_, {}, {}, place_});
    }
    void launch_zero_fills() {
        if (zero_fills_.count == 0) return;
        const ZeroFills fills = std::exchange(zero_fills_, {});
        if (fills.blocks != 0) add(fills.blocks, fills);
    }

    void begin_segment() {
        next_ = 0;
        if (segment_ < segments_.size()) return; // compare with the one of the step before
        segments_.emplace_back();
        begin_capture();
    }
    void begin_capture() {
        // Relaxed, because buffers may grow in between.
        check(cudaStreamBeginCapture(capture_, cudaStreamCaptureModeRelaxed), "gsh::cuda::Recorder");
        capturing_ = true;
        captured_ = {}; // the first kernel waits for nothing in this graph, even inside a branch
    }
    /// While the stream is captured: the next kernel is at `place`, and waits for what it has to.
    void enter(const Place& place) {
        if (place == captured_) return;
        if (captured_.fork != 0) {
            const std::vector<cudaGraphNode_t> end = dependencies();
            ends_.insert(ends_.end(), end.begin(), end.end());
        }
        if (captured_.fork == place.fork) {
            set_dependencies(before_);
        } else {
            if (captured_.fork != 0) set_dependencies(ends_);
            ends_.clear();
            before_ = dependencies();
        }
        captured_ = place;
    }
    /// Nodes that the next launch would wait for.
    [[nodiscard]] std::vector<cudaGraphNode_t> dependencies() const {
        cudaStreamCaptureStatus status;
        unsigned long long id = 0;
        cudaGraph_t graph = nullptr;
        const cudaGraphNode_t* nodes = nullptr;
        const cudaGraphEdgeData* edges = nullptr;
        std::size_t count = 0;
        check(cudaStreamGetCaptureInfo(capture_, &status, &id, &graph, &nodes, &edges, &count), "gsh::cuda::Recorder");
        return {nodes, nodes + count};
    }
    void set_dependencies(std::vector<cudaGraphNode_t>& nodes) {
        check(cudaStreamUpdateCaptureDependencies(capture_, nodes.data(), nullptr, nodes.size(),
                                                  cudaStreamSetCaptureDependencies),
              "gsh::cuda::Recorder");
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
        if (next_ < old.nodes.size()) segment.arguments.resize(old.nodes[next_].first);
        for (std::size_t i = 0; i < next_; ++i) {
            Node& node = old.nodes[i];
            enter(node.place);
            if (node.function != nullptr) {
                node.launch(capture_, node.blocks, old.arguments.data() + node.first);
                node.node = last_node();
            } else {
                node.work(capture_);
            }
            segment.nodes.push_back(std::move(node));
        }
    }
    void cut_segment() {
        launch_zero_fills();
        if (!capturing_ && next_ != segments_[segment_].nodes.size()) capture_again();
        Segment& segment = segments_[segment_];
        if (capturing_) {
            capturing_ = false;
            check(cudaStreamEndCapture(capture_, &segment.graph), "gsh::cuda::Recorder");
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
        const std::vector<cudaGraphNode_t> nodes = dependencies();
        return nodes.size() == 1 ? nodes[0] : nullptr;
    }

    cudaStream_t stream_, capture_;
    std::vector<Segment> segments_; // in order
    std::size_t segment_ = 0;       // the current one
    std::size_t next_ = 0;          // the node of it that the next launch is compared with
    bool recording_ = false, capturing_ = false;
    Place place_, captured_;        // of the next launch, and of the last captured one
    std::size_t forks_ = 0;         // of the step so far
    std::vector<cudaGraphNode_t> before_, ends_; // of the captured fork: what its branches wait for, and their ends
    std::string_view stage_;
    ZeroFills zero_fills_; // asked for, and not launched yet
    Counts counts_;
};

} // namespace gsh::cuda::detail
