// SPDX-License-Identifier: Apache-2.0
/// @file  The seam between models and training: what makes splats for a frame and learns from their gradient.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/pipeline/learned_array.hpp>
#include <gsh/pipeline/photo.hpp>
#include <gsh/render/raster_cache.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>

namespace gsh {

/// Where the gradient of a photograph's camera is collected. Both are empty if the camera does not learn.
///
/// Shapes  camera [1], center [1], in the backend's memory; center is the camera's centre as colours depend on it,
///         apart from its projection.
template <class T>
struct CameraGradientView {
    Span<CameraGradient<T>> camera = {};
    Span<vec3<T>> center = {};
};

/// Something that makes splats for a frame and learns from their gradient. A step of training calls, in this order:
///
///     come_to(step, progress)             the step's number, and the share in [0, 1] of the run that is over
///     prepare(frame)                      evaluates what does not depend on the camera
///     camera(photo)                       the photograph's camera as the scene has it now
///     forward(frame, center, splats)      writes size() splats as seen from the camera's centre
///     camera_gradient(photo)              zeros to add to, or nothing
///     backward(frame, center, dL_dsplats, dL_dcenter)    adds to the gradients of learned()
///     camera_backward(photo)              takes over what was added to camera_gradient(photo)
///     learned()                           the arrays that take a step of Adam, with their rates at this step
///     after_step(raster_cache)            changes that are due after the step; size() may change here alone
///
/// forward may be called several times after one prepare. Photo::frame lies below frame_count().
template <class S, class B, class T>
concept SplatScene = requires(S& scene, const Photo& photo, std::size_t frame, std::uint64_t step, double progress,
                              const vec3<T>& center, const SplatView<T>& splats, const SplatView<const T>& dL_dsplats,
                              Span<vec3<T>> dL_dcenter, const RasterCache<B, T>& raster_cache) {
    { scene.size() } -> std::convertible_to<std::size_t>;
    { scene.frame_count() } -> std::convertible_to<std::size_t>;
    scene.come_to(step, progress);
    scene.prepare(frame);
    { scene.camera(photo) } -> std::same_as<Camera<T>>;
    scene.forward(frame, center, splats);
    { scene.camera_gradient(photo) } -> std::same_as<CameraGradientView<T>>;
    scene.backward(frame, center, dL_dsplats, dL_dcenter);
    scene.camera_backward(photo);
    { scene.learned() } -> std::same_as<LearnedArrays<T>>;
    scene.after_step(raster_cache);
};

/// A base for scenes that need only some of these calls: cameras are fixed, nothing depends on the step or is prepared,
/// and nothing happens after it. The size of the frames is left to the scene.
template <Backend B, std::floating_point T>
struct PlainScene {
    void come_to(std::uint64_t /*step*/, double /*progress*/) {}
    void prepare(std::size_t /*frame*/) {}
    [[nodiscard]] Camera<T> camera(const Photo& photo) const { return photo.camera.template cast<T>(); }
    [[nodiscard]] CameraGradientView<T> camera_gradient(const Photo&) const { return {}; }
    void camera_backward(const Photo&) const {}
    void after_step(const RasterCache<B, T>&) const {}
};

} // namespace gsh
