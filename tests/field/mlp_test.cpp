// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/threads.hpp>
#include <gsh/field/cpu/mlp.hpp>
#include <gsh/field/mlp.hpp>

#include "support/gradient.hpp"

#include <cmath>
#include <cstddef>
#include <vector>

using namespace gsh;

namespace {

struct Shape {
    int inputs, outputs, width, hidden_layers;
    std::size_t rows;
};
constexpr Shape shapes[] = {
    {3, 2, 5, 0, 7}, {4, 1, 8, 1, 65}, {5, 3, 7, 2, 1}, {16, 9, 16, 3, 70}, {6, 27, 33, 2, 33}, {40, 3, 64, 1, 300},
};

/// The network from its equation, one number after the other.
std::vector<double> plain(const Mlp& mlp, const std::vector<double>& weights, std::vector<double> x) {
    for (std::size_t l = 0; l < mlp.layer_count(); ++l) {
        std::vector<double> y(mlp.layer_outputs(l), 0.0);
        for (std::size_t o = 0; o < y.size(); ++o) {
            for (std::size_t i = 0; i < x.size(); ++i) y[o] += weights[mlp.layer_offset(l) + o * x.size() + i] * x[i];
            if (l + 1 < mlp.layer_count()) y[o] = std::max(y[o], 0.0);
        }
        x = y;
    }
    return x;
}

template <class T, class B>
struct MlpRun {
    std::vector<T> outputs, dL_dweights, dL_dinputs;

    MlpRun(B backend, const Mlp& mlp, const std::vector<T>& weights, FeatureView<const T> inputs,
        const std::vector<T>& dL_doutputs, int backwards = 1)
        : outputs(dL_doutputs.size()), dL_dweights(weights.size(), T(0)), dL_dinputs(inputs.values.size(), T(0)) {
        Mlp::Cache<B, T> cache;
        mlp.forward(backend, weights, {inputs}, outputs, cache);
        for (int i = 0; i < backwards; ++i)
            mlp.backward(backend, weights, {inputs}, dL_doutputs, cache, dL_dweights,
                         {dL_dinputs, inputs.rows, inputs.columns, inputs.block});
    }
};

} // namespace

TEST_CASE("Mlp::forward evaluates the network row by row") {
    for (const Shape& s : shapes) {
        const Mlp mlp({s.inputs, s.outputs, s.width, s.hidden_layers});
        test::Rng rng(2);
        const auto weights = mlp.initial_weights<double>(5);
        const auto inputs = rng.numbers(s.rows * mlp.inputs());
        const auto view = row_major(Span<const double>(inputs), mlp.inputs());
        const MlpRun<double, cpu::Serial> run(cpu::Serial(), mlp, weights, view,
                                               std::vector(s.rows * mlp.outputs(), 0.0));
        for (std::size_t r = 0; r < s.rows; ++r) {
            const double* row = inputs.data() + r * mlp.inputs();
            const auto expected = plain(mlp, weights, {row, row + mlp.inputs()});
            for (std::size_t o = 0; o < mlp.outputs(); ++o)
                CHECK(run.outputs[r * mlp.outputs() + o] == doctest::Approx(expected[o]).epsilon(1e-12));
        }
    }
}

TEST_CASE("Mlp::backward is the gradient of forward") {
    for (const Shape& s : shapes) {
        const Mlp mlp({s.inputs, s.outputs, s.width, s.hidden_layers});
        test::Rng rng(3);
        auto weights = mlp.initial_weights<double>(7);
        auto inputs = rng.numbers(s.rows * mlp.inputs());
        const auto dL_doutputs = rng.numbers(s.rows * mlp.outputs());
        const auto view = row_major(Span<const double>(inputs), mlp.inputs());
        cpu::Serial backend;
        Mlp::Cache<cpu::Serial, double> cache;
        std::vector<double> outputs(dL_doutputs.size());
        const auto loss = [&] {
            mlp.forward(backend, weights, {view}, outputs, cache);
            double sum = 0;
            for (std::size_t i = 0; i < outputs.size(); ++i) sum += outputs[i] * dL_doutputs[i];
            return sum;
        };
        const MlpRun<double, cpu::Serial> run(backend, mlp, weights, view, dL_doutputs);
        INFO("hidden layers " << s.hidden_layers << ", width " << s.width);
        // At this step, a kink between the two evaluations is rare. These seeds have none.
        const std::size_t stride = std::max<std::size_t>(1, weights.size() * s.rows / 20000);
        test::check_gradient(loss, weights, run.dL_dweights, {.stride = stride});
        test::check_gradient(loss, inputs, run.dL_dinputs, {.stride = stride});
    }
}

