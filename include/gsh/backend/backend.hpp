// SPDX-License-Identifier: Apache-2.0
/// @file  The backend concepts: the operations of a machine that components use.
#pragma once

#include <gsh/core/span.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <type_traits>
#include <vector>

namespace gsh {

namespace detail {
struct NoOp {
    GSH_HD void operator()(std::size_t) const {}
};
struct NoOpChunk {
    void operator()(std::size_t, std::size_t, std::size_t) const {}
};

/// False for every backend. A component asserts it where an overload of its backend is missing.
template <class B>
inline constexpr bool overload_is_included = false;

template <class B>
concept TellsItsMemory = requires { requires std::same_as<decltype(B::host_memory), const bool>; } &&
                         (B::host_memory || requires(const B& backend, const void* memory, std::size_t bytes) {
                             { backend.owns(memory, bytes) } -> std::same_as<bool>;
                         });
} // namespace detail

/// An object that owns threads or a stream, allocates storage and runs function objects over index ranges.
///
/// A Buffer's memory belongs to the backend: only for_each bodies and the backend's own overloads may access it. The
/// host accesses it through upload and download. Where host_memory is true, a Buffer is host memory, and any other host
/// memory may take its place. Where it is false, owns distinguishes the backend's memory from the host's, and
/// components refuse host memory (check_memory, backend/memory.hpp).
template <class B>
concept Backend = requires(B& backend, std::size_t n, detail::NoOp body, typename B::template Buffer<float>& buffer,
                           Span<float> span, Span<const float> input) {
    { B::name() } -> std::convertible_to<std::string_view>;
    { B::available() } -> std::same_as<bool>; // at run time: is there a device?
    requires detail::TellsItsMemory<B>;       // static constexpr bool host_memory, and owns where it is false
    buffer.resize(n);                         // contents are unspecified afterwards
    { buffer.size() } -> std::convertible_to<std::size_t>;
    { Span<float>(buffer) };
    backend.for_each(n, body);       // body(i), i in [0, n), any order
    backend.fill(span, 0.0f);        // every element := value
    backend.copy(input, span);       // within the backend
    backend.upload(input, span);     // host -> backend
    backend.download(input, span);   // backend -> host, after what was queued before
    backend.synchronize();           // throws DeviceError if the work failed
};

/// An object that runs fixed chunks of a range on the host. File readers, checks of captures and other set-up code
/// require no more than this.
///
/// for_chunks(n, grain, body) calls body(chunk, begin, end) once for every chunk of `grain` consecutive indices, in any
/// order. Chunks depend on n and grain alone. Sums that are kept per chunk and added in chunk order are therefore
/// bit-identical at any thread count.
template <class E>
concept HostExecutor =
    requires(E& executor, std::size_t n, detail::NoOpChunk body) { executor.for_chunks(n, n, body); };

/// A backend whose buffers are host memory and which can run fixed chunks of a range.
template <class B>
concept CpuBackend = Backend<B> && B::host_memory && HostExecutor<B> && requires(B& backend) {
    { backend.thread_count() } -> std::convertible_to<std::size_t>;
};

/// The arithmetic of fields. `mixed`: operands of networks are in bf16, sums in float; on a GPU, features and copies of
/// tables have 16 bits, too. What is learned and its moments stay in float.
enum class Precision { fp32, mixed };

/// That of a backend, or fp32 if it has no other.
template <Backend B>
[[nodiscard]] Precision precision_of([[maybe_unused]] const B& backend) {
    if constexpr (requires { backend.precision(); }) return backend.precision();
    else return Precision::fp32;
}

/// A backend that may queue a step's work without a wait, so that its host learns of an error only afterwards. What
/// that asks of the parts of a training is on one page, docs/components/deferred_steps.md.
///
///     deferring()    whether the host must not wait now, because a step is being recorded
///     halted()       the word that is not zero after an error in such a step, [1]; see halt_word
///
/// It may also have for_each_branch(count, branch) and free_memory(), bytes. RepeatedStep is specialised for it.
template <class B>
concept DeferringBackend = Backend<B> && requires(B& backend, const B& constant) {
    { constant.deferring() } -> std::same_as<bool>;
    { backend.halted() } -> std::convertible_to<Span<const std::uint32_t>>;
};

/// A trainer settles its repeated steps at least so often.
inline constexpr std::size_t most_unsettled_steps = 200;

/// Runs a step that is repeated many times, such as a step of training. This version calls it.
///
/// A device specialises it: it records what the step launches and repeats the record, and it does not wait for errors.
/// Steps after an error then change nothing that is learned. settle() waits, and returns how many of the steps since
/// its last call have changed nothing. The caller then mends the cause, takes back what its host code has counted, and
/// goes on from the step that failed.
///
/// `kind` distinguishes steps that launch other work, for instance because images have another size. forget() drops the
/// records, before memory is freed whose addresses they contain.
template <Backend B>
class RepeatedStep {
public:
    explicit RepeatedStep(B&) {}
    template <class Step>
    void run(std::uint64_t /*kind*/, const Step& step) {
        step();
    }
    [[nodiscard]] std::uint64_t settle() { return 0; }
    void forget() {}
};

/// Calls branch(0) to branch(count - 1). None may read or write what another one writes: a device that records its step
/// runs them at the same time, and each branch in its own order. Work after the call waits for all of them.
template <Backend B, class Branch>
void for_each_branch(B& backend, std::size_t count, const Branch& branch) {
    if constexpr (requires { backend.for_each_branch(count, branch); }) {
        backend.for_each_branch(count, branch);
    } else {
        for (std::size_t i = 0; i < count; ++i) branch(i);
    }
}

/// Makes a buffer of the backend a copy of values of the host.
template <Backend B, class T>
void assign(B& backend, Span<const T> from, typename B::template Buffer<T>& to) {
    to.resize(from.size());
    backend.upload(from, Span<T>(to));
}
template <Backend B, class T>
void assign(B& backend, const std::vector<T>& from, typename B::template Buffer<T>& to) {
    assign(backend, Span<const T>(from), to);
}
/// A buffer of the backend with a copy of values of the host.
template <Backend B, class T>
[[nodiscard]] typename B::template Buffer<T> uploaded(B& backend, const std::vector<T>& from) {
    typename B::template Buffer<T> to;
    assign(backend, from, to);
    return to;
}
/// A copy on the host of values in the backend's memory. Waits for the backend.
template <Backend B, class T>
[[nodiscard]] std::vector<std::remove_const_t<T>> downloaded(B& backend, Span<T> from) {
    std::vector<std::remove_const_t<T>> to(from.size());
    backend.download(Span<const T>(from), Span<std::remove_const_t<T>>(to));
    return to;
}

/// The word of a DeferringBackend; empty on backends that report errors at once. Function objects that change what is
/// learned do nothing while it is set.
template <Backend B>
[[nodiscard]] Span<const std::uint32_t> halt_word([[maybe_unused]] B& backend) {
    if constexpr (DeferringBackend<B>) return backend.halted();
    else return {};
}
/// Whether it is set, for host code that makes rare changes to what is learned. Waits for a backend with such a word.
template <Backend B>
[[nodiscard]] bool has_halted(B& backend) {
    const Span<const std::uint32_t> word = halt_word(backend);
    std::uint32_t host = 0;
    if (!word.empty()) backend.download(word, Span<std::uint32_t>(&host, 1));
    return host != 0;
}
[[nodiscard]] GSH_HD inline bool is_halted(Span<const std::uint32_t> word) { return !word.empty() && word[0] != 0; }

/// Number of chunks in for_chunks(n, grain, …).
[[nodiscard]] constexpr std::size_t chunk_count(std::size_t n, std::size_t grain) { return (n + grain - 1) / grain; }

} // namespace gsh
