// SPDX-License-Identifier: Apache-2.0
/// @file  The hash grid on the CUDA backend equals the one of cpu::Serial.
#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/serial.hpp>
#include <gsh/field/cpu/hash_grid.hpp>
#include <gsh/field/cuda/hash_grid.cuh>
#include <gsh/field/hash_grid.hpp>
#include <gsh/optim/adam.hpp>
#include <gsh/optim/cuda/adam.cuh>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"
#include "support/device_arrays.hpp"
#include "support/gradient.hpp"
#include "support/rounded_mlp.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace gsh::hash_grid_on_device {
namespace {

using cuda::Device;

using Grid = HashGrid<5, 4>;
const Grid::Params small{.base = 3, .growth = 1.7, .table_size = 256}; // levels 0 to 2 dense, 3 and 4 hashed

template <class T>
Device::Buffer<T> to_device(Device& device, const std::vector<T>& host) {
    Device::Buffer<T> buffer(host.size());
    device.upload(Span<const T>(host), Span<T>(buffer));
    return buffer;
}
template <class T>
std::vector<T> fetch(Device& device, const Device::Buffer<T>& buffer) {
    return downloaded(device, Span<const T>(buffer));
}

template <class T>
std::vector<T> numbers(std::uint64_t seed, std::size_t count) {
    test::Rng rng(seed);
    std::vector<T> result(count);
    for (T& x : result) x = static_cast<T>(rng.uniform(-1, 1));
    return result;
}

/// Points and level weights, with what a pass reads.
template <class G, class T>
struct Problem {
    G grid;
    std::vector<vec3<T>> points;
    std::vector<T> coarse, fine, table, gradient;
    int split = 0;
    std::size_t block = G::feature_count;

    Problem(const typename G::Params& params, const std::vector<vec3<double>>& at)
        : grid(params), points(at.begin(), at.end()), table(numbers<T>(3, grid.parameter_count())),
          gradient(numbers<T>(4, at.size() * G::output_count)) {}
    [[nodiscard]] FeatureView<T> view(Span<T> values) const { return {values, points.size(), G::output_count, block}; }
};

template <class T>
struct Results {
    std::vector<T> features, dL_dtable;
    std::vector<vec3<T>> dL_dpoints;
    std::vector<std::uint32_t> touched;
    std::vector<std::size_t> touched_begin;
    std::size_t lookups = 0;
};

/// Forward into features that hold ones, and `backwards` times backward into a gradient that holds zeros.
template <class G, class T>
Results<T> run_serial(const Problem<G, T>& p, Write mode = Write::assign, int backwards = 1) {
    cpu::Serial backend;
    typename G::template Query<cpu::Serial, T> query;
    p.grid.prepare(backend, p.points, query, {p.split, p.coarse, p.fine});
    Results<T> r;
    r.features.assign(p.gradient.size(), T(1));
    r.dL_dtable.assign(p.table.size(), T(0));
    r.dL_dpoints.assign(p.points.size(), vec3<T>(T(0)));
    r.touched.assign(query.touched.begin(), query.touched.end());
    r.touched_begin.assign(query.touched_begin.begin(), query.touched_begin.end());
    r.lookups = query.lookups;
    const FeatureView<const T> gradient(p.gradient, p.points.size(), G::output_count, p.block);
    p.grid.forward(backend, p.table, query, p.view(r.features), mode);
    for (int i = 0; i < backwards; ++i) p.grid.backward(backend, gradient, query, r.dL_dtable);
    p.grid.backward_points(backend, p.table, query, gradient, r.dL_dpoints);
    return r;
}
template <class G, class T>
Results<T> run_device(const Problem<G, T>& p, Write mode = Write::assign, int backwards = 1,
                      Precision precision = Precision::fp32) {
    Device device;
    device.set_precision(precision);
    typename G::template Query<Device, T> query;
    const auto points = to_device(device, p.points);
    const auto coarse = to_device(device, p.coarse), fine = to_device(device, p.fine);
    p.grid.prepare(device, points, query, {p.split, coarse, fine});
    const auto table = to_device(device, p.table), gradient_values = to_device(device, p.gradient);
    auto features = to_device(device, std::vector<T>(p.gradient.size(), T(1)));
    auto dL_dtable = to_device(device, std::vector<T>(p.table.size(), T(0)));
    auto dL_dpoints = to_device(device, std::vector<vec3<T>>(p.points.size(), vec3<T>(T(0))));
    const FeatureView<const T> gradient(gradient_values, p.points.size(), G::output_count, p.block);
    p.grid.forward(device, table, query, p.view(features), mode);
    for (int i = 0; i < backwards; ++i) p.grid.backward(device, gradient, query, dL_dtable);
    p.grid.backward_points(device, table, query, gradient, dL_dpoints);
    return {fetch(device, features),
            fetch(device, dL_dtable),
            fetch(device, dL_dpoints),
            fetch(device, query.touched),
            {query.touched_begin.begin(), query.touched_begin.end()},
            query.lookups};
}

template <class T>
void check_equal(const Results<T>& found, const Results<T>& expected) {
    const double tolerance = sizeof(T) == 8 ? 1e-12 : 1e-6;
    CHECK(found.touched == expected.touched);
    CHECK(found.touched_begin == expected.touched_begin);
    CHECK(found.lookups == expected.lookups);
    CHECK(test::relative_distance(found.features, expected.features) <= tolerance);
    CHECK(test::relative_distance(found.dL_dtable, expected.dL_dtable) <= tolerance);
    for (std::size_t i = 0; i < found.dL_dtable.size(); ++i)
        if (expected.dL_dtable[i] == T(0)) CHECK(found.dL_dtable[i] == T(0));
    const auto plain = [](const std::vector<vec3<T>>& vectors) {
        std::vector<T> all;
        for (const auto& v : vectors) all.insert(all.end(), {v.x, v.y, v.z});
        return all;
    };
    CHECK(test::relative_distance(plain(found.dL_dpoints), plain(expected.dL_dpoints)) <= 10 * tolerance);
}

std::vector<vec3<double>> spread(std::size_t count) {
    return test::Rng(8).vecs(count, 0, 1);
}

} // namespace

