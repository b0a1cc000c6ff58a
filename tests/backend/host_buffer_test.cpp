// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/host_buffer.hpp>

#include <doctest/doctest.h>

#include <cstdint>
#include <utility>

using namespace gsh;

TEST_CASE("a buffer is aligned and keeps its memory when it shrinks") {
    cpu::Buffer<float> buffer(1000);
    CHECK(reinterpret_cast<std::uintptr_t>(buffer.data()) % cpu::Buffer<float>::alignment == 0);
    const float* before = buffer.data();
    buffer.resize(10);
    CHECK(buffer.size() == 10);
    buffer.resize(1000);
    CHECK(buffer.data() == before);
    buffer.resize(0);
    CHECK(buffer.empty());
}

TEST_CASE("a buffer that grows again takes a quarter more than before") {
    cpu::Buffer<float> buffer(1000);
    buffer.resize(1001);
    const float* before = buffer.data();
    buffer.resize(1250);
    CHECK(buffer.data() == before);
    CHECK(buffer.size() == 1250);
    buffer.resize(5000);
    CHECK(buffer.size() == 5000);
    buffer[4999] = 1;
}

TEST_CASE("a large buffer begins at a large page") {
    cpu::Buffer<float> buffer(cpu::Buffer<float>::large_page / sizeof(float));
    CHECK(reinterpret_cast<std::uintptr_t>(buffer.data()) % cpu::Buffer<float>::large_page == 0);
    buffer[buffer.size() - 1] = 1;
    const cpu::Buffer<float> copy = buffer;
    CHECK(copy[copy.size() - 1] == 1);
    buffer.resize(2 * buffer.size()), buffer.resize(3);
    CHECK(buffer.size() == 3);
    const cpu::Buffer<float> moved = std::move(buffer);
    CHECK(moved.size() == 3);
}

TEST_CASE("copies are deep, moves take the memory") {
    cpu::Buffer<int> buffer(3);
    for (std::size_t i = 0; i < 3; ++i) buffer[i] = static_cast<int>(i);
    cpu::Buffer<int> copy = buffer;
    copy[1] = 9;
    CHECK(buffer[1] == 1);
    const int* memory = copy.data();
    const cpu::Buffer<int> moved = std::move(copy);
    CHECK(moved.data() == memory);
    CHECK(moved[1] == 9);

    buffer = moved;
    CHECK(buffer[1] == 9);
    CHECK(buffer.data() != moved.data());
    const Span<const int> view = moved;
    CHECK(view[2] == 2);

    const cpu::Buffer<int> none, copy_of_none = none;
    CHECK(copy_of_none.empty());
}
