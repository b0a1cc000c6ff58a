// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/field/hash_field.hpp>

#include "support/gradient.hpp"

using namespace gsh;

namespace {
using Field = HashField<3, 2>;

Field small_field() { return Field({.base = 3, .growth = 1.7, .table_size = 64}, {.outputs = 4, .width = 8, .hidden_layers = 1}); }
} // namespace

TEST_CASE("HashField::backward is the gradient of forward") {
    cpu::Serial backend;
    const Field field = small_field();
    test::Rng rng(4);
    const auto points = rng.vecs(13, 0.05, 0.95);
    auto table = rng.numbers(field.grid().parameter_count());
    auto weights = rng.numbers(field.mlp().parameter_count());
    const auto loss_weights = rng.numbers(13 * 4);
    Field::Grid::Query<cpu::Serial, double> query;
    field.grid().prepare<cpu::Serial, double>(backend, points, query);
    Field::Cache<cpu::Serial, double> cache;
    std::vector<double> outputs(13 * 4);
    const auto loss = [&] {
        field.forward(backend, table, weights, query, outputs, cache);
        double sum = 0;
        for (std::size_t i = 0; i < outputs.size(); ++i) sum += outputs[i] * loss_weights[i];
        return sum;
    };
    loss();
    std::vector<double> dL_dtable(table.size(), 0), dL_dweights(weights.size(), 0);
    field.backward(backend, weights, query, loss_weights, cache, dL_dtable, dL_dweights);
    test::check_gradient(loss, table, dL_dtable);
    test::check_gradient(loss, weights, dL_dweights);

    const auto once = dL_dtable;
    loss();
    field.backward(backend, weights, query, loss_weights, cache, dL_dtable, dL_dweights);
    for (std::size_t i = 0; i < once.size(); ++i) CHECK(dL_dtable[i] == doctest::Approx(2 * once[i]).epsilon(1e-14));
}

TEST_CASE("HashField gives the same bits at any thread count") {
    const Field field = small_field();
    test::Rng rng(4);
    const auto double_points = rng.vecs(5000, 0, 1);
    const std::vector<vec3<float>> points(double_points.begin(), double_points.end());
    const auto table = field.grid().initial_table<float>(1), weights = field.mlp().initial_weights<float>(2);
    const std::vector<float> dL_doutputs(5000 * 4, 0.25f);
    const auto run = [&]<class B>(B backend) {
        typename Field::Grid::Query<B, float> query;
        field.grid().prepare<B, float>(backend, points, query);
        typename Field::Cache<B, float> cache;
        std::vector<float> result(5000 * 4 + table.size() + weights.size(), 0.0f);
        const Span<float> all(result);
        field.forward(backend, table, weights, query, all.subspan(0, 5000 * 4), cache);
        field.backward(backend, weights, query, dL_doutputs, cache, all.subspan(5000 * 4, table.size()),
                              all.subspan(5000 * 4 + table.size(), weights.size()));
        return result;
    };
    const auto serial = run(cpu::Serial());
    for (const std::size_t threads : {1, 2, 3, 7}) CHECK(run(cpu::Threads(threads)) == serial);
}