TEST_CASE_TEMPLATE("HashGrid on the device equals Serial at any number of points", T, float, double) {
    if (test::skip_without_device()) return;
    for (const std::size_t n : {0, 1, 2, 31, 32, 33, 257, 700}) { // the last: more points than cells on some levels
        CAPTURE(n);
        const Problem<Grid, T> p(small, spread(n));
        check_equal(run_device(p), run_serial(p));
    }
}

TEST_CASE("lists name every use of the table once, and the tests' problems have lists of every kind") {
    if (test::skip_without_device()) return;
    const Grid grid(small);
    std::vector<vec3<double>> points = spread(700);
    for (const auto& p : test::Rng(1).vecs(700, 0.501, 0.51)) points.push_back(p);
    std::vector<double> fine(points.size(), 1.0);
    fine[5] = 0;
    const cuda::detail::HashLists<double, 5> lists(grid, points, {4, {}, fine});
    CHECK(lists.lookups == 8 * (5 * points.size() - 1));

    std::vector<std::vector<double>> weights(points.size(), std::vector<double>(grid.entry_count(), 0.0));
    bool full_segment = false, summed = false, direct = false, is_long = false, is_short = false;
    std::size_t entries = 0;
    for (const auto& task : lists.gather_tasks) {
        (task.summed ? summed : direct) = true;
        (task.lane_bits == 5 ? is_long : is_short) = true;
        CHECK(task.first == entries);
        CHECK((task.count << task.lane_bits) <= 128);
        entries += task.count;
        for (std::size_t e = task.first; e < task.first + task.count; ++e)
            for (std::size_t k = lists.item_begin[e]; k < lists.item_begin[e + 1]; ++k) {
                const auto [row, weight] = lists.items[k];
                if (!task.summed) {
                    weights[row][lists.entries[e]] += weight;
                    continue;
                }
                CHECK(weight == 1);
                const std::size_t s = row / 8, size = lists.segments[s + 1] - lists.segments[s];
                CHECK((0 < size && size <= 64));
                full_segment = full_segment || size == 64;
                for (std::size_t p = lists.segments[s]; p < lists.segments[s + 1]; ++p) {
                    const std::uint32_t i = lists.points[p];
                    weights[i][lists.entries[e]] +=
                        grid.level(task.level).cell(points[i]).weight(static_cast<int>(row % 8));
                }
            }
    }
    CHECK(entries == lists.entries.size());
    CHECK(lists.touched.size() == entries);
    CHECK((full_segment && summed && direct && is_long && is_short));
    for (std::size_t i = 0; i < points.size(); ++i) {
        std::vector<double> expected(grid.entry_count(), 0.0);
        for (int l = 0; l < 5; ++l)
            for (int c = 0; c < 8; ++c) {
                const auto cell = grid.level(l).cell(points[i]);
                if (l < 4 || i != 5) expected[grid.level(l).index(cell, c)] += cell.weight(c);
            }
        for (std::size_t e = 0; e < expected.size(); ++e)
            if (std::abs(weights[i][e] - expected[e]) > 1e-12) FAIL_CHECK("point " << i << ", entry " << e);
    }
}

