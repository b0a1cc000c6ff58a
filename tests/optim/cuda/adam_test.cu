// SPDX-License-Identifier: Apache-2.0
/// @file  Adam on the GPU.
#include <gsh/backend/serial.hpp>
#include <gsh/optim/cpu/adam.hpp>
#include <gsh/optim/cuda/adam.cuh>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"
#include "support/gradient.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace gsh::adam_on_device {
namespace {

using cuda::Device;

constexpr std::size_t sizes[] = {0, 1, 3, 4, 5, 31, 32, 33, 1023, 1024, 1025, 3001};

/// Parameters, gradients, m and v, one after the other; they begin `shift` elements after an aligned address.
template <class T>
struct State {
    std::size_t size, shift;
    std::vector<T> numbers;

    State(std::size_t count, std::size_t offset, std::uint64_t seed)
        : size(count), shift(offset), numbers(4 * (count + offset)) {
        test::Rng rng(seed);
        for (T& number : numbers) number = T(rng.uniform(-1, 1));
        for (std::size_t i = 3 * (size + shift); i < numbers.size(); ++i) numbers[i] = std::abs(numbers[i]);
    }
    [[nodiscard]] std::size_t first(std::size_t array) const { return array * (size + shift) + shift; }
};

/// Calls work(parameters, gradients, m, v) on the arrays of a state.
template <class T, class Work>
void on_arrays(const State<T>& state, T* numbers, const Work& work) {
    const auto array = [&](std::size_t k) { return Span<T>(numbers + state.first(k), state.size); };
    work(array(0), array(1), array(2), array(3));
}
template <class T, class Work>
State<T> on_device(Device& device, State<T> state, const Work& work) {
    Device::Buffer<T> buffer(state.numbers.size());
    device.upload(Span<const T>(state.numbers), Span<T>(buffer));
    on_arrays(state, buffer.data(), work);
    device.download(Span<const T>(buffer), Span<T>(state.numbers));
    return state;
}
template <class T, class Work>
State<T> on_host(State<T> state, const Work& work) {
    on_arrays(state, state.numbers.data(), work);
    return state;
}

/// The largest difference, relative to numbers of order one.
template <class T>
double difference(const State<T>& a, const State<T>& b) {
    double worst = 0;
    for (std::size_t i = 0; i < a.numbers.size(); ++i)
        worst = std::max(worst, std::abs(double(a.numbers[i]) - double(b.numbers[i])));
    return worst;
}
template <class T>
constexpr double tolerance = std::is_same_v<T, float> ? 1e-6 : 1e-14;

std::vector<std::uint32_t> some_rows(std::size_t rows) {
    std::vector<std::uint32_t> some;
    for (std::size_t r = 0; r < rows; r += 1 + r % 3) some.push_back(std::uint32_t(r));
    return some;
}

} // namespace

TEST_CASE_TEMPLATE("Adam::step follows the CPU's, at every alignment", T, float, double) {
    if (test::skip_without_device()) return;
    Device device;
    cpu::Serial serial;
    for (const std::size_t size : sizes)
        for (const std::size_t shift : {0, 1}) {
            CAPTURE(size);
            CAPTURE(shift);
            const State<T> start(size, shift, 1);
            for (const auto used : {UsedGradients::keep, UsedGradients::zero}) {
                const auto found = on_device(device, start, [&](auto p, auto g, auto m, auto v) {
                    Adam().step(device, p, g, m, v, 0.01, 3, used);
                });
                const auto expected = on_host(
                    start, [&](auto p, auto g, auto m, auto v) { Adam().step(serial, p, g, m, v, 0.01, 3, used); });
                CHECK(difference(found, expected) < tolerance<T>);
                if (size > 0) CHECK(difference(found, start) > 1e-3);
            }
        }
}

