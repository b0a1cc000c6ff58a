// SPDX-License-Identifier: Apache-2.0
/// @file  One thread block after the other, on the host: its threads run as fibers, which wait at barriers and at
///        operations of a warp, and its mistakes become exceptions.
#pragma once

#include <gsh/core/span.hpp>

#include "support/cuda_emulation/fiber.hpp"
#include "support/cuda_emulation/warp_barriers.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <functional>
#include <memory>
#include <numeric>
#include <source_location>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

struct uint3 {
    unsigned x, y, z;
};
struct dim3 {
    unsigned x = 1, y = 1, z = 1;
    constexpr dim3(unsigned x_ = 1, unsigned y_ = 1, unsigned z_ = 1) : x(x_), y(y_), z(z_) {}
};

// The built-in variables of device code, for the thread that runs at the moment.
inline uint3 threadIdx{}, blockIdx{};
inline dim3 blockDim{}, gridDim{};
inline constexpr int warpSize = 32;

namespace gsh::test {

/// A mistake of a kernel, found by the emulation.
class KernelFault : public std::runtime_error {
public:
    using std::runtime_error::runtime_error;
};

/// The order in which blocks, and threads within a block, take their turns. Results must not depend on it.
enum class Order { forward, reverse, random };

/// When a thread did something, up to its next barrier.
struct Moment {
    std::uint32_t thread = 0; // from 1 on; 0 if nobody did it
    std::uint32_t epoch = 0;  // barriers of the block until then
    std::uint32_t date = 0;   // barriers of the thread's warp until then
};

/// The block that runs at the moment. Threads run one at a time, until they wait or end.
class Block {
public:
    /// What the threads of a group hand to each other: a record of each thread, on that thread's stack.
    using Records = std::vector<void*>; // by lane, or by thread of the block; null for those that take no part
    using Combine = void (*)(const Records&);

    struct Thread {
        unsigned index = 0;
        bool started = false, ended = false;
        Fiber* fiber = nullptr;
        // What the thread waits for, while `kind` is not null.
        const char* kind = nullptr;
        std::source_location where;
        std::uint32_t mask = 0; // of a warp's operation; 0 for one of the whole block
        void* record = nullptr;
        Combine combine = nullptr;
    };

    static Block* current() { return current_; }

    Block(dim3 size, Order order, std::uint64_t seed)
        : size_(size), threads_(std::size_t(size.x) * size.y * size.z), turns_(threads_.size()) {
        std::iota(turns_.begin(), turns_.end(), 0u);
        if (order == Order::reverse) std::reverse(turns_.begin(), turns_.end());
        if (order == Order::random) shuffle(turns_, seed);
        warps_.resize((threads_.size() + 31) / 32);
        for (std::size_t t = 0; t < threads_.size(); ++t) threads_[t].index = static_cast<unsigned>(t);
    }

    /// Runs body() once for each thread. Throws what a thread throws.
    void run(const std::function<void()>& body) {
        static std::uint64_t serial = 0;
        serial_ = ++serial;
        current_ = this;
        body_ = &body;
        try {
            while (step()) {
            }
        } catch (...) {
            if (!failure_) failure_ = std::current_exception();
        }
        if (failure_) abandon();
        current_ = nullptr;
        if (failure_) std::rethrow_exception(failure_);
    }

    [[nodiscard]] const Thread& thread() const { return *thread_; }
    [[nodiscard]] std::size_t thread_count() const { return threads_.size(); }
    /// Differs between any two blocks that ever ran.
    [[nodiscard]] std::uint64_t serial() const { return serial_; }
    /// Number of block barriers so far.
    [[nodiscard]] std::uint32_t epoch() const { return epoch_; }
    /// What the running thread does has this date.
    [[nodiscard]] Moment now() const { return {thread_->index + 1, epoch_, warps_[thread_->index / 32].count()}; }
    /// Whether what was done at that moment comes before what the running thread does now: the thread did it itself, or
    /// a barrier lies between, of the block or, if both threads are of one warp, of lanes of the warp.
    [[nodiscard]] bool knows(const Moment& then) const {
        if (then.thread == 0 || then.epoch != epoch_) return true;
        const std::size_t mine = thread_->index, other = then.thread - 1;
        return mine == other || (mine / 32 == other / 32 && warps_[mine / 32].knows(mine % 32, other % 32, then.date));
    }

