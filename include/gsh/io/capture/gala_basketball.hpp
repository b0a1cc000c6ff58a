// SPDX-License-Identifier: Apache-2.0
/// @file  Loads scenes of GalaBasketball: text files, a rig of 27 joints, static backgrounds.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/io/capture/capture_data.hpp>
#include <gsh/io/capture/capture_images.hpp>
#include <gsh/io/capture/capture_photos.hpp>
#include <gsh/io/capture/named_camera.hpp>
#include <gsh/io/file/folder_list.hpp>
#include <gsh/io/file/full_path.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/number_lines.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/motion/any_motion.hpp>
#include <gsh/io/motion/gala_rig.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <map>
#include <numbers>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh {

struct GalaScene {
    GalaRig rig;
    Capture capture;            ///< with the motion of options.person
    std::vector<Motion> people; ///< all of them
};

/// Motions that replace those of the data set, such as fits of SMPL-X to its people.
///
/// Frame  that of the cameras which load_gala_scene returns: the files' world with x negated, y up, in metres.
struct GalaMotions {
    Span<const BodyModel> bodies = {};        ///< one for all, or one for each person; none: the rig of the data set
    std::vector<std::filesystem::path> files; ///< what load_any_motion reads, one for each person of the scene
};

/// Loads a scene. Its layout, in addition to the rig in options.model (default: FOLDER/../model):
///
///     FOLDER/camera/ID.txt      vertical field of view in degrees, width, height; position;
///                               quaternion x, y, z, w; scale
///     FOLDER/bg/ID.png          the camera's view without people: Capture::backgrounds
///     FOLDER/ID/NUMBER.png      photographs (four digits), used as a whole; NUMBER_mask.png is not read
///     FOLDER/pose/NUMBER.txt    load_gala_motions
///
/// For the published scenes (idle, dribble, …), identified by the folder's name, frames and split are those in use.
/// Otherwise all frames are used unless options specify them. Camera 6 (or the last one) is the test camera. Images
/// that the split does not use are not read and count as not taken, as do those that are missing, with a warning.
/// options.poses may name another motion for options.person, with a pose for each of these frames.
///
/// Errors  those of load_capture. A scene without training frames (gymnastics) has only motions: use load_gala_motions.
template <HostExecutor E>
[[nodiscard]] GalaScene load_gala_scene(E& executor, const std::filesystem::path& folder,
                                        const CaptureOptions& options = {},
                                        std::vector<std::string>* warnings = nullptr);

/// The same with other motions of its people, in place of options.poses; each has a pose for each frame of the split,
/// and takes the timestamps of these frames. Without files it is the function above.
///
/// Errors  as above; ShapeError for motions of another number of people or frames, ValueError for bodies without
///         motions, and for a number of bodies that is neither 1 nor that of the motions.
template <HostExecutor E>
[[nodiscard]] GalaScene load_gala_scene(E& executor, const std::filesystem::path& folder, const GalaMotions& motions,
                                        const CaptureOptions& options = {},
                                        std::vector<std::string>* warnings = nullptr);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// The split of published results: frames of the training cameras and of the test camera.
struct GalaSplit {
    std::optional<FrameRange> train, test;
};
inline GalaSplit known_gala_split(std::string_view scene) {
    struct Row {
        std::string_view scene;
        FrameRange train, test;
    };
    constexpr Row rows[] = {{"idle", {0, 98, 2}, {0, 98, 2}},    {"turn", {0, 98, 2}, {0, 98, 2}},
                            {"dribble", {0, 58, 2}, {0, 58, 2}}, {"shot", {0, 78, 2}, {0, 78, 2}},
                            {"block", {0, 78, 2}, {0, 79, 1}},   {"boxout", {0, 140, 2}, {0, 141, 1}},
                            {"match", {0, 246, 6}, {0, 249, 1}}};
    for (const Row& row : rows)
        if (row.scene == scene) return {row.train, row.test};
    return {};
}

/// Reads a camera file. The files' left-handed camera looks along +z with y up; ours has y down.
inline Camera<double> read_gala_camera(const InputFile& input) {
    const NumberLines lines(input);
    const std::vector<double>& view = lines.at(0, 3, "field of view, width, height");
    const vec3<double> position = lines.vector(1, "position");
    const std::vector<double>& q = lines.at(2, 4, "quaternion x, y, z, w");
    const vec3<double> scale = lines.size() > 3 ? lines.vector(3, "scale") : vec3<double>(1);
    const std::string name = input.name();
    check_value(view[0] > 0 && view[0] < 180, name,
                "the vertical field of view is " + number_text(view[0]) + ", expected degrees between 0 and 180");
    check_value(view[1] >= 1 && view[2] >= 1 && view[1] <= 65535 && view[2] <= 65535, name,
                "width and height must be pixels");
    check_value(std::abs(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1) < 1e-2, name,
                "the quaternion is not of length 1, expected x, y, z, w");
    check_value(scale.x > 0 && std::abs(scale.y - scale.x) < 1e-3 * scale.x &&
                    std::abs(scale.z - scale.x) < 1e-3 * scale.x,
                name, "the scale differs between axes, or is not above 0; our cameras have none");
    Camera<double> camera;
    camera.width = static_cast<int>(view[1]), camera.height = static_cast<int>(view[2]);
    const double half = view[0] / 360 * std::numbers::pi;
    camera.fx = camera.fy = camera.height / (2 * std::tan(half));
    camera.cx = camera.width / 2.0, camera.cy = camera.height / 2.0;
    const mat3<double> world_from_camera = mirrored(rotation_from_quat(quat<double>{q[3], q[0], q[1], q[2]}));
    // M R M is a mirrored camera frame with x to the left. Half a turn about z gives x right, y down.
    const mat3<double> half_turn(vec3<double>(-1, 0, 0), vec3<double>(0, -1, 0), vec3<double>(0, 0, 1));
    camera.R = half_turn * transpose(world_from_camera);
    camera.t = -(camera.R * mirrored(position));
    check_camera(name, "camera", camera);
    return camera;
}

