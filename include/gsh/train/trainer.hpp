// SPDX-License-Identifier: Apache-2.0
/// @file  The trainer: photographs in random order, forwards in order, backwards in reverse, a step of Adam.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/camera/camera_input.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/image/image.hpp>
#include <gsh/learn/learned_array.hpp>
#include <gsh/optim/adam.hpp>
#include <gsh/photo/photo.hpp>
#include <gsh/photo/photo_gain.hpp>
#include <gsh/photo/photo_loss.hpp>
#include <gsh/photo/photo_pixels.hpp>
#include <gsh/train/splat_scene.hpp>
#include <gsh/train/stage.hpp>
#include <gsh/train/step_history.hpp>
#include <gsh/train/train_params.hpp>

#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// The settings of a photograph's loss in a training.
[[nodiscard]] inline PhotoLossParams photo_loss_params(const TrainParams& config) {
    return {.filter = config.filter,
            .ssim_weight = config.ssim_weight,
            .background = config.background,
            .gradient_transmittance_min = config.gradient_transmittance_min};
}

/// Trains a scene on photographs. A step uses one photograph. An epoch uses each once, in an order that depends only on
/// seed and epoch, so that a run can stop and resume after any step.
///
/// Loss, optimiser and gains are policies. Loss has the calls of PhotoLoss, Gains those of PhotoGains. Terms of the
/// loss that need no picture are the scene's (LossTerm).
///
/// Source  paper §3.2 (loss), and Liu et al., "Animatable 3D Gaussian", 2024, for what the paper leaves open. For
///         static scenes, Kerbl et al., "3D Gaussian Splatting for Real-Time Radiance Field Rendering", 2023.
template <Backend B, class Scene, std::floating_point T = float, class Loss = PhotoLoss<B, T>, class Optimizer = Adam,
          class Gains = PhotoGains<B, T>>
    requires SplatScene<Scene, B, T> && ArrayOptimizer<Optimizer, B, T>
class Trainer {
public:
    using Scalar = T;

    /// The caller owns the scene and the photographs' pixels. Photographs with a source are read ahead of their steps.
    /// Errors  ValueError: no photographs, a photograph of a frame that the scene does not have, settings or rates out
    ///         of range. ShapeError: images of another size than their cameras.
    Trainer(B& backend, Scene& scene, std::vector<Photo> photos, std::uint64_t seed, const TrainParams& config = {})
        requires std::constructible_from<Loss, B&, PhotoLossParams>
        : Trainer(backend, scene, std::move(photos), seed, config, Loss(backend, photo_loss_params(config.checked()))) {
    }
    /// With another loss, for instance a PhotoLoss with another image loss or rasterizer, and perhaps another
    /// optimiser.
    Trainer(B& backend, Scene& scene, std::vector<Photo> photos, std::uint64_t seed, const TrainParams& config,
            Loss loss, Optimizer optimizer = {})
        : Trainer(backend, scene, photos, seed, config, std::move(loss), std::move(optimizer),
                  Gains(backend, photos, config.gain)) {}
    /// The same with other gains.
    Trainer(B& backend, Scene& scene, std::vector<Photo> photos, std::uint64_t seed, const TrainParams& config,
            Loss loss, Optimizer optimizer, Gains gains)
        : backend_(&backend), scene_(&scene), photos_(std::move(photos)), seed_(seed), config_(config.checked()),
          pixels_(backend, photos_, photo_budget(backend, config_)), loss_(std::move(loss)), gains_(std::move(gains)),
          repeated_(backend), history_(backend), optimizer_(std::move(optimizer)) {
        check_value(!photos_.empty(), "Trainer", "there are no photographs to train on");
        for (Photo& photo : photos_) {
            check_photo("Trainer", photo, scene.frame_count());
            photo.weight = static_cast<double>(std::lround(255 * photo.weight)) / 255;
        }
        for (const LearnedArray<T>& array : scene.learned())
            check_value(array.rate >= 0 && std::isfinite(array.rate) && array.other.rate >= 0 &&
                            std::isfinite(array.other.rate),
                        "Trainer", "the rate of " + array.name + " must not be negative");
        scene.set_progress(0, 0);
    }