    /// Waits until all threads of the block have called it at the same place, then combines their records.
    void wait_for_block(const char* kind, const std::source_location& where, void* record = nullptr,
                        Combine combine = nullptr) {
        wait(kind, where, 0, record, combine);
    }

    /// Waits until all lanes of the mask have called it at the same place with the same mask.
    void wait_for_warp(const char* kind, const std::source_location& where, std::uint32_t mask, void* record = nullptr,
                       Combine combine = nullptr) {
        if ((mask >> (thread_->index % 32) & 1u) == 0)
            fail(std::string(kind) + ": lane " + std::to_string(thread_->index % 32) + " is not in its own mask " +
                 hex(mask) + at(where));
        wait(kind, where, mask, record, combine);
    }

    /// Ends the kernel with a message that names block and thread.
    [[noreturn]] void fail(const std::string& what) const {
        throw KernelFault("block " + std::to_string(blockIdx.x) + ", thread " + std::to_string(thread_->index) + ": " +
                          what);
    }

    [[nodiscard]] static std::string at(const std::source_location& where) {
        const std::string_view file = where.file_name();
        return " (" + std::string(file.substr(file.find_last_of('/') + 1)) + ":" + std::to_string(where.line()) + ")";
    }

    static void shuffle(std::vector<unsigned>& turns, std::uint64_t seed) {
        std::uint64_t state = seed * 0x9E3779B97F4A7C15ull + 1;
        for (std::size_t i = turns.size(); i > 1; --i) {
            state ^= state << 13, state ^= state >> 7, state ^= state << 17;
            std::swap(turns[i - 1], turns[state % i]);
        }
    }

private:
    struct Abandoned {};

    static std::string hex(std::uint32_t mask) {
        static constexpr char digits[] = "0123456789abcdef";
        std::string text = "0x";
        for (int shift = 28; shift >= 0; shift -= 4) text += digits[mask >> shift & 15];
        return text;
    }

    /// Runs every thread that can run once. False when all have ended.
    bool step() {
        bool progress = false, ended = true;
        for (const unsigned turn : turns_) {
            Thread& thread = threads_[turn];
            if (thread.ended || thread.kind) continue;
            if (!thread.started)
                start_threads();
            else
                resume(thread);
            if (failure_) return false;
            progress = true;
        }
        for (const Thread& thread : threads_) ended = ended && thread.ended;
        if (ended) return false;
        if (!release() && !progress) stuck();
        return true;
    }

    /// Starts threads from this one on, on one stack, until one of them waits.
    void start_threads() {
        fibers_.push_back(std::make_unique<Fiber>([this](Fiber& fiber) {
            while (Thread* const next = next_unstarted()) {
                next->started = true, next->fiber = &fiber;
                enter(*next);
                try {
                    (*body_)();
                } catch (const Abandoned&) {
                } catch (...) {
                    if (!failure_) failure_ = std::current_exception();
                }
                next->ended = true;
                if (failure_) return;
            }
        }));
        fibers_.back()->resume();
    }
    Thread* next_unstarted() {
        for (; next_turn_ < turns_.size(); ++next_turn_)
            if (!threads_[turns_[next_turn_]].started) return &threads_[turns_[next_turn_]];
        return nullptr;
    }

    void enter(Thread& thread) {
        thread_ = &thread;
        const unsigned i = thread.index;
        threadIdx = {i % size_.x, i / size_.x % size_.y, i / size_.x / size_.y};
    }
    void resume(Thread& thread) {
        enter(thread);
        thread.fiber->resume();
    }

    void wait(const char* kind, const std::source_location& where, std::uint32_t mask, void* record, Combine combine) {
        Thread& mine = *thread_;
        mine.kind = kind, mine.where = where, mine.mask = mask, mine.record = record, mine.combine = combine;
        mine.fiber->suspend();
        if (failure_) throw Abandoned{};
    }

