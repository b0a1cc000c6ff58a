// SPDX-License-Identifier: Apache-2.0
/// @file  Loads PeopleSnapshot as preprocessed by InstantAvatar, and other videos in the same layout.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/capture/capture_data.hpp>
#include <gsh/io/capture/capture_images.hpp>
#include <gsh/io/capture/capture_photos.hpp>
#include <gsh/io/capture/frame_files.hpp>
#include <gsh/io/file/folder_list.hpp>
#include <gsh/io/file/full_path.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/json_file.hpp>
#include <gsh/io/file/npy.hpp>
#include <gsh/io/file/npz.hpp>
#include <gsh/io/motion/any_motion.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/io/motion/people_snapshot_poses.hpp>
#include <gsh/io/motion/smplifyx_file.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh {

/// Loads a person who turns in front of one camera.
///
///     FOLDER/cameras.npz               intrinsic [3, 3], extrinsic [4, 4] (world to camera), height, width
///     FOLDER/images/*.png              frame n is the n-th in the order of the names (image_0000.png, …)
///     FOLDER/masks/*.npy or *.png      [height, width], 0 or 1 (or 0 to 255), one per image; some may be missing, if
///                                      the names end in numbers
///     FOLDER/poses/anim_nerf_train.npz, …_test.npz
///                                      betas, global_orient, body_pose [n, 69], transl: frames of the split only;
///                                      or poses/train.npz, poses/test.npz
///     FOLDER/poses.npz                 or, for all frames, betas, thetas [F, 72], transl; or poses_optimized.npz
///     FOLDER/smplx.npz                 SMPL-X fits (io/motion/smplifyx_file.hpp), used instead for a body of 55 joints
///
/// The capture holds only the frames of the split, ordered by number. The split comes from options.train_frames and
/// test_frames, or from FOLDER/split.json, {"train": [first, last, step], "test": […]}. For the four subjects
/// (male-3-casual, …), identified by the folder's name, the published split is used. Otherwise the last fifth of the
/// video is the test set. options.poses names other poses, for all frames or for those of the split.
///
/// Frame   the camera's; the principal point is kept. options.downscale 0 halves images above 800 pixels (1080 to 540).
/// Units   the layout's pixel coordinates have their origin at the centre of the first pixel of the reduced image, as
///         used when its poses were fitted. Half a pixel is therefore added to the principal point. timestamps are
///         frame / 30.
/// Errors  those of load_capture.
template <HostExecutor E>
[[nodiscard]] Capture load_people_snapshot(E& executor, const std::filesystem::path& folder, const BodyModel& body,
                                           const CaptureOptions& options = {},
                                           std::vector<std::string>* warnings = nullptr);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

struct SnapshotSplit {
    std::optional<FrameRange> train, test;
};

/// The split of published results for a subject's name.
inline SnapshotSplit known_split(std::string_view subject) {
    struct Row {
        std::string_view subject;
        FrameRange train, test;
    };
    constexpr Row rows[] = {{"male-3-casual", {0, 455, 4}, {456, 675, 4}},
                            {"male-4-casual", {0, 659, 6}, {660, 872, 6}},
                            {"female-3-casual", {0, 445, 4}, {446, 647, 4}},
                            {"female-4-casual", {0, 335, 4}, {335, 523, 4}}};
    for (const Row& row : rows)
        if (row.subject == subject) return {row.train, row.test};
    return {};
}

inline SnapshotSplit read_split(const InputFile& input) {
    const OwnedJson owned(read_json(input));
    const Json& json = *owned;
    const JsonObject object(json, input.name());
    const auto range = [&](const char* field) {
        const std::vector<int> numbers = object.integers(field);
        if (numbers.size() != 3)
            throw ShapeError(input.name() + ": " + field + " has " + std::to_string(numbers.size()) +
                             " numbers, expected first, last, step");
        const FrameRange result{numbers[0], numbers[1], numbers[2]};
        check_range(result, input.name() + ": " + field);
        return result;
    };
    SnapshotSplit split;
    split.train = range("train");
    if (object.has("test")) split.test = range("test");
    return split;
}

