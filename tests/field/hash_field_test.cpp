// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/field/cpu/hash_grid.hpp>
#include <gsh/field/cpu/mlp.hpp>
#include <gsh/field/hash_field.hpp>

#include "support/gradient.hpp"

#include <algorithm>
#include <cstddef>
#include <vector>

using namespace gsh;

namespace {

using Field = HashField<3, 2>;
constexpr std::size_t outputs = 4;

Field small_field(std::size_t point_inputs = 0, std::size_t shared_inputs = 0, int hidden_layers = 1) {
    return Field({.base = 3, .growth = 1.7, .table_size = 64},
                 {.outputs = outputs, .width = 8, .hidden_layers = hidden_layers}, point_inputs, shared_inputs);
}

/// Inputs and parameters of a field at `count` random points. Half of the points read fine levels.
template <class T>
struct Problem {
    Field field;
    bool separate_tables;
    std::vector<vec3<T>> points;
    std::vector<T> region, point_inputs, shared, table, weights, loss_weights;

    Problem(std::size_t count, std::size_t point_columns, std::size_t shared_columns, bool multi_scale, bool separate,
            int hidden_layers = 1)
        : field(small_field(point_columns, shared_columns, hidden_layers)), separate_tables(separate) {
        test::Rng rng(4);
        const auto numbers = [&](std::size_t n, double low, double high) {
            std::vector<T> result(n);
            for (T& x : result) x = static_cast<T>(rng.uniform(low, high));
            return result;
        };
        for (const auto& p : rng.vecs(count, 0.05, 0.95)) points.push_back(vec3<T>(p));
        if (multi_scale) region = numbers(count, -1, 1);
        for (T& tau : region) tau = std::max(tau, T(0));
        point_inputs = numbers(count * point_columns, -1, 1);
        shared = numbers(shared_columns, -1, 1);
        table = numbers(field.grid().parameter_count() * (separate ? 2 : 1), -1, 1);
        weights = numbers(field.mlp().parameter_count(), -1, 1);
        loss_weights = numbers(count * outputs, -1, 1);
    }
    [[nodiscard]] MultiScale<T> scales() const { return {1, separate_tables, region}; }
    [[nodiscard]] FieldInputs<T> inputs() const { return {point_inputs, shared}; }
};

template <class B, class T>
struct Passes {
    B backend;
    typename Field::Query<B, T> query;
    typename Field::Cache<B, T> cache;
    std::vector<T> result, dL_dtable, dL_dweights, dL_dshared;

    Passes(B made, const Problem<T>& p)
        : backend(std::move(made)), result(p.points.size() * outputs), dL_dtable(p.table.size(), T(0)),
          dL_dweights(p.weights.size(), T(0)), dL_dshared(p.shared.size(), T(0)) {
        p.field.prepare(backend, p.points, query, p.scales());
    }
    void forward(const Problem<T>& p) {
        p.field.forward(backend, p.table, p.weights, query, result, cache, p.inputs());
    }
    void backward(const Problem<T>& p) {
        p.field.backward(backend, p.weights, query, p.loss_weights, cache, dL_dtable, dL_dweights, p.inputs(),
                         dL_dshared);
    }
};

template <class F>
void for_each_kind(const F& f) {
    f(0, 0, false, false, 1);
    f(3, 0, false, false, 0);
    f(0, 5, false, false, 2);
    f(2, 3, true, false, 1);
    f(1, 2, true, true, 1);
}

} // namespace

