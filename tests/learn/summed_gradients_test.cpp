// SPDX-License-Identifier: Apache-2.0
#include <gsh/cpu.hpp>
#include <gsh/learn/summed_gradients.hpp>

#include "support/gradient.hpp"

#include <doctest/doctest.h>

#include <barrier>
#include <cstddef>
#include <cstdint>
#include <thread>
#include <vector>

using namespace gsh;

namespace {

/// Threads as ranks. Each number is summed in the order of the ranks, so that all have the same bits.
class ThreadRanks {
public:
    explicit ThreadRanks(std::size_t count) : arrays_(count), meeting_(static_cast<std::ptrdiff_t>(count)) {}

    /// One rank's end.
    struct Rank {
        ThreadRanks* all;
        std::size_t index;

        void add_up(Span<double> numbers) {
            all->arrays_[index] = numbers;
            all->meeting_.arrive_and_wait();
            std::vector<double> sums(numbers.size(), 0.0);
            for (const Span<double> array : all->arrays_)
                for (std::size_t i = 0; i < sums.size(); ++i) sums[i] += array[i];
            all->meeting_.arrive_and_wait(); // all have read
            for (std::size_t i = 0; i < sums.size(); ++i) numbers[i] = sums[i];
        }
    };

private:
    std::vector<Span<double>> arrays_;
    std::barrier<> meeting_;
};

/// Two arrays, one of them a table, whose gradients differ from rank to rank and from step to step.
struct Copy {
    cpu::Serial backend{};
    LearnedBuffer<cpu::Serial, double> numbers, table;
    std::vector<std::uint32_t> rows{0, 2};

    Copy() {
        test::Rng rng(4);
        numbers = {backend, rng.numbers(5)};
        table = {backend, rng.numbers(6)};
    }
    LearnedArrays<double> learned() {
        LearnedArrays<double> arrays{numbers.announce("numbers", 0.01), table.announce("table", 0.02)};
        arrays[1].touched_rows = rows, arrays[1].row_size = 2;
        return arrays;
    }
    /// Adds what a rank's photograph asks for in a step.
    void add_gradient(std::size_t rank, int step) {
        test::Rng rng(10 * static_cast<std::uint64_t>(step) + rank);
        for (double& g : numbers.gradient()) g += rng.uniform(-1, 1);
        for (const std::uint32_t row : rows)
            for (std::size_t c = 0; c < 2; ++c) table.gradient()[2 * row + c] += rng.uniform(-1, 1);
    }
    std::vector<double> values() {
        std::vector<double> all;
        for (const Span<double> part : {numbers.values(), table.values()}) all.insert(all.end(), part.begin(), part.end());
        return all;
    }
};

} // namespace

TEST_CASE("copies of a model on three ranks learn the same bits, those of a step with the sum of the gradients") {
    constexpr std::size_t count = 3;
    constexpr int steps = 20;
    ThreadRanks ranks(count);
    std::vector<Copy> copies(count);
    {
        std::vector<std::jthread> threads;
        for (std::size_t r = 0; r < count; ++r)
            threads.emplace_back([&, r] {
                ThreadRanks::Rank rank{&ranks, r};
                const SummedGradients<ThreadRanks::Rank> optimizer{&rank};
                for (int step = 1; step <= steps; ++step) {
                    copies[r].add_gradient(r, step);
                    take_steps(copies[r].backend, optimizer, copies[r].learned(), 1.0, step);
                }
            });
    }
    Copy alone; // has every rank's photograph in each step
    for (int step = 1; step <= steps; ++step) {
        for (std::size_t r = 0; r < count; ++r) alone.add_gradient(r, step);
        take_steps(alone.backend, Adam(), alone.learned(), 1.0, step);
    }
    CHECK(alone.values() != Copy().values());
    for (Copy& copy : copies) CHECK(copy.values() == alone.values());
}
