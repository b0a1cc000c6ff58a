// SPDX-License-Identifier: Apache-2.0
#include "support/reconstruction.hpp"

#include "support/interrupts.hpp"
#include "support/messages.hpp"
#include "support/progress.hpp"
#include "support/rasterizer.hpp"

#include <gsh/core/error.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/io/capture/photos.hpp>
#include <gsh/train/avatar_export.hpp>
#include <gsh/train/frozen_scene.hpp>
#include <gsh/train/light_estimate.hpp>
#include <gsh/train/memory.hpp>
#include <gsh/train/pose_fit.hpp>

#include <algorithm>
#include <set>
#include <string>

namespace gsh::examples {

namespace {

/// The number of Gaussians of each person: as requested, or as many as fit into --max-memory.
/// Errors  ValueError if less than a tenth of the requested number fits.
std::size_t gaussian_count(const Source& source, const Configuration& configuration, const ReconstructOptions& o) {
    if (o.max_memory == 0) return o.gaussians;
    std::size_t pixels = 0;
    for (const auto& camera : source.capture.cameras)
        pixels = std::max(pixels, static_cast<std::size_t>(camera.camera.width) *
                                      static_cast<std::size_t>(camera.camera.height));
    std::size_t held = 0; // bytes of photographs that are in memory already
    for (const auto& image : source.capture.images) held += image.data.size();
    const MemoryModel memory =
        training_memory<Reconstruction::Backend>(configuration.avatar, pixels, held, source.people.size(),
                                                 {.joint_count = source.body().joint_count(),
                                                  .vertex_count = source.body().vertex_count()});
    const std::size_t count = std::min(o.gaussians, memory.gaussians_within(o.max_memory));
    if (count < o.gaussians / 10)
        throw ValueError("--max-memory " + std::to_string(o.max_memory) + " is too little: training " +
                         std::to_string(o.gaussians) + " Gaussians takes about " +
                         std::to_string(memory.bytes(o.gaussians)) + " bytes, a tenth of them " +
                         std::to_string(memory.bytes(o.gaussians / 10)));
    if (count < o.gaussians)
        warn(std::to_string(count) + " instead of " + std::to_string(o.gaussians) + " Gaussians, to stay within " +
             std::to_string(o.max_memory) + " bytes");
    return count;
}

} // namespace

Reconstruction::Person::Person(Backend& backend, std::string called, CanonicalSetup made, std::uint64_t seed,
                               const AvatarConfig& config)
    : name(std::move(called)), setup(std::move(made)),
      model(make_avatar<Backend>(backend, setup.rig, setup.samples, setup.motion.frame_count(), seed, config,
                                  setup.priors)) {}

Reconstruction::Reconstruction(Backend& backend, const Source& source, const Configuration& chosen,
                               const ReconstructOptions& o)
    : configuration(chosen),
      regions_checksum(chosen.has_regions() ? source.regions_checksum : std::string()),
      priors_checksum(chosen.has_priors() ? source.priors_checksum : std::string()),
      test_photos(test_photos_of(source.capture)), held_out_frames(source.capture.held_out_frames),
      scene(backend, cast_of(backend, source, o)),
      trainer(backend, scene, photos_of(source.capture, false), o.seed, configuration.train) {
    if (configuration.avatar.light) light_people(backend);
    if (!held_out_frames.empty())
        motion_split =
            split_by_motion(trainer.photos(), test_photos, held_out_frames, source.capture.motion.timestamps);
    if (!o.refine) return;
    check_value(configuration.test_mask_weight >= 0, "refine.test_mask_weight",
                "must not be negative"); // checked before training
    RefinementConfig config = configuration.refinement;
    std::set<std::size_t> seen;
    for (const Photo& photo : trainer.photos()) seen.insert(photo.frame);
    for (std::size_t frame = 0; frame < scene.frame_count(); ++frame)
        if (!seen.contains(frame)) config.left_out.push_back(frame);
    std::vector<Camera<double>> cameras; // shared by all people; the first person's refinement holds them
    if (o.refine_cameras)
        for (const auto& camera : source.capture.cameras) cameras.push_back(camera.camera);
    for (std::size_t p = 0; p < people.size(); ++p) {
        Person& person = people[p];
        config.joint_rates =
            joint_rates(person.setup.rig.joint_count(), configuration.finger_rate, configuration.face_rate);
        person.refinement.emplace(backend, person.setup.rig, person.setup.motion,
                                  p == 0 ? cameras : std::vector<Camera<double>>(), config);
        scene.refine(*person.refinement, p);
    }
}

Reconstruction::~Reconstruction() = default;

void Reconstruction::light_people(Backend& backend) {
    const AvatarConfig& config = configuration.avatar;
    std::vector<LitPerson> lit;
    for (const Person& person : people) lit.push_back({&person.setup.rig, &person.setup.motion});
    try {
        light_estimate = estimate_light(backend, Span<const LitPerson>(lit), Span<const Photo>(trainer.photos()),
                                        {.points = static_cast<std::size_t>(config.light_points),
                                         .directions = static_cast<std::size_t>(config.light_directions),
                                         .distance = config.light_distance,
                                         .shadows = config.light_shadows});
    } catch (const ValueError& error) {
        throw ValueError(std::string(error.what()) + "; or train without a light, by --config paper");
    }
    const auto light = std::make_shared<LearnedLight<Backend>>(
        backend, light_estimate->light,
        LightRates{config.rates.light_points, config.rates.light_intensities, config.rates.light_gloss});
    for (std::size_t p = 0; p < people.size(); ++p) people[p].model.set_light(people[p].setup.rig, light, p == 0);
}

void Reconstruction::step(double progress) { trainer.step(progress, clock); }
double Reconstruction::last_loss() const { return trainer.last_loss().loss; }
double Reconstruction::last_psnr() const { return trainer.last_psnr(); }

Comparison<float> Reconstruction::compare(const Photo& photo) { return gsh::compare(trainer, photo); }

std::vector<AvatarData> Reconstruction::avatars() {
    std::vector<AvatarData> result;
    const std::vector<std::size_t> frames = photographed_frames(trainer.photos());
    for (std::size_t p = 0; p < people.size(); ++p)
        result.push_back(export_avatar(scene, people[p].setup.rig, frames, trainer.config().filter, p));
    return result;
}

bool Reconstruction::refine_test_poses(Backend& backend) {
    for (std::size_t p = 0; p < people.size(); ++p) {
        Person& person = people[p];
        person.refinement->carry_to_left_out();
        person.test_refinement.emplace(backend, person.setup.rig, person.refinement->motion(),
                                       std::vector<Camera<double>>(), test_time_config(person.refinement->config()));
        scene.refine(*person.test_refinement, p);
    }
    std::set<std::size_t> frames;
    for (const Photo& photo : test_photos) frames.insert(photo.frame);
    const std::size_t rounds = people.size() > 1 ? 2 : 1, steps = (configuration.test_steps + rounds - 1) / rounds;
    PoseFit<Backend> fit(backend, configuration.train.filter,
                         {.steps = steps,
                          .ssim_weight = configuration.train.ssim_weight,
                          .mask_weight = configuration.test_mask_weight,
                          .background = configuration.train.background,
                          .stop = [] { return interrupted.load(); }});
    Progress shown("fitting test poses");
    std::size_t done = 0;
    for (const std::size_t frame : frames) {
        shown.show(static_cast<double>(done++) / static_cast<double>(frames.size()), "frame " + std::to_string(frame));
        std::vector<Photo> photos;
        for (const Photo& photo : test_photos)
            if (photo.frame == frame) photos.push_back(photo);
        for (std::size_t turn = 0; turn < rounds * people.size(); ++turn) {
            FrozenPerson<Scene> frozen(scene, turn % people.size());
            fit.fit(frozen, frame, photos);
            if (interrupted) return false;
        }
    }
    shown.show(1, "done");
    return true;
}

void Reconstruction::end_test_refinement() {
    for (std::size_t p = 0; p < people.size(); ++p) scene.refine(*people[p].refinement, p);
}

std::vector<CastMember<Reconstruction::Model>> Reconstruction::cast_of(Backend& backend, const Source& source,
                                                                        const ReconstructOptions& o) {
    std::vector<CastMember<Model>> cast;
    const std::size_t count = examples::gaussian_count(source, configuration, o);
    for (std::size_t p = 0; p < source.people.size(); ++p) {
        const CapturePerson& from = source.people[p];
        const std::uint64_t seed = p == 0 ? o.seed : random_bits(o.seed, p);
        CanonicalSetup setup = make_canonical_setup(backend, source.body(p), from.motion, configuration, count, seed,
                                                    source.regions[from.body], source.priors[p]);
        Person& person = people.emplace_back(backend, from.name, std::move(setup), seed, configuration.avatar);
        cast.push_back({&person.model, &person.setup.motion});
    }
    return cast;
}

void TrainingRecord::add_sample(double loss_value, double psnr_value) {
    loss.emplace_back(static_cast<double>(steps), loss_value);
    psnr.emplace_back(static_cast<double>(steps), psnr_value);
    constexpr std::size_t most = 600;
    if (loss.size() < most) return;
    interval *= 2;
    for (auto* curve : {&loss, &psnr})
        std::erase_if(*curve, [&](const auto& point) {
            return point.first != 1 && static_cast<std::uint64_t>(point.first) % interval != 0;
        });
}

} // namespace gsh::examples
