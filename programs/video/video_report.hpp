// SPDX-License-Identifier: Apache-2.0
/// @file  The page of gsh-video: a verdict, and a picture of each stage.
#pragma once

#include "video/fitting.hpp"

#include <gsh/check/video_verdict.hpp>

#include <filesystem>
#include <vector>

namespace gsh::programs {

/// Writes OUT/report.html: the verdict, what the fit notes, and for four frames of each camera the keypoints, the
/// outline of the mask and those of the fitted bodies on the photograph; then the way to the report of the avatar.
///
/// Errors  IoError if a stage's files are missing.
void write_video_report(const std::filesystem::path& out, const std::filesystem::path& body,
                        const std::vector<VideoDoubt>& doubts, const FittedCapture& fitted);

} // namespace gsh::programs