TEST_CASE("Mlp::backward adds, and Write::assign overwrites the inputs' gradient alone") {
    const Mlp mlp({6, 5, 12, 2});
    test::Rng rng(4);
    const auto weights = mlp.initial_weights<double>(1), inputs = rng.numbers(40 * 6),
               dL_doutputs = rng.numbers(40 * 5);
    const auto view = row_major(Span<const double>(inputs), 6);
    const MlpRun<double, cpu::Serial> once({}, mlp, weights, view, dL_doutputs),
        twice({}, mlp, weights, view, dL_doutputs, 2);
    for (std::size_t i = 0; i < weights.size(); ++i) CHECK(twice.dL_dweights[i] == 2 * once.dL_dweights[i]);
    for (std::size_t i = 0; i < inputs.size(); ++i) CHECK(twice.dL_dinputs[i] == 2 * once.dL_dinputs[i]);

    cpu::Serial backend;
    Mlp::Cache<cpu::Serial, double> cache;
    std::vector<double> outputs(dL_doutputs.size()), dL_dweights(weights.size(), 0.0), dL_dinputs(inputs.size(), 9.0);
    mlp.forward(backend, weights, {view}, outputs, cache);
    mlp.backward(backend, weights, {view}, dL_doutputs, cache, dL_dweights, row_major(Span<double>(dL_dinputs), 6),
                 Write::assign);
    CHECK(dL_dinputs == once.dL_dinputs);
    std::vector<double> both = inputs; // the gradient takes the place of the inputs
    dL_dweights.assign(weights.size(), 0.0);
    const auto in_place = row_major(Span<double>(both), 6);
    mlp.backward(backend, weights, {in_place}, dL_doutputs, cache, dL_dweights, in_place, Write::assign);
    CHECK(both == once.dL_dinputs);
    CHECK(dL_dweights == once.dL_dweights);
    dL_dweights.assign(weights.size(), 0.0);
    mlp.backward(backend, weights, {view}, dL_doutputs, cache, dL_dweights, {}); // no gradient for the inputs
    CHECK(dL_dweights == once.dL_dweights);
}

TEST_CASE("Mlp takes its inputs in blocks of columns") {
    const Mlp mlp({12, 5, 20, 2});
    test::Rng rng(5);
    constexpr std::size_t rows = 131;
    const auto weights = mlp.initial_weights<double>(1), inputs = rng.numbers(rows * 12),
               dL_doutputs = rng.numbers(rows * 5);
    const auto view = row_major(Span<const double>(inputs), 12);
    const MlpRun<double, cpu::Serial> expected({}, mlp, weights, view, dL_doutputs);
    for (const std::size_t block : {1, 2, 3, 4, 6}) {
        std::vector<double> regrouped(inputs.size());
        const auto groups = blocked(Span<double>(regrouped), 12, block);
        for (std::size_t r = 0; r < rows; ++r)
            for (std::size_t c = 0; c < 12; ++c) groups(r, c) = view(r, c);
        MlpRun<double, cpu::Serial> run({}, mlp, weights, groups, dL_doutputs);
        CHECK(run.outputs == expected.outputs);
        CHECK(run.dL_dweights == expected.dL_dweights);
        const auto dL_dgroups = blocked(Span<double>(run.dL_dinputs), 12, block);
        for (std::size_t r = 0; r < rows; ++r)
            for (std::size_t c = 0; c < 12; ++c) CHECK(dL_dgroups(r, c) == expected.dL_dinputs[r * 12 + c]);
    }
}

