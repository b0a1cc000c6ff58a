// SPDX-License-Identifier: Apache-2.0
/// @file  One person in one photograph: keypoints, mask and camera.
#pragma once

#include <gsh/body/keypoints.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/fit/mask_view.hpp>

#include <cstddef>
#include <vector>

namespace gsh {

struct ViewKeypoints {
    Camera<double> camera;
    std::vector<Keypoint> points;
    std::vector<MetricPoint> metric = {}; ///< the detector's guesses, axes of the camera
    std::size_t camera_number = 0;
    MaskView mask = {}; ///< the caller owns its pixels
};

} // namespace gsh
