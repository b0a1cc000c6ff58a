// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/threads.hpp>
#include <gsh/optim/adam.hpp>
#include <gsh/optim/cpu/adam.hpp>

#include "support/gradient.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

using namespace gsh;

namespace {

template <class T>
struct State {
    std::vector<T> parameters, gradients, m, v;

    explicit State(std::size_t size, std::uint64_t seed = 1)
        : parameters(size), gradients(size, T(0)), m(size, T(0)), v(size, T(0)) {
        for (std::size_t i = 0; i < size; ++i) parameters[i] = static_cast<T>(random_uniform(seed, i));
    }
    bool operator==(const State&) const = default;
};

/// Gradients of a step. Every third row of four numbers always has zeros.
template <class T>
void draw(State<T>& state, std::uint64_t step) {
    for (std::size_t i = 0; i < state.gradients.size(); ++i)
        state.gradients[i] = i / 4 % 3 == 1 ? T(0) : static_cast<T>(random_uniform(step + 7, i) - 0.5);
}

} // namespace

TEST_CASE("Adam::step follows the algorithm as printed") {
    cpu::Serial backend;
    State<double> state(5);
    const Adam adam;
    std::vector<double> p = state.parameters, m(5, 0.0), v(5, 0.0);
    for (int t = 1; t <= 4; ++t) {
        draw(state, static_cast<std::uint64_t>(t));
        adam.step(backend, Span<double>(state.parameters), state.gradients, state.m, state.v, 0.01, t);
        for (std::size_t i = 0; i < 5; ++i) {
            m[i] = 0.9 * m[i] + 0.1 * state.gradients[i];
            v[i] = 0.999 * v[i] + 0.001 * state.gradients[i] * state.gradients[i];
            const double m_hat = m[i] / (1 - std::pow(0.9, t)), v_hat = v[i] / (1 - std::pow(0.999, t));
            p[i] -= 0.01 * m_hat / (std::sqrt(v_hat) + 1e-15);
            CHECK(state.parameters[i] == doctest::Approx(p[i]).epsilon(1e-12));
        }
    }
}

TEST_CASE("Adam's first step has the length of the rate, whatever the gradient's") {
    cpu::Serial backend;
    std::vector<float> p(3, 0.0f), m(3, 0.0f), v(3, 0.0f), g{1e-8f, -3.0f, 1e6f};
    Adam().step(backend, Span<float>(p), g, m, v, 0.5, 1);
    CHECK(p[0] == doctest::Approx(-0.5));
    CHECK(p[1] == doctest::Approx(0.5));
    CHECK(p[2] == doctest::Approx(-0.5));
}

TEST_CASE_TEMPLATE("stepping the touched rows equals dense Adam bit for bit", T, float, double) {
    cpu::Serial backend;
    constexpr std::size_t width = 4;
    State<T> dense(width * 1000), sparse(width * 1000);
    std::vector<std::uint32_t> rows;
    for (std::uint32_t r = 0; r < 1000; ++r)
        if (r % 3 != 1) rows.push_back(r);
    for (int t = 1; t <= 5; ++t) {
        draw(dense, static_cast<std::uint64_t>(t));
        // The moments also change without a gradient.
        if (t == 4) std::fill(dense.gradients.begin(), dense.gradients.end(), T(0));
        std::copy(dense.gradients.begin(), dense.gradients.end(), sparse.gradients.begin());
        Adam().step(backend, Span<T>(dense.parameters), dense.gradients, dense.m, dense.v, 0.01, t);
        Adam().step_rows(backend, Span<T>(sparse.parameters), sparse.gradients, sparse.m, sparse.v, rows, width, 0.01,
                         t);
        CHECK(dense == sparse);
    }
}

TEST_CASE_TEMPLATE("Adam on Threads equals Serial bit for bit", T, float, double) {
    State<T> expected(10007);
    std::vector<std::uint32_t> rows;
    for (std::uint32_t r = 0; r < 10007; r += 1 + r % 5) rows.push_back(r);
    const auto run = [&](auto& backend, State<T>& state) {
        for (int t = 1; t <= 3; ++t) {
            draw(state, static_cast<std::uint64_t>(t));
            Adam().step(backend, Span<T>(state.parameters), state.gradients, state.m, state.v, 0.01, t);
            Adam().step_rows(backend, Span<T>(state.parameters), state.gradients, state.m, state.v, rows, 1, 0.01, t,
                             UsedGradients::zero);
        }
    };
    cpu::Serial serial;
    run(serial, expected);
    for (const std::size_t threads : {1, 2, 3, 7}) {
        cpu::Threads backend(threads);
        State<T> state(10007);
        run(backend, state);
        CHECK(state == expected);
    }
}