/// Reads a motion for a scene. One that does not fit the data set's own rig is probably of another body.
inline Motion load_motion_for_gala(const std::filesystem::path& file, const BodyModel& body, bool is_rig,
                                   const CaptureOptions& options, std::vector<std::string>* warnings) {
    try {
        return load_any_motion(file, body, {options.hands, 30}, warnings);
    } catch (const ShapeError& error) {
        if (!is_rig) throw;
        throw ShapeError(std::string(error.what()) + "; a motion of another body than the data set's needs that body");
    }
}

/// Puts the given motions into the place of the data set's own, which determine how many people and frames there are.
inline void replace_gala_motions(const std::filesystem::path& folder, const GalaMotions& motions, const GalaRig& rig,
                                 const CaptureOptions& options, std::vector<Motion>& people,
                                 std::vector<std::string>* warnings) {
    const std::string found = std::to_string(people.size());
    check_value(motions.bodies.empty() || !motions.files.empty(), folder.string(),
                "its own poses are of its own rig; for another body give a motion of that body for each of the " +
                    found + " people, or leave the body out");
    if (motions.files.empty()) return;
    check_size(folder.string(), "the list of motions", motions.files.size(), people.size(),
               "photographs are used whole, so that each person in them needs a motion");
    check_value(motions.bodies.size() <= 1 || motions.bodies.size() == motions.files.size(), folder.string(),
                "there are " + std::to_string(motions.bodies.size()) + " body models for " + found +
                    " people; give one for all, or one each");
    for (std::size_t p = 0; p < people.size(); ++p) {
        const auto file = folder / motions.files[p]; // an absolute path replaces the folder
        const BodyModel& body =
            motions.bodies.empty() ? rig.body : motions.bodies[std::min(p, motions.bodies.size() - 1)];
        Motion motion = load_motion_for_gala(file, body, motions.bodies.empty(), options, warnings);
        check_size(file.string(), "poses", motion.frame_count(), people[p].frame_count(),
                   "one for each frame of the split");
        motion.timestamps = people[p].timestamps;
        people[p] = std::move(motion);
    }
}

} // namespace detail

template <HostExecutor E>
GalaScene load_gala_scene(E& executor, const std::filesystem::path& folder, const CaptureOptions& options,
                          std::vector<std::string>* warnings) {
    return load_gala_scene(executor, folder, GalaMotions(), options, warnings);
}

