// SPDX-License-Identifier: Apache-2.0
#include "reconstruct/plan.hpp"

#include "common/exit_codes.hpp"
#include "common/machine.hpp"
#include "common/messages.hpp"
#include "reconstruct/load_input.hpp"

#include <gsh/backend/threads.hpp>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <string>

namespace gsh::programs {

namespace {

/// What a training step takes: of each Gaussian, of each pixel of a photograph, and the rest; seconds of one thread.
struct StepCosts {
    double gaussian, pixel, rest;

    [[nodiscard]] double of(double gaussians, double pixels) const {
        return gaussian * gaussians + pixel * pixels + rest;
    }
};
/// Two threads of an AMD EPYC (Zen 5), mean of a whole run. With stages, a run begins with fewer Gaussians and smaller
/// photographs, and light has no field that is evaluated in every step.
constexpr StepCosts with_stages{0.32e-6, 0.18e-6, 5e-3}, without_stages{1.1e-6, 0.3e-6, 8e-3};
/// An NVIDIA H100, which one thread feeds. Stages are left out: small steps do not fill it.
constexpr StepCosts of_gpu{5e-9, 0.5e-9, 0.3e-3};

/// Seconds of one thread, or of a GPU with what its host does beside it.
struct OtherCosts {
    double registered;    ///< of a photograph
    double test_fit_step; ///< of a step that fits a test pose
    double judged;        ///< of a test image
    double avatar;        ///< of the avatar's files and page
};
constexpr OtherCosts thread_costs{.registered = 0.4, .test_fit_step = 0.02, .judged = 0.1, .avatar = 3};
constexpr OtherCosts gpu_costs{.registered = 0.02, .test_fit_step = 1e-3, .judged = 0.1, .avatar = 3};

} // namespace

StageSeconds expected_seconds(const ReconstructionPlan& plan, const Recipe& recipe, std::size_t threads, bool on_gpu,
                              double load_seconds) {
    const double parallel = on_gpu ? 1 : static_cast<double>(std::max<std::size_t>(threads, 1));
    const bool has_stages = recipe.configuration.stage_at(1, 0).stored;
    const StepCosts& costs = on_gpu ? of_gpu : has_stages ? with_stages : without_stages;
    const double step =
        costs.of(static_cast<double>(plan.gaussians * plan.people), static_cast<double>(plan.pixels)) / parallel;
    const OtherCosts& others = on_gpu ? gpu_costs : thread_costs;
    StageSeconds seconds{.load = load_seconds};
    seconds.training = recipe.seconds > 0 ? recipe.seconds : step * static_cast<double>(recipe.length().steps);
    const auto tests = static_cast<double>(plan.test_images);
    seconds.results = (others.avatar + others.judged * tests) / parallel;
    if (recipe.refine) {
        if (recipe.registration)
            seconds.registration = others.registered * static_cast<double>(plan.training_images) / parallel;
        seconds.results +=
            others.test_fit_step * tests * static_cast<double>(recipe.configuration.test_fit.steps) / parallel;
    }
    return seconds;
}

int print_plan(const ReconstructOptions& options) {
    const auto start = std::chrono::steady_clock::now();
    cpu::Threads host(options.machine.threads);
    ReconstructionInput input = load_input(host, options);
    const Recipe recipe = recipe_for(options, input);
    const double load = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    const bool on_gpu = options.machine.backend == "cuda";
    const ReconstructionPlan plan = plan_reconstruction<cpu::Threads>(input, recipe, on_gpu);
    const StageSeconds seconds = expected_seconds(plan, recipe, host.thread_count(), on_gpu, load);
    for (const std::string& warning : input.warnings) warn(warning);

    // Loading took this process what it will take the run, since images are cropped after all of them are read. Beside a
    // GPU, the host takes no more than if it trained itself.
    Recipe on_host = recipe;
    on_host.gaussians = plan.gaussians, on_host.max_memory = 0;
    const std::uint64_t training = on_gpu ? plan_reconstruction<cpu::Threads>(input, on_host).memory : plan.memory;
    Json json;
    json["memory_bytes"] = std::max(peak_memory_bytes(), training);
    if (on_gpu) json["device_memory_bytes"] = plan.memory;
    json["seconds"] = seconds.total();
    json["seconds_of"] = {{"load", seconds.load},
                          {"registration", seconds.registration},
                          {"training", seconds.training},
                          {"results", seconds.results}};
    if (recipe.seconds == 0) json["steps"] = recipe.length().steps;
    json["people"] = plan.people;
    json["gaussians"] = plan.gaussians * plan.people;
    json["cameras"] = plan.cameras;
    json["frames"] = plan.frames;
    json["training_images"] = plan.training_images;
    json["test_images"] = plan.test_images;
    json["image_bytes"] = plan.image_bytes;
    json["threads"] = host.thread_count();
    json["backend"] = options.machine.backend;
    json["configuration"] = recipe.configuration.name;
    std::printf("%s\n", json.dump(2, ' ', false, Json::error_handler_t::replace).c_str());
    return exit_done;
}

} // namespace gsh::programs
