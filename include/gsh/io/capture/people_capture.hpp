// SPDX-License-Identifier: Apache-2.0
/// @file  Captures with several people, each with a name, poses and optional masks.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/image.hpp>
#include <gsh/io/capture/any_capture.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/capture/capture.hpp>
#include <gsh/io/capture/capture_person.hpp>
#include <gsh/io/file/folder_list.hpp>
#include <gsh/io/file/full_path.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/motion/any_motion.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh {

/// A capture with all its people.
struct PeopleCapture {
    AnyCapture any; ///< its motion is that of the first person, or of CaptureOptions::person
    std::vector<CapturePerson> people;
};

/// Names of people derived from pose files: the files' names without extension, or the names of folders. Duplicates get
/// a number, "poses-2".
///
/// Errors  ValueError for a file that is given twice.
[[nodiscard]] inline std::vector<std::string> person_names(const std::vector<std::filesystem::path>& poses);

/// Loads a capture with one or several people. In our own layout there is one pose file or folder per person, relative
/// to the capture or absolute, in any layout of load_any_motion. A layout with several people supplies all of them.
/// `bodies` is one model for all people or one per pose file; none if the layout contains its own. GalaBasketball
/// accepts pose files, too, one for each of its people: motions of `bodies`, or of its own rig without them. With
/// several people, FOLDER/person_masks/NAME/CAMERA/FRAME.png marks each person's pixels in white (or opaque). These
/// masks are optional for each person and camera, and there must be as many as the camera has images.
///
/// Errors    those of load_any_capture; ShapeError for poses whose number of frames differs from the first one's;
///           ValueError for numbers of bodies and poses that do not match, a name given twice, or several pose files in
///           a layout that does not accept them; IoError for masks of an unknown person or camera.
/// Warnings  capture_warnings for each person, with the name first if there are several.
template <HostExecutor E>
[[nodiscard]] PeopleCapture
load_people_capture(E& executor, const std::filesystem::path& folder, Span<const BodyModel> bodies,
                    const std::vector<std::filesystem::path>& poses, CaptureOptions options = {},
                    std::vector<std::string>* warnings = nullptr);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Masks of one person in the views for evaluation, undistorted as the photographs are; empty without a folder.
template <HostExecutor E>
std::vector<Image<std::uint8_t>> load_person_masks(E& executor, const std::filesystem::path& folder,
                                                   const Capture& capture, const std::vector<NamedCamera>& cameras,
                                                   const std::filesystem::path& poses) {
    std::error_code ignored;
    if (!std::filesystem::is_directory(folder, ignored)) return {};
    const std::size_t frames = capture.frame_count();
    for (const auto& path : list_folder(folder)) {
        const std::string name = path.filename().string();
        if (std::filesystem::is_directory(path, ignored) &&
            std::none_of(capture.cameras.begin(), capture.cameras.end(),
                         [&](const NamedCamera& camera) { return camera.name == name; }))
            throw IoError(path.string() + ": there is no camera '" + name + "' in cameras.json");
    }
    std::vector<std::vector<std::filesystem::path>> files(capture.cameras.size());
    for (std::size_t c = 0; c < files.size(); ++c)
        if (const auto place = folder / capture.cameras[c].name; std::filesystem::is_directory(place, ignored))
            files[c] =
                assign_frames({list_images(place)}, {place}, frames, "one per pose of " + poses.string()).rows[0];
    const auto has_mask = [&](std::size_t c, std::size_t f) { return !files[c].empty() && !files[c][f].empty(); };
    std::vector<Image<std::uint8_t>> masks(capture.cameras.size() * frames);
    const std::vector<CaptureView> views = capture.views(true);
    std::vector<StoredMask> stored(views.size());
    load_all(executor, views.size(), [&](std::size_t i) {
        const auto [c, f] = views[i];
        if (has_mask(c, f)) stored[i] = read_mask(files[c][f]);
    });
    std::vector<MaskMeaning> meanings(files.size(), MaskMeaning::soft);
    for (std::size_t c = 0; c < files.size(); ++c) {
        MaskLevels all;
        bool plain = false;
        for (std::size_t i = 0; i < views.size(); ++i) {
            if (views[i].camera != c) continue;
            all.add(stored[i].levels);
            plain = plain || (stored[i].levels.plain() && !stored[i].levels.unit);
        }
        meanings[c] = mask_meaning((folder / capture.cameras[c].name).string(), all, plain);
    }
    load_all(executor, views.size(), [&](std::size_t i) {
        const auto [c, f] = views[i];
        if (!has_mask(c, f)) return;
        const NamedCamera& camera = cameras[c];
        CameraImage photo; // the mask's own size and orientation must be the camera's
        photo.image = PixelImage(4, camera.camera.height, camera.camera.width);
        const PixelImage file = fitted_mask(files[c][f], stored[i], photo, ", as camera '" + camera.name + "' says");
        PixelImage alpha(4, file.height, file.width);
        set_alpha(file, alpha, meanings[c]);
        if (camera.distortion) alpha = straighten(alpha, camera);
        Image<std::uint8_t>& mask = masks[c * frames + f] = Image<std::uint8_t>(1, file.height, file.width);
        for (std::size_t p = 0; p < mask.data.size(); ++p) mask.data[p] = alpha.data[4 * p + 3] > 127;
    });
    return masks;
}

} // namespace detail

