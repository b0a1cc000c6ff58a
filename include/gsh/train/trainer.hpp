// SPDX-License-Identifier: Apache-2.0
/// @file  Training: photographs in random order, forwards in order, backwards in reverse, a step of Adam.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/image/image.hpp>
#include <gsh/loss/photometric.hpp>
#include <gsh/optim/adam.hpp>
#include <gsh/render/rasterizer.hpp>
#include <gsh/train/avatar_model.hpp>
#include <gsh/train/backdrop.hpp>
#include <gsh/train/parameters.hpp>
#include <gsh/train/photo.hpp>
#include <gsh/train/refinement.hpp>
#include <gsh/train/step_images.hpp>
#include <gsh/train/train_config.hpp>

#include <array>
#include <chrono>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// Where a step spends its time.
enum class Stage : std::size_t { photo, field_forward, pose, render, loss, render_backward, model_backward, update };
inline constexpr std::array<std::string_view, 8> stage_names{
    "photo", "field forward", "pose", "render", "loss", "render backward", "model backward", "update"};

/// One of the people that a Trainer trains: the model that is to become them, and their poses. The caller owns both.
template <class Model>
struct CastMember {
    Model* model = nullptr;
    const Motion* motion = nullptr;
};

/// Trains avatars on photographs that show all of them. A step sees one photograph; an epoch sees each once, in an
/// order that depends on the seed and the epoch alone, so that a run may stop and resume anywhere.
///
/// People share the photographs and their frames, nothing else: each has a model, a motion and moments of their own,
/// and perhaps a refinement. Their splats lie one person after the other in one scene, which is rendered in one pass,
/// so that whoever stands in front hides whoever stands behind; on the way back each model reads its own part of the
/// gradient. Functions that speak of one person take their number, 0 where there is only one.
///
/// Source  paper §3.2 (loss) with Liu et al., "Animatable 3D Gaussian", 2024, for what it leaves unsaid.
template <Backend B, std::floating_point T = float, class Model = AvatarModel<B, T>>
class Trainer {
public:
    using Scalar = T;
    using ModelType = Model;
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    /// Several people. Every motion covers every frame: somebody who is not there yet stands where no camera looks.
    /// Errors  ValueError: nobody, somebody twice, no photographs, one that names a frame the motions lack, or a config
    ///         that cannot be meant. ShapeError: motions of different lengths, images of another size than their
    ///         cameras.
    Trainer(B& backend, const std::vector<CastMember<Model>>& cast, std::vector<Photo> photos, std::uint64_t seed,
            const TrainConfig& config = {})
        : backend_(&backend), photos_(std::move(photos)), seed_(seed), config_(config),
          rasterizer_(backend, raster_params<T>(config.filter)), loss_(backend, {.ssim_weight = T(config.ssim_weight)}),
          people_(cast.size()) {
        check_config();
        check_value(!cast.empty(), "Trainer", "there is nobody to train");
        for (std::size_t i = 0; i < cast.size(); ++i) {
            Person& person = people_[i];
            person.model = cast[i].model, person.motion = cast[i].motion, person.first_splat = splat_count_;
            for (std::size_t k = 0; k < i; ++k)
                check_value(people_[k].model != person.model, "Trainer",
                            "person " + std::to_string(i) + " has the model of person " + std::to_string(k) +
                                ", expected one of their own");
            check_size("Trainer", "poses of person " + std::to_string(i), person.motion->frame_count(), frame_count(),
                       "every motion must cover every frame");
            splat_count_ += person.model->size();
        }
        check_value(!photos_.empty(), "Trainer", "there are no photographs to train on");
        for (const Photo& photo : photos_) check_photo(photo);
        for (Person& person : people_) {
            make_codes(person);
            for (Parameters<B, T>* numbers : {&person.gradient, &person.first_moment, &person.second_moment})
                numbers->become_zero_like(backend, person.model->parameters());
        }
    }

    /// One person.
    Trainer(B& backend, Model& model, std::vector<Photo> photos, const Motion& motion, std::uint64_t seed,
            const TrainConfig& config = {})
        : Trainer(backend, std::vector<CastMember<Model>>{{&model, &motion}}, std::move(photos), seed, config) {}

