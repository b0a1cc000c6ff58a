// SPDX-License-Identifier: Apache-2.0
/// @file  A correct and a racy loop for ThreadSanitizer, which must pass the first and report the second.

#include <gsh/backend/threads.hpp>

#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <numeric>
#include <vector>

namespace {

constexpr std::size_t chunks = 64, grain = 100;

/// Delays a chunk until a second one runs, so that two threads certainly work at once. It does not synchronise them.
void meet(std::atomic<int>& running) {
    running.fetch_add(1, std::memory_order_relaxed);
    const auto give_up = std::chrono::steady_clock::now() + std::chrono::seconds(1);
    while (running.load(std::memory_order_relaxed) < 2 && std::chrono::steady_clock::now() < give_up) {}
}

/// Repeatedly, each chunk writes its own numbers and the caller reads all of them.
long clean(gsh::cpu::Threads& backend) {
    std::vector<long> values(chunks * grain, 0), sums(chunks);
    for (int round = 0; round < 100; ++round) {
        std::atomic<int> running = 0;
        backend.for_chunks(values.size(), grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
            if (round == 0) meet(running);
            sums[chunk] = 0;
            for (std::size_t i = begin; i < end; ++i) sums[chunk] += ++values[i];
        });
        backend.for_each(values.size(), [&](std::size_t i) { values[i] += sums[i / grain] - sums[i / grain]; });
    }
    return std::accumulate(sums.begin(), sums.end(), 0L);
}

/// All chunks add to one number.
long racy(gsh::cpu::Threads& backend) {
    long sum = 0;
    std::atomic<int> running = 0;
    backend.for_chunks(chunks * grain, grain, [&](std::size_t, std::size_t begin, std::size_t end) {
        meet(running);
        for (std::size_t i = begin; i < end; ++i) sum += 1;
    });
    return sum;
}

} // namespace

int main(int argc, char** argv) {
    gsh::cpu::Threads backend(3);
    const bool is_racy = argc > 1 && std::strcmp(argv[1], "racy") == 0;
    std::printf("%ld\n", is_racy ? racy(backend) : clean(backend));
}
