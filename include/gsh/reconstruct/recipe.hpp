// SPDX-License-Identifier: Apache-2.0
/// @file  How a capture is reconstructed: the configuration, the length of the training, refinement, limits.
#pragma once

#include <gsh/reconstruct/any_training.hpp>
#include <gsh/setup/configuration.hpp>

#include <cstddef>
#include <cstdint>

namespace gsh {

/// Everything about a reconstruction except its input. The defaults are those of gsh-reconstruct.
struct Recipe {
    Configuration configuration = named_configuration(default_configuration);
    std::uint64_t steps = 0;        ///< of training; rates fall over them; 0: Configuration::usual_steps
    double seconds = 0;             ///< of training, instead of steps; 0: use steps
    std::size_t gaussians = 170000; ///< of each person
    std::uint64_t seed = 0;         ///< of all random choices
    bool refine = false;            ///< refine poses in training, and fit those of test frames
    bool refine_cameras = false;    ///< with refine: cameras, too
    bool registration = true;       ///< with refine: poses are registered to the photographs before training
    /// With registration: poses are near and the shape is right, as after fit_motion; the number of sizes of
    /// photographs. 0: poses may be far, and the shape learns.
    std::size_t fine_registration = 0;
    /// Bytes that training may take, of the host or of the device on which it runs; then there may be fewer Gaussians.
    /// 0: no limit.
    std::uint64_t max_memory = 0;

    [[nodiscard]] TrainingLength length() const {
        return {steps != 0 ? steps : configuration.usual_steps(), seconds};
    }
};

} // namespace gsh
