// SPDX-License-Identifier: Apache-2.0
/// @file  The cameras of a capture: names, roles and calibration.
#pragma once

#include <gsh/camera/distortion.hpp>
#include <gsh/camera/pinhole.hpp>

#include <optional>
#include <string>
#include <vector>

namespace gsh {

/// A camera of a capture. If `distortion` is empty, its images are free of distortion.
struct NamedCamera {
    enum class Role { train, test };

    std::string name;
    Role role = Role::train;
    Camera<double> camera;
    std::optional<Distortion<double>> distortion; ///< of the photographs, if they are not undistorted yet
};

/// The contents of a capture's `cameras.json`.
struct CameraList {
    std::vector<NamedCamera> cameras;
    double fps = 0;                ///< frames per second; 0 if the file does not give it
    std::optional<double> floor_y; ///< height of the floor, metres
    std::vector<int> test_frames;  ///< excluded from training in every camera
};

} // namespace gsh
