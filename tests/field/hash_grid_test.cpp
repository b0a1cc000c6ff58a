// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/threads.hpp>
#include <gsh/field/cpu/hash_grid.hpp>
#include <gsh/field/hash_grid.hpp>
#include <gsh/math/wide.hpp>

#include "support/gradient.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <set>
#include <vector>

using namespace gsh;

namespace {

using Grid = HashGrid<5, 4>;
const Grid::Params small{.base = 3, .growth = 1.7, .table_size = 256}; // levels 0 to 2 dense, 3 and 4 hashed

/// The encoding of one point on one level, from the definition.
std::vector<double> plain(const Grid& grid, const std::vector<double>& table, vec3<double> p, int l) {
    std::vector<double> features(4, 0.0);
    const Grid::Params& params = grid.params();
    const double scale = params.base * std::pow(params.growth, l) - 1;
    const auto stride = static_cast<std::uint64_t>(std::ceil(scale)) + 2;
    for (int corner = 0; corner < 8; ++corner) {
        double weight = 1;
        std::uint64_t at[3];
        for (int axis = 0; axis < 3; ++axis) {
            const double position = scale * p[axis] + 0.5, low = std::floor(position);
            const int up = corner >> axis & 1;
            weight *= up ? position - low : 1 - (position - low);
            at[axis] = static_cast<std::uint64_t>(low) + static_cast<std::uint64_t>(up);
        }
        const std::uint64_t entry = stride * stride * stride <= params.table_size
                                        ? at[0] + stride * (at[1] + stride * at[2])
                                        : (at[0] ^ at[1] * 2654435761u ^ at[2] * 805459861u) % params.table_size;
        for (std::size_t f = 0; f < 4; ++f) features[f] += weight * table[(grid.level(l).offset + entry) * 4 + f];
    }
    return features;
}

/// A table with numbers of order one, so that errors show.
template <class T>
std::vector<T> big_table(const Grid& grid) {
    std::vector<T> table = grid.initial_table<T>(3);
    for (T& x : table) x *= T(1e4);
    return table;
}

template <class T>
std::vector<vec3<T>> cast(const std::vector<vec3<double>>& points) {
    return {points.begin(), points.end()};
}

template <class T, class B>
struct GridRun {
    std::vector<T> features, dL_dtable;
    std::vector<vec3<T>> dL_dpoints;
    std::vector<std::uint32_t> touched;

    GridRun(B& backend, const Grid& grid, const std::vector<T>& table, const std::vector<vec3<T>>& points,
        const std::vector<T>& dL_dfeatures, std::size_t block, int backwards = 1)
        : features(dL_dfeatures.size()), dL_dtable(table.size(), T(0)), dL_dpoints(points.size(), vec3<T>(0)) {
        Grid::Query<B, T> query;
        grid.prepare(backend, points, query);
        touched.assign(query.touched.begin(), query.touched.end());
        const FeatureView<const T> gradient(dL_dfeatures, points.size(), Grid::output_count, block);
        grid.forward(backend, table, query, {features, points.size(), Grid::output_count, block});
        for (int i = 0; i < backwards; ++i) {
            grid.backward(backend, gradient, query, dL_dtable);
            grid.backward_points(backend, table, query, gradient, dL_dpoints);
        }
    }
};

} // namespace

TEST_CASE("levels have the published geometry") {
    const HashGrid<16, 4> grid({.growth = 1.5});
    CHECK(grid.level(0).scale == 3);
    CHECK(grid.level(0).resolution == 4);
    CHECK(grid.level(1).scale == 5);
    CHECK(grid.level(6).scale == doctest::Approx(4 * std::pow(1.5, 6) - 1));
    CHECK_FALSE(grid.level(6).hashed); // 47^3 entries fit 2^17
    CHECK(grid.level(7).hashed);
    CHECK(grid.level(7).size == 1u << 17);
    std::uint32_t offset = 0;
    for (int l = 0; l < 16; ++l) {
        CHECK(grid.level(l).offset == offset);
        CHECK(grid.level(l).offset % 16 == 0);
        CHECK(grid.level(l).size >=
              std::min(1u << 17, grid.level(l).stride() * grid.level(l).stride() * grid.level(l).stride()));
        offset += grid.level(l).size;
    }
    CHECK(grid.entry_count() == offset);
    CHECK(grid.parameter_count() == 4 * grid.entry_count());
}

