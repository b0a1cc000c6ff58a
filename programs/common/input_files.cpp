// SPDX-License-Identifier: Apache-2.0
#include "common/input_files.hpp"

#include "common/progress.hpp"

#include <gsh/io/body/body_file.hpp>
#include <gsh/io/body/region_file.hpp>
#include <gsh/io/capture/any_capture.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/capture/keypoints_file.hpp>
#include <gsh/io/capture/people_capture.hpp>
#include <gsh/io/capture/prior_views_file.hpp>
#include <gsh/io/file/crc32.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/json_file.hpp>
#include <gsh/io/model/avatar_file.hpp>
#include <gsh/io/model/configuration_file.hpp>
#include <gsh/io/model/lpips_file.hpp>
#include <gsh/io/motion/any_motion.hpp>
#include <gsh/io/motion/joint_map_file.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/io/splat/any_splats.hpp>

#include <nlohmann/json.hpp>

#include <cstdint>
#include <cstdio>

namespace gsh::programs {

namespace {

std::string text_of(std::uint32_t checksum) {
    char text[9];
    std::snprintf(text, sizeof text, "%08x", static_cast<unsigned>(checksum));
    return text;
}

/// Shows that a file is being read, if that takes long.
Progress reading(const std::filesystem::path& path) {
    return Progress("reading " + path.filename().string());
}

} // namespace

PeopleCapture people_of_folder(cpu::Threads& backend, const std::filesystem::path& folder, Span<const BodyModel> bodies,
                               const std::vector<std::filesystem::path>& poses, const CaptureOptions& options,
                               std::vector<std::string>& warnings) {
    const Progress shown = reading(folder);
    return load_people_capture(backend, folder, bodies, poses, options, &warnings);
}
bool brings_own_body(const std::filesystem::path& folder) {
    return recognise_capture(folder) == CaptureLayout::gala;
}
std::vector<std::string> warnings_of(const Capture& capture, const BodyModel& body, const Motion& motion) {
    return capture_warnings(capture, body, motion);
}

BodyModel body_of_file(const std::filesystem::path& path) {
    const Progress shown = reading(path);
    return load_body_model(path);
}
RegionLists regions_of_file(const std::filesystem::path& path, std::size_t vertex_count) {
    return read_regions(path, vertex_count);
}
std::vector<EstimatedPriors> priors_of_file(const std::filesystem::path& path, const Capture& capture,
                                            const std::vector<std::string>& people) {
    const Progress shown = reading(path);
    return read_prior_views(path, capture.cameras, capture.frame_count(), people);
}
std::vector<PhotoKeypoints> keypoints_of_file(const std::filesystem::path& path, const Capture& capture) {
    std::vector<PhotoKeypoints> keypoints =
        load_keypoints(path, capture.cameras, capture.frame_count(), capture.image_names);
    std::erase_if(keypoints, [&](const PhotoKeypoints& photo) {
        return !capture.is_training({photo.camera, photo.frame}) || !capture.is_taken({photo.camera, photo.frame});
    });
    check_value(!keypoints.empty(), path.string(), "has no keypoints of a training photograph");
    return keypoints;
}
std::string keypoints_checksum(const std::vector<PhotoKeypoints>& keypoints) {
    Crc32 crc;
    const auto add = [&](const auto& number) { crc.add(reinterpret_cast<const char*>(&number), sizeof number); };
    for (const PhotoKeypoints& photo : keypoints) {
        add(photo.camera), add(photo.frame);
        for (const Detection& person : photo.people)
            for (const Keypoint& point : person.points)
                add(point.landmark), add(point.pixel.x), add(point.pixel.y), add(point.confidence);
    }
    return text_of(crc.value());
}
std::string priors_checksum(const std::filesystem::path& path) {
    return text_of(prior_views_checksum(path));
}
std::string file_checksum(const std::filesystem::path& path) {
    const std::string bytes = read_file(path);
    Crc32 crc;
    crc.add(bytes.data(), bytes.size());
    return text_of(crc.value());
}
Motion motion_of_file(const std::filesystem::path& path, const BodyModel& body, std::vector<std::string>& warnings,
                      bool upright, const std::vector<double>& betas, const RigOption& rig, std::size_t number) {
    const Progress shown = reading(path);
    MotionFileOptions options;
    if (upright) options.world = MotionFileOptions::World::upright;
    options.betas = betas, options.animation = rig.animation, options.input_fps = rig.input_fps_of(number);
    if (!rig.joint_map.empty()) options.joint_map = read_joint_map(rig.joint_map);
    return load_any_motion(path, body, options, &warnings);
}
AvatarData avatar_of_file(const std::filesystem::path& path) {
    const Progress shown = reading(path);
    return load_avatar(path);
}
StillSplats splats_of_file(const std::filesystem::path& path, const std::string& up, std::optional<double> time) {
    const Progress shown = reading(path);
    check_value(!time || recognise_splats(path) == SplatFormat::glb, path.string(),
                "--time is for an animated scene (.glb)");
    StillSplats splats = time ? read_gltf_splats(path, time) : load_any_splats(path);
    check_value(splats.cloud.size() > 0, path.string(), "holds no Gaussians");
    if (const auto axis = up_axis_called(up)) restate_up(splats, *axis);
    return splats;
}
std::string scene_endings() {
    return splat_endings(SplatEndings::read);
}
NamedCamera camera_of_file(const std::filesystem::path& path, const std::string& name) {
    return read_camera(path, name);
}
LpipsNetwork lpips_of_file(const std::filesystem::path& path) {
    return read_lpips(path);
}
Configuration configuration_called(const std::string& name_or_path, std::string_view where) {
    return find_configuration(name_or_path, where);
}
bool is_scene_configuration(const std::string& name_or_path) {
    return is_static_configuration(name_or_path);
}
StaticModelParams scene_configuration_called(const std::string& name_or_path, std::int64_t steps) {
    return find_static_configuration(name_or_path, steps);
}
nlohmann::ordered_json json_of_file(const std::filesystem::path& path) {
    return gsh::detail::read_json(path);
}

} // namespace gsh::programs
