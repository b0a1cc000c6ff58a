// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/vec.hpp>
#include <gsh/math/wide_block.hpp>

#include <doctest/doctest.h>

#include <cstddef>
#include <vector>

using namespace gsh;

TEST_CASE_TEMPLATE("a block reads the elements that were pushed, and the last one in lanes that are left", T, float,
                   double) {
    constexpr std::size_t width = WideBlock<T>::width;
    std::vector<vec3<T>> array(3 * width);
    for (std::size_t i = 0; i < array.size(); ++i) array[i] = vec3<T>(T(i), T(100 + i), T(200 + i));

    for (std::size_t count = 1; count <= width; ++count) {
        CAPTURE(count);
        WideBlock<T> block;
        for (std::size_t k = 0; k < count; ++k) CHECK(block.push(2 * k + 1) == (k + 1 == width));
        CHECK(block.fill());
        CHECK(block.count == count);
        vec3<Wide<T>> wide;
        block.gather(wide, [&](std::size_t i) -> auto& { return array[i]; });
        for (std::size_t lane = 0; lane < width; ++lane) {
            const std::size_t i = 2 * (lane < count ? lane : count - 1) + 1;
            CHECK(wide.x[lane] == array[i].x);
            CHECK(wide.y[lane] == array[i].y);
            CHECK(wide.z[lane] == array[i].z);
        }
    }
    CHECK(!WideBlock<T>().fill());
}

namespace {

template <std::size_t Count>
struct RowsCase {
    static constexpr std::size_t count = Count;
};

} // namespace

TEST_CASE_TEMPLATE("put_rows reads structs of any number of numbers, and add_rows adds some of the lanes back", Case,
                   RowsCase<3>, RowsCase<12>, RowsCase<16>, RowsCase<27>, RowsCase<48>, RowsCase<75>) {
    const auto check = [&]<class T>(T) {
        constexpr std::size_t width = Wide<T>::width;
        using Struct = T[Case::count];
        std::vector<T> numbers(2 * width * Case::count);
        for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] = T(i + 1);
        const auto row = [&](std::size_t lane) -> Struct& { // every second one
            return reinterpret_cast<Struct&>(numbers[2 * lane * Case::count]);
        };
        Wide<T> wides[Case::count];
        put_rows<T>(wides, row);
        for (std::size_t lane = 0; lane < width; ++lane)
            for (std::size_t k = 0; k < Case::count; ++k) CHECK(wides[k][lane] == row(lane)[k]);

        for (const std::size_t added : {std::size_t(0), std::size_t(1), width - 1, width}) {
            const std::vector<T> before = numbers;
            add_rows<T>(wides, added, row);
            for (std::size_t i = 0; i < numbers.size(); ++i) {
                const std::size_t r = i / Case::count;
                const bool mine = r % 2 == 0 && r / 2 < added;
                CHECK(numbers[i] == before[i] + (mine ? wides[i % Case::count][r / 2] : T(0)));
            }
        }
    };
    check(0.0f);
    check(0.0);
}