TEST_CASE("HashGrid evaluates its definition, one point at a time and many") {
    const Grid grid(small);
    const auto table = big_table<double>(grid);
    test::Rng rng(1);
    auto points = rng.vecs(131, 0, 1);
    points[0] = vec3<double>(0), points[1] = vec3<double>(1), points[2] = {1, 0, 0.5};
    cpu::Serial backend;
    const GridRun<double, cpu::Serial> run(backend, grid, table, points, std::vector(points.size() * 20, 0.0), 20);
    for (std::size_t i = 0; i < points.size(); ++i) {
        double one[Grid::output_count];
        grid.encode(table.data(), points[i], one);
        for (int l = 0; l < 5; ++l) {
            const auto expected = plain(grid, table, points[i], l);
            for (std::size_t f = 0; f < 4; ++f) {
                const std::size_t c = static_cast<std::size_t>(l) * 4 + f;
                CHECK(one[c] == doctest::Approx(expected[f]).epsilon(1e-12));
                CHECK(run.features[i * 20 + c] == doctest::Approx(expected[f]).epsilon(1e-12));
            }
        }
    }
}

TEST_CASE("weights of a constant table sum to one") {
    const Grid grid(small);
    const std::vector<double> table(grid.parameter_count(), 1.0);
    test::Rng rng(2);
    for (const auto& point : rng.vecs(20, 0, 1)) {
        double features[Grid::output_count];
        grid.encode(table.data(), point, features);
        for (const double f : features) CHECK(f == doctest::Approx(1).epsilon(1e-14));
    }
}

TEST_CASE("HashGrid's adjoints are the gradients to the table and to the points") {
    const Grid grid(small);
    auto table = big_table<double>(grid);
    test::Rng rng(5);
    auto points = rng.vecs(9, 0.02, 0.98); // their distance to cell faces is far more than the step
    const auto dL_dfeatures = rng.numbers(points.size() * 20);
    cpu::Serial backend;
    Grid::Query<cpu::Serial, double> query;
    std::vector<double> features(dL_dfeatures.size());
    const auto loss = [&] {
        grid.prepare(backend, points, query);
        grid.forward(backend, table, query, row_major(Span<double>(features), 20));
        double sum = 0;
        for (std::size_t i = 0; i < features.size(); ++i) sum += features[i] * dL_dfeatures[i];
        return sum;
    };
    const GridRun<double, cpu::Serial> run(backend, grid, table, points, dL_dfeatures, 20);
    test::check_gradient(loss, table, run.dL_dtable, {.stride = 7});
    auto dL_dpoints = run.dL_dpoints;
    test::check_gradient(loss, test::scalars(points), test::scalars(dL_dpoints), {.tolerance = 1e-5});

    std::vector<double> one_by_one(table.size(), 0.0);
    for (std::size_t i = 0; i < points.size(); ++i)
        grid.encode_backward_table(points[i], &dL_dfeatures[i * 20], one_by_one.data());
    for (std::size_t i = 0; i < table.size(); ++i)
        CHECK(run.dL_dtable[i] == doctest::Approx(one_by_one[i]).epsilon(1e-12));

    // A second backward doubles all gradients, up to the order of the sums.
    const GridRun<double, cpu::Serial> twice(backend, grid, table, points, dL_dfeatures, 20, 2);
    for (std::size_t i = 0; i < table.size(); ++i)
        CHECK(twice.dL_dtable[i] == doctest::Approx(2 * run.dL_dtable[i]).epsilon(1e-12));
    for (std::size_t i = 0; i < points.size(); ++i) CHECK(twice.dL_dpoints[i] == 2.0 * run.dL_dpoints[i]);
}

TEST_CASE("touched entries are those with a gradient, in order") {
    const Grid grid(small);
    test::Rng rng(6);
    const auto points = rng.vecs(15, 0, 1);
    cpu::Serial backend;
    const GridRun<double, cpu::Serial> run(backend, grid, big_table<double>(grid), points,
                                       std::vector(points.size() * 20, 1.0), 4);
    std::set<std::uint32_t> expected;
    for (std::size_t e = 0; e < grid.entry_count(); ++e)
        if (run.dL_dtable[e * 4] != 0) expected.insert(static_cast<std::uint32_t>(e));
    CHECK(run.touched == std::vector<std::uint32_t>(expected.begin(), expected.end()));
}

