// SPDX-License-Identifier: Apache-2.0
#include <gsh/cpu.hpp>
#include <gsh/learn/learned_array.hpp>

#include "support/gradient.hpp"

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

using OtherWhere = LearnedArray<double>::OtherRate::Where;

/// An array of twelve numbers with a gradient, and what announces it.
template <class B>
struct Twelve {
    B backend{};
    std::vector<double> start;
    LearnedBuffer<B, double> buffer;

    Twelve() {
        test::Rng rng(2);
        start = rng.numbers(12);
        buffer = LearnedBuffer<B, double>(backend, start);
        for (double& g : buffer.gradient()) g = rng.uniform(0.5, 1) * (rng.uniform(-1, 1) < 0 ? -1 : 1);
    }
    LearnedArray<double> array(double rate = 0.1) { return buffer.announce("twelve", rate); }
    /// How far each number has moved.
    std::vector<double> moves() {
        std::vector<double> all;
        for (std::size_t i = 0; i < 12; ++i) all.push_back(std::abs(buffer.values()[i] - start[i]));
        return all;
    }
};

/// Adam's first step moves every number by its rate.
void check_moves(const std::vector<double>& moves, const std::vector<double>& rates) {
    REQUIRE(moves.size() == rates.size());
    for (std::size_t i = 0; i < moves.size(); ++i) {
        CAPTURE(i);
        CHECK(moves[i] == doctest::Approx(rates[i]).epsilon(1e-6));
    }
}

} // namespace

TEST_CASE("a learned buffer starts with its values; gradient and moments start at zero") {
    cpu::Serial backend;
    LearnedBuffer<cpu::Serial> buffer(backend, {1, 2, 3});
    CHECK(buffer.size() == 3);
    const LearnedArray<float> array = buffer.announce("three", 0.5);
    CHECK(array.name == "three");
    CHECK(array.rate == 0.5);
    CHECK(array.other.where == LearnedArray<float>::OtherRate::Where::none);
    CHECK(!array.is_table());
    for (std::size_t i = 0; i < 3; ++i) {
        CHECK(array.values[i] == static_cast<float>(i + 1));
        for (const auto& zeros : {array.gradient, array.first_moment, array.second_moment}) CHECK(zeros[i] == 0);
    }
    CHECK(array.values.data() == buffer.values().data());
    CHECK(array.gradient.data() == buffer.gradient().data());
    CHECK(LearnedBuffer<cpu::Serial>().size() == 0);
}

TEST_CASE_TEMPLATE("a step moves an array at its rate times the factor, and the gradient is zero afterwards", B,
                   cpu::Serial, cpu::Threads) {
    Twelve<B> one;
    take_step(one.backend, Adam(), one.array(0.1), 0.5, 1);
    check_moves(one.moves(), std::vector<double>(12, 0.05));
    for (const double g : one.buffer.gradient()) CHECK(g == 0);
    for (const double m : one.array().first_moment) CHECK(m != 0);
}

TEST_CASE("a step of several arrays moves each at its own rate") {
    Twelve<cpu::Serial> one, other;
    take_steps(one.backend, Adam(), LearnedArrays<double>{one.array(0.1), other.array(0.3)}, 0.5, 1);
    check_moves(one.moves(), std::vector<double>(12, 0.05));
    check_moves(other.moves(), std::vector<double>(12, 0.15));
}

TEST_CASE("an array with a rate of zero stays as it is; its gradient is zero afterwards, too") {
    Twelve<cpu::Serial> one;
    take_step(one.backend, Adam(), one.array(0), 1, 1);
    check_moves(one.moves(), std::vector<double>(12, 0.0));
    for (const double g : one.buffer.gradient()) CHECK(g == 0);
    for (const double m : one.array().first_moment) CHECK(m == 0);
}

TEST_CASE("columns and tails move at rates of their own") {
    Twelve<cpu::Serial> columns, tail;
    auto array = columns.array(0.1);
    array.other = {OtherWhere::columns, 4, 1, 0.01};
    take_step(columns.backend, Adam(), array, 2, 1);
    std::vector<double> rates(12, 0.02);
    for (const std::size_t i : {0, 4, 8}) rates[i] = 0.2;
    check_moves(columns.moves(), rates);

    array = tail.array(0.1);
    array.other = {.where = OtherWhere::tail, .width = 5, .rate = 0.01};
    take_step(tail.backend, Adam(), array, 2, 1);
    for (std::size_t i = 0; i < 12; ++i) rates[i] = i < 7 ? 0.2 : 0.02;
    check_moves(tail.moves(), rates);
}

TEST_CASE("of a table, touched rows move alone") {
    Twelve<cpu::Serial> table;
    const std::vector<std::uint32_t> touched{0, 3};
    auto array = table.array(0.1);
    array.touched_rows = touched, array.row_size = 3;
    CHECK(array.is_table());
    take_step(table.backend, Adam(), array, 1, 1);
    std::vector<double> rates(12, 0.0);
    for (const std::size_t i : {0, 1, 2, 9, 10, 11}) rates[i] = 0.1;
    check_moves(table.moves(), rates);
}

TEST_CASE("nothing to learn takes no step") {
    cpu::Serial backend;
    LearnedBuffer<cpu::Serial, double> none(backend, {});
    take_step(backend, Adam(), none.announce("none", 0.1), 1, 1);
    CHECK(none.size() == 0);
}

TEST_CASE("several steps are Adam's own, on any backend bit for bit") {
    Twelve<cpu::Serial> one;
    Twelve<cpu::Threads> threaded;
    std::vector<double> values = one.start, gradient(one.buffer.gradient().begin(), one.buffer.gradient().end()),
                        m(12, 0.0), v(12, 0.0);
    const auto kept = gradient;
    for (std::int64_t step = 1; step < 5; ++step) {
        std::copy(kept.begin(), kept.end(), one.buffer.gradient().begin());
        std::copy(kept.begin(), kept.end(), threaded.buffer.gradient().begin());
        take_step(one.backend, Adam(), one.array(0.1), 1, step);
        take_step(threaded.backend, Adam(), threaded.array(0.1), 1, step);
        Adam().step(one.backend, Span<double>(values), Span<double>(gradient), Span<double>(m), Span<double>(v), 0.1,
                    step);
    }
    for (std::size_t i = 0; i < 12; ++i) {
        CHECK(one.buffer.values()[i] == values[i]);
        CHECK(threaded.buffer.values()[i] == values[i]);
        CHECK(one.array().second_moment[i] == v[i]);
    }
}

TEST_CASE("a part's arrays are appended in order behind a prefix") {
    cpu::Serial backend;
    LearnedBuffer<cpu::Serial> a(backend, {1}), b(backend, {2, 3});
    LearnedArrays<float> all{a.announce("a", 1)};
    append(all, {a.announce("a", 1), b.announce("b", 2)}, "person1/");
    append(all, {b.announce("c", 3)});
    REQUIRE(all.size() == 4);
    CHECK(all[0].name == "a");
    CHECK(all[1].name == "person1/a");
    CHECK(all[2].name == "person1/b");
    CHECK(all[3].name == "c");
    CHECK(all[2].values.data() == b.values().data());
}