TEST_CASE_TEMPLATE("Adam::step_rows moves its rows alone", T, float, double) {
    if (test::skip_without_device()) return;
    Device device;
    cpu::Serial serial;
    for (const std::size_t width : {1, 2, 3, 4, 6, 8})
        for (const std::size_t rows : {0, 1, 31, 32, 33, 700})
            for (const std::size_t shift : {0, 1, 2}) {
                CAPTURE(width);
                CAPTURE(rows);
                CAPTURE(shift);
                const State<T> start(rows * width, shift, 2);
                const auto some = some_rows(rows);
                Device::Buffer<std::uint32_t> list(some.size());
                device.upload(Span<const std::uint32_t>(some), Span<std::uint32_t>(list));
                const auto found = on_device(device, start, [&](auto p, auto g, auto m, auto v) {
                    Adam().step_rows(device, p, g, m, v, list, width, 0.01, 2, UsedGradients::zero);
                });
                const auto expected = on_host(start, [&](auto p, auto g, auto m, auto v) {
                    Adam().step_rows(serial, p, g, m, v, some, width, 0.01, 2, UsedGradients::zero);
                });
                CHECK(difference(found, expected) < tolerance<T>);
                bool others_stay = true;
                for (std::size_t i = 0; i < start.size; ++i) {
                    if (std::binary_search(some.begin(), some.end(), std::uint32_t(i / width))) continue;
                    for (std::size_t k = 0; k < 4; ++k)
                        others_stay =
                            others_stay && found.numbers[found.first(k) + i] == start.numbers[start.first(k) + i];
                }
                CHECK(others_stay);
            }
}

TEST_CASE_TEMPLATE("Adam::step_columns has two rates", T, float, double) {
    if (test::skip_without_device()) return;
    Device device;
    cpu::Serial serial;
    for (const std::size_t width : {1, 3, 12, 27})
        for (const std::size_t first : {std::size_t(0), std::size_t(1), width})
            for (const std::size_t rows : {0, 1, 33, 100})
                for (const std::size_t shift : {0, 1}) {
                    CAPTURE(width);
                    CAPTURE(first);
                    CAPTURE(rows);
                    const State<T> start(rows * width, shift, 3);
                    const auto found = on_device(device, start, [&](auto p, auto g, auto m, auto v) {
                        Adam().step_columns(device, p, g, m, v, width, first, 0.02, 0.001, 2);
                    });
                    const auto expected = on_host(start, [&](auto p, auto g, auto m, auto v) {
                        Adam().step_columns(serial, p, g, m, v, width, first, 0.02, 0.001, 2);
                    });
                    CHECK(difference(found, expected) < tolerance<T>);
                }
}

TEST_CASE("Adam changes nothing on a halted device") {
    if (test::skip_without_device()) return;
    Device device;
    const State<float> start(1003, 0, 4);
    const std::vector<std::uint32_t> first_rows{0, 1, 2};
    Device::Buffer<std::uint32_t> rows(3);
    device.upload(Span<const std::uint32_t>(first_rows), Span<std::uint32_t>(rows));
    const auto step = [&](auto p, auto g, auto m, auto v) {
        Adam().step(device, p, g, m, v, 0.01, 1, UsedGradients::zero);
        Adam().step_rows(device, p, g, m, v, rows, 17, 0.01, 1, UsedGradients::zero);
        Adam().step_columns(device, p, g, m, v, 17, 3, 0.01, 0.02, 1, UsedGradients::zero);
    };
    device.fill(device.halted(), 7u);
    CHECK(on_device(device, start, step).numbers == start.numbers);
    device.resume();
    CHECK(difference(on_device(device, start, step), start) > 1e-3);
}

#if defined(GSH_CUDA_EMULATION)
TEST_CASE("Adam gives the same bits in any order of blocks and threads") {
    auto& machine = test::CudaEmulation::instance();
    const auto run = [&](test::Order order, unsigned char fill) {
        machine.order = order, machine.fill = fill;
        Device device;
        const auto some = some_rows(600);
        Device::Buffer<std::uint32_t> list(some.size());
        device.upload(Span<const std::uint32_t>(some), Span<std::uint32_t>(list));
        return on_device(device, State<float>(1800, 0, 5), [&](auto p, auto g, auto m, auto v) {
            Adam().step(device, p, g, m, v, 0.01, 1);
            Adam().step_rows(device, p, g, m, v, list, 3, 0.01, 2);
            Adam().step_columns(device, p, g, m, v, 9, 3, 0.01, 0.02, 3, UsedGradients::zero);
        });
    };
    const auto expected = run(test::Order::forward, 0xA5).numbers;
    CHECK(run(test::Order::reverse, 0xA5).numbers == expected);
    CHECK(run(test::Order::random, 0xFF).numbers == expected);
    machine.order = test::Order::forward, machine.fill = 0xA5;
}
#endif

} // namespace gsh::adam_on_device
