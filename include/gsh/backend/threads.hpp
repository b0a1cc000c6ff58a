// SPDX-License-Identifier: Apache-2.0
/// @file  The everyday backend: a oneTBB arena of a chosen number of threads.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/serial.hpp>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/partitioner.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <string_view>
#include <thread>

namespace gsh::cpu {

/// Runs chunks of a range on `thread_count` threads; exceptions of a body reach the caller.
class Threads : public detail::HostMemory {
public:
    /// thread_count 0 takes what the machine has.
    explicit Threads(std::size_t thread_count = 0)
        : thread_count_(thread_count ? thread_count : std::max(1u, std::thread::hardware_concurrency())),
          arena_(static_cast<int>(thread_count_)) {}

    [[nodiscard]] static constexpr std::string_view name() { return "threads"; }
    [[nodiscard]] static bool available() { return true; }
    [[nodiscard]] std::size_t thread_count() const { return thread_count_; }

    template <class Body>
    void for_each(std::size_t n, const Body& body) {
        constexpr std::size_t grain = 512; // long enough to hide a task's cost, short enough to balance
        for_chunks(n, grain, [&](std::size_t, std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) body(i);
        });
    }

    template <class Body>
    void for_chunks(std::size_t n, std::size_t grain, const Body& body) {
        const auto run = [&](std::size_t chunk) { body(chunk, chunk * grain, std::min((chunk + 1) * grain, n)); };
        const std::size_t chunks = chunk_count(n, grain);
        if (chunks <= 1 || thread_count_ == 1) {
            for (std::size_t chunk = 0; chunk < chunks; ++chunk) run(chunk);
            return;
        }
        arena_.execute([&] {
            tbb::parallel_for(tbb::blocked_range<std::size_t>(0, chunks, 1),
                              [&](const tbb::blocked_range<std::size_t>& range) {
                                  for (std::size_t chunk = range.begin(); chunk < range.end(); ++chunk) run(chunk);
                              });
        });
    }

private:
    std::size_t thread_count_;
    tbb::task_arena arena_;
};
static_assert(CpuBackend<Threads>);

} // namespace gsh::cpu
