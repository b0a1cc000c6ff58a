// SPDX-License-Identifier: Apache-2.0
/// @file  A photograph to train on or to judge by.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/core/span.hpp>

#include <cstddef>
#include <cstdint>
#include <string>

namespace gsh {

/// One photograph of the person: who took it, when, and its pixels.
///
/// Shapes  rgba [height, width, 4] straight alpha; alpha is the person's mask. plate likewise, opaque: what the camera
///         sees without the person, or empty for a plain background. The caller owns both.
struct Photo {
    std::string name;
    Camera<double> camera;
    std::size_t frame = 0; ///< of the motion
    Span<const std::uint8_t> rgba;
    std::size_t camera_index = 0; ///< of the capture's cameras, by which a refinement knows them
    Span<const std::uint8_t> plate = {};
};

} // namespace gsh
