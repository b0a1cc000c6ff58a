// SPDX-License-Identifier: Apache-2.0
#include <gsh/cpu.hpp>
#include <gsh/model/configured_avatar.hpp>
#include <gsh/train/memory.hpp>

#include "support/bodies.hpp"

#include <doctest/doctest.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

using namespace gsh;

namespace {

/// An avatar of about `samples` points on each vertex of a tube, and the size that was stated for it.
struct Sized {
    cpu::Serial backend;
    BodyModel body = test::tube(4, 6, 6);
    std::size_t points = 0;
    LearnedArrays<float> arrays; ///< for their names and sizes: the model that owns their memory is gone
    PartSize size;

    Sized(const ConfiguredAvatarParams& config, double samples, const PriorInputs& priors) {
        const std::vector<double> betas(2, 0.0);
        const SurfaceSamples surface = sample_surface(body, shaped_vertices(body, betas),
                                                      std::vector<double>(body.vertex_count(), samples), 3);
        points = surface.size();
        CanonicalPriors values{.region = {}, .features = std::vector<double>(priors.feature_count * points, 0.5)};
        if (priors.has_region) values.region.assign(points, 0.5);
        auto model = make_avatar(backend, make_rig(body, betas, surface), surface, 7, 1, config, values);
        arrays = model.learned();
        size = avatar_size<cpu::Serial>(config, body.joint_count(), priors);
    }
};

} // namespace

TEST_CASE("the stated size of an avatar is that of the arrays that it announces, in every configuration") {
    const ConfiguredAvatarParams plain{
        .appearance = {.field = {.grid = {.base = 3, .growth = 1.4, .table_size = 256}, .width = 8}},
        .occlusion = {.grid = {.table_size = 128}}};
    std::vector<ConfiguredAvatarParams> configs;
    for (const Heads heads : {Heads::shared, Heads::separate})
        for (const bool sh : {true, false})
            for (const bool displacement : {true, false})
                for (const auto ao : {AmbientOcclusion::none, AmbientOcclusion::time, AmbientOcclusion::pose}) {
                    configs.push_back(plain);
                    configs.back().heads = heads, configs.back().ao = ao;
                    configs.back().hash_sh = sh, configs.back().hash_displacement = displacement;
                }
    configs.push_back(plain), configs.back().appearance.separate_tables = true;
    configs.push_back(plain), configs.back().head_time = true;
    configs.push_back(plain), configs.back().appearance.field.hidden_layers = 3;
    for (const ConfiguredAvatarParams& config : configs)
        for (const PriorInputs& priors : {PriorInputs{}, PriorInputs{.feature_count = 3, .has_region = true}})
            for (const double samples : {1.0, 2.0}) {
                const Sized avatar(config, samples, priors);
                REQUIRE(avatar.arrays.size() == avatar.size.learned.size());
                std::size_t numbers = 0;
                for (std::size_t i = 0; i < avatar.arrays.size(); ++i) {
                    const LearnedArray<float>& array = avatar.arrays[i];
                    CAPTURE(array.name);
                    CHECK(array.name == avatar.size.learned[i].name);
                    CHECK(array.values.size() == avatar.size.learned[i].at(avatar.points));
                    for (const auto& part : {array.values, array.gradient, array.first_moment, array.second_moment})
                        numbers += part.size();
                }
                const std::size_t other = avatar.size.other_per_point * avatar.points;
                CHECK(avatar.size.fixed() + avatar.size.per_point() * avatar.points == numbers + other);
            }
}

TEST_CASE("a budget has the stated sizes, what is held, and pictures; people multiply the sizes alone") {
    const ConfiguredAvatarParams config{.ao = AmbientOcclusion::time};
    const PartSize size = avatar_size<cpu::Serial>(config, 55, {.feature_count = 10, .has_region = true});
    const MemoryModel one = training_memory<cpu::Serial>(config, 100, 1000),
                      two = training_memory<cpu::Serial>(config, 100, 1000, 2),
                      larger = training_memory<cpu::Serial>(config, 101, 1000),
                      fewer = training_memory<cpu::Serial>(config, 100, 1000, 1, {.joint_count = 24});
    CHECK(two.fixed - one.fixed == sizeof(float) * size.fixed());
    CHECK(two.per_gaussian == 2 * one.per_gaussian);
    CHECK(one.per_gaussian > sizeof(float) * size.per_point());
    CHECK(larger.fixed > one.fixed);
    CHECK(larger.per_gaussian == one.per_gaussian);
    CHECK(one.fixed - fewer.fixed == sizeof(float) * 4 * 3 * (55 - 24));
}