TEST_CASE_TEMPLATE("HashGrid on Threads equals Serial bit for bit, in any blocks", T, float, double) {
    const Grid grid(small);
    const auto table = big_table<T>(grid);
    test::Rng rng(7);
    const auto points = cast<T>(rng.vecs(9001, 0, 1));
    std::vector<T> dL_dfeatures(points.size() * 20);
    for (T& x : dL_dfeatures) x = static_cast<T>(rng.uniform(-1, 1));
    cpu::Serial serial;
    for (const std::size_t block : {4, 20}) {
        const GridRun<T, cpu::Serial> expected(serial, grid, table, points, dL_dfeatures, block);
        for (const std::size_t threads : {1, 2, 3, 7}) {
            cpu::Threads backend(threads);
            const GridRun<T, cpu::Threads> run(backend, grid, table, points, dL_dfeatures, block);
            CHECK(run.features == expected.features);
            CHECK(run.dL_dtable == expected.dL_dtable);
            CHECK(run.dL_dpoints == expected.dL_dpoints);
            CHECK(run.touched == expected.touched);
        }
    }
    // Regrouped columns hold the same numbers.
    const GridRun<T, cpu::Serial> levels(serial, grid, table, points, dL_dfeatures, 4),
        rows(serial, grid, table, points, dL_dfeatures, 20);
    const auto by_level = blocked(Span<const T>(levels.features), 20, 4),
               by_row = row_major(Span<const T>(rows.features), 20);
    bool same = true;
    for (std::size_t i = 0; i < points.size(); ++i)
        for (std::size_t c = 0; c < 20; ++c) same = same && by_level(i, c) == by_row(i, c);
    CHECK(same);
}

TEST_CASE_TEMPLATE("a SIMD pack looks up what its lanes look up", T, float, double) {
    constexpr std::size_t width = LaneTraits<Wide<T>>::width;
    const Grid grid(small);
    const auto table = big_table<T>(grid);
    test::Rng rng(8);
    T coordinates[3][width], seeds[Grid::output_count][width];
    for (auto& axis : coordinates)
        for (T& x : axis) x = static_cast<T>(rng.uniform(-0.1, 1.1)); // some outside the cube
    for (auto& row : seeds)
        for (T& x : row) x = static_cast<T>(rng.uniform(-1, 1));
    const auto pack = [](const T* lanes) { return Wide<T>::load(lanes); };
    const vec3<Wide<T>> point(pack(coordinates[0]), pack(coordinates[1]), pack(coordinates[2]));
    Wide<T> features[Grid::output_count], dL_dfeatures[Grid::output_count];
    for (std::size_t c = 0; c < Grid::output_count; ++c) dL_dfeatures[c] = pack(seeds[c]);
    vec3<Wide<T>> dL_dpoint(Wide<T>(T(0)));
    grid.encode(table.data(), point, features);
    grid.encode_backward_point(table.data(), point, dL_dfeatures, dL_dpoint);

    for (std::size_t lane = 0; lane < width; ++lane) {
        const vec3<T> p(coordinates[0][lane], coordinates[1][lane], coordinates[2][lane]);
        T one[Grid::output_count], seed[Grid::output_count];
        for (std::size_t c = 0; c < Grid::output_count; ++c) seed[c] = seeds[c][lane];
        vec3<T> dL_dp(0);
        grid.encode(table.data(), p, one);
        grid.encode_backward_point(table.data(), p, seed, dL_dp);
        for (std::size_t c = 0; c < Grid::output_count; ++c) CHECK(features[c][lane] == one[c]);
        for (int axis = 0; axis < 3; ++axis) {
            CHECK(dL_dpoint[axis][lane] == doctest::Approx(dL_dp[axis]).epsilon(1e-5));
            if (p[axis] < 0 || p[axis] > 1) CHECK(dL_dp[axis] == 0);
        }
    }
}

TEST_CASE("points outside the cube, and NaN, stay inside the table") {
    const Grid grid(small);
    const auto table = big_table<float>(grid);
    constexpr float inf = std::numeric_limits<float>::infinity(), nan = std::numeric_limits<float>::quiet_NaN();
    const std::vector<vec3<float>> points{{-5, 2, 0.5f}, {inf, -inf, nan}, {1e30f, 0, 1}};
    cpu::Serial backend;
    const GridRun<float, cpu::Serial> run(backend, grid, table, points, std::vector<float>(60, 1.0f), 4);
    for (const float f : run.features) CHECK(std::isfinite(f));
    float at_face[Grid::output_count];
    grid.encode(table.data(), vec3<float>(0, 1, 0.5f), at_face);
    // The passes over many points add in another order; numbers of the table are of order one.
    for (std::size_t c = 0; c < 20; ++c) CHECK(std::abs(run.features[c / 4 * 12 + c % 4] - at_face[c]) < 1e-6f);
}