    [[nodiscard]] B& backend() { return *backend_; }
    [[nodiscard]] Scene& scene() { return *scene_; }
    [[nodiscard]] const std::vector<Photo>& photos() const { return photos_; }
    [[nodiscard]] std::uint64_t seed() const { return seed_; }
    [[nodiscard]] const TrainParams& config() const { return config_; }
    /// Steps taken so far.
    [[nodiscard]] std::uint64_t step_count() const { return step_count_; }
    /// The progress of the last step.
    [[nodiscard]] double progress() const { return progress_; }
    /// Continues after `steps` steps, the last of which was at `progress`. The caller has restored the learned arrays.
    void resume(std::uint64_t steps, double progress) {
        step_count_ = steps;
        progress_ = progress;
        history_.skip(steps);
        scene_->set_progress(steps, progress);
        if (ended_ == Ended::in_update) ended_ = Ended::before_update; // the arrays are others now, the gradient is not
    }

    /// The index of the photograph of step `step`.
    [[nodiscard]] std::size_t photo_of_step(std::uint64_t step) {
        const std::uint64_t epoch = step / photos_.size();
        if (order_.empty() || epoch != order_epoch_) {
            order_ = shuffled_indices(static_cast<std::uint32_t>(photos_.size()), random_bits(seed_, epoch));
            order_epoch_ = epoch;
        }
        return order_[step % photos_.size()];
    }

    /// Takes one step. progress in [0, 1] is the share of the whole run that is over. Learning rates fall with it, see
    /// TrainParams::rate_factor. For a repeatable run, compute it from steps, not from seconds. observer.enter is
    /// called at the beginning of each stage, observer.leave at the end of the step.
    ///
    /// Settles after every most_unsettled_steps, so step_count() may be lower afterwards: a training of
    /// n steps calls this while step_count() < n, and settles at the end, as train_to does.
    ///
    /// After an error, such as memory that runs out, the step can be taken again, with the same bits, since nothing is
    /// learned before a step's gradient is complete. After an error in the update itself it cannot.
    /// Errors  those of settle() and of PhotoSource::read; Error if the step before ended within its update: load a
    ///         checkpoint, and resume.
    template <class Observer = NoObserver>
    void step(double progress = 0, Observer&& observer = {}) {
        if (ended_ == Ended::in_update)
            throw Error("Trainer::step: an error ended the step before in the middle of its update; go on from a "
                        "checkpoint, or begin again");
        if (ended_ == Ended::before_update) forget_gradients();
        if (unsettled_ == most_unsettled_steps) settle();
        const std::size_t index = photo_of_step(step_count_);
        progress_ = progress;
        scene_->set_progress(step_count_, progress);
        pixels_.prepare(index);
        ended_ = Ended::before_update;
        with_names([&] { repeated_.run(kind(index), [&] { compute_step(index, progress, observer); }); });
        ended_ = Ended::well;
        ++step_count_, ++unsettled_;
        pixels_.fetch(photo_of_step(step_count_));
        for (std::size_t ahead = 1; ahead < pixels_.depth(); ++ahead)
            pixels_.read_ahead(photo_of_step(step_count_ + ahead));
        observer.leave();
    }

    /// Takes steps until there are `steps` and all have happened. The progress of step k is k / steps.
    /// Errors  those of settle().
    void train_to(std::uint64_t steps) {
        while (step_count_ < steps) {
            while (step_count_ < steps) step(static_cast<double>(step_count_) / static_cast<double>(steps));
            settle(); // may find that some have not
        }
    }

    /// What steps change: the scene's arrays, then the gains of the photographs.
    [[nodiscard]] LearnedArrays<T> learned() {
        LearnedArrays<T> arrays = scene_->learned();
        arrays.push_back(gains_.announce());
        return arrays;
    }
    /// Exposure and white balance of the photographs.
    [[nodiscard]] const Gains& gains() const { return gains_; }

