// SPDX-License-Identifier: Apache-2.0
/// @file  The library's readers of input files, compiled once together with the JSON and archive code that they use. Those
/// that may take long show a line of progress.
#pragma once

#include "common/rig_option.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/core/span.hpp>

#include <nlohmann/json_fwd.hpp>

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {
struct AvatarData;
struct BodyModel;
struct CameraList;
struct Capture;
struct CaptureOptions;
struct Configuration;
struct EstimatedPriors;
struct LpipsNetwork;
struct Motion;
struct NamedCamera;
struct PhotoKeypoints;
struct PeopleCapture;
struct RegionLists;
struct StaticModelParams;
struct StillSplats;
} // namespace gsh

namespace gsh::programs {

/// load_people_capture.
PeopleCapture people_of_folder(cpu::Threads& backend, const std::filesystem::path& folder, Span<const BodyModel> bodies,
                               const std::vector<std::filesystem::path>& poses, const CaptureOptions& options,
                               std::vector<std::string>& warnings);
/// True if a folder is a capture whose layout includes a body.
bool brings_own_body(const std::filesystem::path& folder);
/// capture_warnings.
std::vector<std::string> warnings_of(const Capture& capture, const BodyModel& body, const Motion& motion);

/// load_body_model.
BodyModel body_of_file(const std::filesystem::path& path);
/// read_regions.
RegionLists regions_of_file(const std::filesystem::path& path, std::size_t vertex_count);
/// read_prior_views, for each person.
std::vector<EstimatedPriors> priors_of_file(const std::filesystem::path& path, const Capture& capture,
                                            const std::vector<std::string>& people);
/// Keypoints of the capture's training photographs.
/// Errors  those of load_keypoints; ValueError if there are none.
std::vector<PhotoKeypoints> keypoints_of_file(const std::filesystem::path& path, const Capture& capture);
/// CRC-32 of all keypoints as text.
std::string keypoints_checksum(const std::vector<PhotoKeypoints>& keypoints);
/// prior_views_checksum, as text.
std::string priors_checksum(const std::filesystem::path& path);
/// CRC-32 of a file as text, to detect changes.
std::string file_checksum(const std::filesystem::path& path);
/// load_any_motion; with `upright` the world is rotated so that the body stands along +y. Motions without a shape take
/// `betas`; `rig` is for those of other rigs and for the frame rate, `number` the motion's number among --poses.
Motion motion_of_file(const std::filesystem::path& path, const BodyModel& body, std::vector<std::string>& warnings,
                      bool upright = false, const std::vector<double>& betas = {}, const RigOption& rig = {},
                      std::size_t number = 0);
/// load_avatar.
AvatarData avatar_of_file(const std::filesystem::path& path);
/// load_any_splats; with `up`, one of up_axis_names, restate_up; with a time, an animated .glb at that time.
/// Errors  ValueError for a file without Gaussians.
StillSplats splats_of_file(const std::filesystem::path& path, const std::string& up = {},
                           std::optional<double> time = {});
/// The endings of scenes, for help texts: ".ply, .compressed.ply, …".
std::string scene_endings();
/// read_camera.
NamedCamera camera_of_file(const std::filesystem::path& path, const std::string& name);
/// read_lpips.
LpipsNetwork lpips_of_file(const std::filesystem::path& path);
/// find_configuration.
Configuration configuration_called(const std::string& name_or_path, std::string_view where);
/// is_static_configuration.
bool is_scene_configuration(const std::string& name_or_path);
/// find_static_configuration.
StaticModelParams scene_configuration_called(const std::string& name_or_path, std::int64_t steps);
/// Reads any JSON file.
/// Errors  IoError naming the file.
nlohmann::ordered_json json_of_file(const std::filesystem::path& path);

} // namespace gsh::programs
