// SPDX-License-Identifier: Apache-2.0
/// @file  The MLP in mixed precision against its equations with operands rounded to bf16 and sums in double.
#include <gsh/field/cpu/mlp_mixed.hpp>

#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/field/cpu/mlp.hpp>
#include <gsh/field/mlp.hpp>

#include "support/gradient.hpp"
#include "support/rounded_mlp.hpp"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

using namespace gsh;

namespace {

struct MixedShape {
    int features, block, points, shared, outputs, width, hidden_layers;
    std::size_t rows;
};
constexpr MixedShape mixed_shapes[] = {
    {64, 4, 0, 0, 30, 64, 2, 64},  {64, 4, 4, 9, 30, 64, 2, 300}, {64, 4, 0, 5, 1, 64, 2, 4 * 64 + 1},
    {8, 2, 0, 0, 3, 16, 1, 63},    {5, 5, 2, 1, 17, 33, 3, 65},   {6, 1, 0, 3, 7, 64, 0, 70},
    {32, 32, 0, 0, 64, 64, 2, 1},  {40, 4, 3, 2, 33, 96, 2, 129},
    {64, 4, 10, 0, 30, 64, 2, 200}, {64, 4, 32, 7, 27, 32, 1, 128},
};

/// Everything that a network computes from one batch.
struct Batch {
    Mlp mlp;
    std::size_t rows, own;
    int features, block;
    std::vector<float> weights, inputs, points, shared, dL_doutputs;
    std::vector<float> outputs, dL_dweights, dL_dinputs, dL_dshared;

    explicit Batch(const MixedShape& s, std::uint64_t seed = 1)
        : mlp({s.features + s.points + s.shared, s.outputs, s.width, s.hidden_layers}), rows(s.rows),
          own(static_cast<std::size_t>(s.points)), features(s.features), block(s.block),
          weights(mlp.initial_weights<float>(seed)) {
        test::Rng rng(seed);
        const auto numbers = [&](std::size_t count) {
            std::vector<float> some(count);
            for (float& number : some) number = static_cast<float>(rng.uniform(-1, 1));
            return some;
        };
        inputs = numbers(rows * static_cast<std::size_t>(features)), points = numbers(rows * own);
        shared = numbers(static_cast<std::size_t>(s.shared)), dL_doutputs = numbers(rows * mlp.outputs());
    }
    [[nodiscard]] FeatureView<const float> view() const {
        return blocked(Span<const float>(inputs), static_cast<std::size_t>(features), static_cast<std::size_t>(block));
    }
    template <class B>
    void run(B backend, Write mode = Write::assign, float before = 0) {
        backend.set_precision(Precision::mixed);
        Mlp::Cache<B, float> cache;
        const MlpInputs<float> in{view(), points, shared};
        outputs.assign(rows * mlp.outputs(), 0), dL_dweights.assign(weights.size(), before);
        dL_dinputs.assign(inputs.size(), before), dL_dshared.assign(shared.size(), before);
        mlp.forward(backend, weights, in, outputs, cache);
        mlp.backward(backend, weights, in, dL_doutputs, cache, dL_dweights,
                     blocked(Span<float>(dL_dinputs), static_cast<std::size_t>(features),
                             static_cast<std::size_t>(block)),
                     mode, dL_dshared);
    }

    /// The same from the equations.
    void run_plain() {
        std::vector<double> rows_of_inputs;
        for (std::size_t r = 0; r < rows; ++r) {
            for (std::size_t i = 0; i < static_cast<std::size_t>(features); ++i)
                rows_of_inputs.push_back(double(view()(r, i)));
            for (std::size_t i = 0; i < own; ++i) rows_of_inputs.push_back(double(points[r * own + i]));
        }
        const test::RoundedMlp plain(mlp, rows, weights, rows_of_inputs, shared, dL_doutputs);
        outputs.assign(plain.outputs.begin(), plain.outputs.end());
        dL_dweights.assign(plain.dL_dweights.begin(), plain.dL_dweights.end());
        dL_dshared.assign(plain.dL_dshared.begin(), plain.dL_dshared.end());
        dL_dinputs.assign(inputs.size(), 0);
        const FeatureView<float> d_view = blocked(Span<float>(dL_dinputs), static_cast<std::size_t>(features),
                                                  static_cast<std::size_t>(block));
        for (std::size_t r = 0; r < rows; ++r)
            for (std::size_t i = 0; i < static_cast<std::size_t>(features); ++i)
                d_view(r, i) =
                    static_cast<float>(plain.dL_dinputs[r * (static_cast<std::size_t>(features) + own) + i]);
    }
};

/// |a - b| / |b|.
double difference(const std::vector<float>& a, const std::vector<float>& b) {
    REQUIRE(a.size() == b.size());
    double sum = 0, size = 1e-30;
    for (std::size_t i = 0; i < a.size(); ++i) sum += std::pow(double(a[i]) - b[i], 2), size += std::pow(b[i], 2.0);
    return std::sqrt(sum / size);
}

} // namespace

TEST_CASE("the MLP in mixed precision computes its equations with operands rounded to bf16") {
    for (const MixedShape& s : mixed_shapes) {
        CAPTURE(s.rows);
        Batch found(s), expected(s);
        found.run(cpu::Serial());
        expected.run_plain();
        // A sum in float can round to another bf16 than one in double, and a ReLU can then be on the other side of 0.
        // In fp32 these differences would be 0.004 for outputs and 0.05 for gradients.
        CHECK(difference(found.outputs, expected.outputs) < 1e-3);
        CHECK(difference(found.dL_dweights, expected.dL_dweights) < 5e-3);
        CHECK(difference(found.dL_dinputs, expected.dL_dinputs) < 5e-3);
        CHECK(difference(found.dL_dshared, expected.dL_dshared) < 5e-3);
    }
}

TEST_CASE("the MLP in mixed precision has the same bits at any number of threads, and adds where it is told to") {
    for (const MixedShape& s : {mixed_shapes[1], mixed_shapes[4]}) {
        MixedShape many = s;
        many.rows = 5000;
        Batch one(many), three(many), added(many);
        one.run(cpu::Serial());
        three.run(cpu::Threads(3));
        CHECK(one.outputs == three.outputs);
        CHECK(one.dL_dweights == three.dL_dweights);
        CHECK(one.dL_dinputs == three.dL_dinputs);
        CHECK(one.dL_dshared == three.dL_dshared);
        added.run(cpu::Serial(), Write::add, 2);
        for (std::size_t i = 0; i < added.dL_dinputs.size(); ++i)
            REQUIRE(added.dL_dinputs[i] == doctest::Approx(one.dL_dinputs[i] + 2));
        for (std::size_t i = 0; i < added.dL_dweights.size(); ++i)
            REQUIRE(added.dL_dweights[i] == doctest::Approx(one.dL_dweights[i] + 2).epsilon(1e-4));
    }
}

TEST_CASE("not a number stays that in mixed precision") {
    Batch batch(mixed_shapes[1]);
    batch.inputs[0] = std::nanf("");
    batch.run(cpu::Serial());
    CHECK(std::isnan(batch.outputs[0]));
    CHECK(std::isfinite(batch.outputs[batch.mlp.outputs()]));
}
