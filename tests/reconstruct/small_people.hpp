// SPDX-License-Identifier: Apache-2.0
/// @file  Small inputs and recipes for the tests of reconstructions.
#pragma once

#include "support/crossing_actors.hpp"
#include "support/held_images.hpp"

#include <gsh/io/capture/capture_data.hpp>
#include <gsh/reconstruct/input.hpp>
#include <gsh/reconstruct/recipe.hpp>
#include <gsh/setup/configuration.hpp>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

namespace gsh::test {

/// Ann, or ann and bob, filmed by two cameras and a test camera in two frames.
inline const CrossingActors& small_actors() {
    static const CrossingActors actors({.image_size = 64, .frames = 2, .cameras = 2, .samples = 4});
    return actors;
}
inline ReconstructionInput small_input(std::size_t people = 1) {
    static const std::pair<Capture, Capture> films = [] {
        CrossingActors actors = small_actors();
        Capture both = actors.together(), one = actors.alone(actors.first(), both.cameras);
        return std::pair(std::move(one), std::move(both));
    }();
    const CrossingActors& actors = small_actors();
    if (people == 1) return reconstruction_input(films.first, actors.body);
    ReconstructionInput input;
    input.bodies.push_back(actors.body);
    input.capture = films.second;
    input.people = {{"ann", 0, actors.ann}, {"bob", 0, actors.bob}};
    return input;
}

/// The same input with images that are read when they are needed. `memory`: StoredImages::memory.
inline ReconstructionInput with_stored_images(ReconstructionInput input, std::uint64_t memory = 0) {
    (void)store_images(input.capture, memory);
    return input;
}

/// A recipe of a few steps with small tables and lights.
inline Recipe small_recipe(std::uint64_t steps = 4) {
    Recipe recipe{.steps = steps, .gaussians = 200};
    for (const auto& [key, value] :
         {std::pair("hash.table_size", "512"), {"light.points", "1"}, {"light.directions", "2"}})
        set_setting(recipe.configuration, key, value, "small_recipe");
    return recipe;
}

} // namespace gsh::test
