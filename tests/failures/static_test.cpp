// SPDX-License-Identifier: Apache-2.0
/// Each allocation fails in turn in steps of a static scene, in which Gaussians are split, cloned and removed. The step
/// can be taken again and ends with the same bits; or, where half of it was done, the next one is refused.
#include <gsh/cpu.hpp>
#include <gsh/reconstruct/static_photos.hpp>
#include <gsh/reconstruct/static_reconstruction.hpp>

#include "failures/failing_allocations.hpp"
#include "reconstruct/small_people.hpp"
#include "support/contains.hpp"

#include <cstddef>
#include <cstdint>
#include <iostream>
#include <memory>
#include <vector>

using namespace gsh;

TEST_CASE("memory runs out in a step of the configuration static, with density control") {
    cpu::Serial backend;
    const StaticPhotos input = static_photos_of(test::small_input().capture, 0);
    constexpr std::uint64_t steps = 6;
    StaticRecipe recipe{.config = static_model_params(steps), .points = 120, .seed = 2};
    recipe.config.density.start = 2, recipe.config.density.interval = 2, recipe.config.density.stop = steps;
    recipe.config.density.reset_interval = 3;
    recipe.config.density.gradient_threshold = 1e-6;
    using Scene = StaticReconstruction<cpu::Serial>;
    const auto prepare = [&] { return std::make_unique<Scene>(backend, input, recipe); };
    std::size_t refused = 0;
    const auto call = [&](std::unique_ptr<Scene>& scene) {
        while (scene->step_count() < steps) {
            try {
                scene->step(static_cast<double>(scene->step_count()) / static_cast<double>(steps));
            } catch (const Error& error) {
                test::allocations::end();
                if (error.what() != test::contains("in the middle of its update")) throw;
                ++refused;
                scene = prepare(); // as the message says
            }
        }
        const auto cloud = scene->cloud();
        std::vector<float> numbers = cloud.opacity_logits;
        for (const auto& v : cloud.means) numbers.insert(numbers.end(), {v.x, v.y, v.z});
        for (const auto& v : cloud.sh) numbers.insert(numbers.end(), {v.x, v.y, v.z});
        return numbers;
    };
    auto whole = prepare();
    (void)call(whole);
    CHECK(whole->total_change().split + whole->total_change().cloned > 0);
    CHECK(whole->size() != 120);
    test::Exhausted sum = test::exhaust("steps, static", prepare, call, {.first = 40, .sample = 60});
    CHECK(refused > 0);
    CHECK(refused < sum.failed / 2);
    std::cout << "steps that were refused after one that failed: " << refused << " of " << sum.failed << std::endl;
    sum += test::exhaust("making a scene", [&] { return prepare()->size(); }, {.first = 10, .sample = 10});
    test::report("a static scene", sum);
}
