// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/backend.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>

#include <doctest/doctest.h>

#include <cstddef>

using namespace gsh;

namespace {
struct NotABackend {
    void for_each(std::size_t, detail::NoOp) {}
};

/// Readers of files need no more.
struct ChunksAlone {
    void for_chunks(std::size_t n, std::size_t, const auto& body) {
        if (n) body(std::size_t(0), std::size_t(0), n);
    }
};
} // namespace

static_assert(HostExecutor<ChunksAlone> && !Backend<ChunksAlone> && !CpuBackend<ChunksAlone>);
static_assert(!Backend<NotABackend>);
static_assert(Backend<cpu::Serial> && CpuBackend<cpu::Serial>);
static_assert(Backend<cpu::Threads> && CpuBackend<cpu::Threads>);

TEST_CASE("chunks cover a range") {
    static_assert(chunk_count(0, 4) == 0);
    static_assert(chunk_count(1, 4) == 1);
    static_assert(chunk_count(4, 4) == 1);
    static_assert(chunk_count(5, 4) == 2);
    CHECK(cpu::Serial::available());
    CHECK(cpu::Serial::name() == "serial");
    CHECK(cpu::Threads::name() == "threads");
}
