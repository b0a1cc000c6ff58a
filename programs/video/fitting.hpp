// SPDX-License-Identifier: Apache-2.0
/// @file  From the folder of a detector to a capture: the fit of gsh-fit, its files and what it says of them.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace gsh::programs {

/// Options of a fit.
struct FitOptions {
    std::filesystem::path detections, body;
    std::string people;          ///< of filmed_people.hpp
    std::vector<double> heights; ///< metres, one for each person, or none
    std::optional<double> focal; ///< pixels of the images, for a single camera
    std::string turn = "auto";   ///< "auto", "yes" or "no"
    int betas = 0;               ///< 0: all that the body has, at most 30
    std::size_t test_every = 0;  ///< every so many frames one is left out of training; 0: none
};

struct FittedCapture {
    std::vector<std::string> notes;      ///< what the user should know, worst first, a sentence each
    std::vector<std::string> poses;      ///< the file of each person's motion, in the capture's folder
    bool masks_by_body = false;          ///< whether the detector can cut masks anew by the fitted bodies
    bool free_before_one_camera = false; ///< whether depth is a guess: one camera, and no turn in one pose

    /// The options that name these files to other programs; none for a single poses.npz.
    [[nodiscard]] std::vector<std::string> poses_option() const;
};

/// Fits the people of a detector's folder, and makes the folder a capture: cameras.json, poses.npz or NAME.npz for each
/// person, and fit.json with the figures of the fit. Masks are mended; other files are not touched. The motion is also
/// written to each path in `to`; with several people to NAME_PERSON of it. All files appear together or not at all. The
/// folder must be locked (StagedResults).
///
/// Errors  those of load_detections and fit_people; ValueError if nobody was found, or fewer people than were asked
///         for; IoError for files that cannot be written.
FittedCapture fit_capture(const FitOptions& options, const std::vector<std::filesystem::path>& to);

} // namespace gsh::programs
