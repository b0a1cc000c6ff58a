// SPDX-License-Identifier: Apache-2.0
#include "common/memory_reserve.hpp"

#include <doctest/doctest.h>

#include <cstddef>
#include <new>

using namespace gsh::programs;

TEST_CASE("the first failed allocation gives the reserve back, and throws if that is not enough") {
    const std::new_handler before = std::get_new_handler();
    set_memory_aside();
    CHECK(memory_reserve.load() != nullptr);
    volatile std::size_t too_much = std::size_t(1) << 62;
    CHECK_THROWS_AS(::operator delete(::operator new(too_much)), std::bad_alloc);
    CHECK(memory_reserve.load() == nullptr);
    CHECK_THROWS_AS(::operator delete(::operator new(too_much)), std::bad_alloc); // nothing is left to give back
    set_memory_aside();
    void* const reserve = memory_reserve.load();
    CHECK(reserve != nullptr);
    set_memory_aside(); // once is enough
    CHECK(memory_reserve.load() == reserve);
    give_reserve_back();
    std::set_new_handler(before);
}
