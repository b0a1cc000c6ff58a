// SPDX-License-Identifier: Apache-2.0
/// @file  Test-time refinement: a frame's pose is fitted to its photographs while the avatar's looks stay as they are.
#pragma once

#include <gsh/avatar/avatar.hpp>
#include <gsh/avatar/rig.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/image/image.hpp>
#include <gsh/loss/photometric.hpp>
#include <gsh/render/rasterizer.hpp>
#include <gsh/train/backdrop.hpp>
#include <gsh/train/refinement.hpp>

#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// One photograph of a frame: its camera and its pixels.
///
/// Shapes  rgba [height, width, 4] straight alpha; alpha is the person's mask. plate likewise, opaque: what the camera
///         sees without the person, or empty for a plain background. The caller owns both.
struct Observation {
    Camera<double> camera;
    Span<const std::uint8_t> rgba, plate = {};
};

/// An avatar, or a model in training, whose splats can be asked for and whose pose has a gradient.
template <class Model, class B, class T>
concept PoseableModel = requires(Model& model, const RigPose<B, T>& pose, const vec3<T>& center,
                                 const SplatView<T>& splats, const SplatView<const T>& dL_dsplats,
                                 typename Model::Cache& cache, const RigPoseGradient<T>& dL_dpose) {
    { model.size() } -> std::convertible_to<std::size_t>;
    model.pose(pose, center, splats, cache);
    model.pose_backward(pose, center, dL_dsplats, cache, dL_dpose);
};

struct PoseFitParams {
    std::size_t steps = 100;
    double ssim_weight = 0.2;
    double mask_weight = 0;                    ///< of mean |alpha - mask|: for clothes in the background's colour
    std::array<double, 3> background{1, 1, 1}; ///< display-referred sRGB, as in training
    std::function<bool()> stop = {};           ///< asked before each step where given; true: no further step
};

/// What a fit did: losses are means over the frame's photographs, without the motion's terms.
struct PoseFitReport {
    double loss_before = 0, loss_after = 0;
    std::size_t steps = 0; ///< fewer than asked for where it was stopped
    bool kept = false;     ///< false: nothing was better than the estimate, which stands
};

/// Moves pose, transl and expression of one frame down the photometric loss of its photographs.
///
/// The numbers that move belong to a MotionRefinement (made with test_time_config()), so that its rates, its pull to
/// the estimate and its ties to neighbouring frames hold here, too, and a whole test sequence is fitted in one motion.
/// Figures from fitted poses are figures of test-time refinement, and a report must say so.
///
/// Errors  ShapeError for an image of another size than its camera; ValueError for a frame that is left out.
template <Backend B, std::floating_point T = float, PoseableModel<B, T> Model = Avatar<B, T>>
class PoseFit {
public:
    using Params = PoseFitParams;
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    /// filter: what the avatar was trained with (AvatarData::filter).
    PoseFit(B& backend, Model& model, const PixelFilter& filter, const Params& params = {})
        : backend_(&backend), model_(&model), params_(params), backdrop_(params.background),
          rasterizer_(backend, raster_params<T>(filter)), loss_(backend, {.ssim_weight = T(params.ssim_weight)}),
          mask_loss_(backend) {
        check_value(params.mask_weight >= 0, "PoseFit", "mask_weight must not be negative");
    }

    /// Takes params.steps steps, one photograph after the other, rates falling from their first value to final_rate. An
    /// end that is worse than the beginning is taken back, where it was stopped, too.
    PoseFitReport fit(MotionRefinement<B, T>& motion, std::size_t frame, const std::vector<Observation>& photos) {
        check(photos, "PoseFit::fit");
        motion.come_to(0);
        check_value(motion.learns_motion(frame), "PoseFit::fit",
                    "frame " + std::to_string(frame) +
                        " does not learn; is it left out, or does it start later? see test_time_config");
        PoseFitReport report;
        report.loss_before = mean_loss(motion, frame, photos);
        remember(motion, frame);
        for (; report.steps < params_.steps && !(params_.stop && params_.stop()); ++report.steps) {
            motion.come_to(static_cast<double>(report.steps) / static_cast<double>(params_.steps));
            const Observation& photo = photos[report.steps % photos.size()];
            render(motion, frame, photo);
            backward(photo, motion.pose_gradient(), motion, frame);
            motion.step();
        }
        report.loss_after = mean_loss(motion, frame, photos);
        report.kept = report.loss_after < report.loss_before;
        if (!report.kept) {
            report.loss_after = report.loss_before;
            restore(motion, frame);
        }
        return report;
    }

    /// Mean loss of the frame's photographs at its present pose.
    [[nodiscard]] double mean_loss(const MotionRefinement<B, T>& motion, std::size_t frame,
                                   const std::vector<Observation>& photos) {
        check(photos, "PoseFit::mean_loss");
        double sum = 0;
        for (const Observation& photo : photos) sum += render(motion, frame, photo);
        return sum / static_cast<double>(photos.size());
    }

private:
    static constexpr std::array groups{RefinementGroup::pose, RefinementGroup::transl, RefinementGroup::expression,
                                       RefinementGroup::betas};

