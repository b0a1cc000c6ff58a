// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of whole training steps on a GPU, of the actor in several configurations.
#include "load.hpp"
#include "measure.cuh"

#include <gsh/cuda.cuh>
#include <gsh/model/configured_avatar.hpp>
#include <gsh/train/avatar_scene.hpp>
#include <gsh/train/trainer.hpp>

#include <algorithm>
#include <cstddef>
#include <memory>
#include <string>
#include <utility>

namespace gsh::bench {
namespace {

using cuda::Device;
using Model = ConfiguredAvatar<Device>;
using Scene = AvatarScene<Device, Model>;

/// A field's tables and networks are most of a step's work, so floors of whole steps are left to the parts.
void measure_steps(Bench& bench, const std::string& name, const Configuration& configuration,
                   Precision precision = Precision::fp32) {
    if (!bench.wants(name)) return;
    const TrainingLoad load = make_training_load(configuration, bench.arguments().gaussians, bench.arguments().size);
    Device& device = bench.device();
    device.set_precision(precision);
    const auto light = load.light ? std::make_shared<LearnedLight<Device>>(device, *load.light) : nullptr;
    Model model = make_avatar<Device>(device, load.setup.rig, load.setup.samples, load.setup.motion.frame_count(), 1,
                                      configuration.avatar, load.setup.priors, {light});
    Scene scene(device, {{&model, &load.setup.motion}});
    Trainer<Device, Scene> trainer(device, scene, load.photos, 1, configuration.train);
    // Each photograph once, but no more often than there are runs. A step that needs larger buffers than those before
    // it is taken again after they have grown.
    const std::size_t steps = std::min(load.photos.size(), static_cast<std::size_t>(bench.arguments().runs));
    while (trainer.step_count() < steps) {
        for (int k = 0; k < 20 && trainer.step_count() < steps; ++k) trainer.step(0.5);
        trainer.settle();
    }
    for (int attempts_left = 2;; --attempts_left) // Gaussians may grow while they learn: then it is measured again
        try {
            bench.measure_runs(
                name, {}, [&](int) { trainer.step(0.5); }, [&](int repeats) { return trainer.time_kernels(repeats); });
            return;
        } catch (const Halted&) {
            if (attempts_left == 0) throw;
            trainer.settle();
        }
}

void cases(Bench& bench) {
    for (const std::string name : {"light", "paper", "no-ao"}) {
        measure_steps(bench, "step/" + name, named_configuration(name));
        measure_steps(bench, "mixed/step/" + name, named_configuration(name), Precision::mixed);
    }
    Configuration stored = named_configuration("no-ao"); // no field
    stored.avatar.hash_sh = stored.avatar.hash_displacement = false;
    measure_steps(bench, "step/stored", stored);
}

} // namespace
} // namespace gsh::bench

int main(int argc, char** argv) {
    return gsh::bench::run_cases(argc, argv, gsh::bench::cases);
}
