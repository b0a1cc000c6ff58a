// SPDX-License-Identifier: Apache-2.0
/// @file  Test-time refinement: a frame's pose is fitted to its photographs while the avatar stays as it is.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/setting.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/loss/photometric_cache.hpp>
#include <gsh/photo/photo.hpp>
#include <gsh/photo/photo_loss.hpp>
#include <gsh/photo/photo_pixels.hpp>
#include <gsh/refine/refinement.hpp>
#include <gsh/train/frozen_scene.hpp>

#include <array>
#include <concepts>
#include <cstddef>
#include <functional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// Settings of a fit.
struct PoseFitParams {
    std::size_t steps = 60;
    double ssim_weight = PhotometricParams<double>().ssim_weight;
    double mask_weight = 0;                    ///< of mean |alpha - mask|; for clothes in the background's colour
    std::array<double, 3> background{1, 1, 1}; ///< display-referred sRGB, as in training
    std::function<bool()> stop = {};           ///< called before each step if given; true ends the fit

    template <class Self, class F>
    static void for_each_setting(Self& self, const F& f) {
        f("refine.test_steps", self.steps, SettingRange::at_least(0));
        f("refine.test_mask_weight", self.mask_weight, SettingRange::at_least(0));
    }
};

/// The result of a fit. Losses are means over the frame's photographs, without the motion's terms.
struct PoseFitReport {
    double loss_before = 0, loss_after = 0;
    std::size_t steps = 0; ///< fewer than Params::steps if the fit was stopped
    bool kept = false;     ///< false: the result was not better, and the estimate was restored
};

/// Fits pose, transl and expression of one frame by descending the photometric loss of its photographs.
///
/// The increments that learn belong to the scene's motion, made with test_time_params(). Its rates, its pull to the
/// estimate and its terms between neighbouring frames therefore apply, and one motion serves a whole test sequence.
/// Figures from fitted poses are figures of test-time refinement, and a report must state it.
///
/// Errors  ShapeError for an image of another size than its camera; ValueError for a frame that is left out.
template <Backend B, std::floating_point T = float>
class PoseFit {
public:
    using Params = PoseFitParams;

    /// filter: the one of the avatar's training (AvatarData::filter).
    PoseFit(B& backend, const PixelFilter& filter, const Params& params = {})
        : backend_(&backend), params_(params), loss_(backend, {.filter = filter,
                                                               .ssim_weight = params.ssim_weight,
                                                               .mask_weight = params.mask_weight,
                                                               .background = params.background}),
          repeated_(backend) {}

    /// Takes params.steps steps, over the photographs in turn. Rates fall from their first value to final_rate. If the
    /// loss at the end is not below that at the beginning, the pose at the beginning is restored, also if the fit was
    /// stopped. All photographs must show `frame`; their own frame numbers are not read. They must be in memory, see
    /// HeldPhoto.
    template <FrozenScene<B, T> Scene>
    PoseFitReport fit(Scene& scene, std::size_t frame, const std::vector<Photo>& photos) {
        MotionRefinement<B, T>& motion = scene.motion();
        check(photos, "PoseFit::fit");
        scene.set_progress(0, 0);
        check_value(motion.learns_motion(frame), "PoseFit::fit",
                    "frame " + std::to_string(frame) +
                        " does not learn; is it left out, or does it start later? see test_time_params");
        scene.prepare(frame);
        const PhotoPixels<B> pixels(*backend_, photos);
        PoseFitReport report;
        report.loss_before = mean_loss_of(scene, frame, photos, pixels);
        remember(motion, frame);
        const auto settle = [&] { loss_.settle(repeated_, scene, report.steps); };
        while (report.steps < params_.steps && !(params_.stop && params_.stop())) {
            scene.set_progress(report.steps, static_cast<double>(report.steps) / static_cast<double>(params_.steps));
            const std::size_t index = report.steps % photos.size();
            repeated_.run(PhotoLoss<B, T>::kind(photos[index], pixels[index]),
                          [&] { step(scene, frame, photos[index], pixels[index]); });
            ++report.steps;
            if (report.steps % steps_between_waits == 0 || report.steps == params_.steps) settle();
        }
        settle();
        report.loss_after = mean_loss_of(scene, frame, photos, pixels);
        report.kept = report.loss_after < report.loss_before;
        if (!report.kept) {
            report.loss_after = report.loss_before;
            restore(motion, frame);
        }
        return report;
    }