    static void check(const std::vector<Observation>& photos, std::string_view where) {
        check_value(!photos.empty(), where, "there are no photographs to fit to");
        for (const Observation& photo : photos) {
            check_camera(where, "an observation's camera", photo.camera);
            const std::size_t bytes =
                4 * static_cast<std::size_t>(photo.camera.width) * static_cast<std::size_t>(photo.camera.height);
            check_size(where, "rgba", photo.rgba.size(), bytes, "the image must have its camera's size");
            if (!photo.plate.empty())
                check_size(where, "plate", photo.plate.size(), bytes, "a plate is as large as its photograph");
        }
    }
    [[nodiscard]] bool with_mask() const { return params_.mask_weight > 0; }
    [[nodiscard]] static ImageView<T> image(Buffer<T>& buffer, int channels, const Camera<double>& camera) {
        return {buffer, channels, camera.height, camera.width};
    }

    /// Splats, picture and loss at the frame's present pose.
    double render(const MotionRefinement<B, T>& motion, std::size_t frame, const Observation& photo) {
        const Camera<T> camera = photo.camera.template cast<T>();
        const std::size_t plane = photo.rgba.size() / 4;
        for (Buffer<T>* buffer : {&render_, &truth_, &dL_drender_}) buffer->resize(3 * plane);
        for (Buffer<T>* buffer : {&alpha_, &mask_, &dL_dalpha_}) buffer->resize(plane);
        backdrop_.photograph(*backend_, photo.rgba, photo.plate, image(truth_, 3, photo.camera),
                             image(mask_, 1, photo.camera));
        motion.pose(frame, pose_);
        splats_.resize(model_->size());
        model_->pose(pose_, camera.center(), splats_.view(), model_cache_);
        rasterizer_.forward(camera, std::as_const(splats_).view(), backdrop_.background(),
                            {.color = image(render_, 3, photo.camera), .alpha = image(alpha_, 1, photo.camera)},
                            raster_cache_);
        loss_.forward(image(render_, 3, photo.camera), image(truth_, 3, photo.camera), loss_cache_);
        double value = loss_.values(loss_cache_).loss;
        if (with_mask()) {
            mask_loss_.forward(image(alpha_, 1, photo.camera), image(mask_, 1, photo.camera), mask_cache_);
            value += params_.mask_weight * mask_loss_.values(mask_cache_).loss;
        }
        return value;
    }

    void backward(const Observation& photo, const RigPoseGradient<T>& dL_dpose, MotionRefinement<B, T>& motion,
                  std::size_t frame) {
        const Camera<T> camera = photo.camera.template cast<T>();
        backend_->fill(Span<T>(dL_drender_), T(0));
        loss_.backward(image(render_, 3, photo.camera), image(truth_, 3, photo.camera), T(1), loss_cache_,
                       image(dL_drender_, 3, photo.camera));
        RenderGradient<T> dL_dtarget{.color = image(dL_drender_, 3, photo.camera)};
        if (with_mask()) {
            backend_->fill(Span<T>(dL_dalpha_), T(0));
            mask_loss_.backward(image(alpha_, 1, photo.camera), image(mask_, 1, photo.camera), T(params_.mask_weight),
                                mask_cache_, image(dL_dalpha_, 1, photo.camera));
            dL_dtarget.alpha = image(dL_dalpha_, 1, photo.camera);
        }
        dL_dsplats_.resize(model_->size());
        fill_zero(*backend_, dL_dsplats_.view());
        rasterizer_.backward(camera, std::as_const(splats_).view(), backdrop_.background(), dL_dtarget, raster_cache_,
                             dL_dsplats_.view());
        model_->pose_backward(pose_, camera.center(), std::as_const(dL_dsplats_).view(), model_cache_, dL_dpose);
        motion.accumulate(frame, dL_dpose);
    }

    static std::size_t row(RefinementGroup group, std::size_t frame) {
        return group == RefinementGroup::betas ? 0 : frame;
    }
    void remember(const MotionRefinement<B, T>& motion, std::size_t frame) {
        for (std::size_t g = 0; g < groups.size(); ++g) {
            const Span<const T> from = motion.increments(groups[g], row(groups[g], frame));
            remembered_[g].resize(from.size());
            backend_->copy(from, remembered_[g]);
        }
    }
    void restore(MotionRefinement<B, T>& motion, std::size_t frame) {
        for (std::size_t g = 0; g < groups.size(); ++g)
            backend_->copy(Span<const T>(remembered_[g]), motion.increments(groups[g], row(groups[g], frame)));
    }

    B* backend_;
    Model* model_;
    Params params_;
    Backdrop<B, T> backdrop_;
    Rasterizer<B, T> rasterizer_;
    PhotometricLoss<B, T> loss_;
    L1Loss<B, T> mask_loss_;

    Buffer<T> render_, truth_, dL_drender_; // [3, height, width]
    Buffer<T> alpha_, mask_, dL_dalpha_;    // [height, width]
    RigPose<B, T> pose_;
    Splats<B, T> splats_, dL_dsplats_;
    typename Model::Cache model_cache_;
    typename Rasterizer<B, T>::Cache raster_cache_;
    typename PhotometricLoss<B, T>::Cache loss_cache_, mask_cache_;
    std::array<Buffer<T>, groups.size()> remembered_;
};

} // namespace gsh
