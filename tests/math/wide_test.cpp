// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/wide.hpp>

#include "support/gradient.hpp"

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <type_traits>
#include <vector>

using namespace gsh;

TEST_CASE_TEMPLATE("Wide does in every lane what the scalar does", S, float, double) {
    using W = Wide<S>;
    test::Rng rng(3);
    for (int repeat = 0; repeat < 200; ++repeat) {
        S a[W::width], b[W::width];
        for (std::size_t i = 0; i < W::width; ++i) {
            a[i] = static_cast<S>(rng.uniform(-8, 8));
            b[i] = static_cast<S>(rng.uniform(0.1, 9));
        }
        const W x = W::load(a), y = W::load(b);
        const W sum = x + y, product = x * y, quotient = x / y, root = sqrt(y), power = exp(x), least = min(x, y),
                most = max(x, y), size = abs(x), chosen = select(x < y, x, y);
        for (std::size_t i = 0; i < W::width; ++i) {
            CHECK(sum[i] == a[i] + b[i]);
            CHECK(product[i] == a[i] * b[i]);
            CHECK(quotient[i] == a[i] / b[i]);
            CHECK(root[i] == std::sqrt(b[i]));
            CHECK(least[i] == std::min(a[i], b[i]));
            CHECK(most[i] == std::max(a[i], b[i]));
            CHECK(size[i] == std::abs(a[i]));
            CHECK(chosen[i] == (a[i] < b[i] ? a[i] : b[i]));
            const double exact = std::exp(static_cast<double>(a[i]));
            CHECK(std::abs(static_cast<double>(power[i]) - exact) <=
                  4 * static_cast<double>(std::numeric_limits<S>::epsilon()) * exact);
        }
        CHECK(any(x < y) == [&] {
            for (std::size_t i = 0; i < W::width; ++i)
                if (a[i] < b[i]) return true;
            return false;
        }());
    }
}

TEST_CASE_TEMPLATE("Wide is a lane type: indices, gathers, masks", S, float, double) {
    using W = Wide<S>;
    using Traits = LaneTraits<W>;
    static_assert(Lane<W> && std::same_as<ScalarOf<W>, S> && Traits::width == W::width);
    S in[W::width];
    for (std::size_t i = 0; i < W::width; ++i) in[i] = static_cast<S>(i) * S(1.5) + S(0.25);
    const W x = W::load(in);
    std::vector<S> table(2 * W::width + 1);
    for (std::size_t i = 0; i < table.size(); ++i) table[i] = static_cast<S>(i * i);
    const auto index = Traits::to_index(x);
    const W whole = Traits::from_index(index), found = Traits::gather(table.data(), index),
            limited = clamp(x, W(S(1)), W(S(3)));
    const MaskOf<W> small = x < W(S(2)), large = x > W(S(3)), neither = !(small || large), both = small && large;
    for (std::size_t i = 0; i < W::width; ++i) {
        CHECK(whole[i] == static_cast<S>(LaneTraits<S>::to_index(in[i])));
        CHECK(found[i] == table[static_cast<std::size_t>(in[i])]);
        CHECK(limited[i] == clamp(in[i], S(1), S(3)));
        CHECK(small[i] == (in[i] < S(2)));
        CHECK(neither[i] == (in[i] >= S(2) && in[i] <= S(3)));
        CHECK(!both[i]);
    }
    CHECK(any(small));
    CHECK_FALSE(any(x < W(S(-1))));
}

TEST_CASE("the exponential of a Wide keeps to the scalar's ends") {
    const Wide<float> low(-200.0f), high(200.0f), zero(0.0f);
    CHECK(exp(low)[0] == doctest::Approx(0.0f));
    CHECK(exp(high)[0] > 1e38f);
    CHECK(exp(zero)[0] == 1.0f);
}