/// Files of a folder with one of two extensions, in the order of their names; the first extension found is used.
inline std::vector<std::filesystem::path> list_masks(const std::filesystem::path& folder) {
    std::vector<std::filesystem::path> files;
    for (const auto& path : list_folder(folder, "a folder of masks"))
        if (path.extension() == ".npy") files.push_back(path);
    return files.empty() ? list_images(folder) : files;
}

/// The camera of cameras.npz at full size, with pixel coordinates counted from the image's corner.
inline Camera<double> read_snapshot_camera(const InputFile& input) {
    const NpzReader file(input);
    const auto K = file.read<double>("intrinsic", {3, 3}, Numbers::any),
               E = file.read<double>("extrinsic", {4, 4}, Numbers::any);
    const auto size = [&](const char* key) {
        const double value = file.read_number<double>(key, Numbers::any);
        check_value(value >= 1 && value <= 65535 && value == std::floor(value), file.name_of(key),
                    "is " + number_text(value) + ", expected a number of pixels");
        return static_cast<int>(value);
    };
    const mat3<double> R(vec3<double>(E[0], E[4], E[8]), vec3<double>(E[1], E[5], E[9]),
                         vec3<double>(E[2], E[6], E[10]));
    return camera_from_K<double>(K.data, R, vec3<double>(E[3], E[7], E[11]), size("width"), size("height"),
                                 input.name());
}

/// Motion of fits (io/motion/smplifyx_file.hpp, or any input of load_any_motion) for these frames of a video with
/// `images` frames. `camera` is replaced by the fits' camera if the file contains one.
inline Motion snapshot_fits(const std::filesystem::path& path, const BodyModel& body,
                            const std::vector<SnapshotFrame>& frames, std::size_t images,
                            MotionFileOptions::Hands hands, Camera<double>& camera,
                            std::vector<std::string>* warnings) {
    const MotionFileOptions options{hands, 30};
    SmplifyxFits fits;
    const auto layout = recognise_motion(path);
    const auto file = motion_file_of(path);
    if (layout == MotionLayout::smplifyx || (layout == MotionLayout::gsh && !NpzReader(file).has_array("poses")))
        fits = load_smplifyx_fits(file, body, options, warnings);
    else
        fits.motion = load_any_motion(path, body, options, warnings);
    const std::size_t T = fits.motion.frame_count();
    if (layout == MotionLayout::smplx_json && T != images && T != frames.size()) // use the files' numbers
        for (const double time : fits.motion.timestamps)
            fits.frame_ids.push_back(static_cast<int>(std::lround(time * options.fps)));
    if (fits.frame_ids.empty() && T != images && T != frames.size())
        throw ShapeError(path.string() + ": holds " + std::to_string(T) + " poses, expected " + std::to_string(images) +
                         ", one per image, or " + std::to_string(frames.size()) +
                         ", one per frame of the split; else store frame_ids");
    std::map<int, std::size_t> row_of; // by the frame's number; the first row of a number counts
    for (std::size_t row = 0; row < fits.frame_ids.size(); ++row) row_of.try_emplace(fits.frame_ids[row], row);
    Motion motion;
    motion.joint_count = fits.motion.joint_count, motion.expression_count = fits.motion.expression_count;
    motion.betas = fits.motion.betas;
    for (std::size_t i = 0; i < frames.size(); ++i) {
        std::size_t row = T == images ? static_cast<std::size_t>(frames[i].number) : i;
        if (!fits.frame_ids.empty()) {
            const auto found = row_of.find(frames[i].number);
            if (found == row_of.end())
                throw IoError(path.string() + ": frame_ids lacks frame " + std::to_string(frames[i].number));
            row = found->second;
        }
        const auto pose = fits.motion.pose_at(row);
        const auto expression = fits.motion.expression_at(row);
        motion.pose.insert(motion.pose.end(), pose.begin(), pose.end());
        motion.expression.insert(motion.expression.end(), expression.begin(), expression.end());
        motion.transl.push_back(fits.motion.transl[row]);
        motion.timestamps.push_back(frames[i].number / 30.0);
    }
    if (fits.has_camera()) camera = fits.camera(camera.width, camera.height);
    camera.R = mat3<double>(1.0), camera.t = vec3<double>(0); // the fits are in the camera's frame
    return motion;
}

} // namespace detail