TEST_CASE_TEMPLATE("Mlp on Threads equals Serial bit for bit", T, float, double) {
    const Mlp mlp({10, 7, 24, 2});
    test::Rng rng(6);
    constexpr std::size_t rows = 1111;
    const auto weights = mlp.initial_weights<T>(1);
    std::vector<T> inputs(rows * 10), dL_doutputs(rows * 7);
    for (T& x : inputs) x = static_cast<T>(rng.uniform(-1, 1));
    for (T& x : dL_doutputs) x = static_cast<T>(rng.uniform(-1, 1));
    const auto view = row_major(Span<const T>(inputs), 10);
    const MlpRun<T, cpu::Serial> expected({}, mlp, weights, view, dL_doutputs);
    for (const std::size_t threads : {1, 2, 3, 7}) {
        cpu::Threads backend(threads);
        Mlp::Cache<cpu::Threads, T> cache;
        std::vector<T> outputs(dL_doutputs.size()), dL_dweights(weights.size(), T(0)), dL_dinputs(inputs.size(), T(0));
        mlp.forward(backend, weights, {view}, outputs, cache);
        mlp.backward(backend, weights, {view}, dL_doutputs, cache, dL_dweights, row_major(Span<T>(dL_dinputs), 10));
        CHECK(outputs == expected.outputs);
        CHECK(dL_dweights == expected.dL_dweights);
        CHECK(dL_dinputs == expected.dL_dinputs);
    }
}

TEST_CASE_TEMPLATE("a row without a gradient adds nothing, and its inputs' gradient is zero", T, float, double) {
    constexpr std::size_t rows = 900, ins = 12, outs = 3;
    const Mlp mlp({ins + 2, outs, 24, 2});
    test::Rng rng(9);
    const auto numbers = [&](std::size_t count) {
        std::vector<T> list(count);
        for (T& x : list) x = static_cast<T>(rng.uniform(-1, 1));
        return list;
    };
    const auto weights = mlp.initial_weights<T>(1), features = numbers(rows * ins), points = numbers(rows);
    const std::vector<T> shared = numbers(1);
    const auto pattern = [&](std::size_t row) {
        if (row < 64) return true;                    // a whole tile
        if (row < 300) return row % 3 == 1;           // every third row
        if (row < 600) return false;                  // none in several tiles
        return row % 100 < 70 || row == rows - 1;     // in runs, and the last one
    };
    const auto run = [&](const auto& has_gradient, bool only_those, Write mode, Precision precision, bool in_place) {
        cpu::Threads backend(2);
        backend.set_precision(precision);
        Mlp::Cache<cpu::Threads, T> cache;
        std::vector<std::size_t> kept;
        for (std::size_t r = 0; r < rows; ++r)
            if (!only_those || has_gradient(r)) kept.push_back(r);
        const std::size_t n = kept.size();
        std::vector<T> f(n * ins), p(n), dL_dy(n * outs), y(n * outs), dL_df(n * ins, T(7));
        std::vector<T> dL_dw(weights.size(), T(0));
        const auto view = blocked(Span<T>(f), ins, 4);
        for (std::size_t r = 0; r < n; ++r) {
            for (std::size_t c = 0; c < ins; ++c) view(r, c) = features[kept[r] * ins + c];
            p[r] = points[kept[r]];
            for (std::size_t o = 0; o < outs; ++o)
                dL_dy[r * outs + o] = has_gradient(kept[r]) ? T(0.1) + features[kept[r] * ins + o] : T(0);
        }
        std::vector<T> dL_dshared(1, T(0));
        mlp.forward(backend, weights, {view, p, shared}, y, cache);
        mlp.backward(backend, weights, {view, p, shared}, dL_dy, cache, dL_dw,
                     in_place ? view : blocked(Span<T>(dL_df), ins, 4), mode, dL_dshared);
        std::vector<T> out(rows * ins, mode == Write::add ? T(7) : T(0)); // of each row of the batch
        const auto gradient = in_place ? view : blocked(Span<T>(dL_df), ins, 4);
        for (std::size_t r = 0; r < n; ++r)
            for (std::size_t c = 0; c < ins; ++c) out[kept[r] * ins + c] = gradient(r, c);
        out.insert(out.end(), dL_dw.begin(), dL_dw.end());
        out.insert(out.end(), dL_dshared.begin(), dL_dshared.end());
        return out;
    };
    for (const Precision precision : {Precision::fp32, Precision::mixed})
        for (const Write mode : {Write::add, Write::assign})
            for (const bool in_place : {false, true}) {
                if (in_place && mode == Write::add) continue;
                const auto expected = run(pattern, true, mode, precision, false);
                const auto found = run(pattern, false, mode, precision, in_place);
                for (std::size_t i = 0; i < expected.size(); ++i) {
                    CAPTURE(i);
                    CHECK(found[i] == doctest::Approx(expected[i]).epsilon(sizeof(T) == 4 ? 1e-5 : 1e-13));
                }
                CHECK(found[400 * ins] == (mode == Write::add ? T(7) : T(0)));
                const auto nothing = run([](std::size_t) { return false; }, false, mode, precision, in_place);
                for (const T number : Span<const T>(nothing).subspan(rows * ins, weights.size() + 1))
                    CHECK(number == 0);
            }
}

