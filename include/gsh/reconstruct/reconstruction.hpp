// SPDX-License-Identifier: Apache-2.0
/// @file  A reconstruction on a backend. A file that includes it also includes the backend's overloads.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/model/checkpoint.hpp>
#include <gsh/model/configured_avatar.hpp>
#include <gsh/photo/reduced_photos.hpp>
#include <gsh/reconstruct/any_reconstruction.hpp>
#include <gsh/reconstruct/input.hpp>
#include <gsh/reconstruct/observer.hpp>
#include <gsh/reconstruct/recipe.hpp>
#include <gsh/reconstruct/register_people.hpp>
#include <gsh/reconstruct/setup.hpp>
#include <gsh/refine/refinement.hpp>
#include <gsh/setup/avatar_export.hpp>
#include <gsh/setup/unseen_points.hpp>
#include <gsh/train/avatar_scene.hpp>
#include <gsh/train/frozen_scene.hpp>
#include <gsh/train/pose_fit.hpp>
#include <gsh/train/stage.hpp>
#include <gsh/train/trainer.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// The reconstruction of one person or several on a backend: models, scene, trainer, refinement.
///
/// Train it by train() (reconstruct/train.hpp), or step by step; then fill_unseen(), and avatars() are ready for files.
/// Parts lists the appearances and ambient occlusions that the recipe may name (AvatarParts).
template <Backend B, class Parts = AvatarParts>
class Reconstruction final : public TrainerCalls<Reconstruction<B, Parts>, AnyReconstruction> {
    using Calls = TrainerCalls<Reconstruction<B, Parts>, AnyReconstruction>;
    friend Calls;

public:
    using Calls::setup;

    /// Of a setup that is made. The backend must outlive this object, and so must the input of the setup.
    Reconstruction(B& backend, ReconstructionSetup made)
        : Reconstruction(backend, taken_priors(made), std::move(made)) {}

    /// Of a capture and its people. Does all that comes before the first step: registers poses (with recipe.refine) on
    /// `backend`, and on `host` places Gaussians and estimates the light. Both backends must outlive this object.
    ///
    /// Errors  those of check_input, register_people and make_setup.
    template <CpuBackend H>
    Reconstruction(B& backend, H& host, ReconstructionInput input, const Recipe& recipe, const Observer& observer = {})
        : Reconstruction(backend, host, std::make_unique<ReconstructionInput>(std::move(input)), recipe, observer) {}
    /// The same where the backend is the host.
    Reconstruction(B& backend, ReconstructionInput input, const Recipe& recipe, const Observer& observer = {})
        requires CpuBackend<B>
        : Reconstruction(backend, backend, std::move(input), recipe, observer) {}

    /// The input that this object was made of, with registered motions; null if it was made of a setup.
    [[nodiscard]] const ReconstructionInput* input() const { return input_.get(); }

    bool queues_steps() const override { return !B::host_memory; }
    void release_memory() override { trainer_.release_memory(); }
    Comparison<float> compare(const Photo& photo) override { return gsh::compare(trainer_, photo); }

    std::vector<AvatarData> avatars() override {
        std::vector<AvatarData> result;
        const std::vector<std::size_t> frames = photographed_frames(setup.photos);
        for (std::size_t p = 0; p < people_.size(); ++p)
            result.push_back(export_avatar(scene_, setup.people[p].rig, frames, trainer_.config().filter, p));
        return result;
    }
    std::vector<std::array<double, 3>> photo_gains() const override { return trainer_.gains().gains(); }
    Motion refined_motion(std::size_t person) const override {
        check_refined("Reconstruction::refined_motion");
        return people_[person].refinement->motion();
    }

    std::vector<std::size_t> fill_unseen() override;
    void end_fill() override {
        for (Person& person : people_) person.model.end_fill();
    }

    bool refine_test_poses(const Observer& observer = {}) override;
    void end_test_refinement() override {
        check_refined("Reconstruction::end_test_refinement");
        for (std::size_t p = 0; p < people_.size(); ++p) scene_.refine(*people_[p].refinement, p);
    }