TEST_CASE_TEMPLATE("lists of any length, on levels that are summed per cell and others", T, float, double) {
    if (test::skip_without_device()) return;
    for (const std::size_t n : {63, 64, 65, 127, 129, 2100}) { // one past a segment; the last: a long list of segments
        CAPTURE(n);
        std::vector<vec3<double>> points = test::Rng(n).vecs(n, 0.501, 0.51); // in one cell of most levels
        const auto others = spread(9);
        points.insert(points.end(), others.begin(), others.end());
        const Problem<Grid, T> p(small, points);
        check_equal(run_device(p), run_serial(p));
    }
    // Few points per cell, but many per entry, since the table is small.
    const Problem<HashGrid<3, 2>, T> collisions({.base = 20, .growth = 2, .table_size = 16}, spread(300));
    check_equal(run_device(collisions), run_serial(collisions));
}

TEST_CASE_TEMPLATE("points on the faces of cells and outside of the cube belong to the same cells", T, float, double) {
    if (test::skip_without_device()) return;
    Problem<Grid, T> p(small, {});
    const T step = sizeof(T) == 8 ? T(1e-16) : T(6e-8);
    for (int l = 0; l < 5; ++l) {
        const T scale = p.grid.level(l).template scale_as<T>();
        for (int cell = 0; T(cell) < scale; ++cell)
            for (int ulps = -1; ulps <= 1; ++ulps) {
                const T at = (T(cell) + T(0.5)) / scale * (T(1) + T(ulps) * step);
                p.points.push_back({at, T(1) - at, T(0.3)});
            }
    }
    for (const T outside : {T(-1), T(0), T(1), T(2), T(1e30)}) p.points.push_back({outside, T(0.4), outside});
    p.gradient = numbers<T>(5, p.points.size() * Grid::output_count);
    check_equal(run_device(p), run_serial(p));
}

TEST_CASE_TEMPLATE("levels have weights, and those of weight 0 are left out", T, float, double) {
    if (test::skip_without_device()) return;
    for (const bool both : {false, true}) {
        Problem<Grid, T> p(small, spread(150));
        p.split = 2;
        p.fine = numbers<T>(6, 150);
        for (T& w : p.fine) w = std::max(w, T(0));
        if (both) p.coarse = numbers<T>(7, 150);
        if (both) p.coarse[3] = p.coarse[77] = T(0);
        check_equal(run_device(p), run_serial(p));
        check_equal(run_device(p, Write::add), run_serial(p, Write::add));
        std::fill(p.fine.begin(), p.fine.end(), T(0));
        check_equal(run_device(p), run_serial(p));
    }
}

TEST_CASE_TEMPLATE("HashGrid writes features in any blocks, and rows of any length", T, float, double) {
    if (test::skip_without_device()) return;
    for (const std::size_t block : {4u, 20u}) {
        Problem<Grid, T> p(small, spread(70));
        p.block = block;
        check_equal(run_device(p), run_serial(p));
    }
    Problem<HashGrid<4, 3>, T> odd({.base = 3, .growth = 1.5, .table_size = 64}, spread(70));
    for (const std::size_t block : {3u, 6u, 12u}) {
        odd.block = block;
        check_equal(run_device(odd), run_serial(odd));
    }
    const Problem<HashGrid<2, 1>, T> one({.base = 3, .growth = 1.5, .table_size = 64}, spread(70));
    check_equal(run_device(one), run_serial(one));
}

