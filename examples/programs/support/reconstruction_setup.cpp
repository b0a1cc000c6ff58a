// SPDX-License-Identifier: Apache-2.0
#include "support/reconstruction_setup.hpp"

#include "support/figures.hpp"
#include "support/machine.hpp"
#include "support/messages.hpp"
#include "support/progress.hpp"
#include "support/source.hpp"

#include <gsh/core/error.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/image/chroma.hpp>
#include <gsh/image/trimap.hpp>
#include <gsh/cpu.hpp>
#include <gsh/io/capture/photos.hpp>
#include <gsh/train/canonical_setup.hpp>
#include <gsh/train/light_estimate.hpp>
#include <gsh/train/memory.hpp>

#include <algorithm>
#include <cstdio>
#include <set>
#include <utility>

namespace gsh::examples {

namespace {

/// Bytes in the memory that --max-memory limits, which training needs beside the avatars: the plates and the cropped
/// photographs. A GPU has three of each at least (FetchAhead).
std::size_t bytes_of_images(const Machine& machine, const ReconstructionSetup& setup) {
    struct Sum {
        std::size_t all = 0, largest = 0;
        void add(std::size_t size) { all += size, largest = std::max(largest, size); }
    } plates, pictures;
    std::set<const std::uint8_t*> known; // photographs share plates
    for (const auto* photos : {&setup.photos, &setup.test_photos})
        for (const Photo& photo : *photos) {
            if (known.insert(photo.plate.data()).second) plates.add(photo.plate.size());
            pictures.add(4 * box_of_photo(photo).size());
        }
    std::size_t bytes = 0;
    for (const Sum& images : {plates, pictures})
        bytes += machine.has_gpu() ? std::min(images.all, 3 * images.largest) : images.all;
    return bytes;
}

/// The number of Gaussians of each person: as requested, or as many as fit into --max-memory. What they leave of a GPU's
/// memory is for plates and photographs (TrainConfig::photo_memory).
/// Errors  ValueError if less than a tenth of the requested number fits.
std::size_t gaussians_within_memory(const Machine& machine, const Source& source, const ReconstructionSetup& setup,
                                    const ReconstructOptions& o, Configuration& configuration) {
    if (o.max_memory == 0) return o.gaussians;
    std::size_t pixels = 0;
    for (const auto& camera : source.capture.cameras)
        pixels = std::max(pixels, static_cast<std::size_t>(camera.camera.width) *
                                      static_cast<std::size_t>(camera.camera.height));
    const MemoryModel memory = training_memory<cpu::Threads>(
        configuration.avatar, pixels, bytes_of_images(machine, setup), source.people.size(),
        {.joint_count = source.body().joint_count(),
         .vertex_count = source.body().vertex_count(),
         .frame_count = source.capture.frame_count()},
        machine.has_gpu() ? device_costs : host_costs);
    const std::size_t count = std::min(o.gaussians, memory.gaussians_within(o.max_memory));
    if (count < o.gaussians / 10)
        throw ValueError("--max-memory " + std::to_string(o.max_memory) + " is too little: training " +
                         std::to_string(o.gaussians) + " Gaussians takes about " +
                         std::to_string(memory.bytes(o.gaussians)) + " bytes, a tenth of them " +
                         std::to_string(memory.bytes(o.gaussians / 10)));
    if (count < o.gaussians)
        warn(std::to_string(count) + " instead of " + std::to_string(o.gaussians) + " Gaussians, to stay within " +
             std::to_string(o.max_memory) + " bytes");
    if (machine.has_gpu())
        configuration.train.photo_memory = std::max<std::uint64_t>(o.max_memory - memory.bytes(count), 1);
    return count;
}

/// Estimates the light that all people share.
void add_light(cpu::Threads& host, ReconstructionSetup& setup) {
    const AvatarConfig& config = setup.configuration.avatar;
    std::vector<LitPerson> lit;
    for (const auto& person : setup.people) lit.push_back({&person.rig, &person.motion});
    try {
        LightEstimate estimate = estimate_light(host, Span<const LitPerson>(lit), Span<const Photo>(setup.photos),
                                                {.points = static_cast<std::size_t>(config.light_points),
                                                 .directions = static_cast<std::size_t>(config.light_directions),
                                                 .distance = config.light_distance,
                                                 .shadows = config.light_shadows});
        char text[192];
        std::snprintf(text, sizeof text,
                      "light from %zu colours of the mesh: a colour per vertex explains them to %.1f dB, with light "
                      "to %.1f dB",
                      estimate.samples, estimate.psnr_even, estimate.psnr);
        setup.light = std::move(estimate.light);
        setup.light_text = text;
    } catch (const ValueError& error) {
        throw ValueError(std::string(error.what()) + "; or train without a light, by --config paper");
    }
}

/// The refinement of --refine. Poses of frames without a photograph in training do not learn.
RefinementConfig refinement_of(const ReconstructionSetup& setup) {
    check_value(setup.configuration.test_mask_weight >= 0, "refine.test_mask_weight",
                "must not be negative"); // checked before training
    RefinementConfig config = setup.configuration.refinement;
    std::set<std::size_t> seen;
    for (const Photo& photo : setup.photos) seen.insert(photo.frame);
    for (std::size_t frame = 0; frame < setup.people[0].motion.frame_count(); ++frame)
        if (!seen.contains(frame)) config.left_out.push_back(frame);
    return config;
}

} // namespace

std::size_t ReconstructionSetup::gaussian_count() const {
    std::size_t count = 0;
    for (const Person& person : people) count += person.gaussian_count();
    return count;
}

std::string run_text(const Source& source, const Configuration& configuration, const ReconstructOptions& o) {
    std::string text;
    if (source.people.size() > 1)
        for (const CapturePerson& person : source.people) text += "person " + person.name + "\n";
    for (const auto& [key, value] : settings_of(configuration)) text += key + " = " + value + "\n";
    if (o.refine) text += o.refine_cameras ? "refine, cameras too\n" : "refine\n";
    if (o.no_registration) text += "not registered\n";
    if (o.fine_registration > 0) text += "fine registration " + std::to_string(o.fine_registration) + "\n";
    if (!source.keypoints_checksum.empty()) text += "keypoints " + source.keypoints_checksum + "\n";
    if (configuration.has_regions() && !source.regions_checksum.empty())
        text += "regions " + source.regions_checksum + "\n";
    if (configuration.has_priors() && !source.priors_checksum.empty())
        text += "priors " + source.priors_checksum + "\n";
    if (!source.capture.held_out_frames.empty())
        text += "held-out frames " + frames_text(source.capture.held_out_frames) + "\n";
    return text;
}

ReconstructionSetup make_setup(Machine& machine, const Source& source, const Configuration& configuration,
                               const ReconstructOptions& o) {
    const Progress shown("preparing the avatar");
    ReconstructionSetup setup;
    setup.configuration = configuration;
    setup.seed = o.seed;
    setup.run = run_text(source, configuration, o);
    setup.registered = source.registration.has_value();
    setup.test_photos = test_photos_of(source.capture);
    setup.photos = photos_of(source.capture, false);
    check_value(!setup.photos.empty(), source.capture.name, "has no photographs to train on");
    setup.unknown.reserve(setup.photos.size());
    for (Photo& photo : setup.photos) {
        setup.unknown.push_back(
            with_hidden(unknown_pixels(photo.rgba, photo.camera.height, photo.camera.width,
                                       configuration.unknown_band * photo.camera.height),
                        photo.unknown));
        photo.unknown = Span<const UnknownPixel>(setup.unknown.back());
        photo.half_chroma =
            configuration.half_chroma && has_half_chroma(photo.rgba, photo.camera.height, photo.camera.width);
        if (source.registration) photo.weight = source.registration->frame_weights[photo.frame];
    }
    setup.held_out_frames = source.capture.held_out_frames;
    const std::size_t count = gaussians_within_memory(machine, source, setup, o, setup.configuration);
    for (std::size_t p = 0; p < source.people.size(); ++p) {
        const CapturePerson& from = source.people[p];
        const std::uint64_t seed = p == 0 ? o.seed : random_bits(o.seed, p);
        CanonicalSetup made = make_canonical_setup(machine.host(), source.body(p), from.motion, configuration, count,
                                                   seed, source.regions[from.body], source.priors[p]);
        setup.people.push_back({from.name, seed, std::move(made.motion), std::move(made.samples), std::move(made.rig),
                                std::move(made.priors)});
    }
    if (configuration.avatar.light) add_light(machine.host(), setup);
    if (!setup.held_out_frames.empty())
        setup.motion_split =
            split_by_motion(setup.photos, setup.test_photos, setup.held_out_frames, source.capture.motion.timestamps);
    if (o.refine) setup.refinement = refinement_of(setup);
    if (o.refine_cameras)
        for (const auto& camera : source.capture.cameras) setup.cameras.push_back(camera.camera);
    return setup;
}

void take_photographs(ReconstructionSetup& setup, Capture& capture) {
    for (auto* photos : {&setup.photos, &setup.test_photos})
        for (Photo& photo : *photos) {
            setup.pixels.push_back(crop_photo(photo));
            capture.image({photo.camera_index, photo.frame}) = {};
        }
    for (PixelImage& image : capture.images) image = {}; // those for neither training nor evaluation
}

} // namespace gsh::examples
