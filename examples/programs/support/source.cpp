// SPDX-License-Identifier: Apache-2.0
#include "support/source.hpp"

#include "support/figures.hpp"
#include "support/input_files.hpp"
#include "support/progress.hpp"

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/io/capture/photos.hpp>
#include <gsh/loss/metrics.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>
#include <gsh/synthetic/studio.hpp>
#include <gsh/train/configuration.hpp>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <system_error>
#include <utility>

namespace gsh::examples {

namespace {

/// Throws for a map that an estimator made of a photograph that training must not use.
void check_priors(const EstimatedPriors& priors, const Capture& capture) {
    for (const auto* views : {&priors.depths, &priors.normals})
        for (const EstimatedView& view : *views)
            check_value(!view.frame || !capture.is_held_out(*view.frame), view.name,
                        "is of frame " + std::to_string(view.frame.value_or(0)) +
                            ", which --hold-out-motion leaves out of training; expected maps of other frames");
}

} // namespace

PosedBody Source::posed(std::size_t person, std::size_t frame) const {
    const Motion& motion = people[person].motion;
    return pose_body(body(person), motion.pose_at(frame), motion.transl[frame], motion.betas,
                     motion.expression_at(frame));
}

BodyRegions Source::body_regions_of(std::size_t person) const {
    return body_regions(body(person), regions[people[person].body]);
}

Source load_people(cpu::Threads& backend, const PeopleOptions& o, const CaptureOptions& how) {
    Source source;
    CaptureOptions options = how;
    options.input_fps = o.input_fps;
    for (const auto& file : o.bodies) source.bodies.push_back(body_of_file(file));
    const std::vector<std::filesystem::path> poses(o.poses.begin(), o.poses.end());
    PeopleCapture loaded = people_of_folder(backend, o.capture, source.bodies, poses, options, source.warnings);
    source.capture = std::move(loaded.any.capture);
    source.people = std::move(loaded.people);
    if (loaded.any.rig) source.bodies.assign(1, std::move(loaded.any.rig->body));
    return source;
}

Source load_source(cpu::Threads& backend, const ReconstructOptions& o) {
    Source source;
    if (o.synthetic) {
        Progress shown("filming the built-in actor");
        shown.show(0, "");
        source.bodies.push_back(make_actor());
        StudioParams studio;
        studio.progress = [&](double share) { shown.show(share, ""); };
        source.capture = film(backend, source.bodies[0], actor_motion(ActorMotion::talk, 12), studio);
        source.capture.name = "the built-in actor";
        if (const auto span = held_out_span(o)) hold_out_motion(source.capture, *span);
        source.people.push_back({"actor", 0, source.capture.motion});
    } else {
        source = load_people(backend, o, {.hold_out = held_out_span(o)});
        if (source.bodies[0].faces.empty())
            source.warnings.push_back(o.capture.string() +
                                      ": its body has no triangles, so each person gets one Gaussian per vertex; "
                                      "region mask, priors and --gaussians have no effect; regions have no figures");
    }
    for (const BodyModel& body : source.bodies)
        source.regions.push_back(o.regions.empty() ? RegionLists() : regions_of_file(o.regions, body.vertex_count()));
    if (!o.regions.empty()) source.regions_checksum = file_checksum(o.regions);
    if (!o.keypoints.empty()) {
        std::error_code ignored;
        const bool in_capture = std::filesystem::exists(o.capture / o.keypoints, ignored);
        const std::filesystem::path path = in_capture ? o.capture / o.keypoints : o.keypoints;
        source.keypoints = keypoints_of_file(path, source.capture);
        source.keypoints_checksum = keypoints_checksum(source.keypoints);
    }
    source.priors.resize(source.people.size());
    if (!o.priors.empty()) {
        std::vector<std::string> names;
        for (const CapturePerson& person : source.people) names.push_back(person.name);
        source.priors = priors_of_file(o.priors, source.capture, names);
        for (const EstimatedPriors& priors : source.priors) check_priors(priors, source.capture);
        source.priors_checksum = priors_checksum(o.priors);
    }
    return source;
}

Configuration configuration_for(const ReconstructOptions& o, Source& source) {
    const Configuration usual = configuration_of(o);
    const bool meshes = std::none_of(source.people.begin(), source.people.end(), [&](const CapturePerson& person) {
        return source.bodies[person.body].faces.empty();
    });
    if (meshes || o.config || !usual.avatar.light) return usual;
    ReconstructOptions other = o;
    other.config = "paper";
    const Configuration fallback = configuration_of(other);
    if (fallback.avatar.light) return usual; // --set requests light; the estimate of the light refuses the body
    source.warnings.push_back(o.capture.string() + ": its body has no triangles for light to fall on, so the " +
                              "configuration is paper instead of " + std::string(default_configuration));
    return fallback;
}

std::vector<Photo> test_photos_of(const Capture& capture) {
    std::vector<Photo> photos = photos_of(capture, true);
    const auto is_new = [&](const Photo& photo) { return capture.is_held_out(photo.frame); };
    check_value(capture.held_out_frames.empty() || std::any_of(photos.begin(), photos.end(), is_new),
                "--hold-out-motion",
                "leaves out frames " + frames_text(capture.held_out_frames) +
                    ", of which there is no test image; expected a span that test cameras filmed");
    for (const Photo& photo : photos) {
        constexpr int least = SsimWindow<double>::size;
        check_value(photo.camera.width >= least && photo.camera.height >= least, "test image " + photo.name,
                    "is " + std::to_string(photo.camera.width) + " x " + std::to_string(photo.camera.height) +
                        " pixels, expected at least " + std::to_string(least) + " x " + std::to_string(least) +
                        " for SSIM");
        bool person = false;
        for (std::size_t i = 3; i < photo.rgba.size() && !person; i += 4) person = photo.rgba[i] > 127;
        check_value(person, "test image " + photo.name,
                    "has a mask (alpha) that nowhere exceeds 1/2, expected a mask that shows a person");
    }
    return photos;
}

} // namespace gsh::examples