TEST_CASE("the logarithm of a Wide is within two units in the last place, from subnormal numbers to the largest") {
    using W = Wide<float>;
    const auto at = [](std::uint32_t bits) {
        float number;
        std::memcpy(&number, &bits, sizeof number);
        return number;
    };
    const auto worst_of = [&](std::uint32_t first, std::uint32_t last, std::uint32_t step) {
        double worst = 0;
        for (std::uint32_t bits = first; bits + step * W::width <= last;) {
            float numbers[W::width];
            for (float& number : numbers) number = at(bits), bits += step;
            const W found = log(W::load(numbers));
            for (std::size_t i = 0; i < W::width; ++i) {
                const double exact = std::log(static_cast<double>(numbers[i]));
                int exponent = 0;
                std::frexp(exact, &exponent);
                const double unit = std::ldexp(1.0, exponent - 24);
                worst = std::max(worst, std::abs(static_cast<double>(found[i]) - exact) / unit);
            }
        }
        return worst;
    };
    CHECK(worst_of(1, 0x7f7fffff, 7919) < 2);           // all sizes
    CHECK(worst_of(0x3f000000, 0x40000000, 61) < 2);    // ½ to 2, where the result passes zero
    CHECK(worst_of(0x3f7ff000, 0x3f801000, 1) < 2);     // next to 1
    CHECK(worst_of(1, 0x00ffffff, 1023) < 2);           // subnormal and small
    constexpr float infinity = std::numeric_limits<float>::infinity();
    CHECK(log(W(1.0f))[0] == 0.0f);
    CHECK(log(W(0.0f))[0] == -infinity);
    CHECK(log(W(-0.0f))[0] == -infinity);
    CHECK(log(W(infinity))[0] == infinity);
    for (const float number : {-1.0f, -1e-40f, -infinity, std::numeric_limits<float>::quiet_NaN()})
        CHECK(std::isnan(log(W(number))[0]));
}

TEST_CASE("powers and exponentials in the normal range follow the scalar's, to an error that grows with the exponent of the result") {
    using W = Wide<float>;
    test::Rng rng(8);
    for (int repeat = 0; repeat < 2000; ++repeat) {
        float x[W::width], exponent[W::width];
        for (std::size_t i = 0; i < W::width; ++i) {
            x[i] = std::exp2(static_cast<float>(rng.uniform(-20, 20)));
            exponent[i] = static_cast<float>(rng.uniform(-3, 3));
        }
        const W found = power(W::load(x), W::load(exponent));
        for (std::size_t i = 0; i < W::width; ++i) {
            const double y = static_cast<double>(exponent[i]) * std::log2(static_cast<double>(x[i])),
                         exact = std::exp2(y);
            CHECK(std::abs(static_cast<double>(found[i]) / exact - 1) < 1e-7 * (1 + std::abs(y)));
        }
        for (float& number : x) number = static_cast<float>(rng.uniform(-87, 87));
        const W exponential = exp_normal(W::load(x));
        for (std::size_t i = 0; i < W::width; ++i) {
            const double y = static_cast<double>(x[i]);
            CHECK(std::abs(static_cast<double>(exponential[i]) / std::exp(y) - 1) < 1e-7 * (1 + std::abs(y)));
        }
    }
    CHECK(power(W(1.0f), W(2.4f))[0] == 1.0f);
}

TEST_CASE("multiply_add of Wides") {
    using W = Wide<float>;
    CHECK(multiply_add(W(2.0f), W(3.0f), W(4.0f))[0] == 10.0f);
}

TEST_CASE("inverse roots and logarithms of positive normal doubles are within two units in the last place") {
    constexpr double unit = std::numeric_limits<double>::epsilon();
    double root = 0, logarithm = 0;
    test::Rng rng(5);
    for (double x = 1e-300; x < 1e300; x *= 1.0 + rng.uniform(0, 0.2)) {
        const Wide<double> all(x);
        root = std::max(root, std::abs(inverse_sqrt(all)[1] * std::sqrt(x) - 1));
        logarithm = std::max(logarithm, std::abs(log_normal(all)[1] - std::log(x)) / std::abs(std::log(x)));
    }
    for (double x = 0.5; x < 2; x *= 1.0 + rng.uniform(0, 1e-3)) // where the logarithm is small
        logarithm = std::max(logarithm, std::abs(log_normal(Wide<double>(x))[0] - std::log(x)) / std::abs(std::log(x)));
    CHECK(root <= 3 * unit); // a unit of it is of the product with the root
    CHECK(logarithm <= 2 * unit);
    CHECK(log_normal(Wide<double>(1.0))[0] == 0);
}

TEST_CASE_TEMPLATE("minimum and maximum follow a comparison, for NaN and zeros, too", S, float, double) {
    using W = Wide<S>;
    const S nan = std::numeric_limits<S>::quiet_NaN();
    CHECK(min(W(S(1)), W(nan))[0] == 1); // b < a ? b : a
    CHECK(std::isnan(min(W(nan), W(S(1)))[0]));
    CHECK(max(W(S(1)), W(nan))[0] == 1);
    CHECK(std::isnan(max(W(nan), W(S(1)))[0]));
    CHECK_FALSE(std::signbit(min(W(S(0)), W(-S(0)))[0]));
    CHECK(std::signbit(max(W(-S(0)), W(S(0)))[0]));
    CHECK(max(Wide<std::uint32_t>(7u), Wide<std::uint32_t>(0xf0000000u))[1] == 0xf0000000u);
    CHECK(min(Wide<std::uint32_t>(7u), Wide<std::uint32_t>(0xf0000000u))[1] == 7u);
}