    /// Steps taken so far.
    [[nodiscard]] std::uint64_t step_count() const { return step_count_; }
    [[nodiscard]] const std::vector<Photo>& photos() const { return photos_; }
    [[nodiscard]] std::uint64_t seed() const { return seed_; }
    [[nodiscard]] const TrainConfig& config() const { return config_; }
    [[nodiscard]] std::size_t person_count() const { return people_.size(); }
    [[nodiscard]] std::size_t frame_count() const { return people_.front().motion->frame_count(); }
    [[nodiscard]] Model& model(std::size_t person = 0) { return *at(person).model; }
    [[nodiscard]] B& backend() { return *backend_; }
    /// Seconds spent per stage since the beginning, in the order of Stage.
    [[nodiscard]] const std::array<double, stage_names.size()>& stage_seconds() const { return stage_seconds_; }

    /// Steps that stage_seconds() covers: those of this run, not of the one that it resumed.
    [[nodiscard]] std::uint64_t timed_steps() const { return timed_steps_; }
    /// The model's working memory.
    [[nodiscard]] typename Model::Cache& cache(std::size_t person = 0) { return at(person).cache; }

    /// From here on the person's poses, and the cameras if it holds any, are `refinement`'s, and learn with the
    /// avatars. It must outlive the trainer.
    /// Errors  ValueError if another person's refinement holds the cameras already: they are the same for all.
    void refine(MotionRefinement<B, T>& refinement, std::size_t person = 0) {
        for (std::size_t i = 0; i < people_.size(); ++i)
            check_value(i == person || !refinement.camera_count() || !people_[i].refinement ||
                            !people_[i].refinement->camera_count(),
                        "Trainer::refine",
                        "cameras learn with person " + std::to_string(i) + "; give them to one person's refinement");
        at(person).refinement = &refinement;
    }
    [[nodiscard]] MotionRefinement<B, T>* refinement(std::size_t person = 0) const { return at(person).refinement; }

    /// The photograph that step `step` sees.
    [[nodiscard]] std::size_t photo_of_step(std::uint64_t step) {
        const std::uint64_t epoch = step / photos_.size();
        if (order_.empty() || epoch != order_epoch_) {
            order_ = shuffled_indices(static_cast<std::uint32_t>(photos_.size()), random_bits(seed_, epoch));
            order_epoch_ = epoch;
        }
        return order_[step % photos_.size()];
    }

    /// Takes one step. progress in [0, 1] is the share of the whole run that is over: learning rates fall with it, see
    /// TrainConfig::rate_factor. A run that is to be repeatable counts steps for it, not seconds.
    void step(double progress = 0) {
        const Photo& photo = photos_[photo_of_step(step_count_)];
        progress_ = progress;
        for (Person& person : people_)
            if (person.refinement) person.refinement->come_to(progress);
        if (config_.random_background) backdrop_.set_color(random_color(step_count_));
        time(Stage::photo, [&] { upload_photo(photo); });
        time(Stage::field_forward, [&] { query_fields(photo.frame); });
        const Camera<T> camera = camera_of(photo);
        time(Stage::pose, [&] { pose_people(photo.frame, camera.center()); });
        time(Stage::render, [&] { draw(camera, {}); });
        time(Stage::loss, [&] {
            loss_.forward(images_.render(), images_.truth(), loss_cache_);
            backend_->fill(images_.dL_drender().data, T(0));
            loss_.backward(images_.render(), images_.truth(), T(1), loss_cache_, images_.dL_drender());
        });
        time(Stage::render_backward, [&] {
            dL_dsplats_.resize(splat_count_);
            const SplatView<T> gradient = dL_dsplats_.view();
            fill_zero(*backend_, gradient);
            rasterizer_.backward(camera, std::as_const(splats_).view(), backdrop_.background(),
                                 {.color = images_.dL_drender()}, raster_cache_, gradient, camera_gradient(photo));
        });
        time(Stage::model_backward, [&] {
            for (Person& person : people_) model_backward(person, photo.frame, camera.center());
            if (!dL_dcenter_.empty())
                camera_refinement()->accumulate_camera(photo.camera_index, Span<const CameraGradient<T>>(dL_dcamera_),
                                                       Span<const vec3<T>>(dL_dcenter_));
        });
        time(Stage::update, [&] { update(progress); });
        backdrop_.set_color(config_.background);
    }

    /// Loss of the last step; waits for it.
    [[nodiscard]] PhotometricValues last_loss() const { return loss_.values(loss_cache_); }