TEST_CASE("Adam zeroes used gradients on request, those of untouched rows stay") {
    cpu::Serial backend;
    State<float> state(12);
    std::fill(state.gradients.begin(), state.gradients.end(), 1.0f);
    const std::vector<std::uint32_t> rows{0, 2};
    Adam().step_rows(backend, Span<float>(state.parameters), state.gradients, state.m, state.v, rows, 4, 0.01, 1,
                     UsedGradients::zero);
    for (std::size_t i = 0; i < 12; ++i) CHECK(state.gradients[i] == (i / 4 == 1 ? 1.0f : 0.0f));
}

TEST_CASE("Adam says what is wrong with its arguments, and takes nothing at all") {
    cpu::Serial backend;
    State<float> s(8);
    std::vector<float> few(7);
    const std::vector<std::uint32_t> rows{0};
    const Span<float> p(s.parameters);
    CHECK_THROWS_AS(Adam().step(backend, p, few, s.m, s.v, 0.1, 1), ShapeError);
    CHECK_THROWS_AS(Adam().step(backend, p, s.gradients, few, s.v, 0.1, 1), ShapeError);
    CHECK_THROWS_AS(Adam().step(backend, p, s.gradients, s.m, few, 0.1, 1), ShapeError);
    CHECK_THROWS_AS(Adam().step(backend, p, s.gradients, s.m, s.v, 0.1, 0), ValueError);
    CHECK_THROWS_AS(Adam().step_rows(backend, p, s.gradients, s.m, s.v, rows, 0, 0.1, 1), ValueError);
    CHECK_THROWS_AS(Adam().step_rows(backend, p, s.gradients, s.m, s.v, rows, 3, 0.1, 1), ValueError);
    Adam().step(backend, Span<float>(), {}, {}, {}, 0.1, 1);
    Adam().step_rows(backend, p, s.gradients, s.m, s.v, {}, 4, 0.1, 1);
    CHECK(s == State<float>(8));
}

TEST_CASE("Adam::step_columns moves the first columns at one rate and the others at another") {
    constexpr std::size_t width = 12, rows = 3000;
    for (const std::size_t first : {0, 3, 12}) {
        CAPTURE(first);
        cpu::Serial serial;
        State<float> slow(rows * width), fast(rows * width), columns(rows * width), threaded(rows * width);
        for (int t = 1; t <= 3; ++t) {
            for (State<float>* state : {&slow, &fast, &columns, &threaded}) draw(*state, static_cast<std::uint64_t>(t));
            Adam().step(serial, Span<float>(slow.parameters), slow.gradients, slow.m, slow.v, 0.001, t);
            Adam().step(serial, Span<float>(fast.parameters), fast.gradients, fast.m, fast.v, 0.02, t);
            Adam().step_columns(serial, Span<float>(columns.parameters), columns.gradients, columns.m, columns.v, width,
                                first, 0.02, 0.001, t, UsedGradients::zero);
            cpu::Threads threads(3);
            Adam().step_columns(threads, Span<float>(threaded.parameters), threaded.gradients, threaded.m, threaded.v,
                                width, first, 0.02, 0.001, t, UsedGradients::zero);
        }
        CHECK(columns == threaded);
        CHECK(columns.m == slow.m);
        CHECK(std::count(columns.gradients.begin(), columns.gradients.end(), 0.0f) == rows * width);
        bool equal = true;
        for (std::size_t i = 0; i < rows * width; ++i)
            equal = equal && columns.parameters[i] == (i % width < first ? fast : slow).parameters[i];
        CHECK(equal);
    }
    cpu::Serial backend;
    std::vector<float> p(8), g(8), m(8), v(8);
    CHECK_THROWS_AS(Adam().step_columns(backend, Span<float>(p), g, m, v, 3, 1, 1, 1, 1), ValueError);
    CHECK_THROWS_AS(Adam().step_columns(backend, Span<float>(p), g, m, v, 0, 0, 1, 1, 1), ValueError);
    CHECK_THROWS_AS(Adam().step_columns(backend, Span<float>(p), g, m, v, 4, 5, 1, 1, 1), ValueError);
}