TEST_CASE("HashGrid::backward adds on the device") {
    if (test::skip_without_device()) return;
    const Problem<Grid, double> p(small, spread(300));
    const auto once = run_device(p), twice = run_device(p, Write::assign, 2);
    for (std::size_t i = 0; i < once.dL_dtable.size(); ++i) CHECK(twice.dL_dtable[i] == 2 * once.dL_dtable[i]);
}

namespace {

/// The problem with the table that mixed precision reads.
template <class G>
Problem<G, float> with_rounded_table(Problem<G, float> p) {
    for (float& x : p.table) x = static_cast<float>(test::as_fp16(double(x)));
    return p;
}
template <class G>
void check_mixed(const Problem<G, float>& p, Write mode = Write::assign) {
    const auto found = run_device(p, mode, 1, Precision::mixed);
    const auto expected = run_device(with_rounded_table(p), mode);
    CHECK(found.features == expected.features);
    CHECK(found.dL_dtable == expected.dL_dtable);
    CHECK(found.dL_dpoints == run_device(p, mode).dL_dpoints); // from the table itself
}

} // namespace

TEST_CASE("in mixed precision, HashGrid reads a table in fp16, and computes in float") {
    if (test::skip_without_device()) return;
    for (const std::size_t n : {0, 1, 31, 32, 33, 255, 256, 257, 700}) {
        CAPTURE(n);
        check_mixed(Problem<Grid, float>(small, spread(n)));
        Problem<HashGrid<3, 2>, float> narrow({.base = 3, .growth = 1.7, .table_size = 64}, spread(n));
        narrow.block = 6;
        check_mixed(narrow);
    }
    Problem<Grid, float> p(small, spread(150)); // new tables, small numbers, and some beyond the range
    for (std::size_t i = 0; i < p.table.size(); ++i) p.table[i] *= i % 3 == 0 ? 1e-4f : i % 3 == 1 ? 1e-7f : 1e5f;
    p.split = 2, p.fine = numbers<float>(6, 150);
    for (float& w : p.fine) w = std::max(w, 0.0f);
    check_mixed(p);
    check_mixed(p, Write::add);
    // Rows of 16 bits need an even number; and double has no other precision.
    const Problem<HashGrid<4, 3>, float> odd({.base = 3, .growth = 1.5, .table_size = 64}, spread(70));
    CHECK(run_device(odd, Write::assign, 1, Precision::mixed).features == run_device(odd).features);
    const Problem<Grid, double> wide(small, spread(70));
    CHECK(run_device(wide, Write::assign, 1, Precision::mixed).features == run_device(wide).features);
}

TEST_CASE("HashGrid's adjoints on the device are the gradient of forward") {
    if (test::skip_without_device()) return;
    Problem<Grid, double> p(small, spread(60));
    p.split = 2;
    p.fine = numbers<double>(6, 60);
    Results<double> gradient = run_device(p);
    const auto loss = [&] { return test::inner(run_device(p, Write::assign, 0).features, p.gradient); };
    test::check_gradient(loss, p.table, gradient.dL_dtable,
                         {.elements = test::spread_elements(p.table.size(), &gradient.touched, 4, 30)});
    test::check_gradient(loss, test::scalars(p.points), test::scalars(gradient.dL_dpoints), {.stride = 7});
}

TEST_CASE("a new table of +-1e-4 loses three ten-thousandths in fp16, and a sixth of what it would in bf16") {
    const std::vector<float> table = Grid(small).initial_table<float>(1);
    double size = 0, fp16 = 0, bf16 = 0;
    for (const float number : table) {
        const auto x = double(number);
        size += x * x, fp16 += std::pow(test::as_fp16(x) - x, 2), bf16 += std::pow(test::as_bf16(x) - x, 2);
    }
    CHECK(std::sqrt(fp16 / size) < 3.5e-4);
    CHECK(std::sqrt(bf16 / size) > 1.5e-3);
}