    /// PSNR of the last step's render against its photograph, before the step's update.
    [[nodiscard]] double last_psnr() const { return images_.psnr(*backend_); }

    /// A person's part of a scene's splats, or of their gradient.
    template <class View>
    [[nodiscard]] View part(std::size_t person, const View& scene) const { return part_of(at(person), scene); }
    /// Everybody's splats together.
    [[nodiscard]] std::size_t splat_count() const { return splat_count_; }
    /// Writes a person's splats at a frame into their part of a scene's, seen from `center`, fields as they were last
    /// queried.
    void pose_person(std::size_t person, std::size_t frame, const vec3<T>& center, const SplatView<T>& scene) {
        pose_person(at(person), frame, center, scene);
    }

    /// What a person's fields are told of a frame; ambient occlusion joins once the run has come to
    /// TrainConfig::ao_start.
    [[nodiscard]] FrameCode<T> frame_code(std::size_t frame, std::size_t person = 0) const {
        return frame_code(at(person), frame);
    }

    /// Queries everybody's fields at a frame, for pose_person.
    void query(std::size_t frame) { query_fields(frame); }

    /// Renders a photograph's view at its frame, over its plate if it has one.
    void render(const Photo& photo, Image<T>& color, Image<T>* alpha = nullptr) {
        backdrop_.set_plate(*backend_, photo.plate, photo.camera.height, photo.camera.width);
        render_view(photo.camera, photo.frame, color, alpha);
    }

    /// Renders a frame at the present parameters: colour [3, height, width] over the plain background, and alpha if
    /// asked.
    void render(const Camera<double>& camera, std::size_t frame, Image<T>& color, Image<T>* alpha = nullptr) {
        backdrop_.clear_plate();
        render_view(camera, frame, color, alpha);
    }

    /// Each Gaussian's ambient occlusion, mean over the frames that there are photographs of; empty where there is
    /// none. What a new motion gets from an avatar whose shadows know only the time.
    [[nodiscard]] std::vector<T> mean_occlusion(std::size_t person = 0) {
        Person& of = at(person);
        std::vector<T> mean, frame_ao(of.model->size());
        if (of.model->config().ao == AmbientOcclusion::none || !occlusion_started()) return {};
        const std::vector<std::size_t> frames = photographed_frames();
        for (const std::size_t frame : frames) {
            set_pose(of, frame);
            backend_->download(of.model->occlusion(of.pose, frame_code(of, frame).ao, of.cache), Span<T>(frame_ao));
            mean.resize(frame_ao.size(), T(0));
            for (std::size_t i = 0; i < mean.size(); ++i) mean[i] += frame_ao[i];
        }
        for (T& ao : mean) ao /= static_cast<T>(frames.size());
        return mean;
    }

    /// A person's canonical Gaussians, fields queried. Where colours and displacements know the time, each Gaussian has
    /// its mean of them over the frames that there are photographs of: what a new motion gets.
    [[nodiscard]] GaussianCloud<T> mean_gaussians(std::size_t person = 0) {
        Person& of = at(person);
        std::vector<std::size_t> frames = photographed_frames();
        if (of.model->head_code_size() == 0) frames.resize(1); // they are all alike
        GaussianCloud<T> cloud;
        std::vector<vec3<double>> means, sh;
        const auto add = [](const std::vector<vec3<T>>& values, std::vector<vec3<double>>& sums) {
            sums.resize(values.size(), vec3<double>(0));
            for (std::size_t i = 0; i < sums.size(); ++i) sums[i] += vec3<double>(values[i]);
        };
        for (const std::size_t frame : frames) {
            of.model->update_canonical(of.cache, frame_code(of, frame));
            cloud = of.model->canonical_gaussians();
            add(cloud.means, means), add(cloud.sh, sh);
        }
        const auto count = static_cast<double>(frames.size());
        for (std::size_t i = 0; i < means.size(); ++i) cloud.means[i] = vec3<T>(means[i] / count);
        for (std::size_t i = 0; i < sh.size(); ++i) cloud.sh[i] = vec3<T>(sh[i] / count);
        return cloud;
    }

