// SPDX-License-Identifier: Apache-2.0
/// @file  What the training of a reconstruction starts from, made on the host for training on any backend.
#pragma once

#include <gsh/avatar/rig.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/image/chroma.hpp>
#include <gsh/image/pixel_box.hpp>
#include <gsh/image/trimap.hpp>
#include <gsh/io/capture/capture_data.hpp>
#include <gsh/io/capture/photos.hpp>
#include <gsh/light/light.hpp>
#include <gsh/model/canonical_points.hpp>
#include <gsh/model/configured_avatar.hpp>
#include <gsh/model/configured_avatar_params.hpp>
#include <gsh/photo/photo.hpp>
#include <gsh/photo/photo_prefetcher.hpp>
#include <gsh/reconstruct/input.hpp>
#include <gsh/reconstruct/observer.hpp>
#include <gsh/reconstruct/recipe.hpp>
#include <gsh/refine/refinement_params.hpp>
#include <gsh/setup/canonical_setup.hpp>
#include <gsh/setup/configuration.hpp>
#include <gsh/setup/light_estimate.hpp>
#include <gsh/train/evaluation.hpp>
#include <gsh/train/memory.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// What a reconstruction trains: people with their Gaussians, photographs, light, and how they learn.
struct ReconstructionSetup {
    /// One of the people: a name, random numbers of its own, and what make_canonical_setup returns.
    struct Person {
        std::string name;
        std::uint64_t seed = 0;
        Motion motion; ///< in the rig's joints
        SurfaceSamples samples;
        RigData rig;
        CanonicalPriors priors; ///< until a Reconstruction takes them

        [[nodiscard]] std::size_t gaussian_count() const { return samples.size(); }
    };

    Configuration configuration;
    std::uint64_t seed = 0;
    std::string run; ///< run_text
    std::vector<Person> people;
    std::vector<Photo> photos, test_photos;         ///< for training; for evaluation
    std::vector<std::vector<UnknownPixel>> unknown; ///< of each photograph for training
    std::vector<std::vector<std::uint8_t>> pixels;  ///< of the photographs, after take_photographs
    std::shared_ptr<StoredPhotos> stored;           ///< the source of those for training, if images are stored
    std::vector<std::size_t> held_out_frames;       ///< of the capture; empty if no span of the motion is held out
    std::optional<MotionSplit> motion_split;        ///< of test_photos, if a span is held out
    std::optional<LightData> light;                 ///< with which the light starts, if there is one
    std::string light_text;                         ///< how well it explains the photographs
    bool registered = false;                        ///< whether motions were registered before (register_people)
    std::optional<RefinementParams> refinement;     ///< of the poses, with refine; joint_rates are each person's own
    std::vector<Camera<double>> cameras;            ///< that are refined, too; or none
    std::vector<std::string> warnings;              ///< about the choice of the number of Gaussians

    /// The number of Gaussians of all people.
    [[nodiscard]] std::size_t gaussian_count() const {
        std::size_t count = 0;
        for (const Person& person : people) count += person.gaussian_count();
        return count;
    }
};

/// The input and the settings of a run, one per line: people if there are several, settings, refinement, regions,
/// estimated priors, frames that are held out. A checkpoint belongs to one such text.
[[nodiscard]] inline std::string run_text(const ReconstructionInput& input, const Recipe& recipe);

/// Places the Gaussians of all people, and estimates the light. The input must outlive the result, because photographs
/// are not copied. `on_device`: training runs on a device with memory of its own, to which recipe.max_memory applies.
///
/// Errors  ValueError without photographs for training, for settings out of range, if recipe.max_memory is too small,
///         or if the light cannot be estimated; those of make_canonical_setup and test_photos_of.
template <class Parts = AvatarParts, CpuBackend B>
[[nodiscard]] ReconstructionSetup make_setup(B& host, const ReconstructionInput& input, const Recipe& recipe,
                                             const Observer& observer = {}, bool on_device = false);

/// Crops the photographs (crop_photo), makes their pixels the setup's own, and drops the images of the capture. Stored
/// images stay stored.
inline void take_photographs(ReconstructionSetup& setup, Capture& capture) {
    for (auto* photos : {&setup.photos, &setup.test_photos})
        for (Photo& photo : *photos) {
            if (photo.source) continue;
            setup.pixels.push_back(crop_photo(photo));
            capture.image({photo.camera_index, photo.frame}) = {};
        }
    for (PixelImage& image : capture.images) image = {}; // those for neither training nor evaluation
}

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// The box of a photograph; of a stored one, without its unknown pixels.
inline PixelBox box_of_photo(const Capture& capture, const Photo& photo) {
    return capture.stored ? capture.stored->facts[photo.source_index].mask : gsh::box_of_photo(photo);
}