    void save(ArchiveWriter& file) override {
        add_trainer(file, trainer_);
        for (std::size_t p = 0; p < people_.size(); ++p)
            if (people_[p].refinement) add_refinement(file, *people_[p].refinement, p);
    }
    void load(const ArchiveReader& file) override {
        load_trainer(file, trainer_);
        for (std::size_t p = 0; p < people_.size(); ++p)
            if (people_[p].refinement) load_refinement(file, *people_[p].refinement, p);
    }

    TableCounts table_counts() override {
        TableCounts counts;
        const auto count = [](const LearnedArrays<float>& arrays, std::size_t& entries, std::size_t& touched) {
            for (const LearnedArray<float>& array : arrays) {
                if (!array.is_table()) continue;
                entries += array.values.size() / array.row_size;
                touched += array.touched_rows.size();
            }
        };
        for (Person& person : people_) {
            counts.lookups += person.model.appearance().lookups();
            count(person.model.appearance().learned(), counts.entries, counts.touched);
            count(person.model.occlusion().learned(), counts.ao_entries, counts.ao_touched);
        }
        return counts;
    }

private:
    using Model = ConfiguredAvatar<B>;
    using Scene = AvatarScene<B, Model>;
    using Refinement = MotionRefinement<B, float>;

    struct Person {
        Model model;
        std::optional<Refinement> refinement, test_refinement; // of training frames; of test frames

        Person(B& backend, const ReconstructionSetup::Person& from, const CanonicalPriors& priors,
               const ConfiguredAvatarParams& config, ModelLight<B> light)
            : model(make_avatar<B, Parts>(backend, from.rig, from.samples, from.motion.frame_count(), from.seed, config,
                                          priors, std::move(light))) {}
    };
    using PriorsOfPeople = std::vector<CanonicalPriors>;

    Reconstruction(B& backend, const PriorsOfPeople& priors, ReconstructionSetup&& made)
        : Calls(std::move(made)), backend_(&backend), scene_(backend, cast(priors)),
          trainer_(backend, scene_, setup.photos, setup.seed, setup.configuration.train), timer_(backend) {
        if (setup.refinement) refine_people();
    }

    template <CpuBackend H>
    Reconstruction(B& backend, H& host, std::unique_ptr<ReconstructionInput> input, const Recipe& recipe,
                   const Observer& observer)
        : Reconstruction(backend, setup_of(backend, host, *input, recipe, observer)) {
        input_ = std::move(input);
    }
    template <CpuBackend H>
    static ReconstructionSetup setup_of(B& backend, H& host, ReconstructionInput& input, const Recipe& recipe,
                                        const Observer& observer) {
        check_input(input);
        check_settings<Parts>(recipe.configuration, "Recipe::configuration");
        if (recipe.refine && recipe.registration) register_people(backend, host, input, recipe, observer);
        ReconstructionSetup made = make_setup<Parts>(host, input, recipe, observer, !B::host_memory);
        take_photographs(made, input.capture);
        return made;
    }

    /// The models have copies of the priors, which are large, so the setup gives its own away.
    static PriorsOfPeople taken_priors(ReconstructionSetup& made) {
        PriorsOfPeople priors;
        for (ReconstructionSetup::Person& person : made.people) priors.push_back(std::exchange(person.priors, {}));
        return priors;
    }
    std::vector<CastMember<Model>> cast(const PriorsOfPeople& priors) {
        const ConfiguredAvatarParams& config = setup.configuration.avatar;
        SharedLight<B> light; // of all people; the first announces it
        if (setup.light) light = std::make_shared<LearnedLight<B>>(*backend_, *setup.light, config.light_rates);
        std::vector<CastMember<Model>> cast;
        for (std::size_t p = 0; p < setup.people.size(); ++p) {
            const ReconstructionSetup::Person& from = setup.people[p];
            Person& person = people_.emplace_back(*backend_, from, priors[p], config, ModelLight<B>{light, p == 0});
            cast.push_back({&person.model, &from.motion});
        }
        return cast;
    }
    void check_refined(const char* where) const {
        check_value(setup.refinement.has_value(), where,
                    "the poses are not refined; make the reconstruction with "
                    "Recipe::refine");
    }
    void refine_people() {
        RefinementParams config = *setup.refinement;
        for (std::size_t p = 0; p < people_.size(); ++p) {
            const ReconstructionSetup::Person& from = setup.people[p];
            config.joint_rates = joint_rates(from.rig.joint_count(), config.finger_rate, config.face_rate);
            // All people share the cameras; the first person's refinement holds them.
            people_[p].refinement.emplace(*backend_, from.rig, from.motion,
                                          p == 0 ? setup.cameras : std::vector<Camera<double>>(), config);
            scene_.refine(*people_[p].refinement, p);
        }
    }

