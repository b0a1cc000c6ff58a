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
/// Shapes  rgba [height, width, 4] straight alpha, owned by the caller; alpha is the person's mask.
struct Photo {
    std::string name;
    Camera<double> camera;
    std::size_t frame = 0; ///< of the motion
    Span<const std::uint8_t> rgba;
    std::size_t camera_index = 0; ///< of the capture's cameras, by which a refinement knows them
};

} // namespace gsh
