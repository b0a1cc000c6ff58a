// SPDX-License-Identifier: Apache-2.0
#include <gsh/cpu.hpp>
#include <gsh/pipeline/configured_avatar.hpp>
#include <gsh/train/memory.hpp>

#include "support/bodies.hpp"

#include <doctest/doctest.h>

#include <cstddef>
#include <cstdint>
#include <vector>

using namespace gsh;

namespace {

const AvatarConfig without_fields{.hash_displacement = false, .hash_sh = false};

/// Bytes of a model's learned arrays, each with its gradient and Adam's two moments.
std::uint64_t learned_bytes(const AvatarConfig& config, std::size_t& gaussians) {
    cpu::Serial backend;
    const BodyModel body = test::tube(4, 6, 6);
    const std::vector<double> betas(2, 0.0);
    const SurfaceSamples samples =
        sample_surface(body, shaped_vertices(body, betas), std::vector<double>(body.vertex_count(), 400.0), 3);
    gaussians = samples.size();
    auto model = make_avatar(backend, make_rig(body, betas, samples), samples, 1, 1, config,
                             {std::vector<double>(samples.size(), 0.5), {}});
    std::uint64_t bytes = 0;
    for (const LearnedArray<float>& array : model.learned())
        for (const auto& numbers : {array.values, array.gradient, array.first_moment, array.second_moment})
            bytes += sizeof(float) * numbers.size();
    return bytes;
}

} // namespace

TEST_CASE("a budget covers the learned arrays of every configuration") {
    // Every level at its largest, so that tables have the size that the estimate assumes.
    const AvatarConfig plain{.hash_base = 64, .hash_growth = 1.2, .hash_table_size = 4096, .ao_table_size = 4096};
    const auto with = [&](auto change) {
        AvatarConfig config = plain;
        change(config);
        return config;
    };
    for (const AvatarConfig& config :
         {plain, with([](AvatarConfig& c) { c.separate_tables = true; }),
          with([](AvatarConfig& c) { c.heads = Heads::separate; }),
          with([](AvatarConfig& c) { c.ao = AmbientOcclusion::time; }),
          with([](AvatarConfig& c) { c.hash_sh = false; }), with([](AvatarConfig& c) { c.hash_displacement = false; }),
          with([](AvatarConfig& c) { c.hash_sh = c.hash_displacement = false; })}) {
        std::size_t gaussians = 0;
        const std::uint64_t bytes = learned_bytes(config, gaussians), table = 4 * sizeof(float) * 16 * 4 * 4096;
        const MemoryModel memory = training_memory(config, 0, 0);
        const std::uint64_t fields = memory.fixed - training_memory(without_fields, 0, 0).fixed;
        CHECK(fields % table == 0);
        CHECK(bytes > fields);                                            // networks and what each Gaussian has
        CHECK(bytes - fields < table / 2 + memory.per_gaussian * gaussians); // no further table fits
    }
}

TEST_CASE("what a network's activations take grows with its width and depth, and what people take with their number") {
    const AvatarConfig plain{.ao = AmbientOcclusion::time};
    const MemoryModel one = training_memory(plain, 100, 1000), two = training_memory(plain, 100, 1000, 2),
                      none = training_memory(without_fields, 100, 1000);
    AvatarConfig wide = plain, deep = plain;
    wide.mlp_width = 2 * plain.mlp_width;
    deep.mlp_hidden_layers = plain.mlp_hidden_layers + 1;
    // Two fields: the joint head's and ambient occlusion's.
    CHECK(training_memory(wide, 100, 1000).per_gaussian - one.per_gaussian == 2 * 2 * 64 * sizeof(float));
    CHECK(training_memory(deep, 100, 1000).per_gaussian - one.per_gaussian == 2 * 64 * sizeof(float));
    CHECK(two.per_gaussian == 2 * one.per_gaussian);
    CHECK(two.fixed - one.fixed == one.fixed - none.fixed); // a person's tables; program and pictures are counted once
}

TEST_CASE("a budget and a number of Gaussians turn into each other") {
    const MemoryModel memory{.fixed = 1000, .per_gaussian = 30};
    CHECK(memory.bytes(7) == 1210);
    CHECK(memory.gaussians_within(1210) == 7);
    CHECK(memory.gaussians_within(1209) == 6);
    CHECK(memory.gaussians_within(1000) == 0);
    CHECK(memory.gaussians_within(0) == 0);
}