/// Bytes in the memory that is limited which training needs apart from the avatars: the plates and the cropped
/// photographs. A device has three of each at least (FetchAhead). Of stored photographs, few are in memory at a time.
/// `pixels`: those of the largest image.
inline std::size_t bytes_of_images(const Capture& capture, const ReconstructionSetup& setup, std::size_t pixels,
                                   bool on_device) {
    struct Sum {
        std::size_t all = 0, largest = 0;
        void add(std::size_t size) { all += size, largest = std::max(largest, size); }
    } plates, pictures;
    std::set<const std::uint8_t*> known; // photographs share plates
    for (const auto* photos : {&setup.photos, &setup.test_photos})
        for (const Photo& photo : *photos) {
            if (known.insert(photo.plate.data()).second) plates.add(photo.plate.size());
            pictures.add(4 * box_of_photo(capture, photo).size());
        }
    std::size_t bytes = 0;
    if (capture.stored) { // on any machine the same: the number of Gaussians must not depend on its processors
        constexpr PhotoPrefetchParams most{.threads = most_photo_threads};
        constexpr std::size_t bytes_per_pixel = 30; // of a whole image, its mask and its trimap, while it is read
        pictures.all = std::min(pictures.all, (most.depth + 1) * pictures.largest);
        bytes = (most.threads + 1) * pixels * bytes_per_pixel;
    }
    for (const Sum& images : {plates, pictures})
        bytes += on_device ? std::min(images.all, 3 * images.largest) : images.all;
    return bytes;
}

/// The memory that training takes, where it trains. `setup` has the photographs and the configuration.
template <class Parts, CpuBackend B>
MemoryModel memory_of_training(const ReconstructionInput& input, const ReconstructionSetup& setup, bool on_device) {
    std::size_t pixels = 0;
    for (const auto& camera : input.capture.cameras)
        pixels = std::max(pixels, static_cast<std::size_t>(camera.camera.width) *
                                      static_cast<std::size_t>(camera.camera.height));
    return training_memory<B, Parts>(setup.configuration.avatar, pixels,
                                     bytes_of_images(input.capture, setup, pixels, on_device), input.people.size(),
                                     {.joint_count = input.body().joint_count(),
                                      .vertex_count = input.body().vertex_count(),
                                      .frame_count = input.capture.frame_count()},
                                     on_device ? device_costs : host_costs);
}

/// The number of Gaussians of each person: as requested, or as many as fit into recipe.max_memory. What they leave of a
/// device's memory is for plates and photographs (TrainParams::photo_memory), of the host's for photographs of files.
/// Errors  ValueError if less than a tenth of the requested number fits.
template <class Parts, CpuBackend B>
std::size_t gaussians_within_memory(const ReconstructionInput& input, const Recipe& recipe, bool on_device,
                                    ReconstructionSetup& setup) {
    if (recipe.max_memory == 0) return recipe.gaussians;
    const MemoryModel memory = memory_of_training<Parts, B>(input, setup, on_device);
    const std::size_t count = std::min(recipe.gaussians, memory.gaussians_within(recipe.max_memory));
    if (count < recipe.gaussians / 10)
        throw ValueError("Recipe::max_memory (--max-memory of the programs) is " + std::to_string(recipe.max_memory) +
                         ", which is too little: training " + std::to_string(recipe.gaussians) +
                         " Gaussians takes about " + std::to_string(memory.bytes(recipe.gaussians)) +
                         " bytes, a tenth of them " + std::to_string(memory.bytes(recipe.gaussians / 10)));
    if (count < recipe.gaussians)
        setup.warnings.push_back(std::to_string(count) + " instead of " + std::to_string(recipe.gaussians) +
                                 " Gaussians, to stay within " + std::to_string(recipe.max_memory) + " bytes");
    const std::uint64_t left = recipe.max_memory - std::min(recipe.max_memory, memory.bytes(count));
    if (on_device)
        setup.configuration.train.photo_memory = std::max<std::uint64_t>(left, 1);
    else if (setup.stored)
        setup.stored->keep_within(std::min(left, setup.stored->memory()));
    return count;
}

/// The training photographs with what is known of their masks, colours and poses.
inline void add_photographs(const ReconstructionInput& input, ReconstructionSetup& setup) {
    const Configuration& configuration = setup.configuration;
    setup.test_photos = test_photos_of(input.capture);
    setup.photos = photos_of(input.capture, false);
    check_value(!setup.photos.empty(), input.capture.name, "has no photographs to train on");
    const double band = configuration.unknown_band;
    if (const auto& images = input.capture.stored)
        setup.stored = std::make_shared<StoredPhotos>(input.capture, band, images->memory);
    setup.unknown.reserve(setup.photos.size());
    for (Photo& photo : setup.photos) {
        const int height = photo.camera.height, width = photo.camera.width;
        if (setup.stored) {
            photo.source = setup.stored;
            photo.half_chroma =
                configuration.half_chroma && input.capture.stored->facts[photo.source_index].half_chroma;
        } else {
            setup.unknown.push_back(unbelieved_pixels(photo.rgba, height, width, band, photo.unknown));
            photo.unknown = Span<const UnknownPixel>(setup.unknown.back());
            photo.half_chroma = configuration.half_chroma && has_half_chroma(photo.rgba, height, width);
        }
        if (input.registration) photo.weight = input.registration->frame_weights[photo.frame];
    }
}