template <HostExecutor E>
GalaScene load_gala_scene(E& executor, const std::filesystem::path& folder, const GalaMotions& motions,
                          const CaptureOptions& options, std::vector<std::string>* warnings) {
    GalaScene scene;
    Capture& capture = scene.capture;
    const auto place = full_path(folder);
    capture.name = place.filename().string();
    const auto model = options.model.empty() ? place.parent_path() / "model" : options.model;
    if (std::error_code ignored; !std::filesystem::exists(model / "mesh.txt", ignored))
        throw IoError((model / "mesh.txt").string() +
                      ": is missing; GalaBasketball keeps its rig in the folder 'model' beside the scenes");
    scene.rig = load_gala_rig(model, warnings);

    // Cameras and frames.
    for (const auto& file : detail::list_numbered(folder / "camera", ".txt")) {
        NamedCamera camera;
        camera.name = file.path.stem().string();
        camera.camera = detail::read_gala_camera(file.path);
        capture.cameras.push_back(camera);
    }
    if (capture.cameras.empty()) throw IoError((folder / "camera").string() + ": holds no camera files NUMBER.txt");
    std::set<std::string> test_names(options.test_cameras.begin(), options.test_cameras.end());
    const auto is_called = [](const std::string& name) {
        return [&name](const NamedCamera& camera) { return camera.name == name; };
    };
    for (const std::string& name : test_names)
        if (std::none_of(capture.cameras.begin(), capture.cameras.end(), is_called(name)))
            throw IoError((folder / "camera").string() + ": there is no camera '" + detail::shortened(name) +
                          "' to judge by");
    if (test_names.empty() && capture.cameras.size() > 1) {
        const std::string usual = "6";
        const bool there = std::any_of(capture.cameras.begin(), capture.cameras.end(), is_called(usual));
        test_names.insert(there ? usual : capture.cameras.back().name);
    }
    for (NamedCamera& camera : capture.cameras)
        if (test_names.count(camera.name)) camera.role = NamedCamera::Role::test;

    detail::GalaSplit split{options.train_frames, options.test_frames};
    if (!split.train && !split.test) split = detail::known_gala_split(capture.name);
    std::vector<int> poses;
    for (const auto& file : detail::list_numbered(folder / "pose", ".txt"))
        poses.push_back(static_cast<int>(file.number));
    if (poses.empty()) throw IoError((folder / "pose").string() + ": holds no poses NUMBER.txt");
    if (!split.train) split.train = FrameRange{poses.front(), poses.back(), 1};
    if (!split.test) split.test = split.train;
    std::set<int> wanted;
    for (const auto& range : {*split.train, *split.test}) {
        detail::check_range(range, folder.string());
        for (int frame = range.first; frame <= range.last; frame += range.step) {
            if (!std::binary_search(poses.begin(), poses.end(), frame))
                throw IoError((folder / "pose").string() + ": the pose of frame " + std::to_string(frame) +
                              " is missing, of the frames " + std::to_string(range.first) + " to " +
                              std::to_string(range.last) + " by " + std::to_string(range.step));
            wanted.insert(frame);
        }
    }
    const std::vector<int> frames(wanted.begin(), wanted.end());
    scene.people = load_gala_motions(folder / "pose", scene.rig, frames);
    check_value(options.person >= 0 && static_cast<std::size_t>(options.person) < scene.people.size(), folder.string(),
                "there is no person " + std::to_string(options.person) + ", the poses hold " +
                    std::to_string(scene.people.size()));
    const auto person = static_cast<std::size_t>(options.person);
    detail::replace_gala_motions(folder, motions, scene.rig, options, scene.people, warnings);
    Motion& motion = scene.people[person];
    if (motions.files.empty() && options.poses != CaptureOptions().poses) {
        const auto named = folder / options.poses;
        motion = detail::load_motion_for_gala(named, scene.rig.body, true, options, warnings);
        check_size(named.string(), "poses", motion.frame_count(), frames.size(), "one for each frame of the split");
    }
    capture.motion = motion;

    // Images.
    const int factor = std::max(1, options.downscale);
    std::vector<NamedCamera> full = capture.cameras;
    for (NamedCamera& camera : capture.cameras) camera.camera = detail::shrink(camera.camera, factor, folder.string());
    const std::size_t C = capture.cameras.size(), F = frames.size();
    capture.images.resize(C * F);
    capture.image_names.resize(C * F);
    std::vector<std::map<long, std::filesystem::path>> files(C);
    for (std::size_t c = 0; c < C; ++c)
        for (const auto& file : detail::list_numbered(folder / full[c].name, ".png")) files[c][file.number] = file.path;
    capture.backgrounds.resize(C);
    detail::load_all(executor, C * (F + 1), [&](std::size_t i) { // backgrounds come first
        const std::size_t c = i < C ? i : (i - C) / F;
        std::filesystem::path path = folder / "bg" / (full[c].name + ".png");
        PixelImage* image = &capture.backgrounds[c];
        if (i >= C) {
            const int frame = frames[(i - C) % F];
            if (!(full[c].role == NamedCamera::Role::test ? *split.test : *split.train).contains(frame)) return;
            const auto file = files[c].find(frame);
            if (file == files[c].end()) return; // not taken
            path = file->second;
            capture.image_names[i - C] = path.stem().string();
            image = &capture.images[i - C];
        }
        *image = detail::read_camera_image(path, full[c]).image;
        for (std::size_t n = 3; n < image->data.size(); n += 4) image->data[n] = 255; // photographs are used as a whole
        *image = detail::shrink(*image, factor);
    });
    check_value(!capture.views(false).empty(), folder.string(),
                "no view is left for training; name another test camera");
    std::vector<std::string> missing;
    for (std::size_t i = 0; i < C * F; ++i) {
        const bool test = full[i / F].role == NamedCamera::Role::test;
        if (capture.images[i].data.empty() && (test ? *split.test : *split.train).contains(frames[i % F]))
            missing.push_back("camera '" + full[i / F].name + "' frame " + std::to_string(frames[i % F]));
    }
    if (!missing.empty() && warnings)
        warnings->push_back(folder.string() + ": " + std::to_string(missing.size()) +
                            " photographs are missing and are left out: " +
                            detail::listing(missing.size(), 6, [&](std::size_t k) { return missing[k]; }));
    const BodyModel& body =
        motions.bodies.empty() ? scene.rig.body : motions.bodies[std::min(person, motions.bodies.size() - 1)];
    detail::finish_capture(capture, body, options, folder, warnings);
    return scene;
}

} // namespace gsh
