// SPDX-License-Identifier: Apache-2.0
#include "reconstruct/load_input.hpp"

#include "common/input_files.hpp"
#include "common/machine.hpp"
#include "common/progress.hpp"

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/io/capture/people_capture.hpp>
#include <gsh/loss/cpu/lpips.hpp>
#include <gsh/setup/configuration.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>
#include <gsh/synthetic/studio.hpp>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <system_error>
#include <utility>

namespace gsh::programs {

namespace {

/// Throws for a map that an estimator made of a photograph that training must not use.
void check_priors(const EstimatedPriors& priors, const Capture& capture) {
    for (const auto* views : {&priors.depths, &priors.normals})
        for (const EstimatedView& view : *views)
            check_value(!view.frame || !capture.is_held_out(*view.frame), view.name,
                        "is of frame " + std::to_string(view.frame.value_or(0)) +
                            ", which --hold-out-motion leaves out of training; expected maps of other frames");
}

/// Half of a memory, at least a byte. The rest is for training and for what is made of a few images.
std::uint64_t half_of(std::uint64_t memory) {
    return std::max<std::uint64_t>(memory / 2, 1);
}

} // namespace

ReconstructionInput load_people(cpu::Threads& backend, const PeopleOptions& o, const CaptureOptions& how) {
    ReconstructionInput input;
    CaptureOptions options = how;
    options.input_fps = o.input_fps;
    options.image_memory = half_of(memory_of_machine());
    if (how.image_memory > 0) options.image_memory = std::min(options.image_memory, how.image_memory);
    if (o.image_memory > 0) options.image_memory = o.image_memory;
    for (const auto& file : o.bodies) input.bodies.push_back(body_of_file(file));
    const std::vector<std::filesystem::path> poses(o.poses.begin(), o.poses.end());
    PeopleCapture loaded = people_of_folder(backend, o.capture, input.bodies, poses, options, input.warnings);
    input.capture = std::move(loaded.any.capture);
    input.people = std::move(loaded.people);
    if (loaded.any.rig) input.bodies.assign(1, std::move(loaded.any.rig->body));
    return input;
}

ReconstructionInput load_input(cpu::Threads& backend, const ReconstructOptions& o) {
    ReconstructionInput input;
    if (o.synthetic) {
        Progress shown("filming the built-in actor");
        shown.show(0, "");
        input.bodies.push_back(make_actor());
        StudioParams studio;
        studio.progress = [&](double share) { shown.show(share, ""); };
        input.capture = film(backend, input.bodies[0], actor_motion(ActorMotion::talk, 12), studio);
        input.capture.name = "the built-in actor";
        if (const auto span = held_out_span(o)) hold_out_motion(input.capture, *span);
        input.people.push_back({"actor", 0, input.capture.motion});
    } else {
        const bool limits_host = o.max_memory > 0 && o.machine.backend != "cuda";
        input = load_people(backend, o,
                            {.hold_out = held_out_span(o), .image_memory = limits_host ? half_of(o.max_memory) : 0});
        if (input.bodies[0].faces.empty())
            input.warnings.push_back(o.capture.string() +
                                     ": its body has no triangles, so each person gets one Gaussian per vertex; "
                                     "region mask, priors and --gaussians have no effect; regions have no figures");
    }
    for (const BodyModel& body : input.bodies)
        input.regions.push_back(o.regions.empty() ? RegionLists() : regions_of_file(o.regions, body.vertex_count()));
    if (!o.regions.empty()) input.regions_checksum = file_checksum(o.regions);
    if (!o.keypoints.empty()) {
        std::error_code ignored;
        const bool in_capture = std::filesystem::exists(o.capture / o.keypoints, ignored);
        const std::filesystem::path path = in_capture ? o.capture / o.keypoints : o.keypoints;
        input.keypoints = keypoints_of_file(path, input.capture);
        input.keypoints_checksum = keypoints_checksum(input.keypoints);
    }
    input.priors.resize(input.people.size());
    if (!o.priors.empty()) {
        std::vector<std::string> names;
        for (const CapturePerson& person : input.people) names.push_back(person.name);
        input.priors = priors_of_file(o.priors, input.capture, names);
        for (const EstimatedPriors& priors : input.priors) check_priors(priors, input.capture);
        input.priors_checksum = priors_checksum(o.priors);
    }
    return input;
}

Recipe recipe_of(const ReconstructOptions& o, Configuration configuration) {
    const std::uint64_t usual = o.synthetic ? 1000 : configuration.usual_steps(); // a demo is short
    return {.configuration = std::move(configuration),
            .steps = o.steps == 0 ? usual : o.steps,
            .seconds = o.seconds,
            .gaussians = o.gaussians,
            .seed = o.seed,
            .refine = o.refine,
            .refine_cameras = o.refine_cameras,
            .registration = !o.no_registration,
            .fine_registration = o.fine_registration,
            .max_memory = o.max_memory};
}

Recipe recipe_for(const ReconstructOptions& o, ReconstructionInput& input) {
    const Configuration usual = configuration_of(o);
    if (input.has_meshes() || o.config || !usual.avatar.light) return recipe_of(o, usual);
    ReconstructOptions other = o;
    other.config = "paper";
    const Configuration fallback = configuration_of(other);
    // --set requests light; the estimate of the light refuses the body
    if (fallback.avatar.light) return recipe_of(o, usual);
    input.warnings.push_back(o.capture.string() + ": its body has no triangles for light to fall on, so the " +
                             "configuration is paper instead of " + std::string(default_configuration));
    return recipe_of(o, fallback);
}

std::optional<LpipsNetwork> lpips_of(const ReconstructOptions& o) {
    if (o.lpips.empty()) return std::nullopt;
    return lpips_of_file(o.lpips);
}

Judge<cpu::Threads> judge_for(cpu::Threads& backend, const ReconstructionInput& input, const ReconstructOptions& o) {
    return {backend, input, lpips_of(o), o.lpips_table ? LpipsScaling::table : LpipsScaling::correct};
}

} // namespace gsh::programs