/// Estimates the light that all people share.
template <CpuBackend B>
void add_light(B& host, ReconstructionSetup& setup) {
    const ConfiguredAvatarParams& config = setup.configuration.avatar;
    std::vector<LitPerson> lit;
    for (const auto& person : setup.people) lit.push_back({&person.rig, &person.motion});
    try {
        LightEstimate estimate =
            estimate_light(host, Span<const LitPerson>(lit), Span<const Photo>(setup.photos), {.light = config.lights});
        char text[192];
        std::snprintf(text, sizeof text,
                      "light from %zu colours of the mesh: a colour per vertex explains them to %.1f dB, with light "
                      "to %.1f dB",
                      estimate.samples, estimate.psnr_even, estimate.psnr);
        setup.light = std::move(estimate.light);
        setup.light_text = text;
    } catch (const ValueError& error) {
        throw ValueError(std::string(error.what()) +
                         "; or train without a light, by the configuration paper (--config paper)");
    }
}

/// The refinement of poses. Those of frames without a photograph in training do not learn.
inline RefinementParams refinement_of(const ReconstructionSetup& setup) {
    check_ranges("refinement", setup.configuration.test_fit); // before training
    RefinementParams config = setup.configuration.refinement;
    std::set<std::size_t> seen;
    for (const Photo& photo : setup.photos) seen.insert(photo.frame);
    for (std::size_t frame = 0; frame < setup.people[0].motion.frame_count(); ++frame)
        if (!seen.contains(frame)) config.left_out.push_back(frame);
    return config;
}

} // namespace detail

inline std::string run_text(const ReconstructionInput& input, const Recipe& recipe) {
    std::string text;
    if (input.people.size() > 1)
        for (const CapturePerson& person : input.people) text += "person " + person.name + "\n";
    for (const auto& [key, value] : stated_settings_of(recipe.configuration)) text += key + " = " + value + "\n";
    if (recipe.refine) text += recipe.refine_cameras ? "refine, cameras too\n" : "refine\n";
    if (!recipe.registration) text += "not registered\n";
    if (recipe.fine_registration > 0) text += "fine registration " + std::to_string(recipe.fine_registration) + "\n";
    if (!input.keypoints_checksum.empty()) text += "keypoints " + input.keypoints_checksum + "\n";
    if (recipe.configuration.has_regions() && !input.regions_checksum.empty())
        text += "regions " + input.regions_checksum + "\n";
    if (recipe.configuration.has_priors() && !input.priors_checksum.empty())
        text += "priors " + input.priors_checksum + "\n";
    if (!input.capture.held_out_frames.empty())
        text += "held-out frames " + detail::frames_text(input.capture.held_out_frames) + "\n";
    return text;
}

template <class Parts, CpuBackend B>
ReconstructionSetup make_setup(B& host, const ReconstructionInput& input, const Recipe& recipe,
                               const Observer& observer, bool on_device) {
    const ObservedStage stage(observer, "preparing the avatar");
    ReconstructionSetup setup;
    setup.configuration = recipe.configuration;
    setup.seed = recipe.seed;
    setup.run = run_text(input, recipe);
    setup.registered = input.registration.has_value();
    detail::add_photographs(input, setup);
    setup.held_out_frames = input.capture.held_out_frames;
    const std::size_t count = detail::gaussians_within_memory<Parts, B>(input, recipe, on_device, setup);
    for (std::size_t p = 0; p < input.people.size(); ++p) {
        const CapturePerson& from = input.people[p];
        const std::uint64_t seed = p == 0 ? recipe.seed : random_bits(recipe.seed, p);
        CanonicalSetup made = make_canonical_setup(host, input.body(p), from.motion, recipe.configuration, count, seed,
                                                   input.regions_of(p), input.priors_of(p));
        setup.people.push_back({from.name, seed, std::move(made.motion), std::move(made.samples), std::move(made.rig),
                                std::move(made.priors)});
    }
    if (recipe.configuration.avatar.light) detail::add_light(host, setup);
    if (!setup.held_out_frames.empty())
        setup.motion_split =
            split_by_motion(setup.photos, setup.test_photos, setup.held_out_frames, input.capture.motion.timestamps);
    if (recipe.refine) setup.refinement = detail::refinement_of(setup);
    if (recipe.refine_cameras)
        for (const auto& camera : input.capture.cameras) setup.cameras.push_back(camera.camera);
    return setup;
}

} // namespace gsh
