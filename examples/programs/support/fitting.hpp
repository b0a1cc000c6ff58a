// SPDX-License-Identifier: Apache-2.0
/// @file  From the folder of a detector to a capture: the fit of gsh-fit, its files and what it says of them.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace gsh::examples {

/// Options of a fit.
struct FitOptions {
    std::filesystem::path detections, body;
    std::optional<double> height; ///< metres
    std::optional<double> focal;  ///< pixels of the images, for a single camera
    std::string turn = "auto";    ///< "auto", "yes" or "no"
    int betas = 0;                ///< 0: all that the body has, at most 30
    std::size_t test_every = 0;   ///< every so many frames one is left out of training; 0: none
};

/// Fits the person of a detector's folder, and makes the folder a capture: cameras.json, poses.npz, and fit.json with
/// the figures of the fit. Other files are not touched. The motion is also written to each path in `to`.
///
/// Returns what the user should know, worst first, a sentence each.
/// Errors  those of load_detections and fit_motion; ValueError if nobody was found.
std::vector<std::string> fit_capture(const FitOptions& options, const std::vector<std::filesystem::path>& to);

} // namespace gsh::examples