template <HostExecutor E>
Capture load_people_snapshot(E& executor, const std::filesystem::path& folder, const BodyModel& body,
                             const CaptureOptions& options, std::vector<std::string>* warnings) {
    const auto warn = [&](const std::string& text) {
        if (warnings) warnings->push_back(text);
    };
    std::error_code ignored;
    Capture capture;
    capture.name = full_path(folder).filename().string();
    NamedCamera named;
    named.name = "camera";
    named.camera = detail::read_snapshot_camera(folder / "cameras.npz");
    const std::vector<std::filesystem::path> folders{folder / "images", folder / "masks"};
    auto listed = detail::list_images(folders[0]);
    if (listed.empty()) throw IoError(folders[0].string() + ": holds no images");
    const auto rows = detail::assign_frames({std::move(listed), detail::list_masks(folders[1])}, folders, 0,
                                            "as many masks as images")
                          .rows;
    const auto &images = rows[0], &masks = rows[1];
    const int count = static_cast<int>(images.size());

    // Select the frames.
    detail::SnapshotSplit split{options.train_frames, options.test_frames};
    const auto split_file = folder / "split.json";
    if (!split.train && !split.test)
        split = std::filesystem::exists(split_file, ignored) ? detail::read_split(split_file)
                                                             : detail::known_split(capture.name);
    if (!split.train) {
        const int border = std::max(1, count * 4 / 5), step = std::max(1, count / 150);
        split.train = FrameRange{0, border - 1, step};
        if (!split.test && border < count) split.test = FrameRange{border, count - 1, step};
        warn(folder.string() + ": no split is known for '" + capture.name + "': frames 0 to " +
             std::to_string(border - 1) + " by " + std::to_string(step) +
             " are for training, the others for tests; write split.json to choose other frames");
    }
    std::vector<detail::SnapshotFrame> frames;
    for (const bool test : {false, true})
        if (const auto& range = test ? split.test : split.train) {
            detail::check_range(*range, folder.string());
            for (int frame = range->first; frame <= std::min(range->last, count - 1); frame += range->step) {
                check_value(!test || !split.train->contains(frame), folder.string(),
                            "frame " + std::to_string(frame) + " is in the training split and in the test split");
                frames.push_back({frame, test});
            }
        }
    check_value(!frames.empty() && !frames[0].test, folder.string(), "no frame is left for training");
    std::sort(frames.begin(), frames.end(), [](const auto& a, const auto& b) { return a.number < b.number; });

    const int longest = std::max(named.camera.width, named.camera.height);
    const bool even = named.camera.width % 2 == 0 && named.camera.height % 2 == 0;
    const int factor = options.downscale > 0 ? options.downscale : longest > 800 && even ? 2 : 1;

    // Load their poses.
    const bool named_fits = options.poses != "poses.npz";
    const auto fits = named_fits ? folder / options.poses : folder / "smplx.npz";
    named.camera.cx += 0.5 * factor, named.camera.cy += 0.5 * factor;
    if (named_fits || (body.joint_count() == 55 && std::filesystem::exists(fits, ignored))) {
        capture.motion =
            detail::snapshot_fits(fits, body, frames, images.size(), options.hands, named.camera, warnings);
    } else {
        capture.motion = detail::snapshot_motion(folder, body, frames, images.size(), options.hands, warnings);
    }

    // Load their images.
    capture.cameras.push_back(named);
    detail::PhotoFiles chosen;
    for (std::size_t i = 0; i < frames.size(); ++i) {
        if (frames[i].test) capture.test_frames.push_back(static_cast<int>(i));
        chosen.images.push_back(images[static_cast<std::size_t>(frames[i].number)]);
        chosen.masks.push_back(masks[static_cast<std::size_t>(frames[i].number)]);
    }
    detail::load_photos(executor, std::move(chosen), factor, options, folder, capture, warnings);
    detail::finish_capture(capture, body, options, folder, warnings);
    return capture;
}

} // namespace gsh
