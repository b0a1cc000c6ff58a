// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/backend.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>

#include "support/chunks_alone.hpp"

#include <doctest/doctest.h>

#include <cstddef>
#include <vector>

using namespace gsh;

namespace {
struct NotABackend {
    void for_each(std::size_t, detail::NoOp) {}
};
} // namespace

static_assert(!HostExecutor<NotABackend>);
static_assert(!Backend<NotABackend>);
static_assert(Backend<cpu::Serial> && CpuBackend<cpu::Serial>);
static_assert(Backend<cpu::Threads> && CpuBackend<cpu::Threads>);

TEST_CASE("branches run in order where a backend has nothing better") {
    cpu::Serial backend;
    std::vector<std::size_t> ran;
    for_each_branch(backend, 3, [&](std::size_t i) { ran.push_back(i); });
    CHECK(ran == std::vector<std::size_t>{0, 1, 2});
}

TEST_CASE("chunks cover a range") {
    static_assert(chunk_count(0, 4) == 0);
    static_assert(chunk_count(1, 4) == 1);
    static_assert(chunk_count(4, 4) == 1);
    static_assert(chunk_count(5, 4) == 2);
    CHECK(cpu::Serial::available());
    CHECK(cpu::Serial::name() == "serial");
    CHECK(cpu::Threads::name() == "threads");
}
