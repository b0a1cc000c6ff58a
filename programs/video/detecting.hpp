// SPDX-License-Identifier: Apache-2.0
/// @file  Runs a detector on videos.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace gsh::programs {

/// What a detector is told.
struct DetectOptions {
    std::vector<std::string> videos = {};       ///< files, or folders of images; one of each camera
    std::filesystem::path detector = {};        ///< empty: the one that is found
    std::filesystem::path calibration = {};     ///< empty: none
    double fps = 10;                            ///< images that are taken from a second of the video, at most
    int frames = 150;                           ///< and of each camera, at most
    int size = 540;                             ///< pixels of the longer side, at most
    std::optional<double> begin = {}, end = {}; ///< seconds from the start of the video
    bool restart = false;                       ///< discard what a detector found before
};

/// Whether a folder holds what a detector wrote, and not a camera's images.
[[nodiscard]] bool is_detector_folder(const std::filesystem::path& path);

/// Runs the detector: options.detector, else GSH_DETECTOR, else gsh-detect beside this program, else scripts/detect of
/// the source tree in which this program was built, else gsh-detect of the search path.
///
/// Errors  IoError if a video does not exist; those of run_stage.
void detect(const DetectOptions& options, const std::filesystem::path& out);

/// Lets the detector cut the masks of its folder anew, by the bodies that a fit has written there.
///
/// Errors  those of run_stage.
void cut_masks_by_body(const DetectOptions& options, const std::filesystem::path& out);

} // namespace gsh::programs
