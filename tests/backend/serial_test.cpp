// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>

#include <doctest/doctest.h>

#include <array>
#include <vector>

using namespace gsh;

TEST_CASE("Serial visits every index in order") {
    cpu::Serial backend;
    std::vector<std::size_t> seen;
    backend.for_each(5, [&](std::size_t i) { seen.push_back(i); });
    CHECK(seen == std::vector<std::size_t>{0, 1, 2, 3, 4});
    backend.for_each(0, [&](std::size_t) { FAIL("no element, no call"); });
    CHECK(backend.thread_count() == 1);
}

TEST_CASE("Serial cuts a range into fixed chunks") {
    cpu::Serial backend;
    std::vector<std::array<std::size_t, 3>> chunks;
    backend.for_chunks(7, 3, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        chunks.push_back({chunk, begin, end});
    });
    CHECK(chunks == std::vector<std::array<std::size_t, 3>>{{0, 0, 3}, {1, 3, 6}, {2, 6, 7}});
    backend.for_chunks(0, 3, [&](std::size_t, std::size_t, std::size_t) { FAIL("no element, no chunk"); });
}

TEST_CASE("fill, copy, upload and download move elements, and insist on sizes") {
    cpu::Serial backend;
    cpu::Serial::Buffer<float> buffer(3);
    backend.fill(Span<float>(buffer), 2.5f);
    std::vector<float> host(3);
    backend.download(Span<const float>(buffer), host);
    CHECK(host == std::vector<float>{2.5f, 2.5f, 2.5f});
    host[1] = -1;
    backend.upload(Span<const float>(host), buffer);
    CHECK(buffer[1] == -1);
    backend.synchronize();

    std::vector<float> short_one(2);
    CHECK_THROWS_AS(backend.copy(Span<const float>(host), short_one), ShapeError);
    CHECK_THROWS_AS(backend.upload(Span<const float>(short_one), buffer), ShapeError);
    CHECK_THROWS_AS(backend.download(Span<const float>(buffer), short_one), ShapeError);
}
