// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/cpu/sum.hpp>
#include <gsh/backend/threads.hpp>

#include "support/gradient.hpp"

using namespace gsh;

TEST_CASE("add_sum is the sum, the same bits at any thread count, and adds") {
    test::Rng rng(1);
    for (const std::size_t n : {0, 1, 4095, 4096, 4097, 20001}) {
        const std::vector<double> values = rng.numbers(n);
        double expected = 0;
        for (const double value : values) expected += value;

        cpu::Serial serial;
        cpu::Buffer<double> partials, result(1);
        result[0] = 0;
        add_sum(serial, Span<const double>(values), Span<double>(result), partials);
        CHECK(result[0] == doctest::Approx(expected).epsilon(1e-12));
        for (const std::size_t threads : {1, 2, 3, 7}) {
            cpu::Threads backend(threads);
            std::vector<double> again(1, 0.0);
            add_sum(backend, Span<const double>(values), Span<double>(again), partials);
            CHECK(again[0] == result[0]);
            add_sum(backend, Span<const double>(values), Span<double>(again), partials);
            CHECK(again[0] == doctest::Approx(2 * result[0]).epsilon(1e-13));
        }
    }
    cpu::Serial serial;
    cpu::Buffer<double> partials, two(2);
    CHECK_THROWS_AS(add_sum(serial, Span<const double>(two), Span<double>(two), partials), ShapeError);
}
