// SPDX-License-Identifier: Apache-2.0
/// @file  The concept between models and training: a scene makes splats for a frame and learns from their gradient.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/camera/camera_input.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/learn/learned_array.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/photo/photo.hpp>
#include <gsh/render/raster_cache.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>

namespace gsh {

/// Where the gradient of a photograph's camera is added. Both are empty if the camera does not learn.
///
/// Shapes  camera [1], the gradient through the projection; center [1], the gradient of the camera's centre through
///         view-dependent colours. Both in the backend's memory.
template <class T>
struct CameraGradientView {
    Span<CameraGradient<T>> camera = {};
    Span<vec3<T>> center = {};
};

/// A scene makes splats for a frame and learns from their gradient. A training step makes these calls, in this order:
///
///     set_progress(step, progress)        sets the step's number, and the share of the run that is over, in [0, 1]
///     prepare(frame)                      evaluates everything that does not depend on the camera
///     camera(photo)                       returns the photograph's camera, with refinement if there is any
///     forward(frame, center, splats)      writes size() splats, seen from the camera's centre
///     camera_gradient(photo)              returns zeros to add to, or empty spans
///     backward(frame, center, dL_dsplats, dL_dcenter)    adds to the gradients of learned()
///     camera_backward(photo)              takes the gradients that were added to camera_gradient(photo)
///     learned()                           returns the arrays that take a step of Adam, with their rates at this step
///     after_step(raster_cache)            makes changes that are due after the step; only here may size() change
///
/// forward may be called several times after one prepare. Every frame is below frame_count().
///
/// A scene may also have take_back(steps), which PhotoLoss::settle calls. A device that runs ahead of the host can find
/// after some steps that a buffer was too small; the last `steps` steps have then changed nothing on the device, and
/// are run again. A scene that counts its steps on the host, outside of set_progress, must subtract them here. It may
/// have kind(photo), a number that differs where the kernels of a photograph's step do: each kind is recorded once. And
/// it may have name_of(splat), what messages call a splat beside its number: "Gaussian 12 of person 1", or nothing. A
/// trainer gives views with factors in place of covariances to a scene whose constant has_needles is true.
template <class S, class B, class T>
concept SplatScene = requires(S& scene, const Photo& photo, std::size_t frame, std::uint64_t step, double progress,
                              const Deferred<vec3<T>>& center, const SplatView<T>& splats,
                              const SplatView<const T>& dL_dsplats, Span<vec3<T>> dL_dcenter,
                              const RasterCache<B, T>& raster_cache) {
    { scene.size() } -> std::convertible_to<std::size_t>;
    { scene.frame_count() } -> std::convertible_to<std::size_t>;
    scene.set_progress(step, progress);
    scene.prepare(frame);
    { scene.camera(photo) } -> std::convertible_to<CameraInput<T>>;
    scene.forward(frame, center, splats);
    { scene.camera_gradient(photo) } -> std::same_as<CameraGradientView<T>>;
    scene.backward(frame, center, dL_dsplats, dL_dcenter);
    scene.camera_backward(photo);
    { scene.learned() } -> std::same_as<LearnedArrays<T>>;
    scene.after_step(raster_cache);
};

/// A base for scenes that need only some of these calls. Cameras are fixed, nothing depends on the step, nothing is
/// prepared, and nothing happens after the step. size(), frame_count(), forward, backward and learned() are the
/// scene's.
template <Backend B, std::floating_point T>
struct PlainScene {
    void set_progress(std::uint64_t /*step*/, double /*progress*/) {}
    void prepare(std::size_t /*frame*/) {}
    [[nodiscard]] CameraInput<T> camera(const Photo& photo) const { return photo.camera.template cast<T>(); }
    [[nodiscard]] CameraGradientView<T> camera_gradient(const Photo&) const { return {}; }
    void camera_backward(const Photo&) const {}
    void after_step(const RasterCache<B, T>&) const {}
};

} // namespace gsh