TEST_CASE_TEMPLATE("a mask as bits, and the first lanes of a register", S, float, double) {
    using W = Wide<S>;
    S numbers[W::width], out[W::width];
    for (std::size_t i = 0; i < W::width; ++i) numbers[i] = static_cast<S>(i), out[i] = S(-1);
    const W x = W::load(numbers);
    CHECK(lane_bits(x >= W(S(1))) == (1u << W::width) - 2);
    CHECK(lane_bits(x < W(S(0))) == 0);
    CHECK(lane_bits(x == W(S(1))) == 2);
    CHECK(lane_bits(x != W(S(1))) == (1u << W::width) - 3);
    CHECK(any(x <= W(S(0))));
    CHECK_FALSE(any(x < W(S(0))));
    x.template store_first<W::width - 1>(out);
    for (std::size_t i = 0; i < W::width; ++i) CHECK(out[i] == (i + 1 < W::width ? numbers[i] : S(-1)));
}

TEST_CASE_TEMPLATE("a row of a fixed number of lanes computes like a whole register", S, float, double) {
    const S numbers[] = {S(1.5), S(-2), S(3), S(-0.25)}, others[] = {S(2), S(-3), S(3), S(0.5)};
    const auto check = [&]<std::size_t Lanes>(std::integral_constant<std::size_t, Lanes>) {
        using Row = Wide<S, Lanes>;
        static_assert(Row::width == Lanes && sizeof(Row) == Lanes * sizeof(S));
        const Row a = Row::load(numbers), b = Row::load(others);
        const Row counted = Row::generate([](std::size_t i) { return i; });
        const Row sum = a + b, scaled = a * S(3), least = min(a, b), most = max(a, b), chosen = select(a > b, a, -b);
        for (std::size_t i = 0; i < Lanes; ++i) {
            CHECK(sum[i] == numbers[i] + others[i]);
            CHECK(scaled[i] == numbers[i] * S(3));
            CHECK(least[i] == std::min(numbers[i], others[i]));
            CHECK(most[i] == std::max(numbers[i], others[i]));
            CHECK(chosen[i] == (numbers[i] > others[i] ? numbers[i] : -others[i]));
            CHECK(counted[i] == static_cast<S>(i));
        }
        S out[] = {S(9), S(9), S(9), S(9)};
        a.store(out);
        for (std::size_t i = 0; i < 4; ++i) CHECK(out[i] == (i < Lanes ? numbers[i] : S(9)));
    };
    check(std::integral_constant<std::size_t, 1>()), check(std::integral_constant<std::size_t, 2>());
    check(std::integral_constant<std::size_t, 4>());
}

TEST_CASE_TEMPLATE("the first lanes of a row are read and written, and the others read as 0", S, float, double) {
    using Row = Wide<S, 4>;
    const S numbers[] = {S(5), S(6), S(7), S(8)};
    S out[] = {S(9), S(9), S(9), S(9)};
    const Row first = Row::template load_first<3>(numbers);
    first.template store_first<2>(out);
    for (std::size_t i = 0; i < 4; ++i) {
        CHECK(first[i] == (i < 3 ? numbers[i] : S(0)));
        CHECK(out[i] == (i < 2 ? numbers[i] : S(9)));
    }
}

TEST_CASE_TEMPLATE("numbers and masks convert to those of another type with as many lanes", S, float, double) {
    using Ints = Wide<std::int32_t, 4>;
    using Row = Wide<S, 4>;
    const Ints whole = Ints::generate([](std::size_t i) { return static_cast<int>(i) * 3 - 4; });
    const Row row(whole);
    const Ints back(row + Row(S(0.5)));
    const auto negative = static_cast<typename Row::Mask>(whole < Ints(0));
    const Ints halved = whole >> 1; // of signed numbers, rounded down
    for (std::size_t i = 0; i < 4; ++i) {
        const int number = static_cast<int>(i) * 3 - 4;
        CHECK(row[i] == static_cast<S>(number));
        CHECK(back[i] == static_cast<int>(static_cast<S>(number) + S(0.5)));
        CHECK(negative[i] == (number < 0));
        CHECK(halved[i] == number >> 1);
    }
}

TEST_CASE("a rough inverse root is within 10⁻⁴") {
    double worst = 0;
    for (float x = 1e-30f; x < 1e30f; x *= 1.37f)
        worst = std::max(worst, std::abs(static_cast<double>(rough_inverse_sqrt(Wide<float>(x))[0]) *
                                             std::sqrt(static_cast<double>(x)) - 1));
    CHECK(worst < 1e-4);
}