TEST_CASE("a field is its network at its grid's features and the inputs beside them") {
    for_each_kind([](std::size_t own, std::size_t shared, bool multi_scale, bool separate, int hidden_layers) {
        const Problem<double> p(131, own, shared, multi_scale, separate, hidden_layers);
        Passes<cpu::Serial, double> passes({}, p);
        passes.forward(p);

        cpu::Serial backend;
        const auto& grid = p.field.grid();
        constexpr std::size_t features = Field::Grid::output_count;
        std::vector<double> rows;
        for (std::size_t i = 0; i < p.points.size(); ++i) {
            const double tau = multi_scale ? p.region[i] : 1;
            double row[features], second[features];
            if (separate) { // τ F_h + (1 - τ) F_l, as in the equation
                const double* fine_table = p.table.data() + grid.parameter_count();
                grid.encode(p.table.data(), p.points[i], row, {1, 1.0, 0.0});
                grid.encode(fine_table, p.points[i], second);
                for (std::size_t c = 0; c < features; ++c) row[c] = tau * second[c] + (1 - tau) * row[c];
            } else {
                grid.encode(p.table.data(), p.points[i], row);
                for (std::size_t c = 2; c < features; ++c) row[c] *= tau; // only level 0 is coarse
            }
            rows.insert(rows.end(), row, row + features);
            rows.insert(rows.end(), p.point_inputs.begin() + static_cast<std::ptrdiff_t>(i * own),
                        p.point_inputs.begin() + static_cast<std::ptrdiff_t>((i + 1) * own));
            rows.insert(rows.end(), p.shared.begin(), p.shared.end());
        }
        Mlp::Cache<cpu::Serial, double> cache;
        std::vector<double> expected(passes.result.size());
        p.field.mlp().forward(backend, p.weights, {row_major(Span<const double>(rows), p.field.mlp().inputs())},
                              expected, cache);
        for (std::size_t i = 0; i < expected.size(); ++i)
            CHECK(passes.result[i] == doctest::Approx(expected[i]).epsilon(1e-12));
    });
}

TEST_CASE("HashField::backward is the gradient of forward") {
    for_each_kind([](std::size_t own, std::size_t shared, bool multi_scale, bool separate, int hidden_layers) {
        Problem<double> p(13, own, shared, multi_scale, separate, hidden_layers);
        Passes<cpu::Serial, double> passes({}, p);
        const auto loss = [&] {
            passes.forward(p);
            double sum = 0;
            for (std::size_t i = 0; i < passes.result.size(); ++i) sum += passes.result[i] * p.loss_weights[i];
            return sum;
        };
        loss();
        passes.backward(p);
        CHECK_THROWS_AS(passes.backward(p), ShapeError); // the cache is used up
        test::check_gradient(loss, p.table, passes.dL_dtable);
        test::check_gradient(loss, p.weights, passes.dL_dweights);
        if (shared) test::check_gradient(loss, p.shared, passes.dL_dshared);

        const auto table = passes.dL_dtable, weights = passes.dL_dweights, to_shared = passes.dL_dshared;
        loss();
        passes.backward(p);
        for (std::size_t i = 0; i < table.size(); ++i)
            CHECK(passes.dL_dtable[i] == doctest::Approx(2 * table[i]).epsilon(1e-14));
        for (std::size_t i = 0; i < weights.size(); ++i) CHECK(passes.dL_dweights[i] == 2 * weights[i]);
        for (std::size_t i = 0; i < to_shared.size(); ++i)
            CHECK(passes.dL_dshared[i] == doctest::Approx(2 * to_shared[i]));
    });
}

TEST_CASE("where a point has no share in the fine levels, they are neither read nor learned") {
    Problem<double> p(40, 0, 0, true, false);
    std::fill(p.region.begin(), p.region.end(), 0.0);
    Passes<cpu::Serial, double> passes({}, p);
    CHECK(passes.query.lookups() == 40 * 8); // the coarse level
    const auto& grid = p.field.grid();
    for (const std::uint32_t entry : passes.query.touched) CHECK(entry < grid.level(1).offset);
    passes.forward(p);
    passes.backward(p);
    for (std::size_t i = grid.level(1).offset * 2; i < passes.dL_dtable.size(); ++i) CHECK(passes.dL_dtable[i] == 0);

    p.region[7] = 0.5;
    Passes<cpu::Serial, double> one({}, p);
    CHECK(one.query.lookups() == 40 * 8 + 2 * 8);
}