TEST_CASE("Mlp initialises within the Xavier bound, reproducibly") {
    const Mlp mlp({64, 27});
    CHECK(mlp.parameter_count() == 64 * 64 + 64 * 64 + 27 * 64);
    const auto weights = mlp.initial_weights<float>(3);
    CHECK(weights == mlp.initial_weights<float>(3));
    CHECK(weights != mlp.initial_weights<float>(4));
    double square = 0;
    for (std::size_t i = 0; i < 4096; ++i) {
        CHECK(std::abs(weights[i]) <= std::sqrt(6.0 / 128));
        square += weights[i] * weights[i];
    }
    CHECK(square / 4096 == doctest::Approx(2.0 / 128).epsilon(0.05)); // bound^2 / 3
}

TEST_CASE("Mlp says what is wrong with its arguments, and takes an empty batch") {
    CHECK_THROWS_AS(Mlp({0, 1}), ValueError);
    CHECK_THROWS_AS(Mlp({1, 0}), ValueError);
    CHECK_THROWS_AS(Mlp({1, 1, 8, -1}), ValueError);
    CHECK_THROWS_AS(Mlp({1, 1, 0, 1}), ValueError);

    const Mlp mlp({4, 2, 8, 1});
    cpu::Serial backend;
    Mlp::Cache<cpu::Serial, float> cache;
    auto weights = mlp.initial_weights<float>(1);
    std::vector<float> inputs(12), outputs(6), dL_dinputs(12), few(5);
    const auto view = row_major(Span<const float>(inputs), 4);
    CHECK_THROWS_AS(mlp.forward(backend, few, {view}, outputs, cache), ShapeError);
    CHECK_THROWS_AS(mlp.forward(backend, weights, {row_major(Span<const float>(inputs), 3)}, outputs, cache),
                    ShapeError);
    CHECK_THROWS_AS(mlp.forward(backend, weights, {view}, few, cache), ShapeError);
    CHECK_THROWS_AS(mlp.forward(backend, weights, {{inputs, 3, 4, 3}}, outputs, cache), ValueError);
    CHECK_THROWS_AS(mlp.forward(backend, weights, {{few, 3, 4, 4}}, outputs, cache), ShapeError);
    CHECK_THROWS_AS(static_cast<void>(row_major(Span<float>(inputs), 5)), ValueError);
    CHECK_THROWS_AS(static_cast<void>(blocked(Span<float>(inputs), 4, 3)), ValueError);
    CHECK_THROWS_AS(static_cast<void>(blocked(Span<float>(inputs), 4, 2).slice(1, 2)), ValueError);

    mlp.forward(backend, weights, {view}, outputs, cache);
    std::vector<float> dL_dweights(weights.size());
    const auto dL_dview = row_major(Span<float>(dL_dinputs), 4);
    CHECK_THROWS_AS(mlp.backward(backend, few, {view}, outputs, cache, dL_dweights, dL_dview), ShapeError);
    CHECK_THROWS_AS(mlp.backward(backend, weights, {view}, few, cache, dL_dweights, dL_dview), ShapeError);
    CHECK_THROWS_AS(mlp.backward(backend, weights, {view}, outputs, cache, few, dL_dview), ShapeError);
    CHECK_THROWS_AS(
        mlp.backward(backend, weights, {view}, outputs, cache, dL_dweights, row_major(Span<float>(inputs), 3)),
        ShapeError);
    cache.rows = 2; // the cache of another batch
    CHECK_THROWS_AS(mlp.backward(backend, weights, {view}, outputs, cache, dL_dweights, dL_dview), ShapeError);

    const FeatureView<float> nothing(Span<float>(), 0, 4, 4);
    mlp.forward(backend, weights, {nothing}, Span<float>(), cache);
    mlp.backward(backend, weights, {nothing}, Span<float>(), cache, dL_dweights, nothing);
    for (const float g : dL_dweights) CHECK(g == 0.0f);
}