    std::unique_ptr<ReconstructionInput> input_; // plates and hidden pixels of the photographs are its own
    B* backend_;
    std::deque<Person> people_; // a deque: their addresses do not change
    Scene scene_;
    Trainer<B, Scene> trainer_;
    StageTimer<B> timer_;
};

template <Backend B, class Parts>
std::vector<std::size_t> Reconstruction<B, Parts>::fill_unseen() {
    std::vector<std::size_t> counts(people_.size(), 0);
    if (!setup.configuration.fill_unseen) return counts;
    std::vector<const SurfaceSamples*> samples;
    for (const ReconstructionSetup::Person& person : setup.people) samples.push_back(&person.samples);
    const std::vector<Showing> showing =
        photographs_showing(*backend_, scene_, samples, setup.photos, setup.configuration.train.filter);
    const std::vector<std::size_t> frames = photographed_frames(setup.photos);
    std::size_t first = 0;
    for (std::size_t p = 0; p < people_.size(); ++p) {
        const std::size_t size = people_[p].model.size();
        const auto fill = fill_of_unseen(scene_, setup.people[p].samples,
                                         Span<const Showing>(showing).subspan(first, size), frames, p);
        counts[p] = fill.points.size();
        if (counts[p] > 0) people_[p].model.fill(fill);
        first += size;
    }
    return counts;
}

template <Backend B, class Parts>
bool Reconstruction<B, Parts>::refine_test_poses(const Observer& observer) {
    check_refined("Reconstruction::refine_test_poses");
    const Configuration& configuration = setup.configuration;
    for (std::size_t p = 0; p < people_.size(); ++p) {
        Person& person = people_[p];
        person.refinement->carry_to_left_out();
        person.test_refinement.emplace(*backend_, setup.people[p].rig, person.refinement->motion(),
                                       std::vector<Camera<double>>(), test_time_params(person.refinement->config()));
        scene_.refine(*person.test_refinement, p);
    }
    std::set<std::size_t> frames;
    for (const Photo& photo : setup.test_photos) frames.insert(photo.frame);
    const std::size_t rounds = people_.size() > 1 ? 2 : 1, steps = (configuration.test_fit.steps + rounds - 1) / rounds;
    PoseFitParams params{.steps = steps,
                         .ssim_weight = configuration.train.ssim_weight,
                         .mask_weight = configuration.test_fit.mask_weight,
                         .background = configuration.train.background,
                         .stop = [&] { return observer.stopped(); }};
    PoseFit<B> fit(*backend_, configuration.train.filter, params);
    // What registration corrects for frames in training, each frame's own large errors, test frames still have.
    params.steps = (steps + 1) / 2, params.ssim_weight = 0;
    PoseFit<B> coarse_fit(*backend_, configuration.train.filter, params);
    cpu::Serial host;
    const ObservedStage stage(observer, "fitting test poses");
    std::size_t done = 0;
    for (const std::size_t frame : frames) {
        stage.tell(static_cast<double>(done++) / static_cast<double>(frames.size()), "frame " + std::to_string(frame));
        std::vector<Photo> photos;
        for (const Photo& photo : setup.test_photos)
            if (photo.frame == frame) photos.push_back(photo);
        for (std::size_t turn = 0; turn < rounds * people_.size(); ++turn) {
            FrozenPerson<Scene> frozen(scene_, turn % people_.size());
            for (const int pixels : {68, 135}) {
                const int factor = reduction_factor(Span<const Photo>(photos), pixels);
                if (!setup.registered || factor == 1) continue;
                const ReducedPhotos reduced(host, Span<const Photo>(photos), factor);
                coarse_fit.fit(frozen, frame, reduced.photos());
            }
            fit.fit(frozen, frame, photos);
            if (observer.stopped()) return false;
        }
    }
    stage.tell(1, "done");
    return true;
}

} // namespace gsh
