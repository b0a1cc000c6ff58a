// SPDX-License-Identifier: Apache-2.0
/// Each allocation fails in turn in steps of training: the step can be taken again, and ends with the same bits.
#include <gsh/cpu.hpp>
#include <gsh/setup/configuration.hpp>

#include "failures/failing_allocations.hpp"
#include "support/small_training.hpp"

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;

TEST_CASE("memory runs out in a step of training, with every configuration") {
    const test::SmallScene scene;
    ConfiguredAvatarParams light = test::quick_avatar(), time = light, pose = light, field = light;
    light.light = true, light.lights.points = 1, light.lights.directions = 2;
    time.ao = AmbientOcclusion::time, time.model.occlusion_start = 0;
    pose.ao = AmbientOcclusion::pose, pose.model.occlusion_start = 0;
    ConfiguredAvatarParams paper = named_configuration("paper").avatar;
    paper.model.occlusion_start = paper.model.sh_start = 0; // all parts, from the first step on
    const std::pair<const char*, const ConfiguredAvatarParams*> configurations[] = {
        {"quick", &field}, {"light", &light}, {"time", &time}, {"pose", &pose}, {"paper", &paper}};
    test::Exhausted sum;
    for (const auto& [name, avatar] : configurations) {
        using Training = test::SmallTraining<cpu::Serial>;
        const auto prepare = [&] { return std::make_unique<Training>(scene, cpu::Serial(), 3, *avatar); };
        const auto call = [](const std::unique_ptr<Training>& training) {
            while (training->trainer.step_count() < 2) training->trainer.step(0);
            return training->parameters();
        };
        sum += test::exhaust(std::string("a step, ") + name, prepare, call, {.first = 30, .sample = 10});
        sum += test::exhaust(std::string("making a training, ") + name, [&] { return prepare()->model.size(); },
                             {.first = 10, .sample = 10});
    }
    test::report("training", sum);
}