    /// A person's avatar as it is now, for files: `rig` with the learned joints, fields queried. Colours and
    /// displacements that know the time are each Gaussian's mean. Shadows that follow the pose come as the field that
    /// they are, those that know the time as a mean, too; none before TrainConfig::ao_start.
    [[nodiscard]] AvatarData avatar(RigData rig, std::size_t person = 0)
        requires std::same_as<T, float>
    {
        Person& of = at(person);
        AvatarData avatar = of.model->avatar(std::move(rig), mean_gaussians(person), config_.filter);
        avatar.ao = mean_occlusion(person);
        if (!avatar.ao.empty()) avatar.occlusion = of.model->occlusion_field();
        return avatar;
    }

    /// A photograph as training sees it, on the host: over the background, with its mask's alpha.
    void photo_pixels(const Photo& photo, Image<T>& color, Image<T>& alpha) {
        check_photo(photo);
        images_.resize(photo.camera.height, photo.camera.width);
        images_.take(*backend_, images_.truth(), color, &alpha,
                     [&](const ImageView<T>& mask) { upload_photo(photo, mask); });
    }

    // The whole state of training, for checkpoints: parameters of the models, these moments, and the step count.
    [[nodiscard]] Parameters<B, T>& first_moment(std::size_t person = 0) { return at(person).first_moment; }
    [[nodiscard]] Parameters<B, T>& second_moment(std::size_t person = 0) { return at(person).second_moment; }
    void set_step_count(std::uint64_t steps) { step_count_ = steps; }
    /// Share of the run that was over at the last step.
    [[nodiscard]] double progress() const { return progress_; }
    void set_progress(double progress) { progress_ = progress; }

private:
    /// One of the people, with all that training keeps of them.
    struct Person {
        Model* model = nullptr;
        const Motion* motion = nullptr;
        std::size_t first_splat = 0;    // in the scene
        Buffer<T> head_codes, ao_codes; // [frames, size of a code]
        RigPose<B, T> pose;
        MotionRefinement<B, T>* refinement = nullptr;
        typename Model::Cache cache;
        Parameters<B, T> gradient, first_moment, second_moment;
    };
    void check_person(std::size_t person) const {
        check_value(person < people_.size(), "Trainer", "there is no person " + std::to_string(person) + " among " +
                                                            std::to_string(people_.size()));
    }
    [[nodiscard]] Person& at(std::size_t person) { return check_person(person), people_[person]; }
    [[nodiscard]] const Person& at(std::size_t person) const { return check_person(person), people_[person]; }
    /// A person's part of the scene.
    template <class View>
    [[nodiscard]] static View part_of(const Person& person, const View& scene) {
        return scene.subview(person.first_splat, person.model->size());
    }

    void check_config() const {
        const auto expect = [](bool good, const std::string& what) { check_value(good, "TrainConfig", what); };
        for (std::size_t g = 0; g < parameter_group_count; ++g) {
            const double rate = config_.rates[static_cast<ParameterGroup>(g)];
            expect(rate >= 0 && std::isfinite(rate),
                   "the rate of " + std::string(parameter_group_names[g]) + " must not be negative");
        }
        expect(config_.decay_start >= 0 && config_.decay_start <= 1, "decay_start must lie in [0, 1]");
        expect(config_.final_rate > 0 && config_.final_rate <= 1, "final_rate must lie in (0, 1]");
        expect(config_.ssim_weight >= 0 && config_.ssim_weight <= 1, "ssim_weight must lie in [0, 1]");
        expect(config_.ao_start >= 0, "ao_start must not be negative");
        expect(config_.filter.dilation >= 0 && std::isfinite(config_.filter.dilation),
               "filter.dilation must not be negative");
    }
    void check_photo(const Photo& photo) const {
        check_value(photo.frame < frame_count(), "Trainer",
                    photo.name + " is of frame " + std::to_string(photo.frame) + ", the motion has " +
                        std::to_string(frame_count()) + " frames");
        check_size("Trainer", photo.name, photo.rgba.size(),
                   4 * static_cast<std::size_t>(photo.camera.width) * static_cast<std::size_t>(photo.camera.height),
                   "the image must have its camera's size");
        if (!photo.plate.empty())
            check_size("Trainer", photo.name + "'s plate", photo.plate.size(), photo.rgba.size(),
                       "a plate is as large as the image");
    }

    template <class F>
    void time(Stage stage, const F& work) {
        const auto start = std::chrono::steady_clock::now();
        work();
        stage_seconds_[static_cast<std::size_t>(stage)] +=
            std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    }