TEST_CASE("entries of separate tables are listed one table after the other") {
    const Problem<double> p(40, 0, 0, true, true);
    Passes<cpu::Serial, double> passes({}, p);
    CHECK(p.field.table_parameter_count(passes.query) == p.table.size());
    passes.forward(p);
    passes.backward(p);
    std::vector<std::uint32_t> learned;
    for (std::uint32_t e = 0; e < p.table.size() / 2; ++e)
        if (passes.dL_dtable[2 * e] != 0 || passes.dL_dtable[2 * e + 1] != 0) learned.push_back(e);
    CHECK(learned == std::vector<std::uint32_t>(passes.query.touched.begin(), passes.query.touched.end()));
}

TEST_CASE_TEMPLATE("HashField gives the same bits at any thread count", T, float, double) {
    for_each_kind([](std::size_t own, std::size_t shared, bool multi_scale, bool separate, int hidden_layers) {
        for (const std::size_t count : {1, 63, 40000}) { // the last one is more than one group of points
            const Problem<T> p(count, own, shared, multi_scale, separate, hidden_layers);
            Passes<cpu::Serial, T> serial({}, p);
            serial.forward(p);
            serial.backward(p);
            for (const std::size_t threads : {1, 2, 3, 7}) {
                Passes<cpu::Threads, T> run(cpu::Threads(threads), p);
                run.forward(p);
                run.backward(p);
                CHECK(run.result == serial.result);
                CHECK(run.dL_dtable == serial.dL_dtable);
                CHECK(run.dL_dweights == serial.dL_dweights);
                CHECK(run.dL_dshared == serial.dL_dshared);
            }
        }
    });
}

TEST_CASE("HashField says what is wrong with its arguments, and takes no points at all") {
    const Problem<double> p(5, 2, 3, true, false);
    cpu::Serial backend;
    Field::Query<cpu::Serial, double> query;
    CHECK_THROWS_AS(p.field.prepare(backend, p.points, query, {4, false, p.region}), ValueError);
    CHECK_THROWS_AS(p.field.prepare(backend, p.points, query, {-1, false, p.region}), ValueError);
    const std::vector<double> few(3, 0.5);
    CHECK_THROWS_AS(p.field.prepare(backend, p.points, query, {1, false, few}), ShapeError);
    CHECK_THROWS_AS(p.field.prepare(backend, p.points, query, {1, true, few}), ShapeError);

    Passes<cpu::Serial, double> passes({}, p);
    auto& q = passes.query;
    auto& c = passes.cache;
    CHECK_THROWS_AS(passes.backward(p), ShapeError); // before forward
    CHECK_THROWS_AS(p.field.forward(backend, few, p.weights, q, passes.result, c, p.inputs()), ShapeError);
    CHECK_THROWS_AS(p.field.forward(backend, p.table, few, q, passes.result, c, p.inputs()), ShapeError);
    std::vector<double> short_result(3);
    CHECK_THROWS_AS(p.field.forward(backend, p.table, p.weights, q, short_result, c, p.inputs()), ShapeError);
    CHECK_THROWS_AS(p.field.forward(backend, p.table, p.weights, q, passes.result, c, {few, p.shared}), ShapeError);
    CHECK_THROWS_AS(p.field.forward(backend, p.table, p.weights, q, passes.result, c, {p.point_inputs, {}}),
                    ShapeError);
    passes.forward(p);
    std::vector<double> short_shared(1);
    CHECK_THROWS_AS(p.field.backward(backend, p.weights, q, p.loss_weights, c, passes.dL_dtable, passes.dL_dweights,
                                     p.inputs(), short_shared),
                    ShapeError);

    const Problem<double> none(0, 2, 3, true, false);
    Passes<cpu::Serial, double> nothing({}, none);
    nothing.forward(none);
    nothing.backward(none);
    CHECK(nothing.query.touched.size() == 0);
}
