// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/threads.hpp>

#include <doctest/doctest.h>

#include <stdexcept>
#include <vector>

using namespace gsh;

TEST_CASE("Threads visits every index once at any thread count") {
    for (const std::size_t threads : {1, 2, 3, 7}) {
        cpu::Threads backend(threads);
        CHECK(backend.thread_count() == threads);
        for (const std::size_t n : {0, 1, 511, 512, 513, 5000}) {
            std::vector<int> visits(n, 0);
            backend.for_each(n, [&](std::size_t i) { ++visits[i]; });
            CHECK(visits == std::vector<int>(n, 1));
        }
    }
}

TEST_CASE("Threads makes the chunks that Serial makes") {
    cpu::Serial serial;
    for (const std::size_t threads : {1, 2, 3, 7}) {
        cpu::Threads backend(threads);
        for (const std::size_t n : {0, 1, 99, 100, 101, 1234}) {
            std::vector<std::size_t> expected(2 * chunk_count(n, 100)), found(expected.size());
            const auto note = [](std::vector<std::size_t>& ends) {
                return [&ends](std::size_t chunk, std::size_t begin, std::size_t end) {
                    ends[2 * chunk] = begin, ends[2 * chunk + 1] = end;
                };
            };
            serial.for_chunks(n, 100, note(expected));
            backend.for_chunks(n, 100, note(found));
            CHECK(found == expected);
        }
    }
}

TEST_CASE("an exception in a body reaches the caller, and the backend lives on") {
    cpu::Threads backend(3);
    const auto fail = [](std::size_t chunk, std::size_t, std::size_t) {
        if (chunk == 5) throw std::runtime_error("chunk 5");
    };
    CHECK_THROWS_WITH_AS(backend.for_chunks(10, 1, fail), "chunk 5", std::runtime_error);
    int calls = 0;
    backend.for_each(1, [&](std::size_t) { ++calls; });
    CHECK(calls == 1);
}

TEST_CASE("thread count 0 takes what the machine has") { CHECK(cpu::Threads().thread_count() >= 1); }