    [[nodiscard]] std::array<double, 3> random_color(std::uint64_t step) const {
        const std::uint64_t bits = random_bits(mix_bits(seed_ + 2), step);
        std::array<double, 3> color;
        for (std::size_t c = 0; c < 3; ++c) color[c] = static_cast<double>(bits >> (21 * c) & 0x1FFFFF) / 0x1FFFFF;
        return color;
    }

    /// The one that holds the cameras, or null.
    [[nodiscard]] MotionRefinement<B, T>* camera_refinement() const {
        for (const Person& person : people_)
            if (person.refinement && person.refinement->camera_count()) return person.refinement;
        return nullptr;
    }
    /// The camera as it is now; only cameras of training photographs are refined, test views keep theirs.
    [[nodiscard]] Camera<T> camera_of(const Photo& photo) const {
        const auto* refinement = camera_refinement();
        return refinement ? refinement->template camera<T>(photo.camera_index) : photo.camera.template cast<T>();
    }
    /// Zeros to add to if the photograph's camera learns, else nothing; dL_dcenter_ goes with it.
    [[nodiscard]] Span<CameraGradient<T>> camera_gradient(const Photo& photo) {
        const auto* refinement = camera_refinement();
        const bool learns = refinement && refinement->learns_camera(photo.camera_index);
        dL_dcamera_.resize(learns ? 1 : 0);
        dL_dcenter_.resize(learns ? 1 : 0);
        backend_->fill(Span<CameraGradient<T>>(dL_dcamera_), CameraGradient<T>{});
        backend_->fill(Span<vec3<T>>(dL_dcenter_), vec3<T>(T(0)));
        return dL_dcamera_;
    }

    /// Frames that there are photographs of, each once.
    [[nodiscard]] std::vector<std::size_t> photographed_frames() const {
        std::vector<std::size_t> frames;
        std::vector<bool> seen(frame_count(), false);
        for (const Photo& photo : photos_) {
            if (!seen[photo.frame]) frames.push_back(photo.frame);
            seen[photo.frame] = true;
        }
        return frames;
    }

    [[nodiscard]] FrameCode<T> frame_code(const Person& person, std::size_t frame) const {
        const auto row = [&](const Buffer<T>& codes, std::size_t size) {
            return Span<const T>(codes).subspan(frame * size, size);
        };
        return {.head = row(person.head_codes, person.model->head_code_size()),
                .ao = row(person.ao_codes, person.model->ao_code_size()),
                .occlusion = occlusion_started()};
    }
    [[nodiscard]] bool occlusion_started() const { return progress_ >= config_.ao_start; }
    void set_pose(Person& person, std::size_t frame) {
        person.refinement ? person.refinement->pose(frame, person.pose)
                          : person.model->rig().upload_pose(*person.motion, frame, person.pose);
    }
    void query_fields(std::size_t frame) {
        for (Person& person : people_) person.model->update_canonical(person.cache, frame_code(person, frame));
    }
    /// Everybody's splats at a frame, one person after the other.
    void pose_people(std::size_t frame, const vec3<T>& center) {
        splats_.resize(splat_count_);
        for (Person& person : people_) pose_person(person, frame, center, splats_.view());
    }
    void pose_person(Person& person, std::size_t frame, const vec3<T>& center, const SplatView<T>& scene) {
        set_pose(person, frame);
        person.model->pose(person.pose, center, part_of(person, scene), person.cache, frame_code(person, frame));
    }
    void model_backward(Person& person, std::size_t frame, const vec3<T>& center) {
        MotionRefinement<B, T>* refinement = person.refinement;
        const RigPoseGradient<T> dL_dpose = refinement && refinement->learns_motion(frame) ? refinement->pose_gradient()
                                                                                           : RigPoseGradient<T>();
        person.model->backward(person.pose, center, part_of(person, std::as_const(dL_dsplats_).view()), person.cache,
                               person.gradient, dL_dpose, dL_dcenter_, frame_code(person, frame));
        if (!dL_dpose.empty()) refinement->accumulate(frame, dL_dpose);
    }

    void upload_photo(const Photo& photo, const ImageView<T>& alpha = {}) {
        images_.resize(photo.camera.height, photo.camera.width);
        backdrop_.photograph(*backend_, photo.rgba, photo.plate, images_.truth(), alpha);
    }

