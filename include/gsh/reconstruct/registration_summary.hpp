// SPDX-License-Identifier: Apache-2.0
/// @file  What the registration of a capture's people found out.
#pragma once

#include <gsh/core/message.hpp>

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace gsh {

/// How far register_people moved the people, and how well their bodies then explain the photographs.
struct RegistrationSummary {
    struct Moved {
        std::string name;
        double joints_mm = 0, root_aligned_mm = 0; ///< means over joints and frames
        double betas = 0;                          ///< root mean square over coefficients
    };
    double psnr = 0;                  ///< of the last level's photographs, dB
    std::size_t keypoints = 0;        ///< photographs with keypoints of these people
    std::optional<double> focal = {}; ///< factor on the focal lengths, if that of a single camera has learned
    std::vector<Moved> people = {};
    std::vector<double> frame_fit = {};            ///< [T] dB; NaN for frames without a photograph
    std::vector<double> frame_weights = {};        ///< [T] with which the frames' photographs are trained
    std::vector<std::size_t> doubtful_frames = {}; ///< that fit much worse than the others

    /// One line for a reader.
    [[nodiscard]] std::string text() const {
        using detail::fixed;
        std::string result = "the registered bodies explain the photographs to " + fixed(psnr, 1) + " dB";
        for (const Moved& person : people)
            result += ", " + (people.size() > 1 ? person.name + ": " : std::string()) + "joints moved by " +
                      fixed(person.joints_mm, 0) + " mm (" + fixed(person.root_aligned_mm, 0) +
                      " mm relative to the root), the shape by " + fixed(person.betas, 2) + " per coefficient";
        if (focal) result += ", the focal length by " + fixed(100 * (*focal - 1), 1) + "%";
        if (keypoints > 0) result += ", with keypoints in " + std::to_string(keypoints) + " photographs";
        return result;
    }
};

} // namespace gsh
