// SPDX-License-Identifier: Apache-2.0
/// @file  A reconstruction on a backend. A file that includes it also includes the backend's overloads.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/model/checkpoint.hpp>
#include <gsh/math/sh.hpp>
#include <gsh/model/avatar_growth.hpp>
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
#include <gsh/setup/schedule.hpp>
#include <gsh/setup/unseen_points.hpp>
#include <gsh/train/avatar_scene.hpp>
#include <gsh/train/frozen_scene.hpp>
#include <gsh/train/pose_fit.hpp>
#include <gsh/train/stage.hpp>
#include <gsh/train/trainer.hpp>

#include <algorithm>
#include <array>
#include <bit>
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

    /// Trainer::step. Before it, the training enters the stage of the schedule that `progress` belongs to: that
    /// settles, and if steps were lost, this returns without a step. A training that goes on for longer than was
    /// planned stays at its stage, because there is no way back.
    void step(double progress) override {
        if (const TrainingStage next = stage_at(progress); next.comes_after(stage_)) {
            const std::uint64_t steps = this->step_count();
            trainer_.release_memory();
            if (this->step_count() < steps) return;
            enter(next);
        }
        Calls::step(progress);
    }
    void finish() override {
        const TrainingStage last = stage_at(1);
        if (!last.comes_after(stage_)) return;
        trainer_.release_memory();
        enter(last);
    }
    bool queues_steps() const override { return !B::host_memory; }
    void release_memory() override { trainer_.release_memory(); }
    Comparison<float> compare(const Photo& photo) override { return gsh::compare(trainer_, photo); }

    std::vector<AvatarData> avatars() override {
        std::vector<AvatarData> result;
        const std::vector<std::size_t> frames = photographed_frames(setup.photos);
        for (std::size_t p = 0; p < people_.size(); ++p) {
            std::optional<RigData> part;
            result.push_back(
                export_avatar(scene_, at_stage(setup.people[p].rig, part), frames, trainer_.config().filter, p));
        }
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
        file.add("stage", std::vector<std::uint64_t>{stage_.stride, stage_.stored});
        add_trainer(file, trainer_);
        for (std::size_t p = 0; p < people_.size(); ++p)
            if (people_[p].refinement) add_refinement(file, *people_[p].refinement, p);
    }
    void load(const ArchiveReader& file) override {
        if (const TrainingStage stage = stage_of(file); stage != stage_) replace_models(stage, [](const auto&...) {});
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
        std::optional<Refinement> refinement = {}, test_refinement = {}; // of training frames; of test frames
    };
    using PriorsOfPeople = std::vector<CanonicalPriors>;

    Reconstruction(B& backend, PriorsOfPeople priors, ReconstructionSetup&& made)
        : Calls(std::move(made)), backend_(&backend), stage_(stage_at(0)), priors_(std::move(priors)),
          scene_(backend, cast()), trainer_(backend, scene_, setup.photos, setup.seed, setup.configuration.train),
          timer_(backend) {
        drop_priors();
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
    std::vector<CastMember<Model>> cast() {
        if (setup.light)
            light_ = std::make_shared<LearnedLight<B>>(*backend_, *setup.light, setup.configuration.avatar.light_rates);
        std::vector<CastMember<Model>> cast;
        for (std::size_t p = 0; p < setup.people.size(); ++p) {
            Person& person = people_.emplace_back(make_model(p, stage_));
            cast.push_back({&person.model, &setup.people[p].motion});
        }
        return cast;
    }

    /// The stage to which a share of the run belongs.
    [[nodiscard]] TrainingStage stage_at(double progress) const {
        std::size_t points = 0;
        for (const auto& person : setup.people) points = std::max(points, person.gaussian_count());
        return setup.configuration.stage_at(progress, points);
    }
    /// The model of a person at a stage, as new. All people share the light; the first announces it.
    [[nodiscard]] Model make_model(std::size_t p, const TrainingStage& stage) {
        const ReconstructionSetup::Person& from = setup.people[p];
        ConfiguredAvatarParams params = setup.configuration.avatar;
        if (stage.stored) params.appearance_type = stored_appearance;
        const auto make = [&](const RigData& rig, const SurfaceSamples& samples, const CanonicalPriors& priors) {
            return make_avatar<B, Parts>(*backend_, rig, samples, from.motion.frame_count(), from.seed, params, priors,
                                         ModelLight<B>{light_, p == 0});
        };
        if (stage.stride == 1) return make(from.rig, from.samples, priors_[p]);
        return make(thinned(from.rig, stage.stride), thinned(from.samples, stage.stride),
                    thinned(priors_[p], from.samples.positions, stage.stride));
    }
    /// A rig or samples, as far as they take part in the present stage; `part` holds them if that is not all.
    template <class Points>
    [[nodiscard]] const Points& at_stage(const Points& all, std::optional<Points>& part) const {
        return stage_.stride == 1 ? all : part.emplace(thinned(all, stage_.stride));
    }
    /// Replaces the models by those of another stage; begin(person, present, made) lets each new one begin with what
    /// the present one has learned. The trainer has released its memory, or has taken no step. The present model has
    /// then released its own, too, because for a while both exist.
    template <class Begin>
    void replace_models(const TrainingStage& next, const Begin& begin) {
        for (std::size_t p = 0; p < people_.size(); ++p) {
            people_[p].model.release_memory();
            Model made = make_model(p, next);
            begin(setup.people[p], people_[p].model, made);
            people_[p].model = std::move(made);
        }
        stage_ = next;
        scene_.update_size();
        scene_.set_progress(trainer_.step_count(), trainer_.progress());
        drop_priors();
    }
    /// Goes on to a stage. The field gives colours of new points first, then they are stored.
    void enter(const TrainingStage& next) {
        if (next.stride != stage_.stride)
            replace_models(
                {.stride = next.stride, .stored = stage_.stored},
                [&](const ReconstructionSetup::Person& from, Model& present, Model& made) {
                    carry_over(*backend_, present.learned(), made.learned(),
                               PointParents(thinned(from.samples, stage_.stride), thinned(from.samples, next.stride)));
                });
        if (next.stored && !stage_.stored) {
            for (Person& person : people_) person.model.update_canonical();
            replace_models(next, [&](const ReconstructionSetup::Person&, Model& present, Model& made) {
                carry_over(*backend_, present.learned(), made.learned());
                store_appearance(*backend_, present.appearance().view(),
                                 present.is_view_dependent() ? sh_basis_count(Model::sh_degree) : 1, made.learned());
            });
        }
    }
    /// Priors are large, and only fields of later stages read them. Those stages have more points.
    void drop_priors() {
        if (!stage_.stored && stage_.stride != stage_at(1).stride) return;
        for (CanonicalPriors& priors : priors_) priors = {.region = {}, .features = {}, .whole = priors.whole};
    }
    /// The stage of a checkpoint, to which this training can go.
    [[nodiscard]] TrainingStage stage_of(const ArchiveReader& file) const {
        if (!file.has("stage")) return stage_; // a file of an older version, when there were no stages
        const std::string path = file.file().path().string();
        const auto numbers = file.read<std::uint64_t>("stage");
        check_size(path, "stage", numbers.size(), 2);
        const TrainingStage stage{.stride = numbers[0], .stored = numbers[1] != 0}, last = stage_at(1);
        check_value(std::has_single_bit(stage.stride) && stage.stride <= stage_at(0).stride &&
                        stage.stored <= last.stored,
                    path,
                    "stage is " + std::to_string(numbers[0]) + " and " + std::to_string(numbers[1]) +
                        ", which is none of this run's");
        check_value(!stage_.comes_after(stage), path,
                    "is of an earlier stage than this training, which cannot go back; load it into a new one");
        return stage;
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
    TrainingStage stage_;
    PriorsOfPeople priors_;     // of all points, as far as later stages read them
    SharedLight<B> light_;      // of all people, or null
    std::deque<Person> people_; // a deque: their addresses do not change
    Scene scene_;
    Trainer<B, Scene> trainer_;
    StageTimer<B> timer_;
};

template <Backend B, class Parts>
std::vector<std::size_t> Reconstruction<B, Parts>::fill_unseen() {
    std::vector<std::size_t> counts(people_.size(), 0);
    if (!setup.configuration.fill_unseen) return counts;
    std::vector<std::optional<SurfaceSamples>> parts(people_.size());
    std::vector<const SurfaceSamples*> samples;
    for (std::size_t p = 0; p < people_.size(); ++p) samples.push_back(&at_stage(setup.people[p].samples, parts[p]));
    const std::vector<Showing> showing =
        photographs_showing(*backend_, scene_, samples, setup.photos, setup.configuration.train.filter);
    const std::vector<std::size_t> frames = photographed_frames(setup.photos);
    std::size_t first = 0;
    for (std::size_t p = 0; p < people_.size(); ++p) {
        const std::size_t size = people_[p].model.size();
        const auto fill =
            fill_of_unseen(scene_, *samples[p], Span<const Showing>(showing).subspan(first, size), frames, p);
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
        std::vector<HeldPhoto> held;
        for (const Photo& photo : setup.test_photos)
            if (photo.frame == frame) held.emplace_back(photo);
        std::vector<Photo> photos;
        for (const HeldPhoto& photo : held) photos.push_back(*photo);
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
