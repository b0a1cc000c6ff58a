// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of a step's parts on a GPU: hash grids, networks, the photometric loss, Adam; and of density control.
#include "measure.cuh"

#include "../field/body_points.hpp"

#include <gsh/core/rng.hpp>
#include <gsh/cuda.cuh>
#include <gsh/field/hash_field.hpp>
#include <gsh/learn/density_descent.hpp>
#include <gsh/loss/photometric.hpp>
#include <gsh/optim/adam.hpp>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace gsh::bench {
namespace {

using cuda::Device;
using Field = HashField<16, 4>;

/// The avatar's fields: the grid and the network apart, forward and backward. Two sets of parameters take turns.
void field_cases(Bench& bench) {
    const std::size_t n = bench.arguments().gaussians;
    for (const bool mixed : {false, true})
        for (const int outputs : {30, 1}) { // colour and displacement; shadows
            const std::string name =
                std::string(mixed ? "mixed/" : "") + "field/" + std::to_string(outputs) + " outputs";
            const bool forward = bench.wants(name + "/forward"), backward = bench.wants(name + "/forward+backward");
            if (!forward && !backward) continue;
            Device& device = bench.device();
            device.set_precision(mixed ? Precision::mixed : Precision::fp32);
            const Field field({.growth = 1.6, .table_size = 1u << 17}, {.outputs = outputs});
            Field::Query<Device, float> query;
            std::vector<float> region(n);
            for (std::size_t i = 0; i < n; ++i) region[i] = i % 100 < 45 ? 1.0f : i % 100 < 65 ? 0.5f : 0.0f;
            const auto tau = uploaded(device, region);
            const auto points = uploaded(device, body_points(n));
            field.prepare(device, points, query, {12, false, tau});
            const std::size_t parameters = field.table_parameter_count(query);
            const auto weights = uploaded(device, field.mlp().initial_weights<float>(2));
            const cuda::Buffer<float> tables[] = {uploaded(device, field.grid().initial_table<float>(1)),
                                                  uploaded(device, field.grid().initial_table<float>(2))};
            cuda::Buffer<float> results(n * static_cast<std::size_t>(outputs)), dL_dtable(parameters),
                dL_dweights(weights.size());
            Field::Cache<Device, float> cache;
            device.fill(Span<float>(results), 0.1f);
            const auto run_forward = [&](int k) {
                field.forward(device, tables[k % 2], weights, query, results, cache, {});
            };

            // Each entry that a point reads once, each point's weights of its corners, the outputs. The table and its
            // gradient are float in mixed precision, too, since every forward pass makes its copy of 16 bits anew.
            // Products in float count at the rate of fp32; three of TF32 for each would take two fifths of that time.
            const double entries = static_cast<double>(query.touched.size()) * 4 * sizeof(float);
            const double lookups = static_cast<double>(query.lookups());
            const double products = 2.0 * static_cast<double>(n * field.mlp().parameter_count());
            const double out = static_cast<double>(results.size()) * sizeof(float);
            const auto work = [&](double bytes, double operations) {
                return Work{bytes, mixed ? 0 : operations, mixed ? operations : 0};
            };
            if (forward)
                bench.measure(name + "/forward", work(entries + out + 12.0 * static_cast<double>(n), products),
                              run_forward);
            if (backward)
                bench.measure(name + "/forward+backward", work(3 * entries + 2 * out + 4 * lookups, 3 * products),
                              [&](int k) {
                                  run_forward(k);
                                  field.backward(device, weights, query, results, cache, dL_dtable, dL_dweights, {});
                              });
        }
}

void loss_cases(Bench& bench) {
    const int size = bench.arguments().size;
    const std::string name = "loss/photometric/" + std::to_string(size);
    if (!bench.wants(name)) return;
    Device& device = bench.device();
    const auto count = 3 * static_cast<std::size_t>(size) * static_cast<std::size_t>(size);
    std::vector<float> a(count, 1.0f), b(count, 1.0f);
    Rng rng(1);
    const double radius = 0.24 * size; // a figure on white
    for (std::size_t i = 0; i < count; ++i) {
        const std::size_t pixel = i % (count / 3), width = static_cast<std::size_t>(size);
        const double x = static_cast<double>(pixel % width), y = static_cast<double>(pixel / width);
        if (std::hypot(x - 0.5 * size, y - 0.5 * size) > radius) continue;
        a[i] = static_cast<float>(rng.uniform()), b[i] = static_cast<float>(rng.uniform());
    }
    cuda::Buffer<float> render = uploaded(device, a), truth = uploaded(device, b), gradient(count);
    const auto view = [&](cuda::Buffer<float>& buffer) { return ImageView<float>{buffer, 3, size, size}; };
    const PhotometricLoss<Device> loss(device);
    PhotometricLoss<Device>::Cache cache;
    bench.measure(name, {static_cast<double>(5 * count * sizeof(float))}, [&](int k) {
        cuda::Buffer<float>& first = k % 2 ? truth : render;
        cuda::Buffer<float>& second = k % 2 ? render : truth;
        loss.forward(view(first), view(second), cache);
        loss.backward(view(first), view(second), 1.0f, cache, view(gradient));
    });
}

/// Adam over all rows of the avatar's table, and over half of them.
void adam_cases(Bench& bench) {
    const std::size_t width = 4, rows = 10 * bench.arguments().gaussians;
    const bool dense = bench.wants("adam/dense"), sparse = bench.wants("adam/half of the rows");
    if (!dense && !sparse) return;
    Device& device = bench.device();
    std::vector<float> values(rows * width);
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<float>(random_uniform(1, i) - 0.5);
    struct Arrays {
        cuda::Buffer<float> parameters, gradients, m, v;
    };
    std::vector<Arrays> inputs(4); // take turns, so that none is in the cache from the run before
    for (Arrays& a : inputs) {
        a.parameters = uploaded(device, values), a.gradients = uploaded(device, values);
        a.m.resize(values.size()), a.v.resize(values.size());
        device.fill(Span<float>(a.m), 0.0f), device.fill(Span<float>(a.v), 0.0f);
    }
    const auto turn = [&](int k) -> Arrays& { return inputs[static_cast<std::size_t>(k) % inputs.size()]; };
    std::vector<std::uint32_t> touched;
    for (std::uint32_t row = 0; row < rows; ++row)
        if (random_bits(2, row / 16) & 1) touched.push_back(row);
    const auto list = uploaded(device, touched);
    const double bytes = 7.0 * sizeof(float) * static_cast<double>(values.size());
    if (dense)
        bench.measure("adam/dense", {bytes}, [&](int k) {
            Arrays& a = turn(k);
            Adam().step(device, Span<float>(a.parameters), a.gradients, a.m, a.v, 1e-3, k + 1);
        });
    if (sparse)
        bench.measure("adam/half of the rows",
                      {bytes * static_cast<double>(touched.size()) / static_cast<double>(rows)}, [&](int k) {
                          Arrays& a = turn(k);
                          Adam().step_rows(device, Span<float>(a.parameters), a.gradients, a.m, a.v, list, width, 1e-3,
                                           k + 1);
                      });
}

/// The plan of density control for a million Gaussians, most of which stay, with and without a limit that half of the
/// changes exceed. It waits for the device to learn how many there will be, so it is no graph, and its time is the
/// host's.
void density_cases(Bench& bench) {
    const bool free = bench.wants("density/plan"), limited = bench.wants("density/limited plan");
    if (!free && !limited) return;
    const std::size_t n = 6 * bench.arguments().gaussians;
    Device& device = bench.device();
    constexpr std::size_t input_count = 8; // take turns
    std::vector<cuda::Buffer<Fate>> of_device;
    std::vector<cuda::Buffer<float>> values;
    Rng rng(1);
    for (std::size_t input = 0; input < input_count; ++input) {
        std::vector<Fate> fates;
        std::vector<float> gradients;
        for (std::size_t i = 0; i < n; ++i) {
            const double u = rng.uniform();
            fates.push_back(u < 0.03 ? Fate::split : u < 0.06 ? Fate::clone : u < 0.08 ? Fate::prune : Fate::keep);
            gradients.push_back(static_cast<float>(rng.uniform()));
        }
        of_device.push_back(uploaded(device, fates)), values.push_back(uploaded(device, gradients));
    }
    detail::DescentBuffers<Device> plan;
    const double bytes = static_cast<double>(n) * (2 * sizeof(Fate) + sizeof(std::uint32_t) + sizeof(gsh::detail::Kin));
    const auto measure = [&](const std::string& name, std::size_t most) {
        bench.measure_runs(
            name, {bytes},
            [&](int k) {
                const std::size_t input = static_cast<std::size_t>(k) % input_count;
                (void)plan_descent(device, Span<const Fate>(of_device[input]), Span<const float>(values[input]), 2, most,
                                   plan);
            },
            [](int) { return std::vector<cuda::KernelTime>(); });
    };
    if (free) measure("density/plan", 2 * n);
    if (limited) measure("density/limited plan", n);
}

void cases(Bench& bench) {
    density_cases(bench);
    field_cases(bench);
    loss_cases(bench);
    adam_cases(bench);
}

} // namespace
} // namespace gsh::bench

int main(int argc, char** argv) {
    return gsh::bench::run_cases(argc, argv, gsh::bench::cases);
}