TEST_CASE("the activations of a network grow with its width and depth") {
    const ConfiguredAvatarParams plain{
        .ao = AmbientOcclusion::time}; // two fields: the shared field's and ambient occlusion's
    ConfiguredAvatarParams wide = plain, deep = plain;
    wide.appearance.field.width = 2 * plain.appearance.field.width, wide.occlusion.width = 2 * plain.occlusion.width;
    deep.appearance.field.hidden_layers = plain.appearance.field.hidden_layers + 1;
    const auto activations = [](const ConfiguredAvatarParams& config) {
        return avatar_size<cpu::Serial>(config, 55, {}).other_per_point;
    };
    CHECK(activations(wide) - activations(plain) == 2 * (64 + 32));
    CHECK(activations(deep) - activations(plain) == 64 + 32);
}

TEST_CASE("poses take memory as long as they are kept") {
    const auto of = [](std::size_t frames, std::size_t people) {
        return training_memory<cpu::Serial>({}, 100, 1000, people, {.vertex_count = 1000, .frame_count = frames}).fixed;
    };
    CHECK(of(30, 1) - of(0, 1) == 30 * 1000 * 3 * sizeof(float));
    CHECK(of(30, 2) - of(0, 2) == 2 * (of(30, 1) - of(0, 1)));
    CHECK(of(most_pose_memory / (1000 * 3 * sizeof(float)) + 1, 1) == of(0, 1));
}

TEST_CASE("light takes memory for the mesh, for the maps of its shadows, and with each Gaussian") {
    const ConfiguredAvatarParams config{.light = true}, without{};
    ConfiguredAvatarParams unshadowed = config;
    unshadowed.lights.shadows = false;
    const auto of = [](const ConfiguredAvatarParams& c, std::size_t people, std::size_t vertices) {
        return training_memory<cpu::Serial>(c, 100, 1000, people, {.vertex_count = vertices});
    };
    const MemoryModel dark = of(without, 1, 1000), lit = of(config, 1, 1000);
    CHECK(of(without, 1, 2000).fixed == dark.fixed);
    CHECK(lit.fixed - of(unshadowed, 1, 1000).fixed == 4 * (4 * 256 * 256 + 12 * 96 * 96));
    CHECK(of(config, 1, 2000).fixed - lit.fixed >= 1000 * 4 * 16); // visibility
    CHECK(lit.per_gaussian > dark.per_gaussian);
    CHECK(of(config, 2, 1000).fixed - of(without, 2, 1000).fixed == 2 * (lit.fixed - dark.fixed));
}

TEST_CASE("a GPU takes memory for the lists of each query of a grid, and for sums of networks") {
    const AvatarInputs inputs;
    const auto on_device = [&](const ConfiguredAvatarParams& config, std::size_t people = 1) {
        return training_memory<cpu::Serial>(config, 100, 1000, people, inputs, device_costs);
    };
    const ConfiguredAvatarParams paper{.ao = AmbientOcclusion::time}, shared{}, separate{.heads = Heads::separate};
    const auto queries = [&](const ConfiguredAvatarParams& config) {
        return avatar_size<cpu::Serial>(config, inputs.joint_count, inputs.priors).queries;
    };
    CHECK(queries(paper) == 2);
    CHECK(queries(shared) == 1);
    CHECK(queries(separate) == 1); // both fields read the same points
    for (const ConfiguredAvatarParams& config : {paper, shared, separate}) {
        const PartSize size = avatar_size<cpu::Serial>(config, inputs.joint_count, inputs.priors);
        const MemoryModel host = training_memory<cpu::Serial>(config, 100, 1000), device = on_device(config);
        CHECK(device.per_gaussian == host.per_gaussian - host_costs.per_gaussian + device_costs.per_gaussian +
                                         queries(config) * device_costs.per_query);
        std::size_t weights = 0;
        for (const LearnedSize& array : size.learned)
            if (array.name.find("network") != std::string::npos) weights += array.fixed;
        CHECK(weights > 8000);
        CHECK(device.fixed + host_costs.fixed == host.fixed + device_costs.fixed + 4 * 512 * weights);
        CHECK(on_device(config, 2).per_gaussian == 2 * device.per_gaussian);
    }
}

TEST_CASE("a budget and a number of Gaussians turn into each other") {
    const MemoryModel memory{.fixed = 1000, .per_gaussian = 30};
    CHECK(memory.bytes(7) == 1210);
    CHECK(memory.gaussians_within(1210) == 7);
    CHECK(memory.gaussians_within(1209) == 6);
    CHECK(memory.gaussians_within(1000) == 0);
    CHECK(memory.gaussians_within(0) == 0);
}
