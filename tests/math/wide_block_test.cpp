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
