// SPDX-License-Identifier: Apache-2.0
/// @file  One of the people in a capture: a name, poses and optional masks.
#pragma once

#include <gsh/body/motion.hpp>
#include <gsh/image/image.hpp>
#include <gsh/io/capture/capture_data.hpp>

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace gsh {

/// A person in a capture.
struct CapturePerson {
    std::string name;     ///< used in file names and tables
    std::size_t body = 0; ///< index of the body model
    Motion motion;        ///< a pose for each of the capture's frames
    /// 1 where a view shows this person: [cameras * frames] as Capture::images, empty where there is no mask; or no
    /// images at all. Only views for evaluation have masks.
    std::vector<Image<std::uint8_t>> masks = {};

    /// The mask of a view; null if there is none.
    [[nodiscard]] const Image<std::uint8_t>* mask(CaptureView view) const {
        if (masks.empty()) return nullptr;
        const auto& mask = masks[view.camera * motion.frame_count() + view.frame];
        return mask.data.empty() ? nullptr : &mask;
    }
};

} // namespace gsh
