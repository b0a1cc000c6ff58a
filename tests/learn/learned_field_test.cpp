// SPDX-License-Identifier: Apache-2.0
#include <gsh/cpu.hpp>
#include <gsh/learn/learned_field.hpp>

#include "support/gradient.hpp"
#include "support/learned.hpp"

#include <cstddef>
#include <vector>

using namespace gsh;

namespace {

constexpr std::size_t point_count = 19;
constexpr int output_count = 3;

/// A field of three outputs over random points, with two inputs of each point and four of all of them.
template <class B>
struct SmallField {
    using Field = LearnedField<B, double, 3, 2>;

    B backend;
    Field field;
    typename Field::Query query;
    std::vector<double> point_inputs, shared_inputs, dL_doutputs,
        values = std::vector<double>(point_count * output_count, 0.0);

    explicit SmallField(B where = B(), const FieldStart& start = {.seed = 5, .stream = 1})
        : backend(std::move(where)),
          field(backend,
                {.name = "small",
                 .sizes = {.grid = {.base = 3, .growth = 1.6, .table_size = 64}, .width = 8, .hidden_layers = 1},
                 .outputs = output_count,
                 .point_inputs = 2,
                 .shared_inputs = 4,
                 .start = start}) {
        test::Rng rng(4);
        const auto points = rng.vecs(point_count, 0.05, 0.95);
        field.field().prepare(backend, Span<const vec3<double>>(points), query);
        point_inputs = rng.numbers(2 * point_count), shared_inputs = rng.numbers(4),
        dL_doutputs = rng.numbers(point_count * output_count);
    }
    FieldInputs<double> inputs() const { return {point_inputs, shared_inputs}; }
    LearnedArrays<double> learned() { return field.learned(query, 0.25); }
    double loss() {
        field.forward(query, values, inputs());
        double sum = 0;
        for (std::size_t i = 0; i < values.size(); ++i) sum += values[i] * dL_doutputs[i];
        return sum;
    }
    void backward(Span<double> dL_dshared = {}) {
        loss();
        field.backward(query, dL_doutputs, inputs(), dL_dshared);
    }
};

} // namespace

TEST_CASE("a learned field's adjoint is the gradient of its outputs, and adds") {
    SmallField<cpu::Serial> small;
    test::randomize(small);
    std::vector<double> dL_dshared(4, 0.0);
    small.backward(dL_dshared);
    const auto once = test::learned_gradients(small);
    const auto once_shared = dL_dshared;
    const auto loss = [&] { return small.loss(); };
    test::check_learned_gradients(small, loss);
    test::check_gradient(loss, Span<double>(small.shared_inputs), Span<const double>(dL_dshared));
    small.backward(dL_dshared);
    test::check_doubled(once, test::learned_gradients(small));
    test::check_doubled(once_shared, dL_dshared);
    for (const std::size_t count : {1, 3}) {
        SmallField<cpu::Threads> threaded{cpu::Threads(count)};
        test::randomize(threaded);
        std::vector<double> dL_dshared_there(4, 0.0);
        threaded.backward(dL_dshared_there);
        CHECK(threaded.values == small.values);
        CHECK(test::learned_gradients(threaded) == once);
        CHECK(dL_dshared_there == once_shared);
    }
}

TEST_CASE("a learned field announces table and network at one rate, and the rows that its points read") {
    SmallField<cpu::Serial> small;
    const auto arrays = small.learned();
    REQUIRE(arrays.size() == 2);
    CHECK(arrays[0].name == "small.table");
    CHECK(arrays[1].name == "small.network");
    CHECK(arrays[0].rate == 0.25);
    CHECK(arrays[1].rate == 0.25);
    CHECK(arrays[0].row_size == 2);
    CHECK(arrays[0].touched_rows.size() == small.query.touched.size());
    CHECK(!arrays[1].is_table());
    CHECK(arrays[1].values.size() == small.field.mlp().parameter_count());
}

TEST_CASE("outputs that are silenced are zero; other inputs that are silenced change nothing") {
    SmallField<cpu::Serial> small;
    small.loss();
    const auto before = small.values;
    for (double& input : small.point_inputs) input += 1;
    small.loss();
    CHECK(small.values != before);
    small.field.silence_other_inputs();
    small.loss();
    const auto silenced = small.values;
    CHECK(silenced != before);
    for (double& input : small.point_inputs) input -= 3;
    for (double& input : small.shared_inputs) input -= 3;
    small.loss();
    CHECK(small.values == silenced);
    small.field.silence_outputs();
    small.loss();
    for (const double value : small.values) CHECK(value == 0);
}

TEST_CASE("fields of another seed or stream start with other numbers, and the same seed with the same") {
    using Start = FieldStart;
    SmallField<cpu::Serial> a, b, seed(cpu::Serial(), Start{.seed = 6, .stream = 1}),
        stream(cpu::Serial(), Start{.seed = 5, .stream = 3});
    CHECK(test::learned_values(a) == test::learned_values(b));
    CHECK(test::learned_values(a) != test::learned_values(seed));
    CHECK(test::learned_values(a) != test::learned_values(stream));
}