    void render_view(const Camera<double>& camera, std::size_t frame, Image<T>& color, Image<T>* alpha) {
        const Camera<T> view = camera.template cast<T>();
        images_.resize(view.height, view.width);
        query_fields(frame);
        pose_people(frame, view.center());
        images_.take(*backend_, images_.render(), color, alpha, [&](const ImageView<T>& plane) { draw(view, plane); });
    }

    void draw(const Camera<T>& camera, const ImageView<T>& alpha) {
        rasterizer_.forward(camera, std::as_const(splats_).view(), backdrop_.background(),
                            {.color = images_.render(), .alpha = alpha}, raster_cache_);
    }

    void update(double progress) {
        ++step_count_;
        ++timed_steps_;
        for (Person& person : people_) {
            if (person.refinement) person.refinement->step();
            update(person, progress);
        }
    }
    /// A step of Adam for every group that learns; the gradients are zero afterwards.
    void update(Person& person, double progress) {
        Model& model = *person.model;
        const auto number = static_cast<std::int64_t>(step_count_);
        const double decay = config_.rate_factor(progress);
        for (std::size_t g = 0; g < parameter_group_count; ++g) {
            const auto group = static_cast<ParameterGroup>(g);
            const double rate = config_.rates[group] * decay;
            const Span<T> parameters = model.parameters()[group], gradients = person.gradient[group],
                          m = person.first_moment[group], v = person.second_moment[group];
            const auto* touched = model.touched_entries(group);
            if (parameters.empty()) continue;
            if (rate == 0) {
                backend_->fill(gradients, T(0));
            } else if (touched) {
                adam_.step_rows(*backend_, parameters, gradients, m, v, *touched, Model::Grid::feature_count, rate,
                                number, UsedGradients::zero);
            } else if (group == ParameterGroup::sh) {
                adam_.step_columns(*backend_, parameters, gradients, m, v, 3 * Model::basis_count, 3, rate, rate / 20,
                                   number, UsedGradients::zero);
            } else {
                const std::size_t slow = group == ParameterGroup::joint_network ? model.displacement_weights() : 0;
                const auto step = [&](std::size_t first, std::size_t count, double part_rate) {
                    const auto part = [&](Span<T> all) { return all.subspan(first, count); };
                    adam_.step(*backend_, part(parameters), part(gradients), part(m), part(v), part_rate, number,
                               UsedGradients::zero);
                };
                step(0, parameters.size() - slow, rate);
                if (slow) step(parameters.size() - slow, slow, config_.rates.displacement * decay);
            }
        }
    }

    /// What the fields are told of each frame: γ(t) with t = frame / frames.
    void make_codes(Person& person) {
        const auto rows = [&](std::size_t size, Buffer<T>& codes) { // a code is γ(t) whole or nothing
            std::vector<T> values(frame_count() * size);
            for (std::size_t frame = 0; size && frame < frame_count(); ++frame)
                TimeEncoding::forward(T(frame) / T(frame_count()), values.data() + frame * size);
            codes.resize(values.size());
            backend_->upload(Span<const T>(values), codes);
        };
        rows(person.model->head_code_size(), person.head_codes);
        rows(person.model->ao_code_size(), person.ao_codes);
    }

    B* backend_;
    std::vector<Photo> photos_;
    std::uint64_t seed_;
    TrainConfig config_;
    Backdrop<B, T> backdrop_{config_.background}; // of this step, or of a picture
    Rasterizer<B, T> rasterizer_;
    PhotometricLoss<B, T> loss_;
    Adam adam_;
    std::vector<Person> people_;
    std::size_t splat_count_ = 0; // everybody's

    std::uint64_t step_count_ = 0;
    double progress_ = 0;
    std::vector<std::uint32_t> order_;
    std::uint64_t order_epoch_ = 0;
    std::array<double, stage_names.size()> stage_seconds_{};
    std::uint64_t timed_steps_ = 0;

    StepImages<B, T> images_;
    Buffer<CameraGradient<T>> dL_dcamera_; // [1] or empty
    Buffer<vec3<T>> dL_dcenter_;           // likewise
    Splats<B, T> splats_, dL_dsplats_;
    typename Rasterizer<B, T>::Cache raster_cache_;
    typename PhotometricLoss<B, T>::Cache loss_cache_;
};

} // namespace gsh