    /// Waits for the steps so far. On a device that does not wait within a step, an error is found here: then either
    /// its cause is mended and the trainer goes back to the step that failed, whose number step_count() returns from
    /// now on, or the error is thrown. Nothing has changed since that step.
    /// Errors  those of Rasterizer::forward.
    void settle() {
        if (std::exchange(unsettled_, 0) == 0) return;
        std::uint64_t lost = 0;
        with_names([&] { lost = loss_.settle(repeated_, *scene_, step_count_); });
        if (lost == 0) return;
        forget_gradients(); // no step has used what the lost ones added
        scene_->set_progress(step_count_, progress_);
    }

    /// Settles, and frees what steps keep for the next one: splats, render, their gradients, and scratch of the
    /// rasterizer and the loss. For the end of a training whose results are then written. last_loss and last_psnr need
    /// another step, which allocates all of it again.
    void release_memory() {
        settle();
        loss_.release_memory();
        splats_ = {}, dL_dsplats_ = {};
        repeated_.forget(); // recorded steps contain addresses
    }

    /// On a backend that records its steps, the times of the last step's kernels, which are repeated for it
    /// (RepeatedStep::time_kernels): for benches. Settles first.
    [[nodiscard]] auto time_kernels(int repeats = 20)
        requires requires(RepeatedStep<B>& steps) { steps.time_kernels(1); }
    {
        settle();
        return repeated_.time_kernels(repeats);
    }

    /// Settles. Returns loss and PSNR of the steps since the last call, in order, of the last StepHistory::capacity at
    /// most. A program that calls it every hundred steps waits for a device only then.
    [[nodiscard]] std::vector<StepValues> history() {
        settle();
        return history_.read(step_count_);
    }
    /// Loss of the last step. Waits for the backend.
    [[nodiscard]] PhotometricValues last_loss() const { return loss_.values(); }
    /// PSNR of the last step's render, which was made before its update, against the photograph. Waits for the backend.
    [[nodiscard]] double last_psnr() const { return loss_.psnr(); }

    /// Settles, and renders a photograph's view at its frame, over its plate if it has one. The camera is the
    /// photograph's own, without refinement.
    void render(const Photo& photo, Image<T>& color, Image<T>* alpha = nullptr) {
        settle();
        pose(photo.camera, photo.frame);
        with_names([&] { loss_.picture(photo, splats(), color, alpha); });
    }
    /// Settles, and renders a frame with the learned arrays: colour [3, height, width] over the plain background, and
    /// alpha if it is given.
    void render(const Camera<double>& camera, std::size_t frame, Image<T>& color, Image<T>* alpha = nullptr) {
        settle();
        pose(camera, frame);
        with_names([&] { loss_.picture(camera, splats(), color, alpha); });
    }
    /// A photograph as training compares it, on the host: over its plate or the background, with its mask.
    void photo_pixels(const Photo& photo, Image<T>& color, Image<T>& mask) {
        check_photo("Trainer::photo_pixels", photo, scene_->frame_count());
        loss_.photograph(photo, color, mask);
    }

private:
    /// Whether splats have factors in place of covariances.
    static constexpr bool has_needles = requires { requires Scene::has_needles; };

