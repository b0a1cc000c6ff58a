// SPDX-License-Identifier: Apache-2.0
/// @file  The verdict of gsh-video: what detection, fit and check say of a video, in sentences.
#pragma once

#include <gsh/check/video_verdict.hpp>

#include <filesystem>
#include <string>
#include <vector>

namespace gsh::programs {

/// The doubts about the video of OUT/capture, whose body was fitted and which OUT/check judged, worst first: those of
/// video_verdict if there is one person, and the findings and the advice of gsh-check.
///
/// @param heights  as the user gave them, one for each person, or none.
/// @param poses    FittedCapture::poses.
/// Errors  IoError if a stage's files are missing.
std::vector<VideoDoubt> doubts_of_video(const std::filesystem::path& out, const std::filesystem::path& body,
                                        const std::vector<double>& heights, const std::vector<std::string>& poses);

} // namespace gsh::programs
