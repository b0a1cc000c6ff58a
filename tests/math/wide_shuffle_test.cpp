// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/wide_shuffle.hpp>

#include <doctest/doctest.h>

#include <cstddef>
#include <cstdint>

using namespace gsh;

TEST_CASE_TEMPLATE("numbers of registers change places", S, float, double, std::uint32_t) {
    constexpr std::size_t n = Wide<S>::width;
    S numbers[2 * n];
    for (std::size_t i = 0; i < 2 * n; ++i) numbers[i] = static_cast<S>(i);
    const Wide<S> a = Wide<S>::load(numbers), b = Wide<S>::load(numbers + n);
    const WidePair<S> zipped = zip(a, b), unzipped = unzip(a, b), back = unzip(zipped.first, zipped.second);
    for (std::size_t i = 0; i < n; ++i) {
        CHECK(zipped.first[i] == static_cast<S>(i / 2 + i % 2 * n));
        CHECK(zipped.second[i] == static_cast<S>((n + i) / 2 + i % 2 * n));
        CHECK(unzipped.first[i] == static_cast<S>(2 * i));
        CHECK(unzipped.second[i] == static_cast<S>(2 * i + 1));
        CHECK(back.first[i] == a[i]);
        CHECK(back.second[i] == b[i]);
    }
}

TEST_CASE_TEMPLATE("rows become columns", S, float, double, std::uint32_t, std::uint64_t) {
    constexpr std::size_t n = Wide<S>::width;
    Wide<S> rows[n];
    for (std::size_t i = 0; i < n; ++i)
        for (std::size_t j = 0; j < n; ++j) rows[i].set(j, static_cast<S>(i * n + j));
    transpose(rows);
    for (std::size_t i = 0; i < n; ++i)
        for (std::size_t j = 0; j < n; ++j) CHECK(rows[i][j] == static_cast<S>(j * n + i));
}

TEST_CASE_TEMPLATE("sums of rows are in the order of the rows, and 0 where there is no row", S, float, double) {
    constexpr std::size_t n = Wide<S>::width;
    const auto check = [&]<int Count>() {
        Wide<S> rows[n];
        for (std::size_t i = 0; i < n; ++i)
            for (std::size_t j = 0; j < n; ++j) rows[i].set(j, static_cast<S>((i + 1) * (j + 2)));
        const Wide<S> sums = sums_of_rows<Count>(rows);
        for (std::size_t i = 0; i < n; ++i)
            CHECK(sums[i] == (i < std::size_t(Count) ? static_cast<S>((i + 1) * n * (n + 3) / 2) : S(0)));
    };
    check.template operator()<1>();
    check.template operator()<2>();
    check.template operator()<int(n)>();
    check.template operator()<(n > 4 ? int(n) - 3 : 1)>();
    check.template operator()<(n > 9 ? 9 : 2)>();
}