inline std::vector<std::string> person_names(const std::vector<std::filesystem::path>& poses) {
    std::vector<std::string> names;
    for (std::size_t i = 0; i < poses.size(); ++i) {
        for (std::size_t k = 0; k < i; ++k)
            check_value(full_path(poses[k]) != full_path(poses[i]), poses[i].string(),
                        "is named twice; each person needs a pose file of their own");
        const auto path = poses[i].has_filename() ? poses[i] : poses[i].parent_path(); // "folder/"
        std::error_code ignored;
        const bool folder = std::filesystem::is_directory(path, ignored);
        const std::string stem = (folder ? path.filename() : path.stem()).string();
        std::string name = stem;
        for (int number = 2; std::find(names.begin(), names.end(), name) != names.end(); ++number)
            name = stem + "-" + std::to_string(number);
        names.push_back(name);
    }
    return names;
}

template <HostExecutor E>
PeopleCapture load_people_capture(E& executor, const std::filesystem::path& folder, Span<const BodyModel> bodies,
                                  const std::vector<std::filesystem::path>& poses, CaptureOptions options,
                                  std::vector<std::string>* warnings) {
    check_value(bodies.size() <= 1 || bodies.size() == poses.size(), folder.string(),
                "there are " + std::to_string(bodies.size()) + " body models for " + std::to_string(poses.size()) +
                    " people (pose files); give one for all, or one each");
    PeopleCapture result;
    std::vector<std::filesystem::path> files;
    for (const auto& file : poses) files.push_back(folder / file); // an absolute path replaces the folder
    const std::vector<std::string> names = person_names(files);
    const auto layout = recognise_capture(folder).value_or(CaptureLayout::gsh);
    check_value(poses.size() <= 1 || layout == CaptureLayout::gsh || layout == CaptureLayout::gala, folder.string(),
                "only captures in our own layout and GalaBasketball's take several pose files; see docs/captures.md");
    check_value(!(options.input_fps > 0) || layout == CaptureLayout::gsh || layout == CaptureLayout::easymocap,
                folder.string(), "has the rate of its data set, 30 frames per second; leave out --input-fps");
    if (!poses.empty()) options.poses = poses.front().string();
    if (poses.size() > 1) options.person = 0; // it refers to one file, not to the list of files
    std::vector<std::string> of_first;
    const bool replaced = layout == CaptureLayout::gala && (!bodies.empty() || poses.size() > 1);
    if (replaced) {
        GalaMotions motions{bodies, files};
        std::error_code ignored; // the usual name, which is not there, names nothing
        if (poses.size() == 1 && poses[0] == CaptureOptions().poses && !std::filesystem::exists(files[0], ignored))
            motions.files.clear();
        GalaScene scene = load_gala_scene(executor, folder, motions, options, &of_first);
        result.any = {layout, std::move(scene.capture), std::move(scene.people), {}};
        if (bodies.empty()) result.any.rig = std::move(scene.rig);
    } else {
        result.any = load_any_capture(executor, folder, bodies.empty() ? nullptr : &bodies[0], options, &of_first);
    }
    const Capture& capture = result.any.capture;
    if (replaced) {
        for (std::size_t p = 0; p < files.size(); ++p)
            result.people.push_back({names[p], bodies.size() > 1 ? p : 0, result.any.people[p]});
    } else if (result.any.people.size() > 1) { // the layout contains several people
        for (std::size_t p = 0; p < result.any.people.size(); ++p)
            result.people.push_back({"person-" + std::to_string(p), 0, result.any.people[p]});
    } else {
        result.people.push_back({names.empty() ? "person" : names.front(), 0, capture.motion});
        for (std::size_t p = 1; p < poses.size(); ++p) {
            const std::size_t body = bodies.size() > 1 ? p : 0;
            MotionFileOptions motion_options{options.hands, capture.fps};
            motion_options.input_fps = options.input_fps;
            Motion motion = load_any_motion(files[p], bodies[body], motion_options, warnings);
            check_size(files[p].string(), "poses", motion.frame_count(), capture.frame_count(),
                       "every person needs a pose for each of the capture's frames, as in " + files[0].string());
            result.people.push_back({names[p], body, std::move(motion)});
        }
    }
    const bool several = result.people.size() > 1;
    if (warnings) {
        const std::size_t first = result.any.people.size() > 1 ? static_cast<std::size_t>(options.person) : 0;
        for (const std::string& text : of_first)
            warnings->push_back((several ? result.people[first].name + ": " : "") + text);
        for (std::size_t p = 0; p < result.people.size(); ++p) {
            if (p == first) continue;
            const CapturePerson& person = result.people[p];
            const BodyModel& body = result.any.rig ? result.any.rig->body : bodies[person.body];
            for (const std::string& text : capture_warnings(capture, body, person.motion))
                warnings->push_back(person.name + ": " + folder.string() + ": " + text);
        }
    }
    const auto place = folder / "person_masks";
    std::error_code ignored;
    if (!several || !std::filesystem::is_directory(place, ignored)) return result;
    for (const auto& path : list_folder(place)) {
        const auto called = [&](const CapturePerson& person) { return person.name == path.filename().string(); };
        if (!std::filesystem::is_directory(path, ignored) ||
            std::any_of(result.people.begin(), result.people.end(), called))
            continue;
        throw IoError(path.string() + ": there is no such person; the people are " +
                      detail::listing(result.people.size(), 8,
                                      [&](std::size_t i) { return detail::shortened(result.people[i].name); }));
    }
    const bool ours = result.any.layout == CaptureLayout::gsh; // the capture's cameras have lost their distortion
    const auto cameras = ours ? read_cameras(folder / "cameras.json").cameras : capture.cameras;
    for (std::size_t p = 0; p < result.people.size(); ++p)
        result.people[p].masks =
            detail::load_person_masks(executor, place / result.people[p].name, capture, cameras,
                                      files.empty() ? folder : files[std::min(p, files.size() - 1)]);
    return result;
}

} // namespace gsh
