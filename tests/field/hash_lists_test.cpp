// SPDX-License-Identifier: Apache-2.0
#include <gsh/field/hash_grid.hpp>
#include <gsh/field/hash_lists.hpp>

#include "support/gradient.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <vector>

using namespace gsh;

namespace {

using ListedGrid = HashGrid<4, 1>;
using ListsOf = detail::HashLists<double, 4>;

struct ListedPoints {
    ListedGrid grid{{.base = 3, .growth = 2.5, .table_size = 256}};
    std::vector<vec3<double>> positions;
    std::vector<double> gradient, fine; // of each point: of its one feature, the same on each level; the level's weight
    LevelWeights<double> weights;

    explicit ListedPoints(std::size_t count) {
        test::Rng rng(4);
        positions = rng.vecs(count, 0, 1);
        gradient = rng.numbers(count, -1, 1);
        fine = rng.numbers(count, 0, 1);
        for (std::size_t i = 0; i < count; i += 3) fine[i] = 0; // these do not read the fine levels
        weights = {2, {}, fine};
    }
};

} // namespace

TEST_CASE("what the lists of a hash grid add up is the gradient of its table, point by point") {
    const ListedPoints of(3000);
    const ListsOf lists(of.grid, of.positions, of.weights);

    std::map<std::uint32_t, double> expected;
    std::size_t lookups = 0;
    for (int l = 0; l < 4; ++l)
        for (std::size_t i = 0; i < of.positions.size(); ++i) {
            const double weight = l < 2 ? 1 : of.fine[i];
            if (weight == 0) continue;
            const HashCell<double> cell = of.grid.level(l).cell(of.positions[i]);
            for (int c = 0; c < 8; ++c, ++lookups)
                expected[of.grid.level(l).index(cell, c)] += cell.weight(c) * weight * of.gradient[i];
        }
    CHECK(lists.lookups == lookups);

    // The rows of a summed level are sums of cells, eight of each segment; those of other levels are points.
    std::vector<double> sums(8 * (lists.segments.size() - 1), 0);
    for (const detail::HashTask& task : lists.sum_tasks)
        for (std::uint32_t s = task.first; s < task.first + task.count; ++s)
            for (std::uint32_t k = lists.segments[s]; k < lists.segments[s + 1]; ++k) {
                const std::uint32_t i = lists.points[k];
                const HashCell<double> cell = of.grid.level(task.level).cell(of.positions[i]);
                const double weight = task.level < 2 ? 1 : of.fine[i];
                for (int c = 0; c < 8; ++c)
                    sums[8 * s + static_cast<std::size_t>(c)] += cell.weight(c) * weight * of.gradient[i];
            }
    std::map<std::uint32_t, double> found;
    std::size_t summed = 0, direct = 0;
    for (const detail::HashTask& task : lists.gather_tasks)
        for (std::uint32_t e = task.first; e < task.first + task.count; ++e) {
            CHECK(!found.contains(lists.entries[e])); // each entry has one list
            double& sum = found[lists.entries[e]];
            for (std::uint32_t k = lists.item_begin[e]; k < lists.item_begin[e + 1]; ++k)
                sum += lists.items[k].weight * (task.summed ? sums : of.gradient)[lists.items[k].row];
            ++(task.summed ? summed : direct);
        }
    CHECK(summed > 0);
    CHECK(direct > 0);
    REQUIRE(found.size() == expected.size());
    for (const auto& [entry, sum] : expected) CHECK(found[entry] == doctest::Approx(sum).epsilon(1e-9));

    REQUIRE(lists.touched.size() == expected.size());
    CHECK(std::is_sorted(lists.touched.begin(), lists.touched.end()));
    for (const std::uint32_t entry : lists.touched) CHECK(expected.contains(entry));
    CHECK(lists.touched_begin.back() == lists.touched.size());
}

TEST_CASE("a list's length decides how many threads share it, and a block has lists of one class and level") {
    const ListedPoints of(500);
    const ListsOf lists(of.grid, of.positions, of.weights);
    for (const detail::HashTask& task : lists.gather_tasks) {
        CHECK(task.count <= ListsOf::gather_block >> task.lane_bits);
        for (std::uint32_t e = task.first; e < task.first + task.count; ++e) {
            const std::size_t length = lists.item_begin[e + 1] - lists.item_begin[e];
            const auto fits = [&](const ListsOf::Lanes& lanes) { return length <= lanes.most_items; };
            CHECK(std::find_if(std::begin(ListsOf::classes), std::end(ListsOf::classes), fits)->bits == task.lane_bits);
        }
    }
    for (const detail::HashTask& task : lists.sum_tasks) CHECK(task.count <= ListsOf::segments_per_block);
    for (std::size_t s = 0; s + 1 < lists.segments.size(); ++s)
        CHECK(lists.segments[s + 1] - lists.segments[s] <= ListsOf::segment_size);
}