TEST_CASE("neighbours that share a cell give what each gives alone") {
    const Grid grid(small);
    const auto whole_table = big_table<double>(grid);
    auto table = whole_table;
    cpu::Serial backend;
    test::Rng rng(11);
    std::vector<vec3<double>> points; // along a line: many in a row share a cell, also across the end of a block
    for (int i = 0; i < 700; ++i) points.push_back({0.1 + 0.8 * i / 700.0, 0.3 + 0.2 * i / 700.0, 0.55});
    std::vector<double> coarse(points.size()), fine(points.size());
    for (std::size_t i = 0; i < points.size(); ++i)
        coarse[i] = i % 7 == 3 ? 0 : 0.5, fine[i] = i % 100 < 40 ? 0 : rng.uniform(0.1, 1); // zeros within cells
    Grid::Query<cpu::Serial, double> query;
    grid.prepare(backend, points, query, LevelWeights<double>{2, coarse, fine});

    // Entries that no point with a weight uses are never read.
    std::vector<char> touched(grid.entry_count(), 0);
    for (const std::uint32_t entry : query.touched) touched[entry] = 1;
    for (std::size_t entry = 0; entry < touched.size(); ++entry)
        if (!touched[entry])
            for (std::size_t f = 0; f < 4; ++f) table[entry * 4 + f] = std::numeric_limits<double>::quiet_NaN();

    std::vector<double> features(points.size() * 20), dL_dfeatures = rng.numbers(features.size()),
        dL_dtable(table.size(), 0.0), expected(table.size(), 0.0);
    grid.forward(backend, table, query, row_major(Span<double>(features), 20));
    grid.backward(backend, row_major(Span<const double>(dL_dfeatures), 20), query, dL_dtable);
    for (std::size_t i = 0; i < points.size(); ++i) {
        const LevelWeight<double> weight{2, coarse[i], fine[i]};
        double alone[Grid::output_count];
        grid.encode(whole_table.data(), points[i], alone, weight);
        for (std::size_t c = 0; c < 20; ++c) CHECK(features[i * 20 + c] == doctest::Approx(alone[c]).epsilon(1e-12));
        grid.encode_backward_table(points[i], &dL_dfeatures[i * 20], expected.data(), weight);
    }
    for (std::size_t n = 0; n < expected.size(); ++n) CHECK(dL_dtable[n] == doctest::Approx(expected[n]).epsilon(1e-11));
}

TEST_CASE("HashGrid says what is wrong with its arguments, and takes no points at all") {
    CHECK_THROWS_AS(Grid({.base = 1}), ValueError);
    CHECK_THROWS_AS(Grid({.growth = 0.5}), ValueError);
    CHECK_THROWS_AS(Grid({.table_size = 1000}), ValueError);
    CHECK_THROWS_AS(Grid({.growth = 1000}), ValueError);
    CHECK_THROWS_AS(Grid({.base = 2000, .growth = 1, .table_size = 1u << 30}), ValueError); // too many numbers

    const Grid grid(small);
    cpu::Serial backend;
    Grid::Query<cpu::Serial, float> query;
    auto table = grid.initial_table<float>(1);
    std::vector<float> features(60), few(7);
    std::vector<vec3<float>> points(3, vec3<float>(0.5f)), one(1);
    grid.prepare(backend, points, query);
    const auto view = row_major(Span<float>(features), 20);
    CHECK_THROWS_AS(grid.forward(backend, few, query, view), ShapeError);
    CHECK_THROWS_AS(grid.forward(backend, table, query, row_major(Span<float>(features), 10)), ShapeError);
    // A block would split a level.
    CHECK_THROWS_AS(grid.forward(backend, table, query, {features, 3, 20, 10}), ValueError);
    CHECK_THROWS_AS(grid.backward(backend, view, query, few), ShapeError);
    CHECK_THROWS_AS(grid.backward(backend, row_major(Span<float>(features), 10), query, table), ShapeError);
    CHECK_THROWS_AS(grid.backward(backend, {features, 3, 20, 2}, query, table), ValueError);
    CHECK_THROWS_AS(grid.backward_points(backend, few, query, view, points), ShapeError);
    CHECK_THROWS_AS(grid.backward_points(backend, table, query, view, one), ShapeError);
    CHECK_THROWS_AS(grid.backward_points(backend, table, query, row_major(Span<float>(features), 10), points),
                    ShapeError);

    grid.prepare(backend, Span<const vec3<float>>(), query);
    CHECK(query.touched.size() == 0);
    const FeatureView<float> nothing(Span<float>(), 0, 20, 20);
    grid.forward(backend, table, query, nothing);
    grid.backward(backend, nothing, query, table);
    grid.backward_points(backend, table, query, nothing, {});
}

