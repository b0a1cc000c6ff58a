// SPDX-License-Identifier: Apache-2.0
/// @file  How much memory a file may ask for.

#include "io/temporary.hpp"

#include <doctest/doctest.h>

#include <gsh/io/file/claimed_size.hpp>

#include <limits>

using namespace gsh;
using namespace gsh::detail;

TEST_CASE("64 MiB is never questioned, more must be backed by a 200th") {
    CHECK(may_take(unquestioned_memory, 0));
    CHECK(!may_take(unquestioned_memory + 200, 0));
    CHECK(may_take(200'000'000, 1'000'000));
    CHECK(!may_take(200'000'200, 1'000'000));
    CHECK(!may_take(std::numeric_limits<std::uint64_t>::max(), std::uint64_t(1) << 32));
    CHECK_NOTHROW(check_claimed_poses("a.bvh", 60, 20'000, 2));
    CHECK_NOTHROW(check_claimed_poses("a.bvh", 60, 1'000'000, 100'000'000));
    test::check_throws<IoError>([] { check_claimed_poses("a.bvh", 4000, 4000, 20'000); },
                                {"a.bvh holds 4000 frames of 4000 joints in 20000 bytes"});
    CHECK_NOTHROW(check_claim("a.npz: x", 1000, 1));
    test::check_throws<IoError>([] { check_claim("a.npz: x", std::uint64_t(1) << 30, 250); },
                                {"a.npz: x inflates from 250 to 1073741824 bytes", "200 times"});
}