    [[nodiscard]] static bool same(const Thread& a, const Thread& b) {
        const char *const file = a.where.file_name(), *const other = b.where.file_name(); // mostly the same literal
        return a.kind == b.kind && a.mask == b.mask && a.where.line() == b.where.line() &&
               a.where.column() == b.where.column() && (file == other || std::string_view(file) == other);
    }

    /// Lets those go on whose whole group waits at one place. False if there are none.
    bool release() {
        bool released = false;
        bool all = true;
        for (const Thread& thread : threads_) all = all && thread.kind && thread.mask == 0 && same(thread, threads_[0]);
        if (all) {
            ++epoch_;
            release_group(0, threads_.size(), ~0u);
            return true;
        }
        for (std::size_t first = 0; first < threads_.size(); first += 32) {
            const std::size_t count = std::min<std::size_t>(32, threads_.size() - first);
            for (std::size_t lane = 0; lane < count; ++lane) {
                const Thread& leader = threads_[first + lane];
                if (!leader.kind || leader.mask == 0) continue;
                bool complete = count == 32 || leader.mask >> count == 0;
                for (std::size_t other = 0; other < count; ++other)
                    if (leader.mask >> other & 1u) complete = complete && same(threads_[first + other], leader);
                if (!complete) continue;
                if (std::string_view(leader.kind) == "__syncwarp")
                    warps_[first / 32].pass(leader.mask, static_cast<std::size_t>(std::popcount(leader.mask)) == count);
                release_group(first, count, leader.mask);
                released = true;
            }
        }
        return released;
    }
    void release_group(std::size_t first, std::size_t count, std::uint32_t mask) {
        records_.assign(count, nullptr);
        Combine combine = nullptr;
        for (std::size_t i = 0; i < count; ++i) {
            if (count <= 32 && (mask >> i & 1u) == 0) continue;
            Thread& thread = threads_[first + i];
            records_[i] = thread.record;
            combine = thread.combine;
            thread.kind = nullptr;
        }
        if (combine) combine(records_);
    }

    /// Nobody can go on: says who waits where.
    [[noreturn]] void stuck() {
        std::string text = "the threads of block " + std::to_string(blockIdx.x) + " wait for each other:";
        std::vector<std::pair<std::string, unsigned>> places;
        for (const Thread& thread : threads_) {
            std::string place = thread.ended ? "have ended"
                                             : "wait at " + std::string(thread.kind) + at(thread.where) +
                                                   (thread.mask ? " with mask " + hex(thread.mask) : "");
            auto known = std::find_if(places.begin(), places.end(), [&](const auto& p) { return p.first == place; });
            if (known != places.end())
                ++known->second;
            else
                places.emplace_back(std::move(place), 1u);
        }
        for (const auto& [place, count] : places)
            text.append(" ").append(std::to_string(count)).append(" ").append(place).append(";");
        text.back() = '.';
        throw KernelFault(text);
    }

    /// Ends the functions on all stacks, so that what they own is released.
    void abandon() {
        for (Thread& thread : threads_)
            while (thread.started && !thread.ended) resume(thread);
        fibers_.clear();
    }

    inline static Block* current_ = nullptr;

    dim3 size_;
    std::vector<Thread> threads_;
    std::vector<unsigned> turns_;
    std::size_t next_turn_ = 0;
    std::vector<std::unique_ptr<Fiber>> fibers_;
    const std::function<void()>* body_ = nullptr;
    Thread* thread_ = nullptr;
    Records records_; // of the group that is released
    std::exception_ptr failure_;
    std::uint64_t serial_ = 0;
    std::uint32_t epoch_ = 1;
    std::vector<WarpBarriers> warps_;
};

} // namespace gsh::test

#if defined(GSH_CHECK_SPANS)
[[noreturn]] inline void gsh::detail::index_outside_span(std::size_t index, std::size_t size) {
    const std::string what = "a span of " + std::to_string(size) + " elements, index " + std::to_string(index);
    if (const test::Block* block = test::Block::current()) block->fail(what);
    throw std::out_of_range(what);
}
#endif