    template <class Observer>
    void compute_step(std::size_t index, double progress, Observer& observer) {
        const Photo& photo = photos_[index];
        observer.enter(Stage::photo);
        loss_.set_photo(photo, pixels_[index], config_.background_of_step(seed_, step_count_));
        observer.enter(Stage::field_forward);
        scene_->prepare(photo.frame);
        observer.enter(Stage::pose);
        const CameraInput<T> camera = scene_->camera(photo);
        splats_.resize(scene_->size(), has_needles);
        scene_->forward(photo.frame, camera.center, splats_.view());
        gains_.apply(index, splats_.colors);
        observer.enter(Stage::render);
        loss_.render(camera.camera, splats());
        observer.enter(Stage::loss);
        loss_.compare();
        history_.add(step_count_ + 1, loss_.values_on_backend());

        observer.enter(Stage::render_backward);
        const CameraGradientView<T> dL_dcamera = scene_->camera_gradient(photo);
        dL_dsplats_.resize(scene_->size(), has_needles);
        fill_zero(*backend_, dL_dsplats_.view());
        loss_.backward(camera.camera, splats(), dL_dsplats_.view(), dL_dcamera.camera);
        observer.enter(Stage::model_backward);
        gains_.backward(index, splats().colors, dL_dsplats_.colors);
        scene_->backward(photo.frame, camera.center, std::as_const(dL_dsplats_).view(), dL_dcamera.center);
        scene_->camera_backward(photo);

        observer.enter(Stage::update);
        const double factor = config_.rate_factor(progress);
        const LearnedArrays<T> arrays = scene_->learned();
        ended_ = Ended::in_update; // unless the step comes to its end
        take_steps(*backend_, optimizer_, arrays, factor, static_cast<std::int64_t>(step_count_ + 1));
        if (gains_.learns(progress))
            gains_.step(index, static_cast<std::int64_t>(step_count_ / photos_.size() + 1), factor);
        else
            gains_.forget_gradient();
        scene_->after_step(loss_.raster_cache());
    }

    /// Clears what a step has added that was not taken to its end.
    void forget_gradients() {
        for (const LearnedArray<T>& array : scene_->learned()) backend_->fill(array.gradient, T(0));
        gains_.forget_gradient();
        ended_ = Ended::well;
    }

    /// call(); an error about a Gaussian also tells the likely cause, and what the scene calls the Gaussian.
    template <class Call>
    void with_names(const Call& call) const {
        try {
            call();
        } catch (const GaussianError& error) {
            std::string message = std::string(error.what()) + "; is a learning rate too high?";
            if constexpr (requires { scene_->name_of(std::size_t()); })
                if (const std::string name = scene_->name_of(error.gaussian()); !name.empty())
                    message += " It is " + name;
            throw GaussianError(message, error.gaussian());
        }
    }
    [[nodiscard]] static std::uint64_t photo_budget([[maybe_unused]] const B& backend, const TrainParams& config) {
        if (config.photo_memory != 0) return config.photo_memory;
        if constexpr (requires { backend.free_memory(); }) return backend.free_memory() / 2;
        else return PhotoPixels<B>::no_limit;
    }
    /// Steps of one kind launch the same kernels.
    [[nodiscard]] std::uint64_t kind(std::size_t index) const {
        const Photo& photo = photos_[index];
        const std::uint64_t of_photo = Loss::kind(photo, pixels_[index]);
        if constexpr (requires { scene_->kind(photo); }) return of_photo ^ mix_bits(scene_->kind(photo));
        else return of_photo;
    }
    [[nodiscard]] SplatView<const T> splats() const { return splats_.view(); }
    void pose(const Camera<double>& camera, std::size_t frame) {
        scene_->prepare(frame);
        splats_.resize(scene_->size(), has_needles);
        scene_->forward(frame, camera.template cast<T>().center(), splats_.view());
    }
    B* backend_;
    Scene* scene_;
    std::vector<Photo> photos_;
    std::uint64_t seed_;
    TrainParams config_;
    PhotoPixels<B> pixels_;
    Loss loss_;
    Gains gains_;
    RepeatedStep<B> repeated_;
    StepHistory<B> history_;
    Optimizer optimizer_;
    Splats<B, T> splats_, dL_dsplats_;

    /// How the last step ended: an exception leaves a gradient, or arrays of which some are updated.
    enum class Ended { well, before_update, in_update };

    Ended ended_ = Ended::well;
    std::uint64_t step_count_ = 0;
    std::size_t unsettled_ = 0; // steps since the last settle
    double progress_ = 0;
    std::vector<std::uint32_t> order_;
    std::uint64_t order_epoch_ = 0;
};

} // namespace gsh
