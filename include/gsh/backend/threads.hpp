// SPDX-License-Identifier: Apache-2.0
/// @file  The multi-threaded CPU backend: a oneTBB arena with a chosen number of threads.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/serial.hpp>

#include <tbb/blocked_range.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/partitioner.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <optional>
#include <string_view>
#include <thread>

namespace gsh::cpu::inline GSH_ISA {

namespace detail {
/// One parallel loop, on the caller's stack. The type of its body is known to one function alone, so oneTBB's templates
/// are compiled once for all loops of a program; they were a tenth of the compile time of a training.
///
/// Fork and join are written as a release and an acquire. oneTBB orders them anyway, but ThreadSanitizer does not see
/// the synchronisation inside that library. Two atomics per task are cheap.
class Loop {
public:
    template <class Body>
    Loop(std::size_t n, std::size_t grain, const Body& body)
        : n_(n), grain_(grain), body_(&body), run_(&Loop::run<Body>) {
        fork_.store(true, std::memory_order_release);
    }
    /// Runs chunks [begin, end).
    void operator()(std::size_t begin, std::size_t end) {
        (void)fork_.load(std::memory_order_acquire);
        const Leave leave{join_};
        run_(body_, n_, grain_, begin, end);
    }
    ~Loop() { (void)join_.load(std::memory_order_acquire); }

private:
    struct Leave {
        std::atomic<unsigned>& join;
        ~Leave() { join.fetch_add(1, std::memory_order_release); }
    };
    template <class Body>
    static void run(const void* body, std::size_t n, std::size_t grain, std::size_t begin, std::size_t end) {
        for (std::size_t chunk = begin; chunk < end; ++chunk)
            (*static_cast<const Body*>(body))(chunk, chunk * grain, std::min((chunk + 1) * grain, n));
    }

    std::size_t n_, grain_;
    const void* body_;
    void (*run_)(const void*, std::size_t, std::size_t, std::size_t, std::size_t);
    std::atomic<bool> fork_ = false;
    std::atomic<unsigned> join_ = 0;
};

/// The body that oneTBB copies from task to task. ThreadSanitizer does not check how oneTBB reads such a copy; it
/// checks everything from Loop::operator() on.
struct LoopTask {
    Loop* loop;
    [[gnu::no_sanitize_thread]] void operator()(const tbb::blocked_range<std::size_t>& chunks) const {
        (*loop)(chunks.begin(), chunks.end());
    }
};
} // namespace detail

/// Runs chunks of a range on `thread_count` threads; exceptions of a body reach the caller.
class Threads : public detail::HostBackend {
public:
    /// thread_count 0 stands for all hardware threads.
    explicit Threads(std::size_t thread_count = 0)
        : thread_count_(thread_count ? thread_count : std::max(1u, std::thread::hardware_concurrency())),
          arena_(static_cast<int>(thread_count_)) {
        if (thread_count_ > std::max(1u, std::thread::hardware_concurrency()))
            more_than_cores_.emplace(tbb::global_control::max_allowed_parallelism, thread_count_);
    }

    [[nodiscard]] static constexpr std::string_view name() { return "threads"; }
    [[nodiscard]] static bool available() { return true; }
    [[nodiscard]] std::size_t thread_count() const { return thread_count_; }

    template <class Body>
    void for_each(std::size_t n, const Body& body) {
        constexpr std::size_t grain = 512; // long enough to hide a task's cost, short enough to balance
        for_chunks(n, grain, [&](std::size_t, std::size_t begin, std::size_t end) {
            const Body mine = body; // no store can alias the members of a local copy, so the loop may be vectorised
            for (std::size_t i = begin; i < end; ++i) mine(i);
        });
    }

    template <class Body>
    void for_chunks(std::size_t n, std::size_t grain, const Body& body) {
        const std::size_t chunks = chunk_count(n, grain);
        detail::Loop loop(n, grain, body);
        if (chunks <= 1 || thread_count_ == 1) loop(0, chunks);
        else run(loop, chunks);
    }

private:
    void run(detail::Loop& loop, std::size_t chunks) {
        arena_.execute(
            [&] { tbb::parallel_for(tbb::blocked_range<std::size_t>(0, chunks, 1), detail::LoopTask{&loop}); });
    }

    std::size_t thread_count_;
    std::optional<tbb::global_control> more_than_cores_; ///< raises the limit of oneTBB, which is the number of cores
    tbb::task_arena arena_;
};
static_assert(CpuBackend<Threads>);

} // namespace gsh::cpu