TEST_CASE("a new table is uniform in 1e-4, reproducibly") {
    const Grid grid(small);
    const auto table = grid.initial_table<float>(9);
    CHECK(table == grid.initial_table<float>(9));
    CHECK(table != grid.initial_table<float>(10));
    const auto [low, high] = std::minmax_element(table.begin(), table.end());
    CHECK(*low >= -1e-4f);
    CHECK(*high <= 1e-4f);
    CHECK(*high - *low > 1.9e-4f);
}

TEST_CASE("levels count at a point as much as their weights say, in every pass") {
    const Grid grid(small);
    auto table = big_table<double>(grid);
    test::Rng rng(11);
    auto points = rng.vecs(300, 0.02, 0.98);
    std::vector<double> coarse = rng.numbers(300), fine = rng.numbers(300);
    for (std::size_t i = 0; i < 300; ++i) {
        if (i % 3 == 0) fine[i] = 0;
        if (i % 5 == 0) coarse[i] = 0;
        if (i >= 128 && i < 256) fine[i] = 0; // a whole block that reads no fine level
    }
    const auto dL_dfeatures = rng.numbers(300 * 20);
    cpu::Serial backend;
    Grid::Query<cpu::Serial, double> query;
    grid.prepare(backend, points, query, {2, coarse, fine});
    std::vector<double> features(300 * 20, 7.0), dL_dtable(table.size(), 0.0), expected_gradient(table.size(), 0.0);
    std::vector<vec3<double>> dL_dpoints(300, vec3<double>(0.0));
    grid.forward(backend, table, query, row_major(Span<double>(features), 20));
    grid.backward(backend, row_major(Span<const double>(dL_dfeatures), 20), query, dL_dtable);
    grid.backward_points(backend, table, query, row_major(Span<const double>(dL_dfeatures), 20), dL_dpoints);
    std::size_t lookups = 0;
    for (std::size_t i = 0; i < 300; ++i) {
        const LevelWeight<double> weight{2, coarse[i], fine[i]};
        double plain[Grid::output_count], weighted[Grid::output_count];
        grid.encode(table.data(), points[i], plain);
        grid.encode(table.data(), points[i], weighted, weight);
        for (std::size_t c = 0; c < 20; ++c) {
            CHECK(weighted[c] == doctest::Approx(plain[c] * (c < 8 ? coarse[i] : fine[i])).epsilon(1e-12));
            CHECK(features[i * 20 + c] == doctest::Approx(weighted[c]).epsilon(1e-12));
        }
        vec3<double> dL_dpoint(0.0);
        grid.encode_backward_point(table.data(), points[i], &dL_dfeatures[i * 20], dL_dpoint, weight);
        CHECK(dL_dpoints[i] == dL_dpoint);
        grid.encode_backward_table(points[i], &dL_dfeatures[i * 20], expected_gradient.data(), weight);
        lookups += (coarse[i] != 0 ? 16u : 0u) + (fine[i] != 0 ? 24u : 0u);
    }
    CHECK(query.lookups == lookups);
    for (std::size_t i = 0; i < table.size(); ++i)
        CHECK(dL_dtable[i] == doctest::Approx(expected_gradient[i]).epsilon(1e-12));
    std::set<std::uint32_t> learned;
    for (std::size_t e = 0; e < grid.entry_count(); ++e)
        if (dL_dtable[e * 4] != 0) learned.insert(static_cast<std::uint32_t>(e));
    CHECK(std::vector<std::uint32_t>(learned.begin(), learned.end()) ==
          std::vector<std::uint32_t>(query.touched.begin(), query.touched.end()));

    auto twice = features;
    grid.forward(backend, table, query, row_major(Span<double>(twice), 20), Write::add);
    for (std::size_t c = 0; c < features.size(); ++c) CHECK(twice[c] == 2 * features[c]);

    const std::vector<double> few(3, 1.0);
    CHECK_THROWS_AS(grid.prepare(backend, points, query, {2, few, {}}), ShapeError);
    CHECK_THROWS_AS(grid.prepare(backend, points, query, {2, {}, few}), ShapeError);
}
