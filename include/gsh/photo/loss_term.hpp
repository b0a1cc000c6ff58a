// SPDX-License-Identifier: Apache-2.0
/// @file  Terms of a training's loss beside the photographs: of a person's pose, or of learned arrays.
#pragma once

#include <gsh/avatar/rig.hpp>
#include <gsh/backend/backend.hpp>

#include <concepts>
#include <cstddef>

namespace gsh {

/// A term of the loss that needs no picture, for instance a prior. A scene that has been given one (AvatarScene::add)
/// calls it in the backward pass of each step whose frame counts. The term keeps references to what it reads and to the
/// gradients to which it adds: those of a model's learned() arrays, or that of the pose.
template <Backend B, std::floating_point T = float>
class LossTerm {
public:
    virtual ~LossTerm() = default;

    /// Whether the term has a share in the steps of a frame. On a device, steps whose terms differ are recorded apart.
    [[nodiscard]] virtual bool counts(std::size_t /*frame*/) const { return true; }

    /// Adds the term's gradient at a frame of the training motion. `pose` is the person's present pose. Its gradient
    /// has no parts where the motion does not learn. Work is queued on the backend that holds both; there is no wait.
    virtual void backward(std::size_t frame, const RigPose<B, T>& pose, const RigPoseGradient<T>& dL_dpose) = 0;
};

} // namespace gsh