    /// Mean loss of the frame's photographs at its present pose.
    template <FrozenScene<B, T> Scene>
    [[nodiscard]] double mean_loss(Scene& scene, std::size_t frame, const std::vector<Photo>& photos) {
        check(photos, "PoseFit::mean_loss");
        scene.prepare(frame);
        return mean_loss_of(scene, frame, photos, PhotoPixels<B>(*backend_, photos));
    }

private:
    /// A device is waited for so often; the motion remembers more steps than that (RefinementTables).
    static constexpr std::size_t steps_between_waits = 100;
    static constexpr std::array groups{RefinementGroup::pose, RefinementGroup::transl, RefinementGroup::expression,
                                       RefinementGroup::betas};

    static void check(const std::vector<Photo>& photos, std::string_view where) {
        check_value(!photos.empty(), where, "there are no photographs to fit to");
        for (const Photo& photo : photos) {
            check_photo(where, photo, photo.frame + 1);
            check_value(!photo.source, where, photo.name + " is not in memory; hold it with HeldPhoto");
        }
    }

    /// Computes splats, picture and loss at the frame's present pose. Returns the photograph's camera.
    Camera<T> render(auto& scene, std::size_t frame, const Photo& photo, const typename PhotoPixels<B>::View& pixels) {
        const Camera<T> camera = photo.camera.template cast<T>();
        loss_.set_photo(photo, pixels);
        splats_.resize(scene.size());
        scene.forward(frame, camera.center(), splats_.view());
        loss_.render(camera, std::as_const(splats_).view());
        loss_.compare();
        return camera;
    }
    void step(auto& scene, std::size_t frame, const Photo& photo, const typename PhotoPixels<B>::View& pixels) {
        const Camera<T> camera = render(scene, frame, photo, pixels);
        dL_dsplats_.resize(scene.size());
        fill_zero(*backend_, dL_dsplats_.view());
        loss_.backward(camera, std::as_const(splats_).view(), dL_dsplats_.view());
        scene.backward(frame, camera.center(), std::as_const(dL_dsplats_).view(), {});
        scene.after_step(loss_.raster_cache());
    }
    [[nodiscard]] double mean_loss_of(auto& scene, std::size_t frame, const std::vector<Photo>& photos,
                                      const PhotoPixels<B>& pixels) {
        double sum = 0;
        for (std::size_t i = 0; i < photos.size(); ++i) {
            render(scene, frame, photos[i], pixels[i]);
            sum += loss_.loss();
        }
        return sum / static_cast<double>(photos.size());
    }

    static std::size_t row(RefinementGroup group, std::size_t frame) {
        return group == RefinementGroup::betas ? 0 : frame;
    }
    void remember(const MotionRefinement<B, T>& motion, std::size_t frame) {
        for (std::size_t g = 0; g < groups.size(); ++g) {
            const Span<const T> from = motion.increments(groups[g], row(groups[g], frame));
            remembered_[g].resize(from.size());
            backend_->copy(from, Span<T>(remembered_[g]));
        }
    }
    void restore(MotionRefinement<B, T>& motion, std::size_t frame) {
        for (std::size_t g = 0; g < groups.size(); ++g)
            backend_->copy(Span<const T>(remembered_[g]), motion.increments(groups[g], row(groups[g], frame)));
    }

    B* backend_;
    Params params_;
    PhotoLoss<B, T> loss_;
    RepeatedStep<B> repeated_;
    Splats<B, T> splats_, dL_dsplats_;
    std::array<typename B::template Buffer<T>, groups.size()> remembered_;
};

} // namespace gsh