TEST_CASE("in mixed precision, a forward pass sees every change of the table, and of which table it is") {
    if (test::skip_without_device()) return;
    const Problem<Grid, float> p(small, spread(100));
    Device device;
    device.set_precision(Precision::mixed);
    Grid::Query<Device> query;
    const auto points = to_device(device, p.points);
    p.grid.prepare(device, points, query);
    const auto forward = [&](const Device::Buffer<float>& table) {
        Device::Buffer<float> features(p.gradient.size());
        p.grid.forward(device, table, query, p.view(Span<float>(features)));
        return fetch(device, features);
    };
    auto table = to_device(device, p.table);
    const auto other = to_device(device, numbers<float>(9, p.table.size())); // another field with the same points
    const auto first = forward(table), of_other = forward(other);
    CHECK(first != of_other);
    CHECK(forward(table) == first);

    Device::Buffer<float> gradient(p.table.size()), m(p.table.size()), v(p.table.size());
    device.fill(Span<float>(gradient), 1.0f), device.fill(Span<float>(m), 0.0f), device.fill(Span<float>(v), 0.0f);
    Adam().step_rows(device, Span<float>(table), gradient, m, v, query.touched, Grid::feature_count, 0.01, 1);
    auto changed = p;
    changed.table = fetch(device, table);
    const auto after = forward(table);
    CHECK(after != first);
    CHECK(after == run_device(with_rounded_table(changed)).features);

    device.upload(Span<const float>(p.table), Span<float>(table)); // as a checkpoint is read
    CHECK(forward(table) == first);
}

TEST_CASE("a table that does not begin at a row is refused") {
    if (test::skip_without_device()) return;
    const Grid grid(small);
    Device device;
    Grid::Query<Device> query;
    const auto points = to_device(device, std::vector<vec3<float>>(3, vec3<float>(0.5f)));
    grid.prepare(device, points, query);
    Device::Buffer<float> table(grid.parameter_count() + 1), features(3 * Grid::output_count);
    const FeatureView<float> view(features, 3, Grid::output_count, 4);
    CHECK_THROWS_AS(grid.forward(device, Span<const float>(table).subspan(1, grid.parameter_count()), query, view),
                    ValueError);
    grid.forward(device, Span<const float>(table).subspan(0, grid.parameter_count()), query, view);
}

#if defined(GSH_CUDA_EMULATION)

TEST_CASE("HashGrid has the same bits in any order of threads, whatever new memory holds") {
    auto& machine = test::CudaEmulation::instance();
    Problem<Grid, float> p(small, spread(300));
    p.split = 3;
    p.fine = numbers<float>(6, 300);
    for (const Precision precision : {Precision::fp32, Precision::mixed}) {
        const auto expected = run_device(p, Write::assign, 1, precision);
        for (const auto order : {test::Order::forward, test::Order::reverse, test::Order::random})
            for (const unsigned char fill : {0xA5, 0xFF}) { // the second: numbers that are none
                machine.order = order, machine.fill = fill;
                const auto found = run_device(p, Write::assign, 1, precision);
                CHECK(found.features == expected.features);
                CHECK(found.dL_dtable == expected.dL_dtable);
            }
        machine.order = test::Order::forward, machine.fill = 0xA5;
    }
}

TEST_CASE("a pass of HashGrid does not wait and allocates nothing") {
    auto& machine = test::CudaEmulation::instance();
    const Grid grid(small);
    Device device;
    Grid::Query<Device> query;
    const auto points = to_device(device, std::vector<vec3<float>>(3, vec3<float>(0.5f)));
    grid.prepare(device, points, query);
    Device::Buffer<float> table(grid.parameter_count()), features(3 * Grid::output_count);
    const FeatureView<float> view(features, 3, Grid::output_count, 4);
    device.synchronize();
    const auto waits = machine.waits, allocations = machine.allocations, launches = machine.launches;
    grid.forward(device, table, query, view);
    grid.backward(device, view, query, table);
    CHECK(machine.waits == waits);
    CHECK(machine.allocations == allocations);
    device.synchronize();
    CHECK(machine.launches == launches + 3);

    device.set_precision(Precision::mixed);
    grid.forward(device, table, query, view); // allocates the copy
    device.synchronize();
    const auto waits_before = machine.waits, allocations_before = machine.allocations;
    grid.forward(device, table, query, view);
    CHECK(machine.waits == waits_before);
    CHECK(machine.allocations == allocations_before);
    device.synchronize();
}

#endif

} // namespace gsh::hash_grid_on_device
