// SPDX-License-Identifier: Apache-2.0
#include "video/detecting.hpp"

#include "video/stage_process.hpp"

#include <gsh/core/error.hpp>

#include <cstdlib>
#include <filesystem>
#include <string>
#include <system_error>
#include <vector>

namespace gsh::programs {

namespace {

std::string detector_of(const DetectOptions& options) {
    if (!options.detector.empty()) return options.detector.string();
    if (const char* named = std::getenv("GSH_DETECTOR"); named && *named) return named;
    const std::filesystem::path programs = folder_of_programs();
    std::error_code error;
    for (const auto& place : {programs / "gsh-detect", programs / "../../../scripts/detect"})
        if (std::filesystem::exists(place, error)) return std::filesystem::weakly_canonical(place, error).string();
    return "gsh-detect";
}

} // namespace

bool is_detector_folder(const std::filesystem::path& path) {
    std::error_code error;
    for (const char* file : {"video.json", "keypoints.json", "keypoints"})
        if (std::filesystem::exists(path / file, error)) return true;
    return false;
}

void detect(const DetectOptions& options, const std::filesystem::path& out) {
    std::error_code error;
    for (const std::string& video : options.videos)
        if (!std::filesystem::exists(video, error)) throw IoError(video + ": does not exist");
    std::vector<std::string> words{detector_of(options), out.string()};
    words.insert(words.end(), options.videos.begin(), options.videos.end());
    const auto add = [&](const char* name, const std::string& value) { words.insert(words.end(), {name, value}); };
    add("--fps", std::to_string(options.fps));
    add("--frames", std::to_string(options.frames));
    add("--size", std::to_string(options.size));
    if (options.begin) add("--begin", std::to_string(*options.begin));
    if (options.end) add("--end", std::to_string(*options.end));
    if (!options.calibration.empty()) add("--calibration", options.calibration.string());
    if (options.restart) words.push_back("--restart");
    run_stage("finding the person", words);
}

void cut_masks_by_body(const DetectOptions& options, const std::filesystem::path& out) {
    run_stage("cutting the masks by the body", {detector_of(options), out.string(), "--bodies"});
}

} // namespace gsh::programs
