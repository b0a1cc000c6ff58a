// SPDX-License-Identifier: Apache-2.0
#include <gsh/train/step_history.hpp>

#include <gsh/backend/serial.hpp>
#include <gsh/core/error.hpp>

#include <doctest/doctest.h>

#include "support/guarded.hpp"

#include <cstddef>
#include <cstdint>
#include <vector>

using namespace gsh;

namespace {

template <class B>
void add(B& backend, StepHistory<B>& history, std::uint64_t step, double mse = 0.01) {
    const std::vector<double> values{static_cast<double>(step), 0, 0, mse};
    typename B::template Buffer<double> on_backend;
    assign(backend, values, on_backend);
    history.add(step, Span<const double>(on_backend));
}

template <class B>
void check_steps(StepHistory<B>& history, std::uint64_t first, std::uint64_t last) {
    const std::vector<StepValues> found = history.read(last);
    REQUIRE(found.size() == last - first + 1);
    for (std::size_t k = 0; k < found.size(); ++k) {
        CHECK(found[k].step == first + k);
        CHECK(found[k].loss == static_cast<double>(first + k));
    }
}

} // namespace

TEST_CASE_TEMPLATE("steps are read once, in order", B, cpu::Serial, test::Guarded) {
    B backend;
    StepHistory<B> history(backend);
    CHECK(history.read(0).empty());
    for (std::uint64_t step = 1; step <= 3; ++step) add(backend, history, step);
    check_steps(history, 1, 3);
    CHECK(history.read(3).empty());
    add(backend, history, 4, 0.001);
    const auto found = history.read(4);
    REQUIRE(found.size() == 1);
    CHECK(found[0].psnr == doctest::Approx(30));
}

TEST_CASE_TEMPLATE("the last steps are kept, across the end of the ring", B, cpu::Serial, test::Guarded) {
    B backend;
    StepHistory<B> history(backend);
    const std::uint64_t capacity = StepHistory<B>::capacity, last = 2 * capacity + 300;
    for (std::uint64_t step = 1; step <= last; ++step) {
        add(backend, history, step);
        if (step == 7) check_steps(history, 1, 7);
    }
    check_steps(history, last - capacity + 1, last);
}

TEST_CASE("a step that is taken again overwrites its values, and skipped steps are not read") {
    cpu::Serial backend;
    StepHistory<cpu::Serial> history(backend);
    for (std::uint64_t step = 1; step <= 3; ++step) add(backend, history, step, 0.1);
    add(backend, history, 3, 0.01);
    history.skip(2);
    const auto found = history.read(3);
    REQUIRE(found.size() == 1);
    CHECK(found[0].psnr == doctest::Approx(20));
    CHECK_THROWS_AS(history.add(4, {}), ShapeError);
}
