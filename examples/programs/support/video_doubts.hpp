// SPDX-License-Identifier: Apache-2.0
/// @file  The verdict of gsh-video: what detection, fit and check say of a video, in sentences.
#pragma once

#include <gsh/check/video_verdict.hpp>

#include <filesystem>
#include <optional>
#include <vector>

namespace gsh::examples {

/// The doubts about the video of OUT/capture, whose body was fitted and which OUT/check judged, worst first: those of
/// video_verdict, and the findings and the advice of gsh-check.
///
/// Errors  IoError if a stage's files are missing.
std::vector<VideoDoubt> doubts_of_video(const std::filesystem::path& out, const std::filesystem::path& body,
                                        std::optional<double> height);

} // namespace gsh::examples
